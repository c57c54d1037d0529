"""`lilgym-mp prompts` and `lilgym-mp score`."""

import json

import pytest

from lilgym_mp.contrib.rlvr import KINDS, Row
from lilgym_mp.wrappers.text import image_part, picture
from tests.command_line import error_of, lilgym, output_of, succeeds
from tests.json_files import read_json, read_json_lines


def written(path, *lines):
    path.write_text("".join(line if isinstance(line, str) else json.dumps(line) + "\n" for line in lines))
    return str(path)


def rows_of(prompts, options):
    """The rows that `lilgym-mp llm prompts OPTIONS` writes."""
    succeeds(f"llm prompts {options} --out", prompts)
    return read_json_lines(prompts)


@pytest.fixture(scope="module")
def truths(tmp_path_factory):
    """A file of two prompts, and its rows with the expert's answers."""
    prompts = tmp_path_factory.mktemp("rows") / "prompts.jsonl"
    return prompts, rows_of(prompts, "--kind truth --episodes 2 --expert-answers")


@pytest.mark.parametrize("kind", KINDS)
def test_prompts__with_answers_score_fully(kind, tmp_path, capsys):
    prompts = tmp_path / "prompts.jsonl"
    command = f"--kind {kind} --level 2 --episodes 4"
    assert [set(row) & {"prompt", "answer"} for row in rows_of(prompts, command)] == [{"prompt"}] * 4
    assert "--force overwrites it" in error_of(capsys, f"llm prompts {command} --out", prompts)
    answered = rows_of(prompts, f"{command} --expert-answers --force")
    replies = written(tmp_path / "replies.jsonl", *({"id": row["id"], "reply": row["answer"]} for row in answered[:3]))
    succeeds(f"llm score {prompts} --answers {replies} --out", tmp_path / "scores.json")
    assert lilgym(f"llm score {prompts} --answers {replies} --out", replies) == 2
    shown = capsys.readouterr().out
    assert "success   75.0 % (3 of 4; 95 % interval over statements " in shown
    assert "outcomes  missing 1, success 3" in shown
    summary = read_json(tmp_path / "scores.json")
    assert (summary["success"], summary["rows_without_reply"], len(summary["scores"])) == (0.75, 1, 4)


def test_score__repeated_lines_count_once_and_samples_give_pass_at_k(truths, tmp_path):
    (prompts, (first, second)), scores = truths, tmp_path / "scores.json"
    right = {"id": first["id"], "reply": first["answer"]}
    samples = [{**right, "sample": 0}, *[{"id": first["id"], "reply": "?", "sample": n} for n in (1, 2, 3)]]
    others = [{"id": second["id"], "reply": f"maybe {n}"} for n in range(4)]

    def summary(*lines):
        answers = written(tmp_path / "replies.jsonl", *lines)
        succeeds(f"llm score {prompts} --answers {answers} --force --out", scores)
        return read_json(scores)

    once = summary(*[right] * 500)
    assert (once["success"], once["pass"], once["replies"]) == (0.5, {}, 1)  # the second prompt has no reply
    found = summary(*samples, *others)
    assert (found["success"], found["replies"]) == (0.125, 8)
    assert found["pass"] == {"pass@1": 0.125, "pass@2": 0.25, "pass@4": 0.5}
    assert found["reasons"] == {"no line is true or false": 7}


def test_prompts__as_pictures_have_a_base64_image_of_the_start(tmp_path):
    (row,) = rows_of(tmp_path / "prompts.jsonl", "--kind truth --episodes 1 --scene image")
    ((shown, text),) = [message["content"] for message in row["messages"]]
    assert shown == image_part(picture(Row.from_json(row).task.start))
    assert row["task"]["statement"] in text["text"]
    assert "blue" not in text["text"].replace(row["task"]["statement"], "")


def test_score__thoughts_are_a_list_that_can_be_set(truths, tmp_path, capsys):
    prompts, rows = truths
    replies = ({"id": row["id"], "reply": f"<hm>\ntrue\nfalse\n</hm>\n{row['answer']}"} for row in rows)
    command = f"llm score {prompts} --answers {written(tmp_path / 'a', *replies)}"
    assert "not_understood 2" in output_of(capsys, command)
    assert "success   100.0 %" in output_of(capsys, f"{command} --thoughts hm")


def test_score__a_reply_of_nan_is_not_understood_and_a_cut_one_is_not_read(truths, tmp_path, capsys):
    prompts, (first, second) = truths
    nan = {"id": first["id"], "reply": float("nan")}
    cut = {"id": second["id"], "reply": second["answer"], "finish_reason": "length"}
    answers = written(tmp_path / "a", nan, nan, cut)
    assert "outcomes  cut 1, not_understood 1" in output_of(capsys, f"llm score {prompts} --answers {answers}")


def test_score__bad_input_is_one_line(truths, tmp_path, capsys):
    prompts, (row, _) = truths
    good = written(tmp_path / "good", {"id": row["id"], "reply": None})
    samples = [{"id": row["id"], "sample": 0, "reply": reply} for reply in ("true", "true", "false")]
    for lines, message in (
        ([{"id": "other", "reply": ""}], "has no row 'other'"),
        ([{"id": row["id"]}], "line 1: a reply must be an object"),
        (["{\n"], "not JSON"),
        (samples, f"line 3: another reply to '{row['id']}' as sample 0: "),
        (['{"id": "a", "reply": "", "reply": "x"}\n'], "duplicate key 'reply'"),
        ([], "the file is empty"),
    ):
        assert lilgym(f"llm score {prompts} --answers", written(tmp_path / "replies", *lines)) == 2
        assert message in capsys.readouterr().err.splitlines()[-1]
    other = written(tmp_path / "other", {**row, "format": "lilgym_mp row 0"})
    for command, message in (
        (f"{prompts} --answers nowhere", "cannot be read: No such file"),
        (f"{other} --answers {good}", "line 1: a row must have the format"),
    ):
        assert lilgym(f"llm score {command}") == 2
        assert message in capsys.readouterr().err.splitlines()[-1]
