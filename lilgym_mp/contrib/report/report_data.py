"""Loads the recordings for a report, checks that they are comparable, and groups them by agent."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, product
from pathlib import Path
from typing import Any

from lilgym_mp.contrib.report.charts import Looks
from lilgym_mp.contrib.report.games import Result, read_results
from lilgym_mp.contrib.report.played import TRANSCRIPTS, conversations, is_conversation_run, people
from lilgym_mp.corpus.records import shown
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.datasets import is_database
from lilgym_mp.evaluation.episode_files import Header, Recording, read_episodes
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.files import MAX_NUMBER, SUFFIX
from lilgym_mp.evaluation.recording_metadata import read_metadata
from lilgym_mp.learning.common.run_directory import EVALUATIONS_FILE, PROGRESS_FILE, RUN_FILE, begin_run
from lilgym_mp.learning.common.run_directory import shown as shown_setting
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, Strings
from lilgym_mp.scene.grouping import grouped

SHARED_SETTINGS = tuple(EnvConfig.settings())  # must be equal in all recordings of a report
EXPERT = "expert"
ACCURACIES = ("accuracy", "accuracy_with_image", "image_accuracy")  # keys of an evaluation


class ReportError(ValueError):
    """Recordings or directories that no report can be made from."""


@dataclass(frozen=True)
class AgentResults:
    """An agent's recordings in one configuration and split, one per run."""

    agent: str
    configuration: str
    split: str
    runs: tuple[Recording, ...]
    commits: Strings = ()  # of the code that played, as far as known

    @property
    def header(self) -> Header:
        """Header of the first run; runs of an agent differ in their seeds."""
        return self.runs[0].header

    def start_scenes(self, predicate: Callable[[Episode], bool]) -> int:
        """The number of start scenes whose episodes satisfy the predicate."""
        return sum(map(predicate, self.runs[0].episodes)) // self.header.passes


@dataclass(frozen=True)
class TrainingCurve:
    """Evaluations of a training run, and its recipe."""

    run: Path
    learner: str
    configuration: str  # "" for a run on all configurations
    evaluations: tuple[AnyDict, ...] = ()  # evaluations on dev during training
    recipe: AnyMapping = field(default_factory=AnyDict)


@dataclass(frozen=True)
class ReportData:
    """Everything that a report is made from."""

    entries: tuple[AgentResults, ...]
    curves: tuple[TrainingCurve, ...]
    games: tuple[Result, ...] = ()

    @property
    def header(self) -> Header:
        """Header of the first recording."""
        return self.entries[0].header

    @cached_property
    def agents(self) -> list[str]:
        """Trained agents first, the expert last."""
        names = dict.fromkeys(entry.agent for entry in self.entries)
        return sorted(names, key=lambda name: (name == EXPERT, name not in self.trained))

    @cached_property
    def trained(self) -> set[str]:
        """The agents with a training run."""
        return {entry.agent for entry in self.entries if entry.header.run is not None}

    @cached_property
    def looks(self) -> Looks:
        """The agents' colours in all charts."""
        looks = Looks()
        for agent in self.agents:
            looks[agent]
        return looks

    def agent_of(self, run: Path) -> str | None:
        """The agent of a training run; None if no episodes of it were recorded."""
        recorded = ((entry, each.header.run) for entry in self.entries for each in entry.runs)
        return next((entry.agent for entry, of in recorded if of and Path(of).resolve() == run.resolve()), None)

    @property
    def configurations(self) -> list[str]:
        """Names of the recorded configurations, in the order of CONFIGURATIONS."""
        return [name for name in CONFIGURATIONS if any(entry.configuration == name for entry in self.entries)]

    @property
    def splits(self) -> list[str]:
        """Names of the recorded splits, sorted."""
        return sorted({entry.split for entry in self.entries})

    @property
    def main_split(self) -> str:
        """The split used for analyses: dev, as in the paper, if it was played."""
        return "dev" if "dev" in self.splits else self.splits[0]

    @cached_property
    def results(self) -> list[AgentResults]:
        """All results by configuration, split and agent, each in the order above."""
        places = product(self.configurations, self.splits, self.agents)
        found = {(entry.configuration, entry.split, entry.agent): entry for entry in self.entries}
        return [found[place] for place in places if place in found]

    def of(self, configuration: str, split: str | None = None) -> list[AgentResults]:
        """All agents' results in a configuration, by default on the main split."""
        place = configuration, split or self.main_split
        return [entry for entry in self.results if (entry.configuration, entry.split) == place]

    def of_agent(self, agent: str) -> list[AgentResults]:
        """The agent's results on the main split."""
        return [entry for entry in self.results if (entry.agent, entry.split) == (agent, self.main_split)]

    def find(self, agent: str, configuration: str, split: str | None = None) -> AgentResults | None:
        """The agent's results, by default on the main split."""
        return next((entry for entry in self.of(configuration, split) if entry.agent == agent), None)


def load_report_data(paths: Sequence[Path]) -> ReportData:
    """Loads all episodes and training curves in the paths, of which directories are searched recursively.

    Episodes are in recordings, runs of `lilgym-mp llm play` and, if they are named, databases of the web server.
    Results of games are in JSON files that are named.

    Raises ReportError, naming file and key, if there are no recordings or they are not comparable; EpisodesError for a
    damaged file.
    """
    files = list(dict.fromkeys(file for path in paths for file in _files(path)))
    try:
        games = tuple(result for path in paths if path.suffix == ".json" for result in read_results(path))
    except ValueError as error:
        raise ReportError(str(error)) from None
    if not files and games:
        return ReportData((), (), games=games)
    if not files:
        raise ReportError(
            f"no recorded episodes (*{SUFFIX}) in {', '.join(map(str, paths))};"
            " record some with: lilgym-mp evaluate RUN --record DIR"
        )
    recordings: list[Recording] = []
    for recording in chain.from_iterable(map(_recordings, files)):
        # A deterministic policy may have been recorded twice.
        if not any((recording.header, recording.episodes) == (other.header, other.episodes) for other in recordings):
            recordings.append(recording)
    _check_comparable(recordings)
    progress = (file for path in paths if path.is_dir() for file in sorted(path.rglob(PROGRESS_FILE)))
    curves = tuple(_curve(file.parent) for file in progress if file.with_name(RUN_FILE).exists())
    return ReportData(tuple(_entries(recordings)), curves, games)


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise ReportError(f"{path}: there is no such file or directory")
    if not path.is_dir():
        return [] if path.suffix == ".json" else [path]
    runs = (file.parent for file in path.rglob(TRANSCRIPTS))
    return sorted([*path.rglob(f"*{SUFFIX}"), *filter(is_conversation_run, runs)])


def _recordings(path: Path) -> Iterable[Recording]:
    """Of a recording, a run of a language model, or a database of the web server."""
    if path.is_dir():
        return [conversations(path)]
    return people(path) if is_database(path) else [read_episodes(path)]


def _check_comparable(recordings: Sequence[Recording]) -> None:
    """Raises ReportError if recordings differ in SHARED_SETTINGS or task files."""
    first = recordings[0]
    tasks: dict[tuple[str, str], Recording] = {}
    for recording in recordings:
        settings = recording.header.settings
        header = recording.header
        for key in SHARED_SETTINGS:
            own = getattr(settings, key)
            value = getattr(first.header.settings, key)
            if own != value:
                raise ReportError(
                    f"{recording.path}: {key} is {own!r}, but {value!r} in {first.path};"
                    f" all recordings of a report must have the same {key}"
                )
        known = tasks.setdefault((settings.configuration, header.split), recording)
        if known.header.tasks_sha256 != header.tasks_sha256:
            raise ReportError(
                f"{recording.path}: tasks_sha256 is {header.tasks_sha256[:12]}..., but {known.header.tasks_sha256[:12]}"
                f"... in {known.path}: the tasks come from different files"
            )


def _entries(recordings: Sequence[Recording]) -> Iterator[AgentResults]:
    headers = [recording.header for recording in recordings]
    groups = grouped(
        ((_label(header, headers), header.settings.configuration, header.split), recording)
        for recording, header in zip(recordings, headers, strict=True)
    )
    for (label, configuration, split), runs in groups.items():
        runs.sort(key=lambda run: (run.header.training_seed or 0, run.header.seed))
        _check_seeds(runs)
        commits = [str(commit) for run in runs if (commit := read_metadata(run.path).get("commit"))]
        yield AgentResults(label, configuration, split, tuple(runs), tuple(dict.fromkeys(commits)))


def _check_seeds(runs: Sequence[Recording]) -> None:
    """Raises ReportError for runs of one agent with the same seed, of training or, without it, of the evaluation."""
    seen: dict[int, Recording] = {}
    for run in runs:
        header = run.header
        key, seed = ("seed", header.seed) if header.run is None else ("training_seed", header.training_seed)
        if seed is None:
            if len(runs) > 1:
                raise ReportError(f"{run.path}: {key} is missing; it must distinguish this run from {runs[0].path}")
            continue
        other = seen.setdefault(seed, run)
        if other is not run:
            raise ReportError(
                f"{run.path}: {key} {seed} is that of {other.path}; runs of one agent must differ in it, or get"
                " different names with --name"
            )


def _label(header: Header, headers: Sequence[Header]) -> str:
    """The name of a recording's agent, and what distinguishes it from other recordings of that name."""
    own = header.agent, header.settings, header.split
    others = [other for other in headers if (other.agent, other.settings, other.split) == own]
    keys = differing_keys([other.recipe for other in others])
    differences = [f"{key} {shown_setting(header.recipe.get(key))}" for key in keys]
    if len({other.actions for other in others}) > 1:
        differences.append(header.actions)
    if len({other.supervision for other in others}) > 1:
        differences.append(header.supervision)
    return f"{header.agent} ({', '.join(differences)})" if differences else header.agent


def differing_keys(recipes: Sequence[Any]) -> list[str]:
    """Keys, except the seed, in which recipes differ."""
    keys = dict.fromkeys(key for recipe in recipes for key in recipe if key != "seed")
    return [key for key in keys if len({json.dumps(recipe.get(key)) for recipe in recipes}) > 1]


def _curve(directory: Path) -> TrainingCurve:
    """The curve of the run in this directory. Raises ReportError if one of its files is damaged."""
    try:
        run = begin_run(directory, {}, resume=True)
        identity = run.identity
        environment = run.identity.get("environment", {})
        learner = str(identity.get("learner"))
        configuration = environment.get("configuration", "")
        if configuration not in ("", *CONFIGURATIONS):
            raise ValueError(f"unknown configuration {shown(configuration)}")
        evaluations = _evaluations(run.path / EVALUATIONS_FILE)
        return TrainingCurve(run.path, learner, configuration, evaluations, dict(identity.get("recipe", {})))
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as fault:
        raise ReportError(f"{directory}: damaged, or not a training run: {fault}") from None


def _evaluations(file: Path) -> tuple[AnyDict, ...]:
    """The evaluations in a JSON Lines file, one for each number of steps, since a resumed run repeats some; none if
    there is no such file. Raises ValueError for an invalid number."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    records = [dict(json.loads(line)) for line in lines]
    for record, key in product(records, ("steps", *ACCURACIES)):
        value = record.get(key)
        is_needed = key in ("steps", "accuracy")
        if (value is not None or is_needed) and not (isinstance(value, int | float) and abs(value) < MAX_NUMBER):
            raise ValueError(f"{key} must be a number, not {shown(value)}")
    return tuple({record["steps"]: record for record in records}.values())
