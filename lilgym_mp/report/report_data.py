"""The recordings that a report is about: found, checked to belong together, and put together by agent."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lilgym_mp.evaluation.episodes import SAMPLED, SUFFIX, Header, Recording, read_episodes
from lilgym_mp.evaluation.recording_metadata import RecordingMetadata
from lilgym_mp.evaluation.settings import CONFIGURATIONS

RUN_FILE, PROGRESS_FILE, EVALUATIONS_FILE = "run.json", "progress.jsonl", "evaluations.jsonl"
FINISHED = "finished"  # directory of an experiment with a description of each run
SHARED = ("corpus", "rules", "horizon", "grid")  # settings that all recordings of a report must share
EXPERT = "expert"
LEARNERS = {"run": "ppo", "imitation-run": "imitation"}  # by the format of their run.json, which names none


class ReportError(ValueError):
    """Places that no report can be made of."""


@dataclass(frozen=True)
class Entry:
    """One agent in one configuration and split: a recording a run."""

    agent: str
    configuration: str
    split: str
    runs: tuple[Recording, ...]

    @property
    def header(self) -> Header:
        return self.runs[0].header


@dataclass(frozen=True)
class Curve:
    """The progress of a training run, a mapping a line."""

    run: Path
    learner: str
    configuration: str  # "" of a run for all configurations
    lines: tuple[dict[str, Any], ...]
    evaluations: tuple[dict[str, Any], ...] = ()  # on dev while training, a mapping each
    recipe: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class Gathered:
    """All that a report is made of."""

    entries: tuple[Entry, ...]
    curves: tuple[Curve, ...]
    metadata: tuple[RecordingMetadata, ...] = ()  # of every recording for which they were kept
    training_commands: tuple[str, ...] = ()  # of experiments, in order of the runs' names

    @property
    def agents(self) -> list[str]:
        """Trained ones first, the expert last."""
        names = dict.fromkeys(entry.agent for entry in self.entries)
        trained = {entry.agent for entry in self.entries if entry.header.run is not None}
        return sorted(names, key=lambda name: (name == EXPERT, name not in trained))

    @property
    def configurations(self) -> list[str]:
        return [name for name in CONFIGURATIONS if any(entry.configuration == name for entry in self.entries)]

    @property
    def splits(self) -> list[str]:
        return sorted({entry.split for entry in self.entries})

    @property
    def main_split(self) -> str:
        """The split that analyses are made on: dev, as in the paper, where it was played."""
        return "dev" if "dev" in self.splits else self.splits[0]

    @property
    def header(self) -> Header:
        return self.entries[0].header

    def find(self, agent: str, configuration: str, split: str | None = None) -> Entry | None:
        """The entry, on the main split unless another is named."""
        wanted = agent, configuration, split or self.main_split
        return next((e for e in self.entries if (e.agent, e.configuration, e.split) == wanted), None)

    def of(self, configuration: str) -> list[Entry]:
        """The entries of a configuration on the main split, in the agents' order."""
        found = (self.find(agent, configuration) for agent in self.agents)
        return [entry for entry in found if entry is not None]


def gather(places: Sequence[Path], runs: Sequence[Path] = ()) -> Gathered:
    """Everything recorded in the places: files of episodes, or directories searched with all that is in them.

    `runs`: further directories with training runs whose progress is wanted.

    Raises ReportError naming file and key when there is nothing, or what does not belong together; EpisodesError for
    a file that is damaged.
    """
    files = list(dict.fromkeys(file for place in places for file in _files(place)))
    recordings = _distinct(read_episodes(file) for file in files)
    _check_same(recordings)
    return Gathered(
        tuple(_entries(recordings)),
        tuple(_curves([*places, *runs])),
        tuple(found for recording in recordings if (found := RecordingMetadata.read(recording.path)) is not None),
        tuple(_training_commands(places)),
    )


def _files(place: Path) -> list[Path]:
    if not place.exists():
        raise ReportError(f"{place}: there is no such file or directory")
    if not place.is_dir():
        return [place]
    found = sorted(place.rglob(f"*{SUFFIX}"))
    if not found:
        kind = "a training run, but holds" if (place / RUN_FILE).exists() else "no run and no results: it holds"
        raise ReportError(
            f"{place} is {kind} no recorded episodes (*{SUFFIX});"
            " record some with: lilgym-mp evaluate RUN --record DIR, or name a run that `lilgym-mp train` finished"
        )
    return found


def _distinct(recordings: Iterable[Recording]) -> list[Recording]:
    """The recordings without those that hold the same as an earlier one, as simple policies played twice do."""
    kept: list[Recording] = []
    for recording in recordings:
        if not any((recording.header, recording.episodes) == (other.header, other.episodes) for other in kept):
            kept.append(recording)
    return kept


def _check_same(recordings: Sequence[Recording]) -> None:
    """Raises ReportError when recordings are of different corpora, rules, horizons, grids or tasks."""
    first = recordings[0]
    tasks: dict[tuple[str, str], Recording] = {}
    for recording in recordings:
        for key in SHARED:
            values = [getattr(found.header.settings, key) for found in (first, recording)]
            if values[0] != values[1]:
                raise ReportError(
                    f"{recording.path}: {key} is {values[1]!r}, but {values[0]!r} in {first.path};"
                    f" a report is about one {key}: give only recordings that share it"
                )
        header = recording.header
        known = tasks.setdefault((header.settings.configuration, header.split), recording)
        if known.header.tasks_sha256 != header.tasks_sha256:
            raise ReportError(
                f"{recording.path}: tasks_sha256 is {header.tasks_sha256[:12]}..., but {known.header.tasks_sha256[:12]}"
                f"... in {known.path}: the tasks come from different files"
            )


def _entries(recordings: Sequence[Recording]) -> Iterator[Entry]:
    groups: dict[tuple[str, str, str], list[Recording]] = {}
    labels = _labels([recording.header for recording in recordings])
    for recording, label in zip(recordings, labels, strict=True):
        header = recording.header
        groups.setdefault((label, header.settings.configuration, header.split), []).append(recording)
    for (label, configuration, split), runs in groups.items():
        runs.sort(key=lambda run: (run.header.training_seed or 0, run.header.seed))
        _check_seeds(runs)
        yield Entry(label, configuration, split, tuple(runs))


def _check_seeds(runs: Sequence[Recording]) -> None:
    """Raises ReportError for runs that cannot be told apart by their seeds."""
    seen: dict[tuple[int | None, int], Recording] = {}
    for run in runs:
        header = run.header
        if header.run is not None and header.training_seed is None and len(runs) > 1:
            raise ReportError(f"{run.path}: training_seed is missing; it must tell this run from {runs[0].path}")
        other = seen.setdefault((header.training_seed, header.seed), run)
        if other is not run:
            raise ReportError(
                f"{run.path}: training_seed {header.training_seed} and seed {header.seed} are those of {other.path};"
                " runs of one agent must differ in a seed, or be called differently by --name"
            )


def _labels(headers: Sequence[Header]) -> list[str]:
    """What to call each recording's agent: as recorded, and in what it differs from others of that name."""
    labels: list[str] = []
    for header in headers:
        others = [
            other
            for other in headers
            if (other.agent, other.settings, other.split) == (header.agent, header.settings, header.split)
        ]
        differences = [
            f"{key} {setting_shown(header.recipe.get(key))}" for key in differing([o.recipe for o in others])
        ]
        if len({other.actions for other in others}) > 1:
            differences.append("sampled" if header.actions == SAMPLED else "greedy")
        if len({other.mask for other in others}) > 1:
            differences.append("with mask" if header.mask else "without mask")
        if len({other.supervision for other in others}) > 1 and not differences:
            differences.append(header.supervision)
        labels.append(f"{header.agent} ({', '.join(differences)})" if differences else header.agent)
    return labels


def differing(recipes: Sequence[Any]) -> list[str]:
    """Keys, but for the seed, in which recipes differ."""
    keys = dict.fromkeys(key for recipe in recipes for key in recipe if key != "seed")
    return [key for key in keys if len({json.dumps(recipe.get(key)) for recipe in recipes}) > 1]


def setting_shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else "unset" if value is None else str(value)


def _curves(places: Iterable[Path]) -> Iterator[Curve]:
    """The progress of every training run in the directories."""
    for place in places:
        for file in sorted(place.rglob(PROGRESS_FILE)) if place.is_dir() else ():
            description = file.with_name(RUN_FILE)
            if not description.exists():
                continue
            try:
                run = json.loads(description.read_text(encoding="utf-8"))
                lines, evaluations = (_json_lines(file.with_name(name)) for name in (PROGRESS_FILE, EVALUATIONS_FILE))
                identity = run.get("identity", run)
                settings = identity.get("environment", identity.get("settings", {}))
                name: str = identity.get("learner") or run["format"].removeprefix("lilgym_mp-")
                configuration: str = settings.get("configuration", "")
                recipe: Mapping[str, Any] = identity.get("recipe", {})
            except (OSError, ValueError, AttributeError, KeyError, TypeError) as fault:
                raise ReportError(f"{file}: damaged, or no progress of a training run: {fault}") from None
            yield Curve(file.parent, LEARNERS.get(name, name), configuration, lines, evaluations, recipe)


def _json_lines(file: Path) -> tuple[dict[str, Any], ...]:
    """What each line of the file holds; nothing where there is no such file."""
    if not file.exists():
        return ()
    return tuple(json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())


def _training_commands(places: Iterable[Path]) -> Iterator[str]:
    """How the runs of the experiments in the places were trained."""
    for place in places:
        for file in sorted(place.rglob(f"{FINISHED}/*.json")) if place.is_dir() else ():
            try:
                words = json.loads(file.read_text(encoding="utf-8"))["commands"][0]
                command = " ".join(["lilgym-mp", *words])
            except (OSError, ValueError, KeyError, IndexError, TypeError) as fault:
                raise ReportError(f"{file}: damaged, or not of a finished run: {fault!r}") from None
            if words:
                yield command
