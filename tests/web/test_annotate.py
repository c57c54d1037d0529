"""/annotate: the paper's annotation procedure, from import to export."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.corpus import check_corpus, load_tasks, write_corpus
from lilgym_mp.corpus.jsonlines import flipit_entries
from lilgym_mp.programs import ProgramError
from lilgym_mp.programs.syntax import parse
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Scene
from lilgym_mp.web.authentication import issue_operator_token
from lilgym_mp.web.program_evaluator import MAX_REQUESTS, ProgramEvaluationError, ProgramEvaluator, QuotaExceeded
from lilgym_mp.web.routes.tutorial import TASKS
from lilgym_mp.web.store.database import open_database
from lilgym_mp.web.store.models import Base
from tests.web.web_app import Browser, server

API = "/api/annotate"
BLUE = "exist(filter_obj(all_items, lambda x: is_blue(x)))"
TUTORIAL_PROGRAMS = {
    "exist": BLUE,
    "count": "equal_int(count(filter_obj(all_boxes, lambda b: exist(filter_obj(b, lambda x: "
    "AND(is_black(x), is_bottom(x)))))), 2)",
    "faithful": "All(filter_obj(all_items, lambda x: is_triangle(x)), lambda x: is_yellow(x))",
    "touching": "exist(filter_obj(all_items, lambda x: AND(is_circle(x), is_touching_wall(x))))",
}


def _block(colour: str) -> dict[str, Any]:
    return {"x_loc": 40, "y_loc": 80, "type": "square", "color": colour, "size": 20}


def nlvr_file(count: int) -> bytes:
    """NLVR JSON lines: statements about a blue block, each with one scene where it is true and one where it is not."""
    lines = []
    for index in range(count):
        for scene, label in (([[_block("#0099ff")], [], []], "true"), ([[_block("Black")], [], []], "false")):
            identifier = f"{index}-{int(label == 'true')}"
            sentence = f"Statement {index} says that something is blue."
            line = {"sentence": sentence, "identifier": identifier, "label": label, "structured_rep": scene}
            lines.append(json.dumps(line))
    return "\n".join(lines).encode()


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Any]:
    with server(tmp_path, program_processes=1, program_seconds=20.0) as made:
        yield made


@pytest.fixture
def organiser(app: Any) -> Browser:
    return Browser(app).log_in("Olga", "organiser")


def imported(organiser: Browser, data: bytes, **query: Any) -> dict[str, Any]:
    response = organiser.post(f"{API}/imports", content=data, params=query)
    assert response.status_code == 200, response.text
    return response.json()


def assigned(organiser: Browser, *names: str, statements: int = 1, each: int = 1) -> list[Browser]:
    """Logged-in browsers of annotators who have been assigned a batch."""
    browsers = [Browser(organiser.app).log_in(name) for name in names]
    people = {line["name"]: line["id"] for line in organiser.get(f"{API}/people").json()}
    body = {
        "name": f"batch of {', '.join(names)}",
        "people": [people[name] for name in names],
        "statements": statements,
        "annotators_each": each,
    }
    assert organiser.post(f"{API}/batches", body).status_code == 201
    return browsers


def first_assignment(browser: Browser) -> str:
    """The API path of the first assignment."""
    return f"{API}/assignments/{browser.get(f'{API}/assignments').json()[0]['id']}"


def submit(browser: Browser, path: str, program: str, key: str = "k1", **more: Any) -> Any:
    return browser.post(f"{path}/submissions", {"key": key, "program": program, **more})


def test_procedure__from_import_to_a_valid_corpus_file(organiser: Browser, tmp_path: Path):
    assert imported(organiser, nlvr_file(3)) == {"read": 3, "added": 3, "faults": 0, "first_faults": []}
    (ada,) = assigned(organiser, "Ada", statements=3)
    for line in ada.get(f"{API}/assignments").json():
        path = f"{API}/assignments/{line['id']}"
        body = ada.get(path).json()
        assert body["hidden_scenes"] == 1
        run = ada.post(f"{path}/run", {"program": BLUE}).json()
        assert run["agrees"]
        assert run["truth"] is body["label"]
        response = submit(ada, path, BLUE, confidence=5)
        assert response.json()["verdict"] == "accepted", response.text
    export = organiser.get(f"{API}/export")
    assert export.status_code == 200
    file = tmp_path / "annotated.jsonl"
    file.write_bytes(export.content)
    report = check_corpus(file)
    assert report.ok, str(report)
    assert [count.tasks for count in report.counts if count.start == "flipit" and count.tasks] == [6]
    statistics = organiser.get(f"{API}/statistics").json()
    assert (statistics["statements"], statistics["collected"], statistics["kept"]) == (3, 3, 3)
    assert statistics["annotators"][0]["accepted"] == 3
    assert statistics["median_seconds"] >= 0


def test_hidden_scenes__never_reach_the_annotator(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    path = first_assignment(ada)
    body = ada.get(path).json()
    always = "True" if body["label"] else "False"
    response = submit(ada, path, always)
    assert response.status_code == 201
    assert response.json()["verdict"] == "failed"
    texts = [ada.get(path).text, response.text, ada.get(f"{API}/history").text]
    hidden = "black square" if body["label"] else "blue square"
    assert "square" in texts[0]
    assert not any(hidden in text for text in texts)
    assert set(response.json()) == {"id", "verdict", "message"}


def test_submission__that_disagrees_with_the_shown_scene_is_refused(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    path = first_assignment(ada)
    response = submit(ada, path, f"NOT({BLUE})")
    assert response.status_code == 409
    assert "does not agree with the shown scene" in response.json()["message"]
    assert ada.get(f"{API}/history").json() == []


def test_submission__sent_twice_is_stored_once(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    path = first_assignment(ada)
    answers = [submit(ada, path, BLUE, key="same").json() for _ in range(3)]
    assert answers[0] == answers[1] == answers[2]
    assert len(ada.get(f"{API}/history").json()) == 1


def test_submission__history_lists_all_newest_first(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    path = first_assignment(ada)
    always = "True" if ada.get(path).json()["label"] else "False"
    submit(ada, path, always, key="one", comment="a guess")
    submit(ada, path, BLUE, key="two", question="Is a <b>blue</b> circle meant?")
    history = ada.get(f"{API}/history").json()
    assert [line["verdict"] for line in history] == ["accepted", "failed"]
    assert history[0]["question"] == "Is a <b>blue</b> circle meant?"


def test_program__invalid_or_too_long_is_refused_and_changes_nothing(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    path = first_assignment(ada)
    for program in ("", "   ", "exist(", "unknown(all_items)", "x" * 9_000, "x" * 10_000_000):
        for where in ("run", "submissions"):
            response = ada.post(f"{path}/{where}", {"program": program, "key": "k"})
            assert response.status_code == (413 if len(program) > 9_000 else 422), program[:20]
            assert response.json()["message"]
    assert ada.get(path).json()["state"] == "open"


def test_program__failing_on_the_shown_scene_says_why(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    run = ada.post(f"{first_assignment(ada)}/run", {"program": "is_blue(all_items)"}).json()
    assert run["truth"] is None
    assert "must be an item" in run["fault"]


def test_program__failing_on_the_empty_scene_is_refused(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    response = submit(ada, first_assignment(ada), "is_blue(unique(all_items))")
    assert response.status_code == 409
    assert "fails on a scene without items" in response.json()["message"]


def test_evaluator__kills_a_slow_program_and_recovers():
    evaluator = ProgramEvaluator(1, 0.000001)
    try:
        with pytest.raises(ProgramEvaluationError, match="took longer than"):
            asyncio.run(evaluator.evaluate("Ada", BLUE, [Scene.empty()] * 50_000))
        evaluator._seconds = 30.0
        assert asyncio.run(evaluator.evaluate("Ada", BLUE, [Scene.empty()])).truths == [False]
    finally:
        evaluator.close()


def test_evaluator__runs_one_program_of_a_person_at_a_time_and_limits_those_waiting():
    async def evaluate_all() -> list[str]:
        ended: list[str] = []

        async def run(name: str, scenes: int) -> None:
            try:
                await evaluator.evaluate(name, BLUE, [Scene.empty()] * scenes)
                ended.append(name)
            except QuotaExceeded:
                ended.append(f"{name} refused")

        await asyncio.gather(*(run("Ada", 30_000) for _ in range(MAX_REQUESTS + 1)), run("Bob", 1), run("Bob", 1))
        return ended

    evaluator = ProgramEvaluator(1, 60.0)
    try:
        ended = asyncio.run(evaluate_all())
    finally:
        evaluator.close()
    assert ended == ["Ada refused", "Ada", "Bob", "Ada", "Bob", "Ada", "Ada"]


def test_annotators__can_neither_see_nor_change_each_others_assignments(organiser: Browser):
    imported(organiser, nlvr_file(2))
    ada, bob = assigned(organiser, "Ada", "Bob", statements=2)
    path = first_assignment(ada)
    assert ada.get(path).status_code == 200
    assert bob.get(path).status_code == 404
    assert bob.get(path.replace("/api", "").replace("/assignments", "")).status_code == 404
    for where, body in (
        ("run", {"program": BLUE}),
        ("submissions", {"program": BLUE, "key": "k"}),
        ("skip", {"key": "k", "reason": "other"}),
    ):
        assert bob.post(f"{path}/{where}", body).status_code == 404
    assert bob.send("PUT", f"{path}/draft", {"program": "x", "version": 0}).status_code == 404
    assert bob.get(f"{API}/history").json() == []
    assert ada.get(path).json()["state"] == "open"


@pytest.mark.parametrize("path", ["people", "batches", "reviews", "statistics", "export"])
def test_organiser_routes__are_closed_to_annotators_and_anonymous_visitors(app: Any, path: str):
    assert Browser(app).log_in("Ada").get(f"{API}/{path}").status_code == 403
    assert Browser(app).get(f"{API}/{path}").status_code == 401


def test_draft__a_stale_tab_cannot_overwrite_a_newer_draft(organiser: Browser):
    imported(organiser, nlvr_file(1))
    (ada,) = assigned(organiser, "Ada")
    path = f"{first_assignment(ada)}/draft"
    assert ada.send("PUT", path, {"program": "exist(", "version": 0}).json() == {"version": 1}
    assert ada.send("PUT", path, {"program": "exist(", "version": 0}).json() == {"version": 1}
    response = ada.send("PUT", path, {"program": "count(", "version": 0})
    assert response.status_code == 409
    assert "another tab" in response.json()["message"]
    assert ada.get(first_assignment(ada)).json()["draft"] == "exist("


def test_assignment__survives_a_restart(tmp_path: Path):
    with server(tmp_path) as app:
        organiser = Browser(app).log_in("Olga", "organiser")
        imported(organiser, nlvr_file(1))
        (ada,) = assigned(organiser, "Ada")
        path = first_assignment(ada)
        ada.send("PUT", f"{path}/draft", {"program": "exist(", "version": 0})
        ada.post(f"{path}/skip", {"key": "k", "reason": "ambiguous", "comment": "two readings"})
        cookies = dict(ada.client.cookies)
        before = ada.get(path).json()
    with server(tmp_path) as app:
        again = Browser(app)
        again.client.cookies.update(cookies)
        assert again.get(path).json() == before
        assert before["submissions"][0]["reason"] == "ambiguous"


def test_redistribution__assigns_skipped_and_disputed_statements_to_others(organiser: Browser):
    imported(organiser, nlvr_file(3))
    (ada,) = assigned(organiser, "Ada", statements=3)
    skipped, disputed, kept = (line["id"] for line in ada.get(f"{API}/assignments").json())
    ada.post(f"{API}/assignments/{skipped}/skip", {"key": "k", "reason": "too hard"})
    for number in (disputed, kept):
        ada.get(f"{API}/assignments/{number}")
        submit(ada, f"{API}/assignments/{number}", BLUE)
    reviews = organiser.get(f"{API}/reviews").json()
    sent = [statement["submissions"][0]["id"] for statement in reviews]
    note = {"verdict": "disputed", "note": "Shorter, please."}
    assert organiser.post(f"{API}/submissions/{sent[1]}/reviews", note).status_code == 204
    assert organiser.post(f"{API}/submissions/{sent[2]}/reviews", {"verdict": "kept"}).status_code == 204
    bob = Browser(organiser.app).log_in("Bob")
    people = {line["name"]: line["id"] for line in organiser.get(f"{API}/people").json()}
    body = {"name": "second round", "people": [people["Ada"], people["Bob"]]}
    assert organiser.post(f"{API}/redistributions", body).json()["assignments"] == 2
    assert len(bob.get(f"{API}/assignments").json()) == 2
    assert [line["note"] for line in ada.get(f"{API}/history").json()] == ["", "Shorter, please.", ""]
    statistics = organiser.get(f"{API}/statistics").json()
    assert (statistics["collected"], statistics["kept"], statistics["disputed"]) == (2, 1, 1)
    again = organiser.post(f"{API}/redistributions", {**body, "name": "third round"})
    assert again.status_code == 409


def test_agreement__compares_truth_values_and_not_texts(organiser: Browser):
    imported(organiser, nlvr_file(2))
    ada, bob = assigned(organiser, "Ada", "Bob", statements=2, each=2)
    programs = {
        0: (BLUE, "exist(filter_color(all_items, Color.BLUE))"),
        1: (BLUE, "AND(exist(filter_color(all_items, Color.BLUE)), count(all_items) == 1)"),
    }
    for browser, place in ((ada, 0), (bob, 1)):
        for number, line in enumerate(browser.get(f"{API}/assignments").json()):
            response = submit(browser, f"{API}/assignments/{line['id']}", programs[number][place])
            assert response.json()["verdict"] == "accepted", response.text
    towers = [[_block("#0099ff"), {**_block("Black"), "y_loc": 59}], [], []]
    more = {"sentence": "More.", "identifier": "m-0", "label": "true", "structured_rep": towers}
    imported(organiser, json.dumps(more).encode())
    same, other = organiser.get(f"{API}/reviews").json()
    assert same["agreement"] == 1.0
    assert same["compared_scenes"] == 6
    assert other["agreement"] == pytest.approx(5 / 6, abs=1e-4)


def _add(organiser: Browser, name: str, role: str = "annotator") -> tuple[str, str]:
    """A new person's login path, and the path of the API for the person."""
    path = organiser.post(f"{API}/people", {"name": name, "role": role}).json()["path"]
    (number,) = [line["id"] for line in organiser.get(f"{API}/people").json() if line["name"] == name]
    return path, f"{API}/people/{number}"


def _opened(app: Any, path: str) -> Browser:
    """A browser that has opened the login link."""
    browser = Browser(app)
    assert browser.get(path, follow_redirects=False).status_code == 303
    return browser


@pytest.mark.parametrize("ending", ["revoked", "replaced", "revoked, then issued anew"])
def test_links__revoking_or_replacing_one_ends_its_logins_for_good(organiser: Browser, ending: str):
    path, person = _add(organiser, "Eve")
    eve = _opened(organiser.app, path)
    assert eve.get(f"{API}/assignments").status_code == 200
    if ending != "replaced":
        assert organiser.send("DELETE", f"{person}/token").status_code == 204
    if ending != "revoked":
        new_path = organiser.post(f"{person}/token").json()["path"]
        assert _opened(organiser.app, new_path).get(f"{API}/assignments").status_code == 200
    assert eve.get(f"{API}/assignments").status_code == 401
    assert Browser(organiser.app).get(path).status_code == 401


@pytest.mark.parametrize("name", ["organiser", "Organiser", " ORGANISER "])
def test_people__the_name_of_the_organiser_who_starts_the_server_is_reserved(organiser: Browser, name: str):
    with organiser.app.state.services.database.write_session() as session:
        printed = f"/login?token={issue_operator_token(session)}"
    response = organiser.post(f"{API}/people", {"name": name})
    assert response.status_code == 409
    assert "reserved" in response.json()["message"]
    (number,) = [line["id"] for line in organiser.get(f"{API}/people").json() if line["name"] == "organiser"]
    for method, path, body in (
        ("POST", "token", None),
        ("DELETE", "token", None),
        ("PUT", "role", {"role": "annotator"}),
    ):
        response = organiser.send(method, f"{API}/people/{number}/{path}", body)
        assert response.status_code == 409
        assert "starts the server" in response.json()["message"]
    assert _opened(organiser.app, printed).get(f"{API}/people").status_code == 200


def test_people__a_taken_name_is_refused_and_changes_nothing(organiser: Browser):
    path, _ = _add(organiser, "Eve")
    response = organiser.post(f"{API}/people", {"name": "Eve", "role": "organiser"})
    assert response.status_code == 409
    assert "already annotator 'Eve'" in response.json()["message"]
    assert _opened(organiser.app, path).get(f"{API}/people").status_code == 403


def test_people__a_changed_role_applies_to_existing_logins(organiser: Browser):
    path, person = _add(organiser, "Eve")
    eve = _opened(organiser.app, path)
    assert eve.get(f"{API}/people").status_code == 403
    assert organiser.send("PUT", f"{person}/role", {"role": "organiser"}).status_code == 204
    assert eve.get(f"{API}/people").status_code == 200
    response = eve.send("PUT", f"{person}/role", {"role": "annotator"})
    assert response.status_code == 409
    assert "your own" in response.json()["message"]


def test_import__reads_the_corpus_format_and_reports_errors(organiser: Browser, tmp_path: Path):
    tasks = load_tasks("builtin", "scatter", "flipit", "dev")
    entries = list(flipit_entries(tasks))[:5]
    write_corpus(tmp_path / "some.jsonl.gz", "some", "CC0-1.0", entries)
    data = (tmp_path / "some.jsonl.gz").read_bytes()
    assert imported(organiser, data)["added"] == 5
    assert imported(organiser, data)["added"] == 0
    broken = b'{"sentence": "S.", "identifier": "1-0", "label": "maybe", "structured_rep": []}\n{"sentence": 1}\nno'
    body = imported(organiser, broken)
    assert (body["read"], body["faults"]) == (0, 3)
    assert "label must be true or false" in body["first_faults"][0]
    for data in (b"", b"\xff\xfe", b"\x1f\x8b broken"):
        response = organiser.post(f"{API}/imports", content=data)
        assert response.status_code == 422
        assert "the file" in response.json()["message"]


def test_language__lists_every_word_with_signature_and_documentation(app: Any):
    body = Browser(app).get(f"{API}/language").json()
    words = {word["name"]: word for word in body["words"]}
    assert {name for name, word in words.items() if word["is_function"]} == set(WORDS)
    assert all(word["signature"] and word["meaning"] for word in words.values())
    assert {"all_boxes", "Color.BLUE", ".is_tower()", "lambda"} <= set(words)


@pytest.mark.parametrize("program", [BLUE, "exist(all_itmes)", "exist((", "a ; b", "lambda: 1", ""])
def test_check__reports_the_parsers_error(app: Any, program: str):
    body = Browser(app).post(f"{API}/check", {"program": program}).json()
    if body["ok"]:
        parse(program)
        return
    with pytest.raises(ProgramError) as fault:
        parse(program)
    assert (body["offset"], body["message"]) == (fault.value.offset, fault.value.reason)


def test_tutorial__tasks_can_be_solved_and_stay_solved(app: Any):
    ada = Browser(app).log_in("Ada")
    assert {task.name for task in TASKS} == set(TUTORIAL_PROGRAMS)
    for name, program in TUTORIAL_PROGRAMS.items():
        response = ada.post(f"{API}/tutorial/{name}/submissions", {"program": program})
        assert response.json()["verdict"] == "accepted", (name, response.text)
    assert all(task["solved"] for task in ada.get(f"{API}/tutorial").json())
    assert ada.post(f"{API}/tutorial/none/run", {"program": BLUE}).status_code == 404
    spurious = {"program": "exist(filter_obj(all_items, lambda x: is_triangle(x)))"}
    assert ada.post(f"{API}/tutorial/faithful/submissions", spurious).json()["verdict"] == "failed"


@pytest.mark.parametrize("path", ["", "/guidelines", "/tutorial", "/organise"])
def test_pages__load_for_an_organiser(organiser: Browser, path: str):
    assert organiser.get(f"/annotate{path}").status_code == 200


def test_pages__ask_anonymous_visitors_to_log_in(app: Any):
    assert "to log in" in Browser(app).get("/annotate").text
    assert Browser(app).get("/annotate/tutorial").status_code == 401


def test_database__migrations_create_the_schema_of_the_models(tmp_path: Path):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    database = open_database(f"sqlite:///{tmp_path / 'web.sqlite3'}")
    with database.engine.connect() as connection:
        differences = compare_metadata(MigrationContext.configure(connection), Base.metadata)
    database.close()
    assert differences == []
