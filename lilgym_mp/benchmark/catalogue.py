"""The table of benchmark cases. Adding a case takes one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

from lilgym_mp.benchmark import players
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


Opener = Callable[[Workload], AbstractContextManager[Play]]


@dataclass(frozen=True)
class BenchmarkCase:
    """Something to measure, in steps per second or, in the group "parts", in microseconds per call."""

    group: str
    name: str
    num_envs: int
    open: Opener
    is_part: bool = False


def _all_cases() -> Iterator[BenchmarkCase]:
    def case(group: str, name: str, count: int, opener: Callable[..., Any], **options: Any) -> BenchmarkCase:
        return BenchmarkCase(group, name, count, partial(opener, num_envs=count, **options))

    def one(group: str, name: str, opener: Callable[..., Any], **options: Any) -> BenchmarkCase:
        return BenchmarkCase(group, name, 1, partial(opener, **options))

    def vector(group: str, name: str, count: int, **options: Any) -> BenchmarkCase:
        return case(group, name, count, players.vector, **options)

    def sb3(backend: str, count: int, *, masks: bool = False, **options: Any) -> BenchmarkCase:
        name = f"SB3, {backend}{', masks' if masks else ''}"
        return case("sb3", name, count, players.sb3, backend=backend, masks=masks, **options)

    for count in (1, *BATCHES):
        yield case(COPY_GROUP, "memory copy", count, players.copying)

    yield one("single", "single", players.single)
    yield one("single", "single, masks", players.single, masks=True)
    yield one("single", "single, stop forcing", players.single, wrap=stop_forcing_v0, masks=True)

    for count in BATCHES:
        yield vector("batched", "batched", count)
        yield vector("batched", "batched, no copy", count, copy=False)
        yield vector("batched", "batched, masks", count, masks=True)
        yield vector("batched", "batched, no copy, masks", count, copy=False, masks=True)
        yield vector("batched", "batched, stop forcing", count, wrap=stop_forcing_v0, masks=True)

    for count in WORKER_BATCHES:
        for processes in _process_counts():
            name = f"workers, {processes} process{'es' if processes > 1 else ''}"
            yield vector("workers", name, count, processes=processes)
            yield vector("workers", f"{name}, no copy", count, processes=processes, copy=False)
            yield vector("workers", f"{name}, masks", count, processes=processes, masks=True)

    for name, wrap in WRAPPERS.items():
        yield vector("wrappers", f"wrapped: {name}", 64, wrap=wrap)

    yield from (sb3("batched", count) for count in BATCHES)
    yield from (sb3("workers", count, num_workers=2) for count in WORKER_BATCHES)
    yield from (sb3(backend, count) for backend in ("dummy", "subproc") for count in (8, 64))
    yield from (sb3("batched", count, masks=True) for count in (8, 64))
    yield sb3("subproc", 8, masks=True)

    yield one("pettingzoo", "PettingZoo, parallel", players.game, form="parallel_env")
    yield one("pettingzoo", "PettingZoo, AEC (raw_env)", players.game, form="raw_env")
    yield one("pettingzoo", "PettingZoo, AEC (env)", players.game, form="env")
    yield case("pettingzoo", "games, batched", 64, players.batched_games, copy=True)
    yield case("pettingzoo", "games, batched, no copy", 64, players.batched_games, copy=False)

    parts: dict[tuple[str, int], Opener] = {
        ("program truth", 1): partial(players.component, make=lambda dynamics: dynamics.goal_reached),
        ("mask", 1): partial(players.component, make=lambda dynamics: dynamics.legal_mask),
        **{("mask, in a batch", n): partial(players.batched_masks, num_envs=n) for n in BATCHES},
        ("reset", 1): players.reset,
        ("reset, in a batch", 64): partial(players.batched_reset, num_envs=64),
        ("image, brought up to date", 1): partial(players.component, make=players.canvas),
        ("image, drawn whole", 1): partial(players.component, make=players.drawing, every=20),
    }
    for (name, count), opener in parts.items():
        yield BenchmarkCase("parts", name, count, opener, is_part=True)


def _process_counts() -> list[int]:
    """1, 2, 4, ... up to the number of cores, but at least 1 and 2."""
    counts = [1, 2]
    while 2 * counts[-1] <= usable_cores():
        counts.append(2 * counts[-1])
    return counts


GROUPS = tuple(dict.fromkeys(case.group for case in _all_cases()))


def benchmark_cases(groups: Sequence[str] = GROUPS) -> list[BenchmarkCase]:
    """All cases of the groups, and always those of COPY_GROUP. Raises ValueError naming the choices."""
    chosen = {COPY_GROUP, *(choose("group", group, dict(zip(GROUPS, GROUPS, strict=True))) for group in groups)}
    return [case for case in _all_cases() if case.group in chosen]
