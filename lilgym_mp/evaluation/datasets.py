"""Data sets of played episodes for offline learning: from agents or recordings, in one form for all file formats.

docs/datasets.md lists the fields. Minari and pyarrow are imported only when their files are written.
"""

# pyarrow and Minari are extras.
# pyright: reportMissingImports=false

from __future__ import annotations

import base64
import gzip
import io
import json
import os
import sqlite3
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from PIL import Image

from lilgym_mp.corpus import NoTasksError
from lilgym_mp.corpus.extras import install
from lilgym_mp.corpus.records import shown
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.masks import action_masks
from lilgym_mp.envs.observation import ARRAYS, TEXT, item_capacity
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.files import SUFFIX, write_atomically
from lilgym_mp.evaluation.runs import play_steps
from lilgym_mp.scene.arrays import AnyDict, AnyMapping
from lilgym_mp.scene.choices import choose, listed
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import StructuredObservation, TextObservation

IMAGE = "image"
STRUCTURED = "structured"
TOKENS = "tokens"
FORMS = (IMAGE, STRUCTURED, TEXT, TOKENS)  # of observations
EVALUATION_SPLIT = "dev"  # of the environment for evaluation that a Minari data set names
DECIMALS = 6  # of returns, which sums of rewards have not exactly
SQLITE_MAGIC = b"SQLite format 3\0"

GymEnv = gym.Env[Any, Any]


class DatasetError(ValueError):
    """Episodes that cannot become one data set, or a file that has none."""


class Source(NamedTuple):
    """Episodes to be written, of one environment and agent."""

    settings: EnvConfig
    split: str
    agent: str  # name of the agent or player
    episodes: Sequence[Episode]


class Rollout(NamedTuple):
    """An episode of T actions with its observations."""

    episode: AnyMapping  # fields with a value for the episode
    steps: AnyMapping  # fields with a value for each of the T actions, as arrays or lists
    observations: Sequence[Any]  # T + 1, in the environment's own form


# Sources


def recorded(paths: Iterable[Path]) -> Iterator[Source]:
    """The episodes of recordings (files, or all within directories) and of databases of the web server.

    Raises EpisodesError or DatasetError naming the file.
    """
    for path in paths:
        files = sorted(path.rglob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not files:
            raise DatasetError(f"{path}: has no recordings, whose names end in {SUFFIX}")
        for file in files:
            yield from _played_in_browsers(file) if is_database(file) else [_recording(file)]


def is_database(file: Path) -> bool:
    """Whether it is an SQLite file, such as the database of the web server."""
    with file.open("rb") as opened:
        return opened.read(len(SQLITE_MAGIC)) == SQLITE_MAGIC


def _recording(file: Path) -> Source:
    recording = read_episodes(file)
    header = recording.header
    tasks = header.settings.tasks(header.split)
    if header.tasks_sha256 != tasks.provenance.sha256:
        raise DatasetError(f"{file}: was recorded with other tasks than those of {tasks.provenance}")
    return Source(header.settings, header.split, header.agent, recording.episodes)


def _played_in_browsers(file: Path) -> Iterator[Source]:
    """The finished episodes of the page /play."""
    columns = "corpus, configuration, rules, split, player, task_id, outcome, actions"
    try:
        with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as connection:
            known = {row[1] for row in connection.execute("PRAGMA table_info(played_episodes)")}
            columns += ", statement" if "statement" in known else ", NULL"  # an older database
            query = f"SELECT {columns} FROM played_episodes WHERE outcome IS NOT NULL ORDER BY created, id"
            rows = connection.execute(query).fetchall()
    except sqlite3.Error as error:
        raise DatasetError(f"{file}: has no played episodes that can be read: {error}") from None
    for corpus, configuration, rules, split, player, task_id, outcome, actions, statement in rows:
        settings = EnvConfig(configuration, corpus=corpus, rules=rules)
        dynamics = settings.dynamics()
        played = list(map(dynamics.appearance.decode, json.loads(actions)))
        task = settings.tasks(split).by_id(task_id)
        if statement not in (None, task.statement):
            raise DatasetError(
                f"{file}: the statement of task {task.id} was {shown(statement)} when it was played,"
                f" and is {shown(task.statement)} in corpus {settings.corpus!r}"
            )
        episode = Episode.of(task, played, outcome, dynamics, tags=task.tags)
        yield Source(settings, split, player or "player", [episode])


# Rollouts


def common_settings(sources: Sequence[Source]) -> EnvConfig:
    """The settings of all sources, at least one. Raises DatasetError if they differ."""
    first, *others = dict.fromkeys(source.settings for source in sources)
    if others:
        names = {settings.configuration for settings in (first, *others)}
        raise DatasetError(
            f"episodes of {listed(names)} cannot be one data set; choose with --configuration"
            if len(names) > 1
            else f"episodes of {first} and {others[0]} cannot be one data set; convert them one by one"
        )
    return first


def environments(settings: EnvConfig, splits: Sequence[str], form: str) -> dict[str, GymEnv]:
    """Environments by split, of `splits` and dev if it has tasks; their observations are in one of FORMS and one space.

    Raises ValueError for another form.
    """
    observation = choose("observation", form, {IMAGE: TEXT, TEXT: TEXT, STRUCTURED: ARRAYS, TOKENS: ARRAYS})
    envs: dict[str, GymEnv] = {}
    for split in dict.fromkeys((*splits, EVALUATION_SPLIT)):
        try:
            envs[split] = gym.make(settings.id, observation=observation, **settings.arguments(split))
        except NoTasksError:
            if split in splits:
                raise
    if form == TEXT:
        return {split: TextObservation(env) for split, env in envs.items()}
    if form == STRUCTURED:
        slots = max(item_capacity(env.get_wrapper_attr("tasks"), settings.dynamics()) for env in envs.values())
        return {split: StructuredObservation(env, slots=slots) for split, env in envs.items()}
    return envs


def rollouts(
    sources: Sequence[Source],
    envs: Mapping[str, GymEnv],
    on_episode: Callable[[], object] = lambda: None,
    *,
    returns_to_go: bool = False,
    optimal: bool = False,
) -> Iterator[Rollout]:
    """The episodes, played again in the environment of their split, in order.

    `on_episode` is called after each. `returns_to_go`: adds "return_to_go", the sum of the rewards from an action on.
    `optimal`: adds "optimal", the expert's first actions of shortest solutions. Raises DatasetError for an episode that
    ends differently.
    """
    solver = Solver(sources[0].settings.dynamics()) if optimal else None
    for source in sources:
        for episode in source.episodes:
            yield _rollout(source, episode, envs[source.split], solver, returns_to_go=returns_to_go)
            on_episode()


def _rollout(source: Source, episode: Episode, env: GymEnv, solver: Solver | None, *, returns_to_go: bool) -> Rollout:
    base: Any = env.unwrapped
    actions = list(map(base.dynamics.appearance.encode, episode.actions))
    left = iter(actions)
    observations = []
    legal = []
    states = []

    def choose(observation: Any, info: AnyDict) -> int | None:
        observations.append(observation)
        legal.append(action_masks(env))
        states.append(base.state)
        return next(left, None)

    played = list(play_steps(env, env.reset(options={"task": episode.task}), choose))
    outcome = played[-1].info.get("outcome")
    if (outcome, len(played)) != (episode.outcome, len(actions)):
        raise DatasetError(
            f"the episode of {source.agent} on {episode.task} ended as {episode.outcome}, but as {outcome} when played"
            f" again, after {len(played)} of {len(actions)} actions"
        )
    observations.append(played[-1].observation)
    _, rewards, terminated, truncated, _ = zip(*played, strict=True)
    steps: AnyDict = {
        "action": np.array(actions, np.int64),
        "reward": np.array(rewards, np.float64),
        "terminated": np.array(terminated),
        "truncated": np.array(truncated) & ~np.array(terminated),  # unlike a last STOP of the release's rules
        "legal": np.stack(legal),
    }
    if returns_to_go:
        steps["return_to_go"] = np.cumsum(rewards[::-1])[::-1].round(DECIMALS)
    if solver is not None:
        steps["optimal"] = np.zeros_like(steps["legal"])
        for row, found in zip(steps["optimal"], map(solver.optimal_actions, states), strict=True):
            row[list(found.actions)] = True
    about: AnyDict = {name: getattr(episode, name) for name in ("task", "statement", "program", "target")}
    about |= {"split": source.split, "agent": source.agent, "outcome": episode.outcome}
    if isinstance(observations[0], str):
        return Rollout(about, {**steps, "text": observations[:-1]}, observations)
    if isinstance(observations[0]["statement"], np.ndarray):
        about["tokens"] = observations[0]["statement"]
    names = [name for name in observations[0] if name not in ("statement", "target")]
    seen = {name: np.stack([observation[name] for observation in observations[:-1]]) for name in names}
    return Rollout(about, {**steps, **seen}, observations)


# Files


def check_file(path: Path) -> None:
    """Raises DatasetError if no file of this name can be written."""
    if _suffix(path) not in WRITERS:
        raise DatasetError(f"a data set's file must end in {listed(WRITERS)}, unlike {str(path)!r}")
    if path.suffix == ".parquet" and find_spec("pyarrow") is None:
        raise DatasetError(f"a Parquet file needs pyarrow: {install('parquet')}")


def _suffix(path: Path) -> str:
    """The path's suffix, with the one before ".gz"."""
    return "".join(path.suffixes[-2:]) if path.suffix == ".gz" else path.suffix


def write_file(path: Path, played: Iterable[Rollout], about: AnyMapping) -> None:
    """Writes a file of the format that its suffix names, one of WRITERS. If writing fails, no file remains.

    `about` is stored as JSON in npz and Parquet. Equal rollouts, at least one, give equal bytes.
    """
    write_atomically(path, lambda unfinished: WRITERS[_suffix(path)](unfinished, played, about))


def _write_npz(path: Path, played: Iterable[Rollout], about: AnyMapping) -> None:
    parts = [(rollout.episode, rollout.steps) for rollout in played]
    episodes, steps = zip(*parts, strict=True)
    arrays: AnyDict = {name: np.array([one[name] for one in episodes]) for name in episodes[0]}
    arrays |= {name: np.concatenate([one[name] for one in steps]) for name in steps[0]}
    arrays["starts"] = np.cumsum([0, *(len(one["action"]) for one in steps)])  # (N + 1,)
    with path.open("wb") as file:
        np.savez_compressed(file, about=np.array(json.dumps(about, ensure_ascii=False, sort_keys=True)), **arrays)


def _write_json_lines(path: Path, played: Iterable[Rollout], about: AnyMapping) -> None:
    with path.open("wb") as raw, gzip.GzipFile("", "wb", fileobj=raw, mtime=0) if path.suffix == ".gz" else raw as file:
        for rollout in played:
            row = _row(rollout, lambda png: base64.b64encode(png).decode())
            file.write(json.dumps(row, ensure_ascii=False).encode() + b"\n")


def _write_parquet(path: Path, played: Iterable[Rollout], about: AnyMapping) -> None:
    import pyarrow
    import pyarrow.parquet

    rows = [_row(rollout, lambda png: {"bytes": png, "path": None}) for rollout in played]
    table = pyarrow.Table.from_pylist(rows)
    pyarrow.parquet.write_table(table.replace_schema_metadata({"about": json.dumps(about, sort_keys=True)}), path)


def _row(rollout: Rollout, encode: Callable[[bytes], Any]) -> AnyDict:
    """The fields as lists: sets of actions as indices, images as PNG files."""
    row: AnyDict = {}
    for name, value in {**rollout.episode, **rollout.steps}.items():
        if name in ("legal", "optimal"):
            row[name] = [np.flatnonzero(mask).tolist() for mask in value]
        elif name == IMAGE:
            row[name] = [encode(_png(image)) for image in value]
        else:
            row[name] = value.tolist() if isinstance(value, np.ndarray) else value
    return row


def _png(image: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(image).save(file, "PNG")
    return file.getvalue()


WRITERS: Mapping[str, Callable[[Path, Iterable[Rollout], AnyMapping], None]] = {
    ".npz": _write_npz,
    ".jsonl": _write_json_lines,
    ".jsonl.gz": _write_json_lines,
    ".parquet": _write_parquet,
}


# Minari


def check_minari(dataset_id: str) -> Path:
    """The directory that a data set of this name will have. Raises DatasetError if it cannot be written."""
    if find_spec("minari") is None:
        raise DatasetError(f"a Minari data set needs Minari: {install('minari')}")
    from minari.dataset.minari_dataset import parse_dataset_id
    from minari.storage import get_dataset_path

    try:
        parse_dataset_id(dataset_id)
    except (ValueError, TypeError):  # TypeError: it has no version
        raise DatasetError(
            f"{dataset_id!r} cannot name a Minari data set; its name is letters, digits, / and -, and a version, as in"
            " lilgym/tower-expert-v0"
        ) from None
    path: Path = get_dataset_path(dataset_id)
    if path.exists():
        raise DatasetError(f"the Minari data set {dataset_id!r} exists already; choose another name, or delete it")
    return path


def write_minari(
    dataset_id: str,
    played: Iterable[Rollout],
    env: GymEnv,
    eval_env: GymEnv,
    agent: str,
    about: AnyMapping,
) -> None:
    """Writes a data set to Minari's directory.

    The infos contain the fields of a file. `eval_env` is what `recover_environment(eval_env=True)` makes again. If
    writing fails, no files remain. Raises DatasetError as `check_minari` does.
    """
    path = check_minari(dataset_id)
    import minari
    from minari.storage import get_dataset_path

    variable = "MINARI_DATASETS_PATH"
    root = get_dataset_path()
    named = os.environ.get(variable)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=root) as unfinished, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about missing authors and links
        os.environ[variable] = unfinished
        try:
            minari.create_dataset_from_buffers(
                dataset_id,
                map(_buffer, played),
                env=env.spec,
                eval_env=eval_env.spec,
                observation_space=env.observation_space,
                action_space=env.action_space,
                algorithm_name=agent,
                description=", ".join(f"{name} {value}" for name, value in about.items() if value is not None),
                jpeg_encoding=False,
                data_format="hdf5",
            )
        finally:
            os.environ.pop(variable)
            os.environ |= {} if named is None else {variable: named}
        for file in Path(unfinished).rglob("namespace_metadata.json"):
            place = root / file.relative_to(unfinished)
            place.parent.mkdir(parents=True, exist_ok=True)
            file.replace(place)
        (Path(unfinished) / dataset_id).replace(path)


def _buffer(rollout: Rollout) -> Any:
    observed = rollout.observations
    steps = rollout.steps
    observations = observed if isinstance(observed[0], str) else {k: [one[k] for one in observed] for k in observed[0]}
    infos: AnyDict = {name: [rollout.episode[name]] * len(observed) for name in ("task", "program", "agent")}
    for name in {"legal", "optimal", "return_to_go"} & steps.keys():
        infos[name] = np.concatenate([steps[name], np.zeros_like(steps[name][:1])])
    from minari.data_collector import EpisodeBuffer

    return EpisodeBuffer(
        options={"task": rollout.episode["task"]},
        observations=observations,
        actions=steps["action"],
        rewards=steps["reward"],
        terminations=steps["terminated"],
        truncations=steps["truncated"],
        infos=infos,
    )
