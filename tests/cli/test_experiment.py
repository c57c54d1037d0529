"""`lilgym-mp experiment`: what a file may ask for, and that its runs are made once, resumed and reported on."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pytest

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.experiment import minutes, row
from lilgym_mp.cli.experiment_plan import PlannedRun, read_plan
from lilgym_mp.cli.experiment_runs import Attempt, Standing, attempts, carry_out
from tests.own_corpus import write_own_corpus

FILES = Path(__file__).parents[2] / "experiments"
SMALL = """
configurations = ["TowerScratch"]
[[learners]]
learner = "ppo"
"""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize("file", sorted(FILES.glob("*.toml")), ids=lambda file: file.stem)
def test_plan__files_that_come_with_the_project_can_be_run(file: Path, request: pytest.FixtureRequest):
    if tomllib.loads(file.read_text())["corpus"] == "lilgym":
        request.getfixturevalue("official_data")
    plan = read_plan(file)
    assert len({planned.name for planned in plan}) == len(plan)


def test_plan__is_the_matrix_of_learners_configurations_and_seeds(tmp_path: Path):
    text = """
    splits = ["dev", "test"]
    configurations = ["TowerScratch", "TowerFlipIt"]
    seeds = [0, 7]
    policies = ["expert"]
    horizon = 9
    [[learners]]
    learner = "parse-and-plan"
    steps = 30
    [[learners]]
    learner = "ppo"
    name = "forced"
    configurations = ["TowerFlipIt"]
    stop_forcing = true
    """
    plan = read_plan(written(tmp_path / "a.toml", text))
    assert [planned.name for planned in plan] == [
        *("parse-and-plan-0", "parse-and-plan-7", "forced-TowerFlipIt-0", "forced-TowerFlipIt-7", "policies"),
    ]
    assert plan[1].train == ("train", "parse-and-plan", "--seed", "7", "--corpus", "builtin", "--steps", "30")
    assert plan[1].budget == ("step", 30)
    assert " ".join(plan[2].train) == "train ppo TowerFlipIt --seed 0 --corpus builtin --horizon 9 --stop-forcing"
    assert [words[-1] for words in plan[2].evaluate] == ["dev", "test"]
    assert plan[4].train == ()


def test_plan__a_learner_may_be_trained_on_another_corpus_and_imitation_plays_both_starts(tmp_path: Path):
    text = f"""
    corpus = "{tmp_path / "own.jsonl"}"
    configurations = ["TowerScratch", "TowerFlipIt"]
    [[learners]]
    learner = "parse-and-plan"
    corpus = "builtin"
    [[learners]]
    learner = "imitation"
    configurations = ["TowerFlipIt"]
    """
    write_own_corpus(tmp_path / "own.jsonl")
    parser, imitation = read_plan(written(tmp_path / "a.toml", text))
    assert parser.train[-2:] == ("--corpus", "builtin")
    assert imitation.train[-2:] == ("--corpus", str(tmp_path / "own.jsonl"))
    for planned in (parser, imitation):
        (words,) = planned.evaluate
        chosen = words.index("--configuration")
        assert words[chosen + 1 : chosen + 5] == (
            "TowerScratch",
            "TowerFlipIt",
            "--corpus",
            str(tmp_path / "own.jsonl"),
        )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("colour = 1\n" + SMALL, "colour: unknown key; choose from corpus, splits, configurations"),
        (SMALL + "speed = 3", r"learners\[0\]\.speed: unknown key; choose from name, learner"),
        (SMALL.replace("ppo", "sarsa"), "unknown learner 'sarsa'; choose from parse-and-plan, imitation, ppo"),
        (SMALL.replace("TowerScratch", "Tower"), "configurations: unknown value 'Tower'; choose from TowerScratch"),
        ("seeds = []\n" + SMALL, "seeds: must be a list with something in it"),
        ("seeds = [1, 1]\n" + SMALL, "seeds: the same value twice"),
        ("seeds = [-1]\n" + SMALL, "seeds: must be at least 0, not -1"),
        ('splits = ["final"]\n' + SMALL, "splits: unknown value 'final'; choose from train, dev, test"),
        ('policies = ["best"]\n' + SMALL, "policies: unknown value 'best'; choose from expert"),
        ('corpus = "/nowhere/at/all.jsonl"\n' + SMALL, "corpus: .*nowhere"),
        ('rules = "mine"\n' + SMALL, "corpus, rules: .*'mine'.*paper"),
        (SMALL + "envs = true", r"learners\[0\]\.envs: must be of type int, not True"),
        (SMALL + "steps = 0", r"learners\[0\]\.steps: must be a number above 0"),
        (SMALL + "envs = 0", r"learners\[0\]: .*envs"),
        (SMALL + '[[learners]]\nlearner = "ppo"', "learners: two have the same name"),
        (SMALL + 'corpus = "/nowhere.jsonl"', r"learners\[0\]\.corpus: .*nowhere"),
        (SMALL + "corpus = 1", r"learners\[0\]\.corpus: must be a text, not 1"),
        (SMALL + 'name = "a/b"', "name: must be of letters"),
        (SMALL.replace("ppo", "parse-and-plan") + 'configurations = ["TowerScratch"]', "one agent plays all"),
        (SMALL + 'configurations = ["ScatterFlipIt"]', "unknown value 'ScatterFlipIt'; choose from TowerScratch"),
        ("seeds = [0]", "learners: must be one or several tables"),
        ("seeds = [", "no TOML"),
    ],
)
def test_plan__what_cannot_be_is_refused_naming_file_key_and_choices(tmp_path: Path, text: str, said: str):
    with pytest.raises(CommandError, match=said) as fault:
        read_plan(written(tmp_path / "bad.toml", text))
    assert str(fault.value).startswith(str(tmp_path / "bad.toml"))


def test_experiment__bad_input_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = written(tmp_path / "bad.toml", "colour = 1\n" + SMALL)
    assert main(["experiment", str(file), "--out", str(tmp_path / "out")]) == USAGE_ERROR
    assert main(["experiment", str(tmp_path / "none.toml")]) == USAGE_ERROR
    assert "none.toml: cannot be read" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


class Script(Attempt):
    """Runs Python programs in place of our commands."""

    def _call(self, words: Sequence[str]) -> None:
        super()._call(["--help"] if words[0] == "fine" else ["no-such-command"])


def test_carry_out__a_failure_stops_no_other_run_and_is_told_with_its_log(tmp_path: Path):
    for name in ("runs", "episodes", "logs", "finished"):
        (tmp_path / name).mkdir()
    plans = [PlannedRun("bad", (), (("bad",),)), PlannedRun("good", (), (("fine",),))]
    made = [Script(planned, tmp_path, threads=1) for planned in plans]
    carry_out(made, 1, lambda: None, 0.1)
    assert [attempt.standing for attempt in made] == [Standing.FAILED, Standing.FINISHED]
    assert "no-such-command" in made[0].fault
    assert "no-such-command" in made[0].log.read_text()
    again = attempts(plans, tmp_path, 1)
    assert [attempt.standing for attempt in again] == [Standing.WAITING, Standing.FINISHED]


def test_attempts__a_run_made_with_other_options_is_refused(tmp_path: Path):
    (tmp_path / "finished").mkdir()
    (tmp_path / "finished" / "a.json").write_text(json.dumps({"commands": [["other"]], "seconds": 1}))
    with pytest.raises(CommandError, match=r"a\.json: the run a was made with other options: \['other'\]"):
        attempts([PlannedRun("a", ("mine",), ())], tmp_path, 1)


def test_row__tells_how_far_training_is_and_what_time_is_left(tmp_path: Path):
    attempt = Attempt(PlannedRun("a", ("train",), (), ("steps", 100)), tmp_path, threads=1)
    assert row(attempt) == ["a", "waiting", "", "", ""]
    attempt.run.mkdir(parents=True)
    (attempt.run / "progress.jsonl").write_text('{"steps": 10}\n{"steps": 25}\n')
    attempt.standing, attempt.seconds = Standing.TRAINING, 30.0
    assert row(attempt) == ["a", "training", "25 %", "0:30", "1:30"]
    assert minutes(3601) == "60:01"


def test_experiment__smoke_file_runs_once_goes_on_and_is_reported_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    place = tmp_path / "results"
    command = ["experiment", str(FILES / "smoke.toml"), "--out", str(place), "--jobs", "2"]
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert main(command) == 0, [log.read_text()[-2000:] for log in (place / "logs").iterdir()]
    assert "3 of 3 runs finished" in capsys.readouterr().out
    before = {path: path.stat().st_mtime_ns for path in place.rglob("*") if path.is_file()}
    (place / "finished" / "policies.json").unlink()
    assert main(command) == 0
    changed = {path.parts[-2] for path, when in before.items() if path.stat().st_mtime_ns != when}
    assert changed == {"policies", "logs", "finished"}
    capsys.readouterr()
    run = place / "runs" / "ppo-TowerScratch-0"  # recorded already, so not played again
    assert main(["report", str(place / "episodes"), str(run), "--out", str(tmp_path / "report")]) == 0
    assert "episodes:" not in capsys.readouterr().out
    page = (tmp_path / "report" / "index.html").read_text()
    for name in ("ppo+sf (greedy)", "ppo+sf (sampled)", "expert", "random type"):
        assert name in page
    assert next((tmp_path / "report" / "figures").glob("figure-4*.svg")).stat().st_size
