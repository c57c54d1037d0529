"""Endless rows: statements are new until their level has no more, and start scenes have the wanted distance."""

from __future__ import annotations

import random
from collections.abc import Iterator

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.choices import choose
from lilgym_mp.corpus.held_out import shipped_digests, statement_digest
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.scene_sampling import SAMPLERS
from lilgym_mp.generator import LEVELS, Entry, ScenePool, drafts, validate_draft
from lilgym_mp.generator.meanings.generated_corpus import split_of
from lilgym_mp.programs import compile_program
from lilgym_mp.rlvr.rows import KINDS, Row, dynamics_of, solver_of
from lilgym_mp.rlvr.scoring import checked_truths
from lilgym_mp.rules import State
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

STARTS = 4  # plan rows of a statement, before the next one
TRIES = 12  # scenes examined for a start
POOL_WALKS = 32
BARREN = 500  # statements in a row without a start of the wanted distance, after which there is none
PATIENCE = 3_000  # drafts without a new statement, after which statements are repeated


def rows(
    kind: str,
    appearance: str = "tower",
    level: int = 3,
    *,
    seed: int = 0,
    split: str = "train",
    min_actions: int = 2,
    max_actions: int | None = None,
) -> Iterator[Row]:
    """Endless rows, deterministic in the arguments.

    No statement with its program is repeated until PATIENCE drafts in a row gave no new one. The splits share no
    program, whatever their seeds, and no statement is one of the builtin or official dev and test statements.
    `min_actions`, `max_actions`: of the shortest plan from the start to the goal, STOP included; of plan rows only.
    Raises ValueError naming the value and the choices; while iterating, if there are no such starts.
    """
    choose("kind", kind, dict.fromkeys(KINDS))
    choose("appearance", appearance, APPEARANCES)
    choose("split", split, SPLITS)
    if level not in LEVELS:
        raise ValueError(f"unknown level {level!r}; choose from {', '.join(map(str, LEVELS))}")
    horizon = dynamics_of(appearance).horizon
    most = horizon if max_actions is None else max_actions
    if not 2 <= min_actions <= most <= horizon:
        raise ValueError(f"min_actions and max_actions must be 2 to {horizon}, ascending, not {min_actions} and {most}")
    return _rows(kind, appearance, level, seed, split, range(min_actions, most + 1))


def _rows(kind: str, appearance: str, level: int, seed: int, split: str, lengths: range) -> Iterator[Row]:
    rng = random.Random(f"rows {seed} {level} {appearance} {split}")
    number, barren = 0, 0
    for entry in _entries(appearance, level, split, rng):
        barren += 1
        if barren > BARREN:
            words = f"{lengths.start} to {lengths.stop - 1} actions" if kind == "plan" else "a checkable meaning"
            raise ValueError(f"{BARREN} {appearance} statements of level {level} in a row have no {kind} with {words}")
        pair = f"{appearance}-{kind}-{split}-{level}-{seed}-{number}" if kind == "truth" else None
        for target, scene, steps in _variants(kind, entry, appearance, lengths, rng):
            name = f"{appearance}-{kind}-{split}-{level}-{seed}-{number}"
            yield Row(kind, appearance, Task(name, entry.statement, entry.program, target, scene), level, steps, pair)
            number, barren = number + 1, 0


def _variants(
    kind: str, entry: Entry, appearance: str, lengths: range, rng: random.Random
) -> Iterator[tuple[bool, Scene, int | None]]:
    """Targets, scenes, and for plans the number of actions, of an entry's rows."""
    empty = Scene.empty()
    match kind:
        case "plan":
            yield from _plans(entry, appearance, lengths, rng)
        case "truth":  # the first two starts are one edit apart
            yield from ((not start.label, start.scene, None) for start in rng.sample(entry.starts[:2], 2))
        case "scene":
            yield not compile_program(entry.program)(empty), empty, None
        case _:
            if checked_truths(entry.program, appearance) is not None:
                yield True, empty, None


def _entries(appearance: str, level: int, split: str, rng: random.Random) -> Iterator[Entry]:
    pool = ScenePool.sample(appearance, rng, POOL_WALKS)
    seen: set[int] = set()
    unused = 0  # drafts since the last new statement
    for draft in drafts(appearance, level, rng):
        unused += 1
        key = hash((draft.statement, draft.program))
        if split_of(draft.program) != split or (key in seen and unused <= PATIENCE):
            continue
        entry = None if statement_digest(draft.statement) in shipped_digests() else validate_draft(draft, pool, rng)
        if entry is not None:
            if key not in seen:
                seen.add(key)
                unused = 0
            yield entry


def _plans(entry: Entry, appearance: str, lengths: range, rng: random.Random) -> Iterator[tuple[bool, Scene, int]]:
    """Targets with starts from which shortest plans have one of the lengths, and that length."""
    for _ in range(STARTS):
        target = rng.random() < 0.5
        found = _start(entry, target, appearance, lengths, rng)
        if found is not None:
            yield target, *found


def _start(entry: Entry, target: bool, appearance: str, lengths: range, rng: random.Random) -> tuple[Scene, int] | None:
    """Random scenes, each changed by one item as long as that does not bring it nearer to the goal."""
    sampler, solver = SAMPLERS[appearance], solver_of(appearance)
    task = Task("", entry.statement, entry.program, target, Scene.empty())
    near: tuple[Scene, int] | None = None
    for _ in range(TRIES):
        scene = sampler.scene(rng) if near is None else sampler.changed(rng, near[0])
        if task.solved_by(scene):
            continue
        solution = solver.solve_from(State(task, scene, 0))
        if not solution.proven_optimal:
            near = None
        elif solution.steps in lengths:
            return scene, solution.steps
        elif solution.steps < lengths.start and (near is None or solution.steps >= near[1]):
            near = scene, solution.steps
    return None
