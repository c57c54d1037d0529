"""`lilgym-mp experiment`: valid and invalid files; runs are executed once, resumed and reported on."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from lilgym_mp.cli import experiment_runs
from lilgym_mp.cli.experiment import display
from lilgym_mp.cli.experiment_plan import PlannedRun, read_plan
from lilgym_mp.cli.experiment_runs import Attempt, RunStatus, execute, make_attempts
from lilgym_mp.cli.options import CommandError
from lilgym_mp.corpus import write_corpus
from tests.command_line import error_of, lilgym, output_of, succeeds, terminal_as_stderr
from tests.corpora import small_entries
from tests.envs.test_workers import is_running
from tests.json_files import read_json
from tests.scripts import ROOT

FILES = ROOT / "experiments"
FEW = "envs = 2\nsame_statement = 1\nrollout = 32\nbatch_size = 16\nepochs = 1\n"
BUILTIN = 'corpus = "builtin"'
SMALL = """
configurations = ["TowerScratch"]
[[learners]]
learner = "ppo"
"""


def write_file(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("file", sorted(FILES.glob("*.toml")), ids=lambda file: file.stem)
@pytest.mark.long
def test_plan__shipped_files_are_valid(file, request):
    if tomllib.loads(file.read_text())["corpus"] == "lilgym":
        request.getfixturevalue("official_data")
    plan = read_plan(file)
    assert len({planned.name for planned in plan}) == len(plan)


def test_plan__is_the_matrix_of_learners_configurations_and_seeds(tmp_path):
    text = """
    splits = ["dev", "test"]
    configurations = ["TowerScratch", "TowerFlipIt"]
    seeds = [0, 7]
    policies = ["expert"]
    horizon = 9
    [[learners]]
    learner = "parse-and-plan"
    updates = 30
    [[learners]]
    learner = "ppo"
    name = "forced"
    configurations = ["TowerFlipIt"]
    stop_forcing = true
    passes = 3
    """
    plan = read_plan(write_file(tmp_path / "a.toml", text))
    assert [planned.name for planned in plan] == [
        *("parse-and-plan-0", "parse-and-plan-7", "forced-TowerFlipIt-0", "forced-TowerFlipIt-7", "policies"),
    ]
    assert plan[1].train == ("train", "parse-and-plan", "--seed", "7", "--corpus", "builtin", "--updates", "30")
    assert plan[1].budget == ("updates", 30)
    assert " ".join(plan[2].train) == "train ppo TowerFlipIt --seed 0 --corpus builtin --horizon 9 --stop-forcing"
    assert [words[-1] for words in plan[2].evaluate] == ["dev", "test"]
    assert all("--passes 3" in " ".join(words) for words in plan[2].evaluate)
    assert "--passes" not in plan[1].evaluate[0]
    assert plan[4].train == ()


def test_plan__a_whole_number_may_be_written_as_a_float(tmp_path):
    text = 'configurations = ["TowerScratch"]\n[[learners]]\nlearner = "ppo"\nsteps = 1e5\nlearning_rate = 1e-3\n'
    [planned] = read_plan(write_file(tmp_path / "a.toml", text))
    assert planned.budget == ("steps", 100_000)
    assert "--learning-rate 0.001" in " ".join(planned.train)


@pytest.mark.parametrize(
    ("learner", "played"),
    [
        ('"imitation"\nconfigurations = ["TowerFlipIt"]', "TowerScratch TowerFlipIt"),
        ('"imitation"\nconfigurations = ["TowerScratch"]', "TowerScratch"),
        ('"imitation"\nconfigurations = ["TowerFlipIt"]\nempty_starts = 0', "TowerFlipIt"),
        ('"ppo"\nconfigurations = ["TowerFlipIt"]', "TowerScratch TowerFlipIt"),
        ('"ppo"\nconfigurations = ["TowerFlipIt"]\nrecipe = "paper"', "TowerFlipIt"),
        ('"reward-model"\nconfigurations = ["TowerFlipIt"]', "TowerScratch TowerFlipIt"),
    ],
)
def test_plan__evaluates_on_the_starts_of_training(tmp_path, learner, played):
    (planned,) = read_plan(write_file(tmp_path / "a.toml", f'corpus = "builtin"\n[[learners]]\nlearner = {learner}\n'))
    (words,) = planned.evaluate
    assert f"--configuration {played} --corpus" in " ".join(words)


def test_plan__a_path_can_name_the_seed_and_the_results_directory(tmp_path, capsys):
    text = """
    configurations = ["TowerFlipIt"]
    seeds = [3, 5]
    [[learners]]
    learner = "imitation"
    teacher = "{out}/runs/teacher-{seed}"
    """
    file = write_file(tmp_path / "a.toml", text)
    output = output_of(capsys, f"experiment {file} --out here --list")
    assert re.findall("here/runs/teacher-.", output) == ["here/runs/teacher-3", "here/runs/teacher-5"]


@pytest.mark.long
def test_plan__learner_trained_on_another_corpus(tmp_path, own):
    text = f'corpus = "{own}"\n[[learners]]\nlearner = "parse-and-plan"\ncorpus = "builtin"\n'
    (planned,) = read_plan(write_file(tmp_path / "a.toml", text))
    assert planned.train[-2:] == ("--corpus", "builtin")
    assert " ".join(planned.evaluate[0]).endswith(f"--corpus {own} --split dev")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour = 1\n" + SMALL, "unknown key 'colour'; choose from configurations, corpus"),
        (SMALL + "speed = 3", r"learners\[0\]: unknown key 'speed'; choose from actions"),
        (SMALL.replace("ppo", "game") + 'protocol = "poker"', r"--protocol: invalid choice: 'poker' \(choose from"),
        (SMALL.replace("ppo", "sarsa"), r"learners\[0\]: unknown learner 'sarsa'; choose from game, imitation"),
        (SMALL.replace("TowerScratch", "Tower"), "unknown configuration 'Tower'; choose from ScatterFlipIt"),
        ("seeds = [1, 1]\n" + SMALL, "seeds: must be a non-empty list of distinct values"),
        ("seeds = [-1]\n" + SMALL, "--seed must be at least 0, not -1"),
        ('splits = ["final"]\n' + SMALL, "unknown split 'final'; choose from dev, test, train"),
        ('policies = ["best"]\n' + SMALL, "unknown policy 'best'; choose from expert"),
        ('corpus = "/nowhere/at/all.jsonl"\n' + SMALL, "no corpus '/nowhere"),
        (SMALL + "envs = true", r"learners\[0\]: lilgym-mp train ppo: argument --envs: expected one argument"),
        (SMALL + "envs = 0", r"learners\[0\]: .*envs"),
        (SMALL.replace("ppo", "game") + "passes = 2", r"learners\[0\]: passes: games are evaluated once"),
        (SMALL + "passes = 0", r"learners\[0\]: --passes must be at least 1, not 0"),
        (SMALL + '[[learners]]\nlearner = "ppo"', "learners: two have the same name"),
        (SMALL + 'corpus = "/nowhere.jsonl"', r"learners\[0\]: no corpus '/nowhere"),
        (SMALL + "corpus = 1", r"learners\[0\]: corpus: must be a string, not 1"),
        (SMALL + 'name = "a/b"', "name: must consist of letters"),
        (SMALL.replace("ppo", "parse-and-plan") + 'configurations = ["TowerScratch"]', "one agent plays all"),
        ("seeds = [0]", "learners: must be one or more tables"),
        ("seeds = [", "invalid TOML"),
    ],
)
def test_plan__errors_name_file_key_and_choices(tmp_path, text, message):
    with pytest.raises(CommandError, match=message) as error:
        read_plan(write_file(tmp_path / "bad.toml", text))
    assert str(error.value).startswith(str(tmp_path / "bad.toml"))


def test_experiment__split_needs_trained_runs_and_its_tasks(tmp_path, capsys):
    file = write_file(tmp_path / "a.toml", SMALL)
    command = f"experiment {file} --out {tmp_path / 'out'}"
    untrained = error_of(capsys, f"{command} --split test")
    assert "ppo-TowerScratch-0: was not trained; execute the experiment without" in untrained
    assert not (tmp_path / "out").exists()
    write_corpus(tmp_path / "own.jsonl", "own", "MIT", small_entries())
    write_file(file, f'corpus = "{tmp_path / "own.jsonl"}"\n{SMALL}')
    for split in ("--split test", ""):
        assert "it has scratch tasks of scatter dev, tower train" in error_of(capsys, f"{command} {split}")


def test_experiment__only_executes_the_runs_named(tmp_path, capsys):
    file = write_file(tmp_path / "a.toml", "seeds = [0, 1]\n" + SMALL)
    listed = output_of(capsys, f"experiment {file} --list --only ppo-TowerScratch-1").splitlines()
    assert {line.split(":")[0] for line in listed} == {"ppo-TowerScratch-1"}
    refused = error_of(capsys, f"experiment {file} --only ppo-TowerScratch-2")
    assert "unknown run 'ppo-TowerScratch-2'; choose from ppo-TowerScratch-0, ppo-" in refused


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="only Linux pins processes to cores")
@pytest.mark.parametrize(("cores", "jobs", "threads"), [({0}, "", 1), ({0, 1, 2, 3}, "--jobs 2", 2)])
def test_experiment__threads_of_a_run_are_its_share_of_the_usable_cores(tmp_path, monkeypatch, cores, jobs, threads):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: cores)
    seen = []
    monkeypatch.setattr(experiment_runs, "make_attempts", lambda plan, results, threads: seen.append(threads) or [])
    file = write_file(tmp_path / "a.toml", SMALL)
    succeeds(f"experiment {file} {jobs} --out", tmp_path / "out")
    assert seen == [threads]


@pytest.mark.long
def test_experiment__trains_the_game_and_measures_it(tmp_path, own):
    game = 'name = "audit"\nprotocol = "audit"\nverifiers = "always-accept"\nwidth = 16\nsteps = 64\n'
    text = f'corpus = "{own}"\n{SMALL.replace("ppo", "game")}{game}{FEW}'
    succeeds(f"experiment {write_file(tmp_path / 'game.toml', text)} --out", tmp_path)
    results = read_json(tmp_path / "episodes" / "audit-TowerScratch-0-dev.json")["results"]
    found = {(one["verifier"], one["protocol"]) for one in results}
    assert found >= {("oracle", "audit"), ("target-only", "audit")}


class Script(Attempt):
    """Replaces the commands by a fast success or a failure."""

    def _call(self, words):
        super()._call(["--help"] if words[0] == "fine" else ["no-such-command", "{out}"])


@pytest.mark.long
def test_execute__failed_and_killed_runs_do_not_stop_others_and_are_logged(tmp_path):
    slow = ("evaluate", "--policy", "expert", "--configuration", "ScatterFlipIt")
    plans = [PlannedRun(words[0], (), (words,)) for words in (("bad",), slow, ("fine",))]
    make_attempts([], tmp_path, 1)  # makes the directories
    kinds = (Script, Attempt, Script)
    attempts = [kind(planned, tmp_path, 1) for kind, planned in zip(kinds, plans, strict=True)]
    bad, killed, _ = attempts

    def kill():
        process = killed._process
        if process is not None and process.poll() is None:
            process.kill()

    execute(attempts, 1, kill, 0.1)
    assert [attempt.status for attempt in attempts] == [RunStatus.FAILED, RunStatus.FAILED, RunStatus.FINISHED]
    assert "no-such-command" in bad.error
    assert f"no-such-command {tmp_path}\n" in bad.log.read_text()
    assert killed.error.startswith("killed by SIGKILL: $ lilgym-mp evaluate")
    again = make_attempts(plans, tmp_path, 1)
    assert [attempt.status for attempt in again] == [RunStatus.WAITING, RunStatus.WAITING, RunStatus.FINISHED]


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="PR_SET_PDEATHSIG exists only on Linux")
def test_experiment__training_ends_when_the_command_is_killed(tmp_path, own):
    process = start_experiment(tmp_path, own, "10_000_000")
    children = [path.read_text() for path in Path(f"/proc/{process.pid}/task").glob("*/children")]  # see proc(5)
    run = int("".join(children))  # the only one
    process.kill()
    process.wait()
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and is_running(run):
        time.sleep(0.2)
    assert not is_running(run)
    assert next((tmp_path / "out").rglob("checkpoint.pt")).stat().st_size


def start_experiment(directory, corpus, steps):
    """Starts an experiment in a subprocess and waits until its run has some progress."""
    file = write_file(directory / "one.toml", f'corpus = "{corpus}"\n{SMALL}steps = {steps}\n{FEW}')
    command = f"{sys.executable} -m lilgym_mp experiment {file} --jobs 2 --out {directory / 'out'}".split()
    with (directory / "output").open("w") as output:
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    progress = directory / "out" / "runs" / "ppo-TowerScratch-0" / "progress.jsonl"
    while not progress.exists():
        assert process.poll() is None, (directory / "output").read_text()
        time.sleep(0.1)
    return process


@pytest.mark.long
def test_experiment__ctrl_c_saves_and_the_same_command_resumes(tmp_path, own):
    process = start_experiment(tmp_path, own, "640")
    process.send_signal(signal.SIGINT)
    code, output = process.wait(timeout=120), (tmp_path / "output").read_text()
    assert code == 130, output
    assert "ppo-TowerScratch-0: interrupted" in output
    run = tmp_path / "out" / "runs" / "ppo-TowerScratch-0"
    before = (run / "progress.jsonl").read_text()
    assert 0 < len(before.splitlines()) < 20
    succeeds(f"experiment {tmp_path / 'one.toml'} --jobs 2 --out", tmp_path / "out")
    after = (run / "progress.jsonl").read_text()
    assert after.startswith(before)
    assert json.loads(after.splitlines()[-1])["steps"] >= 640
    assert "--resume" in (tmp_path / "out" / "logs" / "ppo-TowerScratch-0.log").read_text()


def test_display__prints_changes_of_status_and_a_bar_on_a_terminal(tmp_path, capsys, monkeypatch):
    attempts = [Attempt(PlannedRun(name, ("train",), (), ("steps", 100)), tmp_path, 1) for name in ("one", "two")]
    (tmp_path / "runs" / "one").mkdir(parents=True)
    (tmp_path / "runs" / "one" / "progress.jsonl").write_text('{"steps": 25}\n')
    terminal = terminal_as_stderr(monkeypatch)
    with display(attempts) as update:
        attempts[0].status = RunStatus.TRAINING
        attempts[1].status = RunStatus.FINISHED
        update()
        update()
    assert capsys.readouterr().out == "one: training\ntwo: finished\n"
    assert "1/2" in terminal.getvalue()
    assert "one 25 %" in terminal.getvalue()


@pytest.mark.parametrize(
    ("marker", "message"),
    [
        ('{"commands": [["other"]]}', r"a\.json: the run a was made with other options: \['other'\]"),
        ("{}", r"a\.json: damaged"),
    ],
)
def test_attempts__reject_a_run_made_with_other_options(tmp_path, marker, message):
    (tmp_path / "finished").mkdir()
    (tmp_path / "finished" / "a.json").write_text(marker)
    with pytest.raises(CommandError, match=message):
        make_attempts([PlannedRun("a", ("mine",), ())], tmp_path, 1)


@pytest.mark.long
def test_attempts__execute_the_commands_that_are_not_done(tmp_path):
    make_attempts([], tmp_path, 1)  # makes the directories
    (tmp_path / "finished" / "a.json").write_text('{"commands": [["mine"], ["fine"]]}')
    before, after = (PlannedRun("a", ("mine",), (words,)) for words in (("fine",), ("fine", "test")))
    statuses = [attempt.status for attempt in make_attempts([before, after], tmp_path, 1)]
    assert statuses == [RunStatus.FINISHED, RunStatus.WAITING]
    again = Script(after, tmp_path, threads=1)
    execute([again], 1, lambda: None, 0.1)
    assert again.status is RunStatus.FINISHED
    assert read_json(again.marker)["commands"] == [["mine"], ["fine"], ["fine", "test"]]


def test_attempts__do_not_train_again_what_ended_unnoticed(tmp_path):
    plan = PlannedRun("a", ("train", "nothing"), (), ("steps", 100))
    (attempt,) = make_attempts([plan], tmp_path, 1)
    attempt.run.mkdir()
    (attempt.run / "run.json").write_text('{"finished": true, "options": {"steps": 100}}')
    (attempt.run / "checkpoint.pt").touch()
    attempt.execute()
    assert attempt.status is RunStatus.FINISHED


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_experiment__smoke_file_runs_resumes_and_is_reported_on(tmp_path, own, capsys):
    place, text = tmp_path / "results", (FILES / "smoke.toml").read_text()
    assert BUILTIN in text
    file = write_file(tmp_path / "smoke.toml", text.replace(BUILTIN, f'corpus = "{own}"'))
    command = f"experiment {file} --out {place} --jobs 2"
    assert lilgym(command) == 0, [log.read_text()[-2000:] for log in (place / "logs").iterdir()]
    assert "3 of 3 runs finished" in capsys.readouterr().out
    before = {path: path.stat().st_mtime_ns for path in place.rglob("*") if path.is_file()}
    (place / "finished" / "policies.json").unlink()
    succeeds(command)
    changed = {path.parent.name for path, when in before.items() if path.stat().st_mtime_ns != when}
    assert changed == {"policies", "logs", "finished"}
    capsys.readouterr()
    run = place / "runs" / "ppo-TowerScratch-0"  # already recorded, so not evaluated again
    assert "episodes:" not in output_of(capsys, f"report {place / 'episodes'} {run} --out", tmp_path / "report")
    page = (tmp_path / "report" / "index.html").read_text()
    for name in ("ppo+sf (greedy)", "ppo+sf (sampled)", "expert", "random type"):
        assert name in page
    trained = (run / "agent.safetensors").stat().st_mtime_ns
    succeeds(f"{command} --split test")
    assert "TowerScratch test" in (place / "test.md").read_text()
    assert (run / "agent.safetensors").stat().st_mtime_ns == trained
    assert lilgym(command) == 0  # the evaluations on dev are still finished
