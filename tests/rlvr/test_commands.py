"""`lilgym-mp prompts` and `lilgym-mp score`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lilgym_mp.cli import main
from lilgym_mp.contrib.rlvr import KINDS, Row
from lilgym_mp.wrappers.text import image_part, picture


def written(path: Path, *lines: object) -> str:
    path.write_text("".join(line if isinstance(line, str) else json.dumps(line) + "\n" for line in lines))
    return str(path)


@pytest.mark.parametrize("kind", KINDS)
def test_prompts__with_answers_score_fully(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    prompts = tmp_path / "prompts.jsonl"
    command = ["llm", "prompts", "--kind", kind, "--level", "2", "--episodes", "4", "--out", str(prompts)]
    assert main(command) == 0
    rows = [json.loads(line) for line in prompts.read_text().splitlines()]
    assert [set(row) & {"prompt", "answer"} for row in rows] == [{"prompt"}] * 4
    assert main(command) == 2
    assert "--force overwrites it" in capsys.readouterr().err
    assert main([*command, "--expert-answers", "--force"]) == 0
    rows = [json.loads(line) for line in prompts.read_text().splitlines()]
    replies = written(tmp_path / "replies.jsonl", *({"id": row["id"], "reply": row["answer"]} for row in rows[:3]))
    assert main(["llm", "score", str(prompts), "--answers", replies, "--out", str(tmp_path / "scores.json")]) == 0
    assert main(["llm", "score", str(prompts), "--answers", replies, "--out", replies]) == 2
    shown = capsys.readouterr().out
    assert "success   75.0% (3 of 4; 95 % interval over statements " in shown
    assert "outcomes  missing 1, success 3" in shown
    summary = json.loads((tmp_path / "scores.json").read_text())
    assert (summary["success"], summary["rows_without_reply"], len(summary["scores"])) == (0.75, 1, 4)


def test_score__repeated_lines_count_once_and_samples_give_pass_at_k(tmp_path: Path):
    prompts, scores = str(tmp_path / "prompts.jsonl"), tmp_path / "scores.json"
    assert main(["llm", "prompts", "--kind", "truth", "--episodes", "2", "--expert-answers", "--out", prompts]) == 0
    first, second = (json.loads(line) for line in Path(prompts).read_text().splitlines())
    right = {"id": first["id"], "reply": first["answer"]}
    samples = [{**right, "sample": 0}, *[{"id": first["id"], "reply": "?", "sample": n} for n in (1, 2, 3)]]
    others = [{"id": second["id"], "reply": f"maybe {n}"} for n in range(4)]
    for lines, success, passed, replies in (
        ([right] * 500, 0.5, {}, 1),  # and the second prompt has no reply
        ([*samples, *others], 0.125, {"pass@1": 0.125, "pass@2": 0.25, "pass@4": 0.5}, 8),
    ):
        answers = written(tmp_path / "replies.jsonl", *lines)
        assert main(["llm", "score", prompts, "--answers", answers, "--out", str(scores), "--force"]) == 0
        summary = json.loads(scores.read_text())
        assert (summary["success"], summary["pass"], summary["replies"]) == (success, passed, replies)
    assert summary["reasons"] == {"no line is true or false": 7}
    assert summary["scores"][1] == {
        "id": first["id"],
        "sample": 1,
        "reward": 0.0,
        "outcome": "not_understood",
        "details": {"reason": "no line is true or false"},
    }


def test_prompts__as_pictures_have_a_base64_image_of_the_start(tmp_path: Path):
    prompts = tmp_path / "prompts.jsonl"
    command = ["llm", "prompts", "--kind", "truth", "--episodes", "1", "--scene", "image", "--out", str(prompts)]
    assert main(command) == 0
    row = json.loads(prompts.read_text())
    ((shown, text),) = [message["content"] for message in row["messages"]]
    assert shown == image_part(picture(Row.from_json(row).task.start))
    assert row["task"]["statement"] in text["text"]
    assert "blue" not in text["text"].replace(row["task"]["statement"], "")


def test_score__thoughts_are_a_list_that_can_be_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    prompts = str(tmp_path / "prompts.jsonl")
    assert main(["llm", "prompts", "--kind", "truth", "--episodes", "1", "--expert-answers", "--out", prompts]) == 0
    row = json.loads(Path(prompts).read_text())
    wrong = {"true": "false", "false": "true"}[row["answer"]]
    answers = written(tmp_path / "a", {"id": row["id"], "reply": f"<hm>\n{wrong}\n</hm>\n{row['answer']}"})
    assert main(["llm", "score", prompts, "--answers", answers]) == 0
    assert "not_understood 1" in capsys.readouterr().out
    assert main(["llm", "score", prompts, "--answers", answers, "--thoughts", "hm"]) == 0
    assert "success   100.0%" in capsys.readouterr().out


def test_score__a_reply_of_nan_is_not_understood_and_a_cut_one_is_not_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    prompts = str(tmp_path / "prompts.jsonl")
    assert main(["llm", "prompts", "--kind", "truth", "--episodes", "2", "--expert-answers", "--out", prompts]) == 0
    first, second = (json.loads(line) for line in Path(prompts).read_text().splitlines())
    nan = {"id": first["id"], "reply": float("nan")}
    cut = {"id": second["id"], "reply": second["answer"], "finish_reason": "length"}
    answers = written(tmp_path / "a", nan, nan, cut)
    assert main(["llm", "score", prompts, "--answers", answers]) == 0
    assert "outcomes  cut 1, not_understood 1" in capsys.readouterr().out


def test_score__bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    prompts = str(tmp_path / "prompts.jsonl")
    assert main(["llm", "prompts", "--kind", "truth", "--episodes", "2", "--out", prompts]) == 0
    row = json.loads(Path(prompts).read_text().splitlines()[0])
    good = written(tmp_path / "good", {"id": row["id"], "reply": None})
    samples = [{"id": row["id"], "sample": 0, "reply": reply} for reply in ("true", "true", "false")]
    for file, replies, message in (
        (prompts, written(tmp_path / "a", {"id": "other", "reply": ""}), "has no row 'other'"),
        (prompts, written(tmp_path / "b", {"id": row["id"]}), "line 1: a reply must be an object"),
        (prompts, written(tmp_path / "c", "{\n"), "not JSON"),
        (prompts, written(tmp_path / "g", *samples), f"line 3: another reply to '{row['id']}' as sample 0: "),
        (prompts, written(tmp_path / "h", '{"id": "a", "reply": "", "reply": "x"}\n'), "duplicate key 'reply'"),
        (prompts, written(tmp_path / "d", "[" * 100_000), "not JSON"),
        (prompts, written(tmp_path / "e"), "the file is empty"),
        (prompts, str(tmp_path / "none"), "cannot be read: No such file"),
        (written(tmp_path / "f", {**row, "format": "lilgym_mp row 0"}), good, "line 1: a row must have the format"),
    ):
        assert main(["llm", "score", file, "--answers", replies]) == 2
        (line,) = capsys.readouterr().err.splitlines()[-1:]
        assert message in line
