"""/annotate: the paper's annotation procedure for one statement."""

import json
from dataclasses import replace
from itertools import product

import pytest

from lilgym_mp.corpus import load_tasks, write_corpus
from lilgym_mp.programs import ProgramError
from lilgym_mp.programs.syntax import parse
from lilgym_mp.programs.vocabulary import vocabulary
from lilgym_mp.programs.words import WORDS
from tests.corpora import small_entries
from tests.stress.program_language import ATTACKS
from tests.web.web_app import Browser, assert_refused, server

API = "/api/annotate"
STATEMENT_ID = "tower-dev-001"
QUERY = {"appearance": "tower", "split": "dev", "statement_id": STATEMENT_ID}
BLUE = "exist(filter_obj(all_items, lambda x: is_blue(x)))"


def scenes_of():
    """The FlipIt tasks of the statement, in file order."""
    scratch = load_tasks("builtin", "tower", "scratch", "dev").by_id(STATEMENT_ID)
    flipit = load_tasks("builtin", "tower", "flipit", "dev")
    return [task for task in flipit if (task.statement, task.program) == (scratch.statement, scratch.program)]


def right_program():
    return scenes_of()[0].program


def overfitted(shown):
    """A program that has the statement's value in the first `shown` scenes, and the wrong one in another."""
    tasks = scenes_of()
    program = tasks[0].program
    for number, word in product(range(30), ("AND", "OR")):
        candidate = f"{word}({program}, count(all_items) < {number})"
        agrees = [replace(task, program=candidate).truth(task.start) is task.truth(task.start) for task in tasks]
        if all(agrees[:shown]) and not all(agrees):
            return candidate
    raise AssertionError("no such program")


def submit(browser, program, query=QUERY, **more):
    return browser.post(f"{API}/annotations", {"program": program, "name": "Ada", **more}, params=query)


def test_procedure__from_the_statement_to_json_lines(browser):
    (entry,) = [each for each in browser.get(f"{API}/statements").json() if each["id"] == STATEMENT_ID]
    body = browser.get(f"{API}/statement", params=QUERY).json()
    tasks = scenes_of()
    assert body["statement"] == entry["statement"] == tasks[0].statement
    assert len(body["shown"]) + body["hidden"] == len(tasks)
    labels = [shown["label"] for shown in body["shown"]]
    assert labels == [task.truth(task.start) for task in tasks[: len(labels)]]
    values = browser.post(f"{API}/run", {"program": tasks[0].program}, params=QUERY).json()
    assert [value["truth"] for value in values] == labels
    assert all(value["parts"] for value in values)
    answer = submit(browser, tasks[0].program)
    assert (answer.status_code, answer.json()["accepted"]) == (201, True)
    done = [each["id"] for each in browser.get(f"{API}/statements", params={"name": "Ada"}).json() if each["done"]]
    assert done == [STATEMENT_ID]
    download = browser.get(f"{API}/annotations")
    assert "annotations.jsonl" in download.headers["content-disposition"]
    (line,) = map(json.loads, download.text.splitlines())
    assert (line["name"], line["program"], line["accepted"]) == ("Ada", tasks[0].program, True)
    assert line["statement_id"] == STATEMENT_ID


def test_hidden_scenes__check_a_submission_and_never_reach_the_annotator(browser):
    shown = browser.get(f"{API}/statement", params=QUERY).json()["shown"]
    answer = submit(browser, overfitted(len(shown)))
    assert (answer.status_code, answer.json()["accepted"]) == (201, False)
    assert set(answer.json()) == {"accepted", "message"}
    assert not any(each["done"] for each in browser.get(f"{API}/statements", params={"name": "Ada"}).json())
    (line,) = map(json.loads, browser.get(f"{API}/annotations").text.splitlines())
    assert line["accepted"] is False


@pytest.mark.parametrize(
    ("program", "said"),
    {
        "NOT({})": "does not agree with the shown scenes",
        "(count(all_items) > 0 or is_blue(unique(all_items))) and {}": "fails on a scene without items",
    }.items(),
)
def test_submission__that_a_shown_or_an_empty_scene_contradicts_is_refused_and_not_saved(browser, program, said):
    assert_refused(submit(browser, program.format(right_program())), 409, said)
    assert browser.get(f"{API}/annotations").text == ""


@pytest.mark.parametrize(
    "given", [{"program": "   "}, {"program": "exist("}, {"program": "x" * 9_000}, {"name": "  "}, {"name": "x" * 81}]
)
def test_submission__without_a_name_or_a_program_is_refused(browser, given):
    assert_refused(submit(browser, **{"program": right_program(), **given}), 422)


def test_run__of_an_invalid_program_is_refused(browser):
    assert browser.post(f"{API}/run", {"program": "exist("}, params=QUERY).status_code == 422


@pytest.mark.parametrize(
    ("program", "fault"), {"is_blue(all_items)": "must be an item", ATTACKS["sorting seven boxes"]: ""}.items()
)
def test_program__that_fails_or_takes_too_many_steps_has_no_value(browser, program, fault, monkeypatch):
    monkeypatch.setattr("lilgym_mp.programs.costs.STEP_LIMIT", 1_000_000)
    for value in browser.post(f"{API}/run", {"program": program}, params=QUERY).json():
        assert value["truth"] is None
        assert value["fault"]
        assert fault in value["fault"]
        assert len(value["parts"]) < 1_000


def test_vocabulary__has_every_word_with_signature_and_documentation():
    words = {word.name: word for word in vocabulary()}
    assert {name for name, word in words.items() if word.is_function} == set(WORDS)
    assert all(word.signature and word.meaning for word in words.values())
    assert {"all_boxes", "Color.BLUE", ".is_tower()", "lambda"} <= set(words)


@pytest.mark.parametrize("program", [BLUE, "exist(all_itmes)", "exist((", "a ; b", "lambda: 1", ""])
def test_check__reports_the_parsers_error(browser, program):
    body = browser.post(f"{API}/check", {"program": program}).json()
    if body["ok"]:
        parse(program)
        return
    with pytest.raises(ProgramError) as fault:
        parse(program)
    assert (body["offset"], body["message"]) == (fault.value.offset, fault.value.reason)


def test_annotation__posted_twice_is_one_row(browser):
    program = right_program()
    answers = [submit(browser, program, name=name) for name in ("Ada", "Ada", "Bea")]
    assert {answer.status_code for answer in answers} == {201}
    assert len(browser.get(f"{API}/annotations").text.splitlines()) == 2


def test_statement_without_a_program__is_shown_and_annotated_by_the_labels_of_its_scenes(tmp_path):
    blue, pair, _ = small_entries()
    entries = [{**blue, "program": None}, {**pair, "program": None, "starts": []}]
    write_corpus(tmp_path / "open.jsonl", "open", "MIT", entries)
    with server(tmp_path, corpus=str(tmp_path / "open.jsonl")) as app:
        browser = Browser(app)
        place = {"appearance": "tower", "split": "train"}
        shown = browser.get("/api/explore/statement", params={**place, "statement_id": "blue"}).json()
        assert shown["program"] is None
        assert [scene["truth"] for scene in shown["scenes"]] == [None, True, False]
        listed = browser.get(f"{API}/statements", params=place).json()
        assert [each["id"] for each in listed] == ["blue", "pair"]
        for program, status in (("exist(all_items)", 201), ("not exist(all_items)", 409)):
            answer = submit(browser, program, {**place, "statement_id": "blue"})
            assert answer.status_code == status
        assert browser.get("/explore", params=place).status_code == 200
        assert browser.get("/play").status_code == 200
