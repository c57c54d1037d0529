"""Write data/builtin.jsonl.gz and its figures in docs/corpus.md: statements written by hand, and generated ones.

The same source, generator and rules give the same bytes. Every statement is proven sound (see
lilgym_mp.generator.validation), every task of it is solved by the expert. With LILGYM_DATA set, statements that
are official ones are looked for too; the hashes of those met are kept in data/builtin_excluded.txt, so that a build
without the official data leaves out the same ones.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from builtin_report import Built, write_report

from lilgym_mp.appearances import APPEARANCES, make_appearance
from lilgym_mp.corpus import check_corpus, load_tasks, words, write_corpus
from lilgym_mp.corpus.forms import normalised, statement_form
from lilgym_mp.generator import LEVELS, Draft, Entry, ScenePool, StartScene, drafts, validate_draft
from lilgym_mp.generator.generated_corpus import split_of
from lilgym_mp.generator.noise import with_typo
from lilgym_mp.generator.start_selection import TruthTable, select_starts
from lilgym_mp.generator.statement_grammar import parse_statement
from lilgym_mp.generator.validation import clear_scenes, is_clear, is_trivial
from lilgym_mp.programs import compile_program
from lilgym_mp.rules import make_dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solution, Solver
from lilgym_mp.task import Task

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TARGET = ROOT / "data" / "builtin_source.toml", ROOT / "data" / "builtin.jsonl.gz"
EXCLUDED, CHECKSUM = ROOT / "data" / "builtin_excluded.txt", ROOT / "data" / "builtin.sha256"
PAGE = ROOT / "docs" / "corpus.md"
NAME, LICENCE = "lilgym_mp builtin corpus", "MIT"
SEED = 2023
SIZES = {"train": 1000, "dev": 150, "test": 300}  # statements of an appearance
LEVEL_SHARES = {"tower": (28, 32, 20, 12, 8), "scatter": (22, 32, 24, 13, 9)}  # percent of the generated ones
STOCK_SIZE = 250  # chains of scenes
MOST_OF_A_FORM = 8  # statements of one split
MOST_WORDINGS = 3  # of one program
TYPO_SHARE, TRIVIAL_SHARE = 0.03, 0.04
FAR_CANDIDATES = 3  # scenes of a truth value among which the one farthest from the other is looked for
SCENE_BUDGET = 8_000  # that the expert looks at for one task
DRAFTS = 150  # for each statement wanted of a level, before a level counts as exhausted
SPARE = 10  # statements of a split, to make up for those that another split has too
LETTERS = "abcdefgh"


class Source(NamedTuple):
    """A hand-written statement."""

    appearance: str
    split: str
    draft: Draft


class Result(NamedTuple):
    """A split, and hashes of the official statements that were left out of it."""

    entries: list[Built]
    official: frozenset[str]


def hand_written() -> Iterator[Source]:
    for appearance, splits in tomllib.loads(SOURCE.read_text(encoding="utf-8")).items():
        for split, entries in splits.items():
            for entry in entries:
                yield Source(appearance, split, Draft(entry["statement"], entry["program"], 0))


class Builder:
    """Everything needed to build the entries of one appearance."""

    def __init__(self, appearance: str) -> None:
        self.appearance = appearance
        self.rng = random.Random(f"{SEED} {appearance}")
        self.stock = ScenePool.sample(appearance, self.rng, STOCK_SIZE)
        self.solver = Solver(make_dynamics(make_appearance(appearance)), SCENE_BUDGET)

    def built(self, entry: Entry, split: str, rng: random.Random) -> Built | None:
        """The entry with far start scenes, if the expert solves all its tasks."""
        starts = (*entry.starts, *self.far_starts(entry, rng))
        solution = self.solution(entry, Scene.empty(), target=True)
        others = [self.solution(entry, start.scene, target=not start.label) for start in starts]
        if not solution.solved or not all(other.solved for other in others):
            return None
        return Built(
            split,
            entry.statement,
            entry.program,
            entry.level,
            solution.steps,
            solution.proven_optimal,
            starts,
            tuple(other.steps for other in others),
            sum(other.proven_optimal for other in others),
        )

    def solution(self, entry: Entry, start: Scene, *, target: bool) -> Solution:
        return self.solver.solve(Task("", entry.statement, entry.program, target, start))

    def far_starts(self, entry: Entry, rng: random.Random) -> Iterator[StartScene]:
        """For each truth value, the scene of some clear ones that needs the most actions, where that is over two."""
        taken = {start.scene for start in entry.starts}
        for label in (True, False):
            scenes = clear_scenes(entry, self.stock, label, rng)
            few = [
                scene for scene, _ in zip((s for s in scenes if s not in taken), range(FAR_CANDIDATES), strict=False)
            ]
            by_steps = {scene: self.solution(entry, scene, target=not label).steps for scene in few}
            farthest = max(by_steps, key=lambda scene: by_steps[scene], default=None)
            if farthest is not None and by_steps[farthest] > 2:
                yield StartScene(farthest, label, by_steps[farthest] - 1)

    def by_hand(self, source: Source) -> Built:
        """Raises SystemExit naming a hand-written statement that is not sound."""
        draft = source.draft
        rng = random.Random(f"{SEED} {draft.statement}")
        entry = self.entry_by_hand(draft, rng)
        built = None if entry is None else self.built(entry, source.split, rng)
        if built is None:
            raise SystemExit(f"not sound: {draft.statement!r}, {draft.program}")
        return built

    def entry_by_hand(self, draft: Draft, rng: random.Random) -> Entry | None:
        """As `validate_draft`, but the program is trusted; parses, if any, only help to choose the start scenes."""
        readings = parse_statement(draft.statement)
        truth = compile_program(draft.program).evaluate
        truths = TruthTable(self.stock, truth)
        edits = truths.edits_from_empty()
        starts = select_starts(truths, rng, lambda scene: is_clear(readings, scene, truth(scene)))
        return Entry(draft.statement, draft.program, 0, edits or 0, tuple(starts)) if starts else None

    def generated(self, split: str, number: int, chosen: Selection) -> Iterator[Built]:
        """That many sound statements; what one level lacks the next makes up for."""
        missing = 0
        for level, wanted in level_numbers(self.appearance, number).items():
            rng = random.Random(f"{SEED} {self.appearance} {level}")  # for all splits, so that they share forms
            found = list(self.of_level(level, split, wanted + missing, chosen, rng))
            missing += wanted - len(found)
            yield from found
            print(f"{self.appearance} {split} level {level}: {len(found)} statements", file=sys.stderr, flush=True)
        if missing:
            raise SystemExit(f"{self.appearance} {split}: {missing} statements too few")

    def of_level(self, level: int, split: str, number: int, chosen: Selection, rng: random.Random) -> Iterator[Built]:
        """That many statements, or fewer when the level has no more."""
        choices = random.Random(f"{SEED} {self.appearance} {split} {level}")
        for draft in islice(drafts(self.appearance, level, rng), DRAFTS * number):
            if number == 0:
                return
            if split_of(draft.program) != split or not chosen.wants(draft, split):
                continue
            entry = validate_draft(draft, self.stock, choices)
            built = None if entry is None else self.built(entry, split, choices)
            if built is None:
                chosen.refuse(draft)
            else:
                number -= 1
                chosen.add(built)
                yield built


class Selection:
    """What is in already, and so what is still wanted: varied, nothing twice, nothing official, little trivial."""

    def __init__(self, taken: Iterable[Built], statements: Iterable[str]) -> None:
        """`taken`: what is in; `statements`: what must not come in, whoever has it."""
        self.statements = set(map(normalised, statements))
        self.forms: Counter[tuple[str, str]] = Counter()
        self.programs: Counter[str] = Counter()
        self.trivial: Counter[str] = Counter()
        self.official: set[str] = set()
        for built in taken:
            self.add(built)

    def add(self, built: Built) -> None:
        self.statements.add(normalised(built.statement))
        self.forms[built.split, statement_form(built.statement)] += 1
        self.programs[built.program] += 1
        self.trivial[built.split] += built.steps == 1

    def refuse(self, draft: Draft) -> None:
        self.statements.add(normalised(draft.statement))

    def wants(self, draft: Draft, split: str) -> bool:
        if normalised(draft.statement) in self.statements or self.programs[draft.program] >= MOST_WORDINGS:
            return False
        if self.forms[split, statement_form(draft.statement)] >= MOST_OF_A_FORM:
            return False
        if is_official(draft.statement):
            self.official.add(statement_hash(draft.statement))
            return False
        return self.trivial[split] < TRIVIAL_SHARE * SIZES[split] or not is_trivial(draft)


def level_numbers(appearance: str, number: int) -> dict[int, int]:
    """How many of `number` statements are of each level; the largest level takes what rounding leaves."""
    numbers = {level: number * share // 100 for level, share in zip(LEVELS, LEVEL_SHARES[appearance], strict=True)}
    numbers[LEVELS[-1]] += number - sum(numbers.values())
    return numbers


def is_official(statement: str) -> bool:
    """Whether the statement is an official one, or was found to be one before."""
    return statement_hash(statement) in excluded_hashes() or normalised(statement) in official_statements()


def statement_hash(statement: str) -> str:
    return hashlib.sha256(f"lilgym_mp builtin {normalised(statement)}".encode()).hexdigest()[:16]


@cache
def excluded_hashes() -> frozenset[str]:
    return frozenset(EXCLUDED.read_text(encoding="ascii").split()) if EXCLUDED.exists() else frozenset()


@cache
def official_statements() -> frozenset[str]:
    """The official train and dev statements, normalised; none without LILGYM_DATA."""
    if not os.environ.get("LILGYM_DATA"):
        return frozenset()
    sets = (load_tasks("lilgym", a, "scratch", split) for a in APPEARANCES for split in ("train", "dev"))
    return frozenset(normalised(task.statement) for tasks in sets for task in tasks)


def build(appearance: str, split: str) -> Result:
    """The entries of a split: the hand-written ones first, then generated ones in random order, with some spare."""
    builder = Builder(appearance)
    sources = [source for source in hand_written() if source.appearance == appearance]
    by_hand = [builder.by_hand(source) for source in sources if source.split == split]
    chosen = Selection(by_hand, (source.draft.statement for source in sources))
    generated = list(builder.generated(split, SIZES[split] - len(by_hand) + SPARE, chosen))
    random.Random(f"{SEED} {appearance} {split}").shuffle(generated)
    return Result([*by_hand, *generated], frozenset(chosen.official))


def merged(results: Iterable[Result], appearance: str) -> list[Built]:
    """The splits one after the other, each at its size, without what an earlier one has."""
    seen: set[str] = set()
    entries: list[Built] = []
    for result in results:
        fresh = [built for built in result.entries if normalised(built.statement) not in seen]
        entries += fresh[: SIZES[result.entries[0].split]]
        seen.update(normalised(built.statement) for built in fresh)
    return list(with_typos(entries, random.Random(f"{SEED} {appearance} typos")))


def with_typos(entries: Sequence[Built], rng: random.Random) -> Iterator[Built]:
    """The entries, some mistyped."""
    known = {word for built in entries for word in words(built.statement)}
    for built in entries:
        if built.level and rng.random() < TYPO_SHARE:
            yield replace(built, statement=with_typo(built.statement, rng, known), mistyped=True)
        else:
            yield built


def json_entries(appearance: str, entries: Sequence[Built]) -> Iterator[dict[str, Any]]:
    """The entries as lines of the file; forms are seen when train has them."""
    train_forms = {statement_form(built.statement) for built in entries if built.split == "train"}
    numbers: Counter[str] = Counter()
    for built in entries:
        numbers[built.split] += 1
        name = f"{appearance}-{built.split}-{numbers[built.split]:03d}"
        tags = ["mistyped"] if built.mistyped else []
        tags += [f"level {built.level}" if built.level else "hand-written"]
        if built.split != "train":
            tags.append("seen form" if statement_form(built.statement) in train_forms else "unseen form")
        yield {
            "id": name,
            "appearance": appearance,
            "split": built.split,
            "statement": built.statement,
            "program": built.program,
            "starts": [
                {"id": f"{name}-{letter}", "label": start.label, "scene": start.scene.to_json()}
                for letter, start in zip(LETTERS, built.starts, strict=False)
            ],
            "tags": tags,
        }


def write(out: Path, built: Mapping[str, Sequence[Built]]) -> None:
    """The file and its checksum. Raises SystemExit with the faults when it has any."""
    entries = [entry for appearance, mine in built.items() for entry in json_entries(appearance, mine)]
    sections = Counter(f"{entry['appearance']} {entry['split']}" for entry in entries)
    write_corpus(out, NAME, LICENCE, entries, sections)
    found = check_corpus(out)
    if not found.ok:
        raise SystemExit(str(found))
    checksum = CHECKSUM if out == TARGET else out.with_suffix(".sha256")
    checksum.write_text(hashlib.sha256(out.read_bytes()).hexdigest() + "\n", encoding="ascii")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=TARGET, help="file to write (default: %(default)s)")
    out = parser.parse_args().out
    parts = [(appearance, split) for appearance in APPEARANCES for split in SIZES]
    with ProcessPoolExecutor(len(parts)) as workers:
        results = dict(zip(parts, workers.map(build, *zip(*parts, strict=True)), strict=True))
    built = {name: merged((results[name, split] for split in SIZES), name) for name in APPEARANCES}
    write(out, built)
    if out == TARGET:
        met = excluded_hashes().union(*(result.official for result in results.values()))
        EXCLUDED.write_text("".join(f"{value}\n" for value in sorted(met)), encoding="ascii")
        write_report(built, out, PAGE)


if __name__ == "__main__":
    main()
