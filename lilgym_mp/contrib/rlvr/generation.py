"""Endless rows: statements are new until their level has no more, and start scenes have the wanted distance."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from itertools import islice
from random import Random

from lilgym_mp.contrib.rlvr.checked_scenes import is_checkable
from lilgym_mp.contrib.rlvr.rows import KINDS, Row, dynamics_of, solver_of
from lilgym_mp.corpus.generator import TrainingPair, split_of, statements
from lilgym_mp.corpus.generator.pairs import check_level
from lilgym_mp.corpus.held_out import shipped_digests, statement_digest
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.corpus.synthesis import near_misses
from lilgym_mp.envs.rules import State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.choices import choose

STARTS = 4  # plan rows of a statement and target besides those of one edit
TRIES = 12  # scenes examined for starts
PROBES = 3  # of these, after which statements whose goal is always near are given up
POOL_WALKS = 64
MOST_PAIRS = 300  # of neighbouring scenes, examined for two in which a statement differs
BARREN = 2_000  # statements in a row without a row, after which there is none
PATIENCE = 3_000  # statements without a new statement, after which statements are repeated

_Variant = tuple[bool, Scene, int | None]  # a row's target, start scene and, for plans, number of actions
_Variants = Callable[[str], Iterator[_Variant]]  # of a program


def rows(
    kind: str,
    appearance: str = "tower",
    level: int = 3,
    *,
    seed: int = 0,
    split: str = "train",
    min_actions: int = 2,
    max_actions: int | None = None,
    seconds: float = math.inf,
) -> Iterator[Row]:
    """Endless rows, deterministic in the arguments.

    No statement with its program is repeated until PATIENCE in a row brought no new one. The splits share no meaning,
    whatever their seeds, and no statement is one of the builtin or official dev and test statements.
    `min_actions`, `max_actions`: of the shortest plan from the start to the goal, STOP included; of plan rows only.
    `seconds`: for a row, after which the search for it ends. Raises ValueError naming the value and the choices; while
    iterating, if there are no such starts, and TimeoutError.
    """
    choose("kind", kind, dict.fromkeys(KINDS))
    choose("split", split, SPLITS)
    check_level(level)
    horizon = dynamics_of(appearance).horizon
    most = horizon if max_actions is None else max_actions
    if not 2 <= min_actions <= most <= horizon:
        raise ValueError(f"min_actions and max_actions must be 2 to {horizon}, ascending, not {min_actions} and {most}")
    return _rows(kind, appearance, level, seed, split, range(min_actions, most + 1), seconds)


def _rows(
    kind: str, appearance: str, level: int, seed: int, split: str, lengths: range, seconds: float
) -> Iterator[Row]:
    rng = Random(f"rows {seed} {level} {appearance} {split}")
    variants = _VARIANTS[kind](appearance, lengths, rng)
    number = 0
    barren = 0
    begun = time.monotonic()
    for statement, program in _new_statements(appearance, level, split, rng):
        barren += 1
        if time.monotonic() - begun > seconds:
            raise TimeoutError(f"no {appearance} {kind} of level {level} was found within {seconds:g} seconds")
        if barren > BARREN:
            words = f"{lengths.start} to {lengths.stop - 1} actions" if kind == "plan" else "a checkable meaning"
            raise ValueError(f"{BARREN} {appearance} statements of level {level} in a row have no {kind} with {words}")
        for target, scene, steps in variants(program):
            name = f"{appearance}-{kind}-{split}-{level}-{seed}-{number}"
            yield Row(kind, appearance, Task(name, statement, program, target, scene), level, steps)
            number += 1
            barren = 0
            begun = time.monotonic()


_split_of = lru_cache(maxsize=65_536)(split_of)  # most statements are of other splits, and draws repeat programs


def _new_statements(appearance: str, level: int, split: str, rng: Random) -> Iterator[TrainingPair]:
    """Statements of the split, new ones as long as there are any."""
    seen: set[int] = set()
    unused = 0  # statements since the last new one
    for pair in statements(appearance, level, rng):
        unused += 1
        key = hash(pair)
        if key in seen and unused <= PATIENCE:
            continue
        if statement_digest(pair.statement) in shipped_digests() or _split_of(pair.program, appearance) != split:
            continue
        if unused <= PATIENCE:
            unused = 0
        seen.add(key)
        yield pair


def _plans(appearance: str, lengths: range, rng: Random) -> _Variants:
    """Starts from which shortest plans, proven shortest, have one of the lengths."""
    neighbours = _truths(appearance, lengths, rng) if lengths.start == 2 else None

    def variants(program: str) -> Iterator[_Variant]:
        if neighbours is not None:  # an edit and STOP
            yield from ((target, scene, 2) for target, scene, _ in neighbours(program))
        for target in rng.sample((True, False), 2):
            task = Task("", "", program, target, Scene.empty())
            for scene, steps in islice(_far_starts(appearance, lengths, rng, task), STARTS):
                yield target, scene, steps

    return variants


def _far_starts(appearance: str, lengths: range, rng: Random, task: Task) -> Iterator[tuple[Scene, int]]:
    """Starts of more than one edit: random scenes, each changed by one item as long as that does not bring it nearer to
    the goal, and scenes on the way from them. Ends early where the first PROBES are all near it."""
    sampler = sampler_of(appearance)
    solver = solver_of(appearance)
    dynamics = dynamics_of(appearance)
    min_edits = max(lengths.start - 1, 2)
    # The scene to change next, and how far at least it is from the goal
    near = None
    distance = 0
    for tries in range(TRIES):
        if tries == PROBES and 2 * distance < min_edits:
            return
        scene = sampler.scene(rng) if near is None else sampler.changed(rng, near)
        if task.solved_by(scene):
            continue
        state = State(task, scene, 0)
        solution = solver.solve_distant(state, min_edits)
        if solution.least_edits >= distance:
            near = scene
            distance = solution.least_edits
        ways: list[tuple[Scene, int]] = []  # scenes at least two edits from the goal, with the actions left
        for index, action in enumerate(solution.actions[:-2]):
            if solution.steps - index in lengths:
                ways.append((state.scene, solution.steps - index))
            state = dynamics.step(state, action).state
        yield from rng.sample(ways, min(1, len(ways)))


def _truths(appearance: str, lengths: range, rng: Random) -> _Variants:
    """Two scenes one edit apart, in one of which the statement is true."""
    pool = ScenePool.sample(appearance, rng, POOL_WALKS)

    def variants(program: str) -> Iterator[_Variant]:
        pair = next(near_misses(program, islice(pool.neighbours(rng), MOST_PAIRS)), ())
        yield from ((not start.label, start.scene, None) for start in rng.sample(pair, len(pair)))

    return variants


def _claims(appearance: str, lengths: range, rng: Random) -> _Variants:
    """The scenes of `_truths`, with one drawn target for both: the claim to have reached it holds in one of them."""
    truths = _truths(appearance, lengths, rng)

    def variants(program: str) -> Iterator[_Variant]:
        target = rng.random() < 0.5
        yield from ((target, scene, None) for _, scene, _ in truths(program))

    return variants


def _programs(appearance: str, lengths: range, rng: Random) -> _Variants:
    """Programs against which others can be checked."""
    return lambda program: iter([(True, Scene.empty(), None)] if is_checkable(program, appearance) else [])


_VARIANTS: Mapping[str, Callable[[str, range, Random], _Variants]] = {
    "plan": _plans,
    "truth": _truths,
    "verify": _claims,
    "program": _programs,
}
