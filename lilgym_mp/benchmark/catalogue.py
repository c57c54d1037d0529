"""The table of benchmark cases. Adding a case takes one line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

from lilgym_mp.benchmark import components, players
from lilgym_mp.benchmark.players import Play
from lilgym_mp.benchmark.traces import Workload
from lilgym_mp.choices import choose
from lilgym_mp.envs.workers import usable_cores
from lilgym_mp.wrappers import (
    action_mask_v0,
    grid_planes_v0,
    stop_forcing_v0,
    structured_observation_v0,
    tokenized_statement_v0,
)

BATCHES = (8, 64, 256)
WORKER_BATCHES = (64, 256)
WRAPPERS: dict[str, Callable[[Any], Any]] = {
    "mask": action_mask_v0,
    "tokens": tokenized_statement_v0,
    "structured": structured_observation_v0,
    "planes": grid_planes_v0,
    "mask, tokens, structured": lambda env: structured_observation_v0(tokenized_statement_v0(action_mask_v0(env))),
}
COPY_GROUP = "copy"  # always measured: the upper bound that others are compared with


@dataclass(frozen=True)
class BenchmarkCase:
    """Something to measure, in steps per second or, in the group "parts", in microseconds per call."""

    group: str
    name: str
    num_envs: int
    open: Callable[[Workload], AbstractContextManager[Play]]
    is_part: bool = False


def _copies() -> list[BenchmarkCase]:
    return [
        BenchmarkCase(COPY_GROUP, "memory copy", count, partial(players.copying, num_envs=count))
        for count in (1, *BATCHES)
    ]


def _single() -> list[BenchmarkCase]:
    forcing = partial(players.single, wrap=stop_forcing_v0, masks=True)
    openers: dict[str, Callable[[Workload], AbstractContextManager[Play]]] = {
        "single": players.single,
        "single, masks": partial(players.single, masks=True),
        "single, stop forcing": forcing,
    }
    return [BenchmarkCase("single", name, 1, opener) for name, opener in openers.items()]


def _vector(
    group: str, name: str, count: int, make: Callable[[Workload, int], Any], *, masks: bool = False
) -> BenchmarkCase:
    return BenchmarkCase(group, name, count, partial(players.vector, num_envs=count, make=make, masks=masks))


def _batched() -> list[BenchmarkCase]:
    copied, not_copied = players.batched_env, partial(players.batched_env, copy=False)
    forced = partial(players.wrapped, wrap=stop_forcing_v0)
    return [
        case
        for count in BATCHES
        for case in (
            _vector("batched", "batched", count, copied),
            _vector("batched", "batched, no copy", count, not_copied),
            _vector("batched", "batched, masks", count, copied, masks=True),
            _vector("batched", "batched, no copy, masks", count, not_copied, masks=True),
            _vector("batched", "batched, stop forcing", count, forced, masks=True),
        )
    ]


def process_counts() -> list[int]:
    """1, 2, 4, ... up to the number of cores, but at least 1 and 2."""
    counts = [1, 2]
    while 2 * counts[-1] <= usable_cores():
        counts.append(2 * counts[-1])
    return counts


def worker_name(processes: int) -> str:
    return f"workers, {processes} process{'es' if processes > 1 else ''}"


def _workers() -> list[BenchmarkCase]:
    found: list[BenchmarkCase] = []
    for count in WORKER_BATCHES:
        for processes in process_counts():
            name = worker_name(processes)
            copied = partial(players.worker_env, processes=processes)
            not_copied = partial(players.worker_env, processes=processes, copy=False)
            found += [
                _vector("workers", name, count, copied),
                _vector("workers", f"{name}, no copy", count, not_copied),
                _vector("workers", f"{name}, masks", count, copied, masks=True),
            ]
    return found


def _wrappers() -> list[BenchmarkCase]:
    return [
        _vector("wrappers", f"wrapped: {name}", 64, partial(players.wrapped, wrap=wrap))
        for name, wrap in WRAPPERS.items()
    ]


def _sb3() -> list[BenchmarkCase]:
    def case(backend: str, count: int, *, masks: bool = False, **options: Any) -> BenchmarkCase:
        name = f"SB3, {backend}{', masks' if masks else ''}"
        return BenchmarkCase(
            "sb3", name, count, partial(players.sb3, num_envs=count, backend=backend, masks=masks, **options)
        )

    return [
        *(case("batched", count) for count in BATCHES),
        *(case("workers", count, num_workers=2) for count in WORKER_BATCHES),
        *(case("dummy", count) for count in (8, 64)),
        *(case("subproc", count) for count in (8, 64)),
        *(case("batched", count, masks=True) for count in (8, 64)),
        case("subproc", 8, masks=True),
    ]


def _pettingzoo() -> list[BenchmarkCase]:
    return [
        BenchmarkCase("pettingzoo", "PettingZoo, parallel", 1, players.parallel_game),
        BenchmarkCase("pettingzoo", "PettingZoo, AEC (raw_env)", 1, partial(players.turn_game, checked=False)),
        BenchmarkCase("pettingzoo", "PettingZoo, AEC (env)", 1, partial(players.turn_game, checked=True)),
        BenchmarkCase("pettingzoo", "games, batched", 64, partial(players.batched_games, num_envs=64, copy=True)),
        BenchmarkCase(
            "pettingzoo", "games, batched, no copy", 64, partial(players.batched_games, num_envs=64, copy=False)
        ),
    ]


def _parts() -> list[BenchmarkCase]:
    openers: dict[tuple[str, int], Callable[[Workload], AbstractContextManager[Play]]] = {
        ("program truth", 1): components.truth,
        ("mask", 1): components.mask,
        **{("mask, in a batch", n): partial(components.batched_masks, num_envs=n) for n in BATCHES},
        ("reset", 1): components.reset,
        ("reset, in a batch", 64): partial(components.batched_reset, num_envs=64),
        ("image, brought up to date", 1): components.image_update,
        ("image, drawn whole", 1): components.full_image,
    }
    return [BenchmarkCase("parts", name, count, opener, is_part=True) for (name, count), opener in openers.items()]


_GROUPS: dict[str, Callable[[], list[BenchmarkCase]]] = {
    COPY_GROUP: _copies,
    "single": _single,
    "batched": _batched,
    "workers": _workers,
    "wrappers": _wrappers,
    "sb3": _sb3,
    "pettingzoo": _pettingzoo,
    "parts": _parts,
}
GROUPS = tuple(_GROUPS)


def benchmark_cases(groups: Sequence[str] = GROUPS) -> list[BenchmarkCase]:
    """All cases of the groups, and always those of COPY_GROUP. Raises ValueError naming the choices."""
    chosen = {choose("group", group, _GROUPS): group for group in groups}
    return [case for build in _GROUPS.values() if build is _copies or build in chosen for case in build()]
