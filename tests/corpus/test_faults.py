"""Faulty corpora: errors name the file, the place and the fault, and `check_corpus` finds all faults."""

import gzip
import json

import pytest

from lilgym_mp.corpus import CorpusError, NoTasksError, check_corpus, load_tasks
from tests.json_files import read_json

HEADER = b'{"format": "lilgym_mp-corpus", "version": 1, "name": "own", "licence": "MIT"}\n'
GOOD_ENTRY = (
    b'{"id":"a","appearance":"tower","split":"train","statement":"s","program":"exist(all_items)","starts":[]}\n'
)

FILE_FAULTS = {
    "empty": (b"", "the file is empty"),
    "rubbish": (b"\x00\xff\xfe\x81", r"not UTF-8 text: byte 0xff at offset 1"),
    "no header": (GOOD_ENTRY, "line 1: the first line must be the header"),
    "header is no JSON": (b"format\n", "line 1: the first line must be the header .*not JSON"),
    "header lacks a key": (b'{"format":"lilgym_mp-corpus","version":1,"licence":"MIT"}\n', "the header lacks name"),
    "header name": (HEADER.replace(b'"own"', b"5"), "name must be a text, not 5"),
    "truncated line": (HEADER + GOOD_ENTRY + GOOD_ENTRY[:40], "line 3: not JSON"),
    "nested": (HEADER + b"[" * 100_000, "line 2: .*nested too deeply"),
    "key twice": (HEADER + b'{"id":"a","id":"b"}\n', "line 2: duplicate key 'id'"),
    "truncated gzip": (gzip.compress(HEADER + GOOD_ENTRY)[:-12], "broken gzip file"),
}


@pytest.mark.parametrize("case", FILE_FAULTS)
def test_file__errors_name_the_file_and_the_fault(case, tmp_path):
    content, message = FILE_FAULTS[case]
    path = tmp_path / "own.jsonl"
    path.write_bytes(content)
    with pytest.raises(CorpusError, match=rf"own\.jsonl.*{message}"):
        load_tasks(path, "tower", "scratch", "train")
    assert not check_corpus(path).ok


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("gone.jsonl", r"no corpus .*gone\.jsonl.*choose from \"builtin\""),
        ("empty", r"lacks tower_scratch_train\.json; it has none of the released files"),
        ("odd", r"tower_scratch_train\.json: cannot be read"),
    ],
)
def test_path__of_no_corpus_is_an_error(name, message, tmp_path):
    for directory in ("empty", "odd/tower_scratch_train.json"):
        (tmp_path / directory).mkdir(parents=True)
    with pytest.raises(CorpusError, match=message):
        load_tasks(tmp_path / name, "tower", "scratch", "train")
    assert "none of the released files" in str(check_corpus(tmp_path / "empty"))


FAULTS = {
    "entry": [  # of the first entry
        ({"appearance": "towers"}, "unknown appearance 'towers'; choose from scatter"),
        ({"split": "eval"}, "unknown split 'eval'; choose from dev, test, train"),
        ({"statement": " "}, "statement must be a non-blank text"),
        ({"statement": "a \x1b[31m"}, r"statement has unprintable characters: 'a .x1b\[31m'"),
        ({"program": 3}, "program must be a non-blank text, not 3"),
        ({"starts": {}}, "starts must be a list"),
        ({"lf": "x"}, "an entry has keys .*it must have"),
        ({"tags": "easy"}, "tags must be a list of distinct, non-blank texts"),
        ({"tags": ["easy", "easy"]}, "tags must be a list of distinct, non-blank texts"),
        ({"id": "pair"}, "id 'pair' is already used: .*line 2"),
        ({"program": "open('x')"}, "entry 'blue'.*program"),
        ({"program": "count(all_items)"}, "entry 'blue'.* has no value on"),
        ({"program": "is_blue(unique(all_items))"}, "entry 'blue'.* has no value on the empty scene"),
    ],
    "start": [  # of its first start
        ({"id": "pair-no"}, "id 'pair-no' is already used"),
        ({"label": "true"}, "label must be true or false, not 'true'"),
        ({"label": False}, "start 'blue-yes': label is false but the program is true"),
        ({"scene": None}, "start 'blue-yes': scene: a scene must be a list"),
        ({"scene": [[], []]}, "start 'blue-yes': scene: a scene has 3 boxes, not 2"),
    ],
    "item": [  # of that one's first item
        ({"color": "Red"}, "box 0, item 0: unknown color 'Red'"),
        ({"y_loc": 10}, "start 'blue-yes': scene: box 0"),
    ],
}


@pytest.mark.parametrize(
    ("place", "change", "message"), [(place, *fault) for place, faults in FAULTS.items() for fault in faults]
)
def test_entry__errors_name_the_entry_and_the_fault(place, change, message, entries, written):
    entry = entries[0]
    start = entry["starts"][0]
    {"entry": entry, "start": start, "item": start["scene"][0][0]}[place].update(change)
    path = written(entries)
    with pytest.raises(CorpusError, match=rf"own\.jsonl, line [234].*{message}"):
        load_tasks(path, "tower", "flipit", "train")
    assert not check_corpus(path).ok


def test_scatter_entry__overlapping_items_are_faults(entries, written):
    circles = entries[2]["starts"][0]["scene"][1]
    circles.append({**circles[0], "x_loc": circles[0]["x_loc"] + 10})
    with pytest.raises(CorpusError, match="start 'round-yes': scene: box 1"):
        load_tasks(written(entries), "scatter", "flipit", "dev")


@pytest.mark.parametrize(
    ("text", "message"),
    {"[]": "the file must be a JSON object", '{"a": {': "not JSON", '{"a": 1, "a": 2}': "duplicate key 'a'"}.items(),
)
def test_released_file__errors_name_the_file(text, message, released):
    (released / "tower_scratch_test.json").write_text(text)
    with pytest.raises(CorpusError, match=rf"tower_scratch_test\.json: {message}"):
        load_tasks(released, "tower", "scratch", "test")
    report = check_corpus(released)
    assert [fault.where.rsplit("_", 1)[-1] for fault in report.faults] == ["test.json"]
    assert sum(count.tasks for count in report.counts) == 3  # the other file's are counted all the same


def test_check__every_fault_is_reported_once(entries, written):
    entries[0]["starts"][1]["label"] = True
    entries[1]["program"] = "count(all_items"
    entries[2]["split"] = "eval"
    found = [str(fault) for fault in check_corpus(written(entries)).faults]
    assert len(found) == 3
    for fault, message in zip(
        found, ("unknown split 'eval'", "program 'count(all_items'", "label is true"), strict=True
    ):
        assert message in fault


def test_check__all_faults_of_an_entry_are_reported_at_once(entries, written):
    item = entries[2]["starts"][0]["scene"][1][0]
    entries[2] |= {"statement": " ", "id": 5, "split": "eval", "note": "x"}
    entries[2]["starts"][0]["scene"] = [[], [{**item, "x_loc": 1.5}, {**item, "color": "Red"}], {}]
    entries[0] |= {"appearance": "towers", "program": "exist(", "tags": 3}
    entries[0]["starts"][0] |= {"label": "true", "id": " ", "scene": [[], []]}
    path = written(entries)
    path.write_text(path.read_text().replace('"MIT"', "3", 1))
    report = check_corpus(path)
    found = "\n".join(map(str, report.faults))
    for message in (
        "line 1: licence must be",
        "entry 'blue': unknown appearance",
        "entry 'blue': tags must",
        "never closed",
        "start ' ': id must",
        "start ' ': label must",
        "a scene has 3 boxes, not 2",
        "line 4: id must be a non-blank text, not 5",
        "line 4: an entry has keys",
        "line 4: statement must",
        "line 4: unknown split",
        "box 1, item 0: x_loc",
        "box 1, item 1: unknown color",
        "box 2: a box must be a list",
    ):
        assert message in found, message


def test_check__all_faults_of_a_released_entry_are_reported_at_once(released):
    path = released / "tower_flipit_test.json"
    content = read_json(path)
    content["blue-yes"] |= {"sentence": " ", "lf": "exist(", "label": "maybe", "structured_rep": [[], []]}
    content["blue-no"] = {**content.pop("blue-no"), "sentence": 5, "label": "true"}
    path.write_text(json.dumps(content))
    found = "\n".join(map(str, check_corpus(released).faults))
    for message in (
        "'blue-yes': statement must be",
        "'blue-yes': program 'exist('",
        "'blue-yes': label must be true",
        "'blue-yes': scene: a scene has 3 boxes",
        "'blue-no': statement must be a non-blank text, not 5",
        "'blue-no': label is true but",
    ):
        assert f"entry {message}" in found


def test_check__a_corpus_without_entries_is_a_fault(written, released):
    (released / "tower_scratch_train.json").write_text("{}")
    for path, name in ((written([]), "own.jsonl"), (released, "tower_scratch_train.json")):
        assert f"{name}: has no entries" in str(check_corpus(path))


def test_file__other_white_space_whole_floats_and_a_missing_licence_are_read(entries, written):
    entries[0]["statement"] = "There\u00a0is a\tblue block.\n"
    item = entries[0]["starts"][0]["scene"][0][0]
    item |= {key: float(item[key]) for key in ("x_loc", "y_loc", "size")}
    path = written(entries)
    path.write_text(path.read_text().replace(',"licence":"MIT"', "", 1))
    assert "licence" not in path.read_text()
    task = load_tasks(path, "tower", "flipit", "train")[0]
    assert task.statement == "There is a blue block."
    assert all(type(value) is int for item in task.start.items() for value in (item.x, item.y))


def test_file__no_tasks_for_a_split_names_those_there_are(entries, written):
    with pytest.raises(NoTasksError, match=r"'test'; it has flipit tasks of scatter dev, tower train"):
        load_tasks(written(entries), "tower", "flipit", "test")


def test_check__a_program_exceeding_the_step_limit_is_evaluated_on_one_scene(entries, written, monkeypatch):
    monkeypatch.setattr("lilgym_mp.programs.costs.STEP_LIMIT", 1_000_000)
    program = "exist(filter_obj(all_items, lambda {}: {}))"
    nested = "exist(all_items)"
    for variable in "abcdefgh":
        nested = program.format(variable, nested)
    circles = [
        {"x_loc": 12 * column, "y_loc": 12 * row, "type": "circle", "color": "Black", "size": 10}
        for column in range(4)
        for row in range(2)
    ]
    starts = [{"id": f"s{n}", "label": True, "scene": [circles, circles, circles[n:]]} for n in range(4)]
    entries[2] |= {"program": nested, "starts": starts}
    (fault,) = check_corpus(written(entries)).faults
    assert "start 's0'" in fault.where
    assert "needs more than 1000000 steps on this scene" in fault.what


@pytest.mark.long
def test_check__counts_the_tasks_of_a_generated_corpus(monkeypatch):
    only = [load_tasks("generated:2", "tower", "flipit", "dev")]
    monkeypatch.setattr("lilgym_mp.corpus.checking.load_all_tasks", lambda corpus: only)
    report = check_corpus("generated:2")
    assert report.ok
    assert [count[:4] for count in report.counts] == [("tower", "flipit", "dev", len(only[0]))]


def test_check__an_invalid_generated_corpus_is_an_error():
    with pytest.raises(CorpusError, match="generated:9"):
        check_corpus("generated:9")


def test_check__missing_released_files_are_listed_but_not_faults(released):
    report = check_corpus(released)
    assert report.ok
    assert len(report.absent_files) == 10
    assert "tower_scratch_train.json" in report.absent_files


@pytest.mark.long
def test_check__the_official_train_and_dev_data_have_no_faults(official_data):
    report = check_corpus(official_data)
    assert report.faults == ()
