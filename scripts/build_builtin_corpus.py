"""Write data/builtin.jsonl.gz from hand-written and generated statements, and its statistics in docs/corpus.md.

The same source, generator and rules give identical bytes. Every statement is validated
(lilgym_mp.generator.meanings.validation) and the expert solves all its tasks. With LILGYM_DATA set, official statements
are excluded; their hashes are kept in data/builtin_excluded.txt, so that builds without the official data exclude the
same ones.
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

from builtin_report import SolvedEntry, write_report

from lilgym_mp.appearances import APPEARANCES, make_appearance
from lilgym_mp.corpus import check_corpus, load_tasks, words, write_corpus
from lilgym_mp.corpus.held_out import statement_digest
from lilgym_mp.corpus.tokens import normalised, statement_form
from lilgym_mp.generator import LEVELS, Draft, Entry, ScenePool, StartScene, drafts, validate_draft
from lilgym_mp.generator.meanings.generated_corpus import split_of
from lilgym_mp.generator.meanings.start_selection import TruthTable, select_starts
from lilgym_mp.generator.meanings.statement_grammar import parse_statement
from lilgym_mp.generator.meanings.validation import clear_scenes, is_clear, is_trivial
from lilgym_mp.generator.noise import with_typo
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
SIZES = {"train": 1000, "dev": 150, "test": 300}  # statements of each appearance
LEVEL_SHARES = {"tower": (28, 32, 20, 12, 8), "scatter": (22, 32, 24, 13, 9)}  # percent of generated statements
POOL_WALKS = 250
MAX_OF_FORM = 8  # statements of one split
MAX_WORDINGS = 3  # of one program
TYPO_SHARE, TRIVIAL_SHARE = 0.03, 0.04
FAR_CANDIDATES = 3  # scenes of each truth value from which the one that takes the most actions to flip is selected
SCENE_BUDGET = 8_000  # of the expert for one task
DRAFTS = 150  # per statement required of a level, before the level counts as exhausted
SPARE = 10  # additional statements of a split, in place of those that another split has too
LETTERS = "abcdefgh"


class Source(NamedTuple):
    """A hand-written statement."""

    appearance: str
    split: str
    draft: Draft


class Result(NamedTuple):
    """A split, and hashes of the official statements excluded from it."""

    entries: list[SolvedEntry]
    official: frozenset[str]


def hand_written() -> Iterator[Source]:
    for appearance, splits in tomllib.loads(SOURCE.read_text(encoding="utf-8")).items():
        for split, entries in splits.items():
            for entry in entries:
                yield Source(appearance, split, Draft(entry["statement"], entry["program"], 0))


class Builder:
    """Builds the entries of one appearance."""

    def __init__(self, appearance: str) -> None:
        self.appearance = appearance
        self.rng = random.Random(f"{SEED} {appearance}")
        self.pool = ScenePool.sample(appearance, self.rng, POOL_WALKS)
        self.solver = Solver(make_dynamics(make_appearance(appearance)), SCENE_BUDGET)

    def solved(self, entry: Entry, split: str, rng: random.Random) -> SolvedEntry | None:
        """The entry with additional start scenes, or None if the expert does not solve all its tasks."""
        starts = (*entry.starts, *self.far_starts(entry, rng))
        solution = self.solution(entry, Scene.empty(), target=True)
        others = [self.solution(entry, start.scene, target=not start.label) for start in starts]
        if not solution.solved or not all(other.solved for other in others):
            return None
        return SolvedEntry(
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
        """For each truth value, the clear scene that takes the most actions to flip, if more than two."""
        used = {start.scene for start in entry.starts}
        for label in (True, False):
            unused = (scene for scene in clear_scenes(entry, self.pool, label, rng) if scene not in used)
            candidates = islice(unused, FAR_CANDIDATES)
            steps = {scene: self.solution(entry, scene, target=not label).steps for scene in candidates}
            farthest = max(steps, key=lambda scene: steps[scene], default=None)
            if farthest is not None and steps[farthest] > 2:
                yield StartScene(farthest, label, steps[farthest] - 1)

    def hand_written_entry(self, source: Source) -> SolvedEntry:
        """Raises SystemExit for a hand-written statement that is not valid."""
        draft = source.draft
        rng = random.Random(f"{SEED} {draft.statement}")
        entry = self.validate_hand_written(draft, rng)
        solved = None if entry is None else self.solved(entry, source.split, rng)
        if solved is None:
            raise SystemExit(f"not valid: {draft.statement!r}, {draft.program}")
        return solved

    def validate_hand_written(self, draft: Draft, rng: random.Random) -> Entry | None:
        """As `validate_draft`, but the program is trusted; parses, if any, only help to choose the start scenes."""
        parses = parse_statement(draft.statement)
        truth = compile_program(draft.program).evaluate
        truths = TruthTable(self.pool, truth)
        edits = truths.edits_from_empty()
        starts = select_starts(truths, rng, lambda scene: is_clear(parses, scene, truth(scene)))
        return Entry(draft.statement, draft.program, 0, edits or 0, tuple(starts)) if starts else None

    def generated_entries(self, split: str, number: int, selection: Selection) -> Iterator[SolvedEntry]:
        """`number` statements; if a level has too few, the next level has more."""
        missing = 0
        for level, required in level_counts(self.appearance, number).items():
            rng = random.Random(f"{SEED} {self.appearance} {level}")  # the same in all splits, so that they share forms
            found = list(self.entries_of_level(level, split, required + missing, selection, rng))
            missing += required - len(found)
            yield from found
            print(f"{self.appearance} {split} level {level}: {len(found)} statements", file=sys.stderr, flush=True)
        if missing:
            raise SystemExit(f"{self.appearance} {split}: missing {missing} statements")

    def entries_of_level(
        self, level: int, split: str, number: int, selection: Selection, rng: random.Random
    ) -> Iterator[SolvedEntry]:
        """Up to `number` statements of the level."""
        validation_rng = random.Random(f"{SEED} {self.appearance} {split} {level}")
        for draft in islice(drafts(self.appearance, level, rng), DRAFTS * number):
            if number == 0:
                return
            if split_of(draft.program) != split or not selection.accepts(draft, split):
                continue
            entry = validate_draft(draft, self.pool, validation_rng)
            solved = None if entry is None else self.solved(entry, split, validation_rng)
            if solved is None:
                selection.reject(draft)
            else:
                number -= 1
                selection.add(solved)
                yield solved


class Selection:
    """Accepts drafts that keep the corpus varied: no duplicates or official statements, few trivial ones."""

    def __init__(self, selected: Iterable[SolvedEntry], statements: Iterable[str]) -> None:
        """`selected`: entries selected before; `statements`: others that are not accepted."""
        self.statements = set(map(normalised, statements))
        self.forms: Counter[tuple[str, str]] = Counter()
        self.programs: Counter[str] = Counter()
        self.trivial: Counter[str] = Counter()
        self.official: set[str] = set()
        for entry in selected:
            self.add(entry)

    def add(self, entry: SolvedEntry) -> None:
        self.statements.add(normalised(entry.statement))
        self.forms[entry.split, statement_form(entry.statement)] += 1
        self.programs[entry.program] += 1
        self.trivial[entry.split] += entry.steps == 1

    def reject(self, draft: Draft) -> None:
        self.statements.add(normalised(draft.statement))

    def accepts(self, draft: Draft, split: str) -> bool:
        if normalised(draft.statement) in self.statements or self.programs[draft.program] >= MAX_WORDINGS:
            return False
        if self.forms[split, statement_form(draft.statement)] >= MAX_OF_FORM:
            return False
        if is_official(draft.statement):
            self.official.add(statement_digest(draft.statement))
            return False
        return self.trivial[split] < TRIVIAL_SHARE * SIZES[split] or not is_trivial(draft)


def level_counts(appearance: str, number: int) -> dict[int, int]:
    """`number` divided among the levels; the highest level gets the remainder."""
    numbers = {level: number * share // 100 for level, share in zip(LEVELS, LEVEL_SHARES[appearance], strict=True)}
    numbers[LEVELS[-1]] += number - sum(numbers.values())
    return numbers


def is_official(statement: str) -> bool:
    """Whether the statement is official, or its hash was recorded as official before."""
    return statement_digest(statement) in excluded_hashes() or normalised(statement) in official_statements()


@cache
def excluded_hashes() -> frozenset[str]:
    return frozenset(EXCLUDED.read_text(encoding="ascii").split()) if EXCLUDED.exists() else frozenset()


@cache
def official_statements() -> frozenset[str]:
    """The normalised official train and dev statements; empty without LILGYM_DATA."""
    if not os.environ.get("LILGYM_DATA"):
        return frozenset()
    sets = (load_tasks("lilgym", a, "scratch", split) for a in APPEARANCES for split in ("train", "dev"))
    return frozenset(normalised(task.statement) for tasks in sets for task in tasks)


def build(appearance: str, split: str) -> Result:
    """The entries of a split: hand-written ones first, then generated ones in random order, SPARE too many."""
    builder = Builder(appearance)
    sources = [source for source in hand_written() if source.appearance == appearance]
    hand_written_entries = [builder.hand_written_entry(source) for source in sources if source.split == split]
    selection = Selection(hand_written_entries, (source.draft.statement for source in sources))
    generated = list(builder.generated_entries(split, SIZES[split] - len(hand_written_entries) + SPARE, selection))
    random.Random(f"{SEED} {appearance} {split}").shuffle(generated)
    return Result([*hand_written_entries, *generated], frozenset(selection.official))


def merged(results: Iterable[Result], appearance: str) -> list[SolvedEntry]:
    """All splits in order, truncated to their sizes, without statements of an earlier split."""
    seen: set[str] = set()
    entries: list[SolvedEntry] = []
    for result in results:
        unseen = [entry for entry in result.entries if normalised(entry.statement) not in seen]
        entries += unseen[: SIZES[result.entries[0].split]]
        seen.update(normalised(entry.statement) for entry in unseen)
    return list(with_typos(entries, random.Random(f"{SEED} {appearance} typos")))


def with_typos(entries: Sequence[SolvedEntry], rng: random.Random) -> Iterator[SolvedEntry]:
    """The entries, some with a typo."""
    known = {word for entry in entries for word in words(entry.statement)}
    for entry in entries:
        if entry.level and rng.random() < TYPO_SHARE:
            yield replace(entry, statement=with_typo(entry.statement, rng, known), mistyped=True)
        else:
            yield entry


def json_entries(appearance: str, entries: Sequence[SolvedEntry]) -> Iterator[dict[str, Any]]:
    """The entries in the file format, with tags."""
    train_forms = {statement_form(entry.statement) for entry in entries if entry.split == "train"}
    counts: Counter[str] = Counter()
    for entry in entries:
        counts[entry.split] += 1
        name = f"{appearance}-{entry.split}-{counts[entry.split]:03d}"
        tags = ["mistyped"] if entry.mistyped else []
        tags += [f"level {entry.level}" if entry.level else "hand-written"]
        if entry.split != "train":
            tags.append("seen form" if statement_form(entry.statement) in train_forms else "unseen form")
        yield {
            "id": name,
            "appearance": appearance,
            "split": entry.split,
            "statement": entry.statement,
            "program": entry.program,
            "starts": [
                {"id": f"{name}-{letter}", "label": start.label, "scene": start.scene.to_json()}
                for letter, start in zip(LETTERS, entry.starts, strict=False)
            ],
            "tags": tags,
        }


def write(out: Path, by_appearance: Mapping[str, Sequence[SolvedEntry]]) -> None:
    """Write the file and its checksum. Raises SystemExit if it has faults."""
    entries = [entry for appearance, own in by_appearance.items() for entry in json_entries(appearance, own)]
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
    by_appearance = {name: merged((results[name, split] for split in SIZES), name) for name in APPEARANCES}
    write(out, by_appearance)
    if out == TARGET:
        excluded = excluded_hashes().union(*(result.official for result in results.values()))
        EXCLUDED.write_text("".join(f"{value}\n" for value in sorted(excluded)), encoding="ascii")
        write_report(by_appearance, out, PAGE)


if __name__ == "__main__":
    main()
