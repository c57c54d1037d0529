"""The builtin corpus: that it matches its source, and keeps what docs/corpus.md promises of it."""

from __future__ import annotations

import gzip
import importlib.util
import json
import re
import sys
import tomllib
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus import TaskSet, Vocabulary, check_corpus, contexts, load_tasks, words
from lilgym_mp.scene import Scene

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "data" / "builtin_source.toml"
SHIPPED = ROOT / "data" / "builtin.jsonl.gz"
BUILDER = ROOT / "scripts" / "build_builtin_corpus.py"
SIZES = {"train": 100, "dev": 25, "test": 25}
ALL_SPLITS = [(appearance, split) for appearance in APPEARANCES for split in SIZES]


def scratch(appearance: str) -> list[TaskSet]:
    return [load_tasks("builtin", appearance, "scratch", split) for split in SIZES]


def test_builtin__has_no_faults():
    assert check_corpus("builtin").faults == ()


@pytest.mark.parametrize(("appearance", "split"), ALL_SPLITS)
def test_builtin__holds_the_statements_and_programs_of_its_source(appearance: str, split: str):
    source = tomllib.loads(SOURCE.read_text(encoding="utf-8"))[appearance][split]
    tasks = load_tasks("builtin", appearance, "scratch", split)
    assert len(tasks) == SIZES[split]
    assert [(task.statement, task.program) for task in tasks] == [(e["statement"], e["program"]) for e in source]


@pytest.mark.parametrize(("appearance", "split"), ALL_SPLITS)
def test_builtin__every_statement_has_start_scenes_of_both_truth_values(appearance: str, split: str):
    tasks = load_tasks("builtin", appearance, "flipit", split)
    assert contexts(tasks) == 2 * SIZES[split]
    assert all(number >= 2 for number in Counter((task.statement, task.target) for task in tasks).values())


@pytest.mark.parametrize(("appearance", "split"), ALL_SPLITS)
def test_builtin__every_statement_has_scenes_one_item_apart_that_differ_in_truth(appearance: str, split: str):
    tasks = load_tasks("builtin", appearance, "flipit", split)
    for statement in {task.statement for task in tasks}:
        mine = [task for task in tasks if task.statement == statement]
        assert any(a.target != b.target and items_apart(a.start, b.start) == 1 for a in mine for b in mine), statement


def items_apart(one: Scene, other: Scene) -> int:
    """How many items stand in one of the scenes only."""
    pairs = zip(one.boxes, other.boxes, strict=True)
    return sum(len(set(a.items) ^ set(b.items)) for a, b in pairs)


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build_builtin_corpus", BUILDER)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("number", range(0, 300, 37))
def test_builtin__building_an_entry_again_gives_what_is_shipped(builder: ModuleType, number: int):
    shipped = gzip.decompress(SHIPPED.read_bytes()).decode().splitlines()[1 + number]
    assert builder.build(list(builder.statements())[number]).entry == json.loads(shipped)


def test_builtin__tower_statements_need_few_edits_from_the_empty_scene(builder: ModuleType):
    tasks = [task for split in scratch("tower") for task in split]
    near = builder.tower_layer(0) + builder.tower_layer(1) + builder.tower_layer(2) + builder.tower_layer(3)
    assert sum(any(task.truth(scene) for scene in near) for task in tasks) > 0.9 * len(tasks)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__few_statements_are_true_of_the_empty_scene(appearance: str):
    tasks = [task for split in scratch(appearance) for task in split]
    true_of_nothing = [task.statement for task in tasks if task.truth(Scene.empty())]
    assert len(true_of_nothing) < 0.05 * len(tasks)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__no_statement_stands_twice(appearance: str):
    statements = [" ".join(words(task.statement)) for split in scratch(appearance) for task in split]
    assert len(set(statements)) == len(statements)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_builtin__dev_and_test_use_the_words_of_train(appearance: str):
    train, dev, test = scratch(appearance)
    known = set(Vocabulary.from_statements(task.statement for task in train).words)
    used = set(Vocabulary.from_statements(task.statement for tasks in (dev, test) for task in tasks).words)
    assert len(used - known) <= 0.05 * len(used)


def test_builtin__no_statement_is_an_official_one(official_data: Path):
    official = {
        plain(task.statement)
        for appearance in APPEARANCES
        for split in ("train", "dev")
        for task in load_tasks(official_data, appearance, "scratch", split)
    }
    assert not [
        task
        for appearance in APPEARANCES
        for s in scratch(appearance)
        for task in s
        if plain(task.statement) in official
    ]


def plain(statement: str) -> str:
    """The statement without case, punctuation and double blanks."""
    return " ".join(re.sub(r"[^a-z0-9 ]", "", statement.lower()).split())
