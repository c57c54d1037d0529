"""Files of recorded episodes: gzipped JSON lines, with a header and then one line per episode.

docs/report.md describes every key. Equal evaluations give equal bytes.
"""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self, cast, get_type_hints

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.decisions import Decision
from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES, Episode
from lilgym_mp.evaluation.files import EpisodesError, checked, write_atomically
from lilgym_mp.evaluation.policies import ACTION_MODES
from lilgym_mp.scene import Scene, SceneError
from lilgym_mp.scene.actions import ActionError, named
from lilgym_mp.scene.appearances import InvalidReason
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import choose

FORMAT = "lilgym_mp-episodes"
VERSION = 2
MAX_LINE_LENGTH = 1 << 20  # characters
EPISODE_TYPES = get_type_hints(Episode, localns={"Decision": Decision})


@dataclass(frozen=True)
class Header:
    """The metadata common to all episodes of a file."""

    package: str  # version of lilgym-mp that wrote the file
    settings: EnvConfig
    split: str
    agent: str  # name in tables; the same for runs that differ only in their seed
    supervision: str
    actions: str  # AS_TRAINED: greedy or sampled, as the agent does better on statements held out of training
    mask: bool  # whether illegal actions were masked
    stop_forcing: bool
    seed: int  # seed of the evaluation
    training_seed: int | None
    passes: int
    episodes: int
    start_scenes: int
    contexts: int
    corpus: str  # the corpus's own name
    tasks_sha256: str  # SHA-256 of the task file
    expert: bool  # whether the episodes contain the lengths of the expert's solutions
    run: str | None = None  # the agent's run directory
    recipe: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, float] = field(default_factory=dict)  # cost of training: steps, cpu_minutes

    def to_json(self) -> AnyDict:
        """The first line of a file of episodes."""
        return {"format": FORMAT, "version": VERSION, **asdict(self), "settings": self.settings.to_json()}

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """Inverse of `to_json`. Raises ValueError, TypeError or KeyError for invalid data."""
        values = dict(data)
        file_format = values.pop("format")
        version = values.pop("version")
        if (file_format, version) != (FORMAT, VERSION):
            raise ValueError(f"format {file_format!r}, version {version!r}; must be {FORMAT!r}, version {VERSION}")
        values["settings"] = EnvConfig.from_json(values["settings"])
        choose("actions", values["actions"], dict.fromkeys(ACTION_MODES))
        return checked(cls(**values))


def episode_from_json(data: Any) -> Episode:
    """Inverse of `Episode.to_json`. Raises ValueError, TypeError or KeyError for invalid data."""
    values = dict(data)
    values.pop("phenomena", None)  # of older recordings
    choose("outcome", values["outcome"], dict.fromkeys(FINAL_OUTCOMES))
    if values["invalid_reason"] is not None:
        choose("invalid_reason", values["invalid_reason"], dict.fromkeys(map(str, InvalidReason)))
    values["actions"] = tuple(named(name) for name in values["actions"])
    values["start"] = Scene.from_json(values["start"])
    for name in ("tags", "rewards", "stop_probabilities"):
        if values.get(name) is not None:
            values[name] = tuple(values[name])
    if values.get("decisions") is not None:
        values["decisions"] = tuple(map(Decision.from_json, values["decisions"]))
    if not values["actions"]:
        raise ValueError("an episode has at least one action")
    for name in ("rewards", "decisions"):
        if values.get(name) is not None and len(values[name]) != len(values["actions"]):
            raise ValueError(f"{len(values[name])} {name} for {len(values['actions'])} actions")
    return checked(Episode(**values), EPISODE_TYPES)


@dataclass(frozen=True)
class Recording:
    """A file of episodes."""

    path: Path
    header: Header
    episodes: tuple[Episode, ...]


def write_episodes(path: Path, header: Header, episodes: Sequence[Episode]) -> None:
    """Writes the file atomically. Raises ValueError if the header states a different number of episodes."""
    if header.episodes != len(episodes):
        raise ValueError(f"the header says {header.episodes} episodes, but there are {len(episodes)}")
    rows = [header.to_json(), *(episode.to_json() for episode in episodes)]
    text = "".join(json.dumps(row, ensure_ascii=False, separators=(",", ":")) + "\n" for row in rows)
    data = gzip.compress(text.encode(), mtime=0)
    write_atomically(path, lambda unfinished: unfinished.write_bytes(data))


def read_episodes(path: Path) -> Recording:
    """Reads a file written by `write_episodes`. Raises EpisodesError naming the file, the line and the error."""
    lines = _lines(path)
    header = _header(path, lines)
    episodes = tuple(_read(path, line_number, episode_from_json, line) for line_number, line in lines)
    if len(episodes) != header.episodes:
        raise EpisodesError(f"{path}: truncated after {len(episodes)} of {header.episodes} episodes")
    return Recording(path, header, episodes)


def read_header(path: Path) -> Header:
    """The header of the file. Raises EpisodesError if it has none, or a damaged one."""
    return _header(path, _lines(path))


def _header(path: Path, lines: Iterator[tuple[int, Any]]) -> Header:
    line_number, first = next(lines, (1, None))
    if not isinstance(first, dict) or cast("dict[str, Any]", first).get("format") != FORMAT:
        raise EpisodesError(f"{path}: holds no recorded episodes: its first line must name the format {FORMAT!r}")
    return _read(path, line_number, Header.from_json, first)


def _read(path: Path, line_number: int, parse: Callable[[Any], Any], data: Any) -> Any:
    """`parse(data)`, its errors with the path and line number."""
    try:
        return parse(data)
    except KeyError as error:
        raise EpisodesError(f"{path}, line {line_number}: missing key {error}") from None
    except (ActionError, SceneError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise EpisodesError(f"{path}, line {line_number}: {error}") from None


def _lines(path: Path) -> Iterator[tuple[int, Any]]:
    """Number and content of each line."""
    try:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            for line_number, line in enumerate(iter(lambda: file.readline(MAX_LINE_LENGTH), ""), start=1):
                yield line_number, json.loads(line)
    except EOFError:
        raise EpisodesError(f"{path}: truncated: the compressed data end too early") from None
    except (gzip.BadGzipFile, zlib.error, ValueError, RecursionError) as error:
        raise EpisodesError(f"{path}: damaged, or not a file of recorded episodes: {error}") from None
    except OSError as error:
        raise EpisodesError(f"{path}: cannot be read: {error.strerror or error}") from None
