"""Episodes as a file that analyses read without the agent: gzipped JSON lines, a header and then a line an episode.

docs/report.md describes every key. Equal evaluations give equal bytes.
"""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Self, cast

from lilgym_mp.actions import Action, ActionError, describe, named
from lilgym_mp.analysis.phenomena import Phenomenon
from lilgym_mp.appearances import InvalidReason
from lilgym_mp.evaluation.decisions import Decision
from lilgym_mp.evaluation.files import write_whole
from lilgym_mp.evaluation.metrics import ENDS
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.scene import Scene, SceneError

FORMAT = "lilgym_mp-episodes"
VERSION = 2
READABLE = (1, VERSION)  # 1 has no decisions
SUFFIX = ".episodes.jsonl.gz"
GREEDY, SAMPLED = "greedy", "sampled"
LONGEST_LINE = 1 << 20  # characters


class EpisodesError(ValueError):
    """A file that does not hold recorded episodes, or not whole ones."""


@dataclass(frozen=True)
class Header:
    """What a file's episodes have in common."""

    package: str  # version of lilgym_mp that wrote the file
    settings: Settings
    split: str
    agent: str  # in tables; runs of one learner that differ by their seed alone share it
    supervision: str
    actions: str  # GREEDY or SAMPLED
    mask: bool  # whether illegal actions were kept from the agent
    stop_forcing: bool
    seed: int  # of the evaluation
    training_seed: int | None
    passes: int
    episodes: int
    start_scenes: int
    contexts: int
    corpus: str  # as the corpus calls itself
    tasks_sha256: str  # of the file that the tasks come from
    expert: bool  # whether the expert's numbers of actions are in the episodes
    run: str | None = None  # where the agent came from
    recipe: Mapping[str, Any] = field(default_factory=dict[str, Any])
    training: Mapping[str, float] = field(default_factory=dict[str, float])  # what training took: steps, cpu_minutes

    def to_json(self) -> dict[str, Any]:
        return {"format": FORMAT, "version": VERSION, **asdict(self), "settings": self.settings.to_json()}

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """What `to_json` gave. Raises ValueError, TypeError, KeyError for anything else."""
        values = dict(data)
        found = values.pop("format"), values.pop("version")
        if found[0] != FORMAT or found[1] not in READABLE:
            versions = " or ".join(map(str, READABLE))
            raise ValueError(f"format {found[0]!r}, version {found[1]!r}; must be {FORMAT!r}, version {versions}")
        values["settings"] = Settings.from_json(values["settings"])
        header = cls(**values)
        for name in ("seed", "passes", "episodes", "start_scenes", "contexts"):
            _check(name, getattr(header, name), "a whole number", lambda value: type(value) is int and value >= 0)
        _check("actions", header.actions, f"{GREEDY!r} or {SAMPLED!r}", lambda value: value in (GREEDY, SAMPLED))
        return header


@dataclass(frozen=True)
class RecordedEpisode:
    """One visit to one start scene."""

    task: str
    statement: str
    program: str
    target: bool
    statement_seen: bool  # word for word among the training tasks
    form_seen: bool  # with its colours, shapes, sizes and numbers blanked
    phenomena: tuple[str, ...]  # by the rules of `corpus.phenomena`
    tags: tuple[str, ...]  # what the corpus tells of the task
    outcome: str
    invalid_reason: str | None
    actions: tuple[Action, ...]
    rewards: tuple[float, ...]  # one an action
    start: Scene
    optimal_actions: int | None = None  # the expert's from the start, STOP included
    actions_left: int | None = None  # the expert's from where a wrong STOP was said, STOP included
    stop_probabilities: tuple[float, ...] | None = None  # the agent's before each action
    decisions: tuple[Decision, ...] | None = None  # what the agent went by before each action; None: not recorded

    @property
    def is_success(self) -> bool:
        return self.outcome == "success"

    @property
    def reward(self) -> float:
        return sum(self.rewards)

    @property
    def edits(self) -> int | None:
        """Edits that the expert needs, None where it was not asked or knows no solution."""
        return None if self.optimal_actions is None else self.optimal_actions - 1

    def to_json(self) -> dict[str, Any]:
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        kept = None if self.decisions is None else [decision.to_json() for decision in self.decisions]
        return {
            **values,
            "actions": [describe(action) for action in self.actions],
            "start": self.start.to_json(),
            "decisions": kept,
        }

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """What `to_json` gave. Raises ValueError, TypeError, KeyError for anything else."""
        values = dict(data)
        for name in ("statement", "program", "task"):
            _check(name, values[name], "a text", lambda value: isinstance(value, str))
        for name in ("target", "statement_seen", "form_seen"):
            _check(name, values[name], "true or false", lambda value: isinstance(value, bool))
        _check("outcome", values["outcome"], f"one of {', '.join(ENDS)}", lambda value: value in ENDS)
        reasons = [str(reason) for reason in InvalidReason]
        _check("invalid_reason", values["invalid_reason"], f"null or one of {', '.join(reasons)}", _among(reasons))
        kinds = [str(kind) for kind in Phenomenon]
        for name in values["phenomena"]:
            _check("phenomena", name, f"among {', '.join(kinds)}", lambda value: value in kinds)
        values["actions"] = tuple(named(name) for name in values["actions"])
        values["start"] = Scene.from_json(values["start"])
        for name in ("phenomena", "tags", "rewards", "stop_probabilities"):
            if values.get(name) is not None:
                values[name] = tuple(values[name])
        if values.get("decisions") is not None:
            values["decisions"] = tuple(map(Decision.from_json, values["decisions"]))
        if not values["actions"]:
            raise ValueError("an episode has at least one action")
        for name in ("rewards", "decisions"):
            if values.get(name) is not None and len(values[name]) != len(values["actions"]):
                raise ValueError(f"{len(values[name])} {name} for {len(values['actions'])} actions")
        return cls(**values)


def _among(choices: Sequence[str]) -> Callable[[Any], bool]:
    return lambda value: value is None or value in choices


def _check(name: str, value: Any, rule: str, holds: Callable[[Any], bool]) -> None:
    if not holds(value):
        raise ValueError(f"{name} must be {rule}, not {value!r:.80}")


@dataclass(frozen=True)
class Recording:
    """A file of episodes."""

    path: Path
    header: Header
    episodes: tuple[RecordedEpisode, ...]


def write_episodes(path: Path, header: Header, episodes: Sequence[RecordedEpisode]) -> None:
    """Writes the file whole. Raises ValueError when the header counts other episodes."""
    if header.episodes != len(episodes):
        raise ValueError(f"the header says {header.episodes} episodes, but there are {len(episodes)}")
    rows = [header.to_json(), *(episode.to_json() for episode in episodes)]
    text = "".join(json.dumps(row, ensure_ascii=False, separators=(",", ":")) + "\n" for row in rows)
    data = gzip.compress(text.encode(), mtime=0)
    write_whole(path, lambda unfinished: unfinished.write_bytes(data))


def read_episodes(path: Path) -> Recording:
    """What `write_episodes` wrote. Raises EpisodesError naming the file, the line and what is wrong with it."""
    lines = _lines(path)
    number, first = next(lines, (1, None))
    if not isinstance(first, dict) or cast("dict[str, Any]", first).get("format") != FORMAT:
        raise EpisodesError(f"{path}: holds no recorded episodes: its first line must name the format {FORMAT!r}")
    header = _read(path, number, Header.from_json, first)
    episodes = tuple(_read(path, number, RecordedEpisode.from_json, line) for number, line in lines)
    if len(episodes) != header.episodes:
        raise EpisodesError(f"{path}: cut short: {len(episodes)} of {header.episodes} episodes are there")
    return Recording(path, header, episodes)


def read_header(path: Path) -> Header | None:
    """The header of the file, None where its first line is of another format. Raises EpisodesError otherwise."""
    number, first = next(_lines(path), (1, None))
    if not isinstance(first, dict) or cast("dict[str, Any]", first).get("format") != FORMAT:
        return None
    return _read(path, number, Header.from_json, first)


def _read(path: Path, number: int, of: Callable[[Any], Any], data: Any) -> Any:
    try:
        return of(data)
    except KeyError as error:
        raise EpisodesError(f"{path}, line {number}: lacks the key {error}") from None
    except (ActionError, SceneError, ValueError, TypeError) as error:
        raise EpisodesError(f"{path}, line {number}: {error}") from None


def _lines(path: Path) -> Iterator[tuple[int, Any]]:
    """Each line's number and content."""
    try:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), ""), start=1):
                yield number, json.loads(line)
    except EOFError:
        raise EpisodesError(f"{path}: cut short: its compressed data end too early") from None
    except (gzip.BadGzipFile, zlib.error, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise EpisodesError(f"{path}: damaged, or no file of recorded episodes: {error}") from None
    except OSError as error:
        raise EpisodesError(f"{path}: cannot be read: {error.strerror or error}") from None
