"""The builtin corpus: that it matches its source, and keeps what docs/corpus.md promises of it."""

from __future__ import annotations

import gzip
import hashlib
import importlib.util
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus import TaskSet, Vocabulary, check_corpus, contexts, load_tasks
from lilgym_mp.corpus.forms import normalised, statement_form
from lilgym_mp.generator.interpretation import holds
from lilgym_mp.generator.statement_grammar import parse_statement
from lilgym_mp.rules import make_dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solver

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "data" / "builtin_source.toml"
SHIPPED = ROOT / "data" / "builtin.jsonl.gz"
SIZES = {"train": 1000, "dev": 150, "test": 300}
ALL_SPLITS = [(appearance, split) for appearance in APPEARANCES for split in SIZES]
LEAST_FORMS = 300
MOST_BYTES = 3_000_000


def scratch(appearance: str) -> list[TaskSet]:
    return [load_tasks("builtin", appearance, "scratch", split) for split in SIZES]


def starts(appearance: str, split: str) -> dict[str, list[Any]]:
    """FlipIt tasks by statement."""
    by_statement: dict[str, list[Any]] = {}
    for task in load_tasks("builtin", appearance, "flipit", split):
        by_statement.setdefault(task.statement, []).append(task)
    return by_statement


def test_builtin__has_no_faults():
    assert check_corpus("builtin").faults == ()


def test_builtin__is_small_and_is_the_file_its_checksum_is_of():
    sizes = {path.name: path.stat().st_size for path in SHIPPED.parent.iterdir() if path.is_file()}
    agents = {name: size for name, size in sizes.items() if name.startswith("agent-")}
    assert max(agents.values()) < MOST_BYTES
    assert sum(sizes.values()) - sum(agents.values()) < MOST_BYTES
    assert SHIPPED.with_name("builtin.sha256").read_text().strip() == hashlib.sha256(SHIPPED.read_bytes()).hexdigest()
    assert SHIPPED.read_bytes()[4:8] == bytes(4), "the gzip header tells a time"


@pytest.mark.parametrize("start", ["scratch", "flipit"])
@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__loads_to_what_a_copy_that_is_checked_loads_to(appearance: str, start: str, tmp_path: Path):
    text = gzip.decompress(SHIPPED.read_bytes())
    (tmp_path / "copy.jsonl").write_bytes(text + b"\n")
    copy = load_tasks(tmp_path / "copy.jsonl", appearance, start, "dev")
    shipped = load_tasks("builtin", appearance, start, "dev")
    assert copy.provenance.sha256 != shipped.provenance.sha256
    assert tuple(copy) == tuple(shipped)
    assert [copy.tags(task.id) for task in copy] == [shipped.tags(task.id) for task in shipped]


@pytest.mark.parametrize(("appearance", "split"), ALL_SPLITS)
def test_builtin__begins_with_the_statements_and_programs_of_its_source(appearance: str, split: str):
    source = tomllib.loads(SOURCE.read_text(encoding="utf-8"))[appearance][split]
    tasks = load_tasks("builtin", appearance, "scratch", split)
    assert len(tasks) == SIZES[split]
    by_hand = [(task.statement, task.program) for task in tasks if "hand-written" in tasks.tags(task.id)]
    assert by_hand == [(entry["statement"], entry["program"]) for entry in source]


@pytest.mark.parametrize(("appearance", "split"), ALL_SPLITS)
def test_builtin__every_statement_has_four_start_scenes_or_more_of_both_truth_values(appearance: str, split: str):
    tasks = load_tasks("builtin", appearance, "flipit", split)
    assert contexts(tasks) == 2 * SIZES[split]
    for mine in starts(appearance, split).values():
        assert len(mine) >= 4
        assert min(Counter(task.target for task in mine).values()) >= 2


@pytest.mark.parametrize(("appearance", "split"), ALL_SPLITS)
def test_builtin__start_scenes_come_in_pairs_one_item_apart_that_differ_in_truth(appearance: str, split: str):
    for statement, mine in starts(appearance, split).items():
        pairs = [pair for number, pair in enumerate(pairwise(mine[:4])) if number in (0, 2)]
        assert all(one.target != other.target for one, other in pairs), statement
        assert all(items_apart(one.start, other.start) <= 2 for one, other in pairs), statement


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__in_most_statements_some_pair_is_equally_full(appearance: str):
    mine = list(starts(appearance, "train").values())
    twins = sum(any(fullness(a) == fullness(b) for a, b in ((m[0], m[1]), (m[2], m[3]))) for m in mine)
    assert twins > 0.9 * len(mine)


def fullness(task: Any) -> int:
    return sum(1 for _ in task.start.items())


def items_apart(one: Scene, other: Scene) -> int:
    """How many items stand in one of the scenes only."""
    pairs = zip(one.boxes, other.boxes, strict=True)
    return sum(len(set(a.items) ^ set(b.items)) for a, b in pairs)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__statements_have_many_forms(appearance: str):
    forms = {statement_form(task.statement) for tasks in scratch(appearance) for task in tasks}
    assert len(forms) >= LEAST_FORMS


@pytest.mark.parametrize("split", ["dev", "test"])
@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__dev_and_test_tell_which_forms_train_has(appearance: str, split: str):
    train = {statement_form(task.statement) for task in load_tasks("builtin", appearance, "scratch", "train")}
    tasks = load_tasks("builtin", appearance, "scratch", split)
    seen = [statement_form(task.statement) in train for task in tasks]
    assert [
        ("seen form" if known else "unseen form") in tasks.tags(task.id)
        for task, known in zip(tasks, seen, strict=True)
    ]
    assert 0.2 < sum(seen) / len(seen) < 0.8


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__statements_that_can_be_read_say_what_their_start_scenes_are_labelled(appearance: str):
    for statement, mine in starts(appearance, "test").items():
        for reading in parse_statement(statement):
            assert all(holds(reading, task.start) != task.target for task in mine), statement


@pytest.mark.parametrize("start", ["scratch", "flipit"])
@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__the_expert_solves_it_within_the_horizon(appearance: str, start: str):
    solver = Solver(make_dynamics(APPEARANCES[appearance]))
    tasks = load_tasks("builtin", appearance, start, "test")
    assert [task.id for task in tasks[:: len(tasks) // 60] if not solver.solve(task).solved] == []


@pytest.fixture(scope="module")
def builder() -> Iterator[ModuleType]:
    sys.path.insert(0, str(ROOT / "scripts"))
    spec = importlib.util.spec_from_file_location("build_builtin_corpus", ROOT / "scripts" / "build_builtin_corpus.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    sys.path.remove(str(ROOT / "scripts"))


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__building_an_entry_again_gives_the_start_scenes_that_are_shipped(builder: ModuleType, appearance: str):
    shipped = {
        entry["statement"]: entry for entry in map(json.loads, gzip.decompress(SHIPPED.read_bytes()).splitlines()[1:])
    }
    maker = builder.Builder(appearance)
    for source in [source for source in builder.hand_written() if source.appearance == appearance][::40]:
        scenes = [start.scene.to_json() for start in maker.by_hand(source).starts]
        assert scenes == [start["scene"] for start in shipped[source.draft.statement]["starts"]]


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__few_statements_are_true_of_the_empty_scene(appearance: str):
    tasks = [task for split in scratch(appearance) for task in split]
    true_of_nothing = [task.statement for task in tasks if task.truth(Scene.empty())]
    assert len(true_of_nothing) < 0.05 * len(tasks)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__no_statement_stands_twice(appearance: str):
    statements = [normalised(task.statement) for split in scratch(appearance) for task in split]
    assert len(set(statements)) == len(statements)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__dev_and_test_use_the_words_of_train(appearance: str):
    train, dev, test = scratch(appearance)
    known = set(Vocabulary.from_statements(task.statement for task in train).words)
    right = [task.statement for tasks in (dev, test) for task in tasks if "mistyped" not in tasks.tags(task.id)]
    used = set(Vocabulary.from_statements(right).words)
    assert len(used - known) <= 0.05 * len(used)


def test_builtin__no_statement_is_an_official_one(official_data: Path):
    official = {
        normalised(task.statement)
        for appearance in APPEARANCES
        for split in ("train", "dev")
        for task in load_tasks(official_data, appearance, "scratch", split)
    }
    ours = {normalised(task.statement) for appearance in APPEARANCES for tasks in scratch(appearance) for task in tasks}
    assert not official & ours
