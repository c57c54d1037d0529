"""The builtin corpus matches its source and has the properties documented in docs/corpus.md."""

import gzip
import hashlib
import tomllib
from itertools import pairwise

import pytest

from lilgym_mp.corpus import check_corpus, load_tasks
from lilgym_mp.corpus.splits import program_form
from lilgym_mp.corpus.tokens import normalised, statement_form
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.grouping import grouped
from tests.scenes import items_apart
from tests.scripts import ROOT

SOURCE = ROOT / "data" / "builtin_source.toml"
SHIPPED = ROOT / "data" / "builtin.jsonl.gz"
SIZES = {"train": 1000, "dev": 150, "test": 300}
MOST_BYTES = 3_000_000


def scratch(appearance):
    return [load_tasks("builtin", appearance, "scratch", split) for split in SIZES]


def starts(appearance, split):
    """FlipIt tasks by statement."""
    return grouped((task.statement, task) for task in load_tasks("builtin", appearance, "flipit", split))


@pytest.mark.long
def test_forms__of_held_out_programs_are_not_in_train_however_they_are_written():
    first = "exist(filter_obj(all_items, lambda x: is_blue(x) and is_top(x)))"
    assert program_form(first) == program_form("exist(filter_obj(all_items, lambda y: (is_top(y) and is_black(y))))")
    for appearance in APPEARANCES:
        train, dev = (load_tasks("builtin:form", appearance, "scratch", split) for split in ("train", "dev"))
        assert not {program_form(task.program) for task in train} & {program_form(task.program) for task in dev}


@pytest.mark.long
def test_builtin__has_no_faults():
    assert check_corpus("builtin").faults == ()
    assert sum(count.tasks for count in check_corpus("builtin:form").counts) > 0


def test_builtin__is_small_and_has_the_recorded_checksum():
    sizes = {path.name: path.stat().st_size for path in SHIPPED.parent.iterdir() if path.is_file()}
    agents = {name: size for name, size in sizes.items() if name.startswith("agent-")}
    assert max(agents.values()) < MOST_BYTES
    assert sum(sizes.values()) - sum(agents.values()) < MOST_BYTES
    assert SHIPPED.with_name("builtin.sha256").read_text().strip() == hashlib.sha256(SHIPPED.read_bytes()).hexdigest()
    assert SHIPPED.read_bytes()[4:8] == bytes(4), "the gzip header has a timestamp"


@pytest.mark.parametrize(("appearance", "start"), [("tower", "flipit"), ("scatter", "scratch")])
@pytest.mark.long
def test_builtin__loads_like_a_validated_copy(appearance, start, tmp_path):
    text = gzip.decompress(SHIPPED.read_bytes())
    (tmp_path / "copy.jsonl").write_bytes(text + b"\n")
    copy = load_tasks(tmp_path / "copy.jsonl", appearance, start, "dev")
    shipped = load_tasks("builtin", appearance, start, "dev")
    assert copy.provenance.sha256 != shipped.provenance.sha256
    assert tuple(copy) == tuple(shipped)
    assert [task.tags for task in copy] == [task.tags for task in shipped]


@pytest.mark.parametrize("split", SIZES)
def test_builtin__has_the_statements_and_programs_of_its_source(appearance, split):
    source = tomllib.loads(SOURCE.read_text())[appearance][split]
    tasks = load_tasks("builtin", appearance, "scratch", split)
    assert len(tasks) == SIZES[split]
    hand_written = [(task.statement, task.program) for task in tasks if "hand-written" in task.tags]
    assert hand_written == [(entry["statement"], entry["program"]) for entry in source]


@pytest.mark.parametrize("split", SIZES)
@pytest.mark.long
def test_builtin__start_scenes_form_pairs_one_item_apart_with_different_truth_values(appearance, split):
    found = starts(appearance, split)
    assert len(found) == SIZES[split]
    for statement, tasks in found.items():
        assert len(tasks) >= 4
        pairs = [pair for number, pair in enumerate(pairwise(tasks[:4])) if number in (0, 2)]
        assert all(one.target != other.target for one, other in pairs), statement
        assert all(items_apart(one.start, other.start) <= 2 for one, other in pairs), statement


@pytest.mark.parametrize("split", ["dev", "test"])
def test_builtin__dev_and_test_tag_the_forms_seen_in_train(appearance, split):
    train = {statement_form(task.statement) for task in load_tasks("builtin", appearance, "scratch", "train")}
    tasks = load_tasks("builtin", appearance, "scratch", split)
    seen = [statement_form(task.statement) in train for task in tasks]
    assert all(("seen form" if known else "unseen form") in task.tags for task, known in zip(tasks, seen, strict=True))
    assert 0.2 < sum(seen) / len(seen) < 0.8


def test_builtin__statements_are_distinct(appearance):
    statements = [normalised(task.statement) for split in scratch(appearance) for task in split]
    assert len(set(statements)) == len(statements)


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_builtin__no_statement_is_an_official_one():
    official = {
        normalised(task.statement)
        for appearance in APPEARANCES
        for split in ("train", "dev")
        for task in load_tasks("lilgym", appearance, "scratch", split)
    }
    ours = {normalised(task.statement) for appearance in APPEARANCES for tasks in scratch(appearance) for task in tasks}
    assert not official & ours
