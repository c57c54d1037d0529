"""Measure the steps per second and the memory of all ways to run the environments.

All ways play the same actions, sampled beforehand: "11 actions" are ten random legal edits and a STOP; a "random
policy" chooses among the legal actions until the episode ends. Resets are timed, but are not counted as steps.
"""

from __future__ import annotations

import gc
import multiprocessing
import re
import sys
import tracemalloc
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from statistics import median
from time import perf_counter, strftime
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.cli.options import CommandError, add_configuration, add_corpus, add_flag, argument_type
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.machine import usable_cores
from lilgym_mp.envs.registration import BUILTIN_CONFIGURATIONS
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.evaluation.recording_metadata import cpu_model
from lilgym_mp.evaluation.terminal import Progress, table
from lilgym_mp.wrappers import action_mask_v0, text_observation_v0

SPLIT = "train"
STOP = 0  # index of the action
EPISODE_ACTIONS = 11  # ten edits and a STOP
# Workloads
FIXED = f"{EPISODE_ACTIONS} actions"
RANDOM = "random policy"
COPY = "memory copy"  # an upper bound on the speed of any environment that copies its images
PROCESSES = max(2, usable_cores())  # of workers
QUICK = ("TowerFlipIt", "ScatterFlipIt")  # configurations
WRAPPERS: dict[str, Callable[[Any], Any]] = {
    "action_mask_v0": action_mask_v0,
    "text_observation_v0": text_observation_v0,
}
COLUMNS = ("way", "workload", "envs", "steps/s", "lowest", "highest", "of copying", "MB")
LEGEND = (
    "Steps per second: median, lowest and highest of the rounds. Of copying: relative to copying as many environments'"
    " images into new memory. MB: memory of the environments and of their own processes, without the corpus."
)


class Workload:
    """Recorded episodes, `actions` actions of all environments together; environment i always plays those of seed i."""

    def __init__(self, settings: EnvConfig, name: str, actions: int) -> None:
        self.settings = settings
        self.name = name
        self.actions = actions
        self.id = settings.id
        self.arguments = settings.arguments(SPLIT)
        own = {"appearance": settings.appearance, "start": settings.start, "protocol": "joint"}
        self.game_arguments = {**self.arguments, **own}  # every round takes one action of the MDP
        self._env = settings.make(SPLIT)
        self.episodes = cache(self._recorded)

    def _recorded(self, seed: int, num_envs: int) -> list[list[int]]:
        """Actions of one environment by episode; first ones of FIXED differ in length, not to end all at once."""
        env = self._env
        rng = np.random.default_rng(seed)
        left = self.actions // num_envs
        episodes: list[list[int]] = []
        env.reset(seed=seed)
        while left > 0 or len(episodes) < 4:
            actions = list[int]()
            ended = False
            length = EPISODE_ACTIONS if episodes else 1 + seed % EPISODE_ACTIONS
            while not ended:
                legal = np.flatnonzero(env.action_masks())  # the first is STOP
                is_last = len(actions) == length - 1
                choices = legal if self.name == RANDOM else legal[:1] if is_last else legal[1:]
                actions.append(int(rng.choice(choices)))
                _, _, terminated, truncated, _ = env.step(actions[-1])
                ended = terminated or truncated
            episodes.append(actions)
            left -= len(actions)
            env.reset()
        return episodes

    def rows(self, num_envs: int, autoreset: AutoresetMode) -> tuple[list[np.ndarray], int]:
        """(N,) actions of each step of a batch, to the end of the shortest, and their number without ignored ones."""
        ignored = -1  # after the end of an episode
        pause = [ignored] if autoreset is AutoresetMode.NEXT_STEP else []
        played = [self.episodes(seed, num_envs) for seed in range(num_envs)]
        columns = [[action for actions in episodes for action in (*actions, *pause)] for episodes in played]
        length = min(map(len, columns))
        table = np.array([column[:length] for column in columns], np.int64).T
        return list(np.where(table == ignored, STOP, table)), int((table != ignored).sum())


Call = tuple[Any, ...]  # a function and its arguments


class Player(NamedTuple):
    """Plays a workload in one way."""

    steps: int
    prepare: Callable[[], object]  # not timed
    calls: list[Call]

    def play(self) -> float:
        """The seconds of all calls."""
        self.prepare()
        begin = perf_counter()
        for function, *arguments in self.calls:
            function(*arguments)
        return perf_counter() - begin

    def rate(self, seconds: float) -> float:
        """Steps per second in at least these seconds, after a run that refills the CPU's caches."""
        self.play()
        plays = [self.play()]
        while sum(plays) < seconds:
            plays.append(self.play())
        return self.steps * len(plays) / sum(plays)


@contextmanager
def copying(workload: Workload, num_envs: int) -> Iterator[Player]:
    """Copies one image per environment into new memory: the upper bound that rates are compared with."""
    image = workload.settings.make(SPLIT).reset(seed=0)[0]["image"]
    count = -(-2_048 // num_envs)
    yield Player(count * num_envs, lambda: None, [(np.repeat(image[None], num_envs, 0).copy,)] * count)


@contextmanager
def single(workload: Workload, num_envs: int, masks: bool = False) -> Iterator[Player]:
    """Plays one environment of `gym.make` after another; with `masks`, asks for the mask before every action."""
    with closing(gym.make(workload.id, **workload.arguments)) as env:
        before: list[Call] = [(env.get_wrapper_attr("action_masks"),)] if masks else []
        episodes = workload.episodes(0, num_envs)
        calls: list[Call] = []
        for actions in episodes:
            calls += [*(call for action in actions for call in (*before, (env.step, action))), (env.reset,)]
        yield Player(sum(map(len, episodes)), lambda: env.reset(seed=0), calls)


@contextmanager
def vector(make: Any, workload: Workload, num_envs: int, masks: bool = False) -> Iterator[Player]:
    """Plays the batch that `make` gives; with `masks`, asks for all masks before every step."""
    with closing(make(workload.id, num_envs, **workload.arguments)) as env:
        rows, steps = workload.rows(num_envs, env.metadata["autoreset_mode"])
        before: list[Call] = [(env.action_masks,)] if masks else []
        yield Player(steps, lambda: env.reset(seed=0), [call for row in rows for call in (*before, (env.step, row))])


def wrapped(make: Any, wrap: Callable[[Any], Any], *args: Any, **settings: Any) -> Any:
    """A batch in a wrapper, whose Python runs in this process for all environments."""
    return wrap(make(*args, **settings))


@contextmanager
def sb3(backend: str, workload: Workload, num_envs: int, masks: bool = False) -> Iterator[Player]:
    """A Stable-Baselines3 `VecEnv` with monitor, as used in training."""
    from lilgym_mp.sb3 import make_vec_env

    first = multiprocessing.get_all_start_methods()[0]  # on Linux "fork": starts in a second, not in a minute
    options: Any = {"workers": {"num_workers": PROCESSES}, "subproc": {"start_method": first}}.get(backend, {})
    with closing(make_vec_env(workload.id, num_envs, backend, **workload.arguments, **options)) as env:
        rows, steps = workload.rows(num_envs, AutoresetMode.SAME_STEP)
        before: list[Call] = [(env.env_method, "action_masks")] if masks else []
        calls = [call for row in rows for call in (*before, (env.step, row))]
        yield Player(steps, lambda: (env.seed(0), env.reset()), calls)


@contextmanager
def batched_games(workload: Workload, num_envs: int) -> Iterator[Player]:
    """Games whose verifier stops them where the workload has STOP."""
    from lilgym_mp.envs.proposer_verifier import AGENTS, BatchedGames

    with closing(BatchedGames(num_envs, **workload.game_arguments)) as games:
        rows, steps = workload.rows(num_envs, AutoresetMode.SAME_STEP)
        calls = [(games.step, dict(zip(AGENTS, (row, (row == STOP).astype(np.int64)), strict=True))) for row in rows]
        yield Player(steps, lambda: games.reset(seed=0), calls)


@dataclass
class Case:
    """A way to run the environments, and what was measured of it."""

    group: str
    name: str
    num_envs: int
    open: Callable[[Workload, int], AbstractContextManager[Player]]
    workload: str = FIXED
    rates: list[float] = field(default_factory=list)
    megabytes: float | None = None


def cases(counts: Sequence[int]) -> Iterator[Case]:
    """Everything that is measured, with these numbers of environments."""
    workers = partial(WorkerVectorEnv, num_workers=PROCESSES)
    for count in dict.fromkeys((1, *counts)):
        yield Case(COPY, COPY, count, copying, workload="-")
    for workload in (FIXED, RANDOM):
        yield Case("single", "single", 1, single, workload)
    yield Case("single", "single, masks", 1, partial(single, masks=True))
    for count in counts:
        for group, make in (("batched", gym.make_vec), ("workers", workers)):
            yield Case(group, group, count, partial(vector, make))
            yield Case(group, f"{group}, no copy", count, partial(vector, partial(make, copy=False)))
            yield Case(group, f"{group}, masks", count, partial(vector, make, masks=True))
            for name, wrap in WRAPPERS.items():
                yield Case(group, f"{group}, {name}", count, partial(vector, partial(wrapped, make, wrap)))
        for backend in ("batched", "workers", "dummy", "subproc"):
            yield Case("sb3", f"SB3, {backend}", count, partial(sb3, backend))
        yield Case("sb3", "SB3, batched, masks", count, partial(sb3, "batched", masks=True))
        yield Case("pettingzoo", "games, batched", count, batched_games)


GROUPS = list(dict.fromkeys(case.group for case in cases([1]) if case.group != COPY))


def add_options(parser: ArgumentParser) -> None:
    """Adds the options of `lilgym-mp bench`."""
    names = " and ".join(QUICK)
    parser.add_argument("--only", nargs="+", choices=GROUPS, default=GROUPS, help="what to measure (default: all)")
    add_configuration(parser, several=True)
    parser.add_argument(
        "--num-envs", nargs="+", type=argument_type(int), default=[64], metavar="N", help="in a batch (default: 64)"
    )
    add_flag(parser, "--quick", f"measure less, and by default only {names}")
    add_corpus(parser)


def run(args: Namespace) -> int:
    """Prints one table per configuration: steps per second and memory of every way to play it."""
    names = args.configuration or (QUICK if args.quick else BUILTIN_CONFIGURATIONS)
    if min(args.num_envs) < 1:
        raise CommandError(f"--num-envs must be at least 1, not {min(args.num_envs)}")
    rounds, seconds, actions = (3, 0.01, 550) if args.quick else (9, 0.1, 4_400)
    machine = f"{cpu_model()}, {usable_cores()} cores, {PROCESSES} worker processes, {rounds} rounds"
    settings = {name: EnvConfig(name, args.corpus) for name in names}
    workloads = {
        name: {kind: Workload(each, kind, actions) for kind in (FIXED, RANDOM)} for name, each in settings.items()
    }
    print(f"{strftime('%Y-%m-%d %H:%M')}, {machine}\n\n{LEGEND}")
    with Progress(len(names) * rounds, "rounds") as progress:
        for name in names:
            found = [case for case in cases(args.num_envs) if case.group in (COPY, *args.only)]
            _measure(found, workloads[name], rounds, seconds, partial(progress.advance, note=name))
            print(f"\n{name}\n\n{table(COLUMNS, _rows(found), keys=3)}", flush=True)
    return 0


def _measure(found: list[Case], workloads: dict[str, Workload], rounds: int, seconds: float, on_round: Any) -> None:
    """Measures each case once per round, so that load on the machine affects all alike."""
    with ExitStack() as stack:
        players: list[tuple[Case, Player]] = []
        for case in found:
            workload = workloads.get(case.workload, workloads[FIXED])
            try:
                players.append((case, stack.enter_context(case.open(workload, case.num_envs))))
            except ImportError as missing:
                print(f"not measured: {case.name} (needs {missing.name})", file=sys.stderr)
                continue
            if case.group != COPY:
                case.megabytes = _megabytes(case, workload)
        for number in range(rounds):
            for case, player in players if number % 2 == 0 else reversed(players):
                case.rates.append(player.rate(seconds))
            on_round()


def _megabytes(case: Case, workload: Workload) -> float:
    """Measures what another such environment allocates here, and its own processes use (on Linux)."""
    others = set(multiprocessing.active_children())
    gc.collect()
    tracemalloc.start()
    try:
        with case.open(workload, case.num_envs) as player:
            player.play()
            found = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(False, __file__)]).traces
            children = set(multiprocessing.active_children()) - others
            files = [path for child in children if (path := Path(f"/proc/{child.pid}/smaps_rollup")).exists()]
            kilobytes = sum(int(size) for path in files for size in re.findall(r"(?m)^Pss: *(\d+)", path.read_text()))
    finally:
        tracemalloc.stop()
    return sum(trace.size for trace in found) / 1e6 + kilobytes / 1e3


def _rows(found: Sequence[Case]) -> list[Sequence[str]]:
    """COLUMNS of each case."""
    copies = {case.num_envs: case.rates for case in found if case.group == COPY}
    rows: list[Sequence[str]] = []
    for case in filter(lambda case: case.rates, found):
        speeds = [f"{float(f'{rate:.3g}'):,.0f}" for rate in (median(case.rates), min(case.rates), max(case.rates))]
        ratio = median(ours / theirs for ours, theirs in zip(case.rates, copies[case.num_envs], strict=False))
        others = ["-", "-"] if case.megabytes is None else [f"{ratio:.2f}", f"{case.megabytes:,.1f}"]
        rows.append([case.name, case.workload, str(case.num_envs), *speeds, *others])
    return rows
