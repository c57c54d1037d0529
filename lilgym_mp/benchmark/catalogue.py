"""What is measured: a table of subjects. Adding one is one line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

from lilgym_mp.benchmark import parts, players
from lilgym_mp.benchmark.players import Play
from lilgym_mp.benchmark.traces import Workload
from lilgym_mp.choices import choose
from lilgym_mp.envs.workers import usable_cores
from lilgym_mp.wrappers import stop_forcing_v0

BATCHES = (8, 64, 256)
WORKER_BATCHES = (64, 256)
LIMIT = "copy"  # the group that is always measured, and the others are compared with


@dataclass(frozen=True)
class Subject:
    """Something to measure, in steps per second or, for the group "parts", in microseconds."""

    group: str
    name: str
    num_envs: int
    open: Callable[[Workload], AbstractContextManager[Play]]
    is_part: bool = False


def _copies() -> list[Subject]:
    return [Subject(LIMIT, "memory copy", count, partial(players.copying, num_envs=count)) for count in (1, *BATCHES)]


def _single() -> list[Subject]:
    forcing = partial(players.single, wrap=stop_forcing_v0, masks=True)
    openers: dict[str, Callable[[Workload], AbstractContextManager[Play]]] = {
        "single": players.single,
        "single, masks": partial(players.single, masks=True),
        "single, stop forcing": forcing,
    }
    return [Subject("single", name, 1, opener) for name, opener in openers.items()]


def _vector(group: str, name: str, count: int, make: Callable[[Workload, int], Any], *, masks: bool = False) -> Subject:
    return Subject(group, name, count, partial(players.vector, num_envs=count, make=make, masks=masks))


def _batched() -> list[Subject]:
    kept, reused = players.batched_env, partial(players.batched_env, copy=False)
    return [
        subject
        for count in BATCHES
        for subject in (
            _vector("batched", "batched", count, kept),
            _vector("batched", "batched, no copy", count, reused),
            _vector("batched", "batched, masks", count, kept, masks=True),
            _vector("batched", "batched, no copy, masks", count, reused, masks=True),
            _vector("batched", "batched, stop forcing", count, players.stop_forced, masks=True),
        )
    ]


def process_counts() -> list[int]:
    """1, 2, 4 ... as far as there are cores; 1 and 2 in any case."""
    counts = [1, 2]
    while 2 * counts[-1] <= usable_cores():
        counts.append(2 * counts[-1])
    return counts


def worker_name(processes: int) -> str:
    return f"workers, {processes} process{'es' if processes > 1 else ''}"


def _workers() -> list[Subject]:
    found: list[Subject] = []
    for count in WORKER_BATCHES:
        for processes in process_counts():
            name = worker_name(processes)
            kept = partial(players.worker_env, processes=processes)
            reused = partial(players.worker_env, processes=processes, copy=False)
            found += [
                _vector("workers", name, count, kept),
                _vector("workers", f"{name}, no copy", count, reused),
                _vector("workers", f"{name}, masks", count, kept, masks=True),
            ]
    return found


def _sb3() -> list[Subject]:
    def subject(backend: str, count: int, *, masks: bool = False, **options: Any) -> Subject:
        name = f"SB3, {backend}{', masks' if masks else ''}"
        return Subject(
            "sb3", name, count, partial(players.sb3, num_envs=count, backend=backend, masks=masks, **options)
        )

    return [
        *(subject("batched", count) for count in BATCHES),
        *(subject("workers", count, num_workers=2) for count in WORKER_BATCHES),
        *(subject("dummy", count) for count in (8, 64)),
        *(subject("subproc", count) for count in (8, 64)),
        *(subject("batched", count, masks=True) for count in (8, 64)),
        subject("subproc", 8, masks=True),
    ]


def _pettingzoo() -> list[Subject]:
    return [
        Subject("pettingzoo", "PettingZoo, parallel", 1, players.parallel_game),
        Subject("pettingzoo", "PettingZoo, AEC (raw_env)", 1, partial(players.turn_game, checked=False)),
        Subject("pettingzoo", "PettingZoo, AEC (env)", 1, partial(players.turn_game, checked=True)),
        Subject("pettingzoo", "games, batched", 64, partial(players.batched_games, num_envs=64, copy=True)),
        Subject("pettingzoo", "games, batched, no copy", 64, partial(players.batched_games, num_envs=64, copy=False)),
    ]


def _parts() -> list[Subject]:
    openers: dict[tuple[str, int], Callable[[Workload], AbstractContextManager[Play]]] = {
        ("program truth", 1): parts.truth,
        ("mask", 1): parts.mask,
        ("mask, in a batch", 64): partial(parts.batched_masks, num_envs=64),
        ("reset", 1): parts.reset,
        ("reset, in a batch", 64): partial(parts.batched_reset, num_envs=64),
        ("image, brought up to date", 1): parts.image,
        ("image, drawn whole", 1): parts.whole_image,
    }
    return [Subject("parts", name, count, opener, is_part=True) for (name, count), opener in openers.items()]


_GROUPS: dict[str, Callable[[], list[Subject]]] = {
    LIMIT: _copies,
    "single": _single,
    "batched": _batched,
    "workers": _workers,
    "sb3": _sb3,
    "pettingzoo": _pettingzoo,
    "parts": _parts,
}
GROUPS = tuple(_GROUPS)


def subjects(groups: Sequence[str] = GROUPS) -> list[Subject]:
    """What there is to measure in the groups and, always, the copying of memory. Raises ValueError with the choices."""
    chosen = {choose("group", group, _GROUPS): group for group in groups}
    return [subject for build in _GROUPS.values() if build is _copies or build in chosen for subject in build()]
