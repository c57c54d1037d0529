"""Episodes of language models and of people in browsers, as recordings, for reports beside trained agents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from lilgym_mp.corpus import contexts
from lilgym_mp.corpus.records import shown
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import datasets
from lilgym_mp.evaluation.episode_files import Header, Recording
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.files import EpisodesError, read_json, read_lines
from lilgym_mp.evaluation.recording_metadata import software
from lilgym_mp.scene.actions import named
from lilgym_mp.scene.arrays import AnyDict, AnyMapping

# Written by `lilgym-mp llm play`
TRANSCRIPTS = "transcripts.jsonl"
SUMMARY = "summary.json"
GAME_TURNS = "turns.jsonl"  # besides these, for games
PEOPLE = "people"


def is_conversation_run(directory: Path) -> bool:
    """Whether the directory contains transcripts and a summary of `lilgym-mp llm play`, of single tasks."""
    is_game = (directory / GAME_TURNS).exists()
    return not is_game and all((directory / name).is_file() for name in (TRANSCRIPTS, SUMMARY))


def conversations(directory: Path) -> Recording:
    """The episodes of a run of `lilgym-mp llm play`. Raises EpisodesError if they cannot be read, or the tasks changed.

    An episode that ended with an answer without an action has its outcome, such as "cut", and the actions before.
    """
    try:
        summary = read_json(directory / SUMMARY)
        given = summary["settings"]
        seed = int(given["seed"])
        settings = EnvConfig.from_json({name: given[name] for name in ("configuration", *EnvConfig.settings())})
        split = given["split"]
        option = dict(given["option"])
        tasks = settings.tasks(split)
        if given["tasks_sha256"] != tasks.provenance.sha256:
            raise ValueError(f"was played with other tasks than those of {tasks.provenance}")
        episodes = [
            _episode(record, settings, split) for record in read_lines(directory / TRANSCRIPTS) if "error" not in record
        ]
        label = " ".join(filter(None, [str(given["agent"]), str(option.get("model") or option.get("directory") or "")]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise EpisodesError(f"{directory}: no run of `llm play` that can be read: {_reason(error)}") from None
    if not episodes:
        raise EpisodesError(f"{directory}: has no episodes yet")
    shown_scene = {"scene": given.get("scene", "list")}
    return _recording(directory, settings, split, label, "language model", episodes, seed, shown_scene)


def _reason(error: Exception) -> str:
    if isinstance(error, TypeError | AttributeError):
        return "a value is of another type than `llm play` writes"
    return f"there is no {error}" if isinstance(error, KeyError) else str(error)


def _episode(record: AnyMapping, settings: EnvConfig, split: str) -> Episode:
    task = settings.tasks(split).by_id(record["task"])
    if task.statement != record["statement"]:
        raise ValueError(f"the statement of task {task.id} was {shown(record['statement'])} when it was played")
    actions = [named(name) for name in record["actions"]]
    return Episode.of(task, actions, str(record["outcome"]), settings.dynamics(), tags=task.tags)


def people(database: Path) -> Iterator[Recording]:
    """A run of the agent "people" for each player, configuration and split: the first attempt at each task.

    Raises EpisodesError.
    """
    played: dict[tuple[EnvConfig, str, str], dict[str, Episode]] = {}
    try:
        for source in datasets.recorded([database]):
            first = played.setdefault((source.settings, source.split, source.agent), {})
            for episode in source.episodes:
                first.setdefault(episode.task, episode)
    except ValueError as error:
        raise EpisodesError(str(error)) from None
    seeds = {name: index for index, name in enumerate(sorted({player for *_, player in played}))}
    for (settings, split, player), episodes in played.items():
        yield _recording(database, settings, split, PEOPLE, "people", list(episodes.values()), seeds[player], {})


def _recording(
    path: Path,
    settings: EnvConfig,
    split: str,
    agent: str,
    supervision: str,
    episodes: Sequence[Episode],
    seed: int,
    recipe: AnyDict,
) -> Recording:
    tasks = settings.tasks(split)
    own = [tasks.by_id(episode.task) for episode in episodes]
    header = Header(
        package=software().get("lilgym-mp", "unknown"),
        settings=settings,
        split=split,
        agent=agent,
        supervision=supervision,
        actions="as answered" if supervision != PEOPLE else "by hand",
        mask=False,
        stop_forcing=False,
        seed=seed,
        training_seed=None,
        passes=1,
        episodes=len(episodes),
        start_scenes=len(episodes),
        contexts=contexts(own),
        corpus=tasks.provenance.name,
        tasks_sha256=tasks.provenance.sha256,
        expert=False,
        recipe=recipe,
    )
    return Recording(path, header, tuple(episodes))
