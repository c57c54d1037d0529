"""Commands that commands print run as they are printed, with options that are not the defaults and blanks in paths."""

import io
import os
import re
import signal
from pathlib import Path

import pytest

from lilgym_mp.contrib.report.behaviour import film_strip
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.learning.common.run_directory import RunDirectory
from tests.command_line import lilgym, output_of, succeeds
from tests.corpora import write_own_corpus

pytest.importorskip("matplotlib")  # of reports

FEW = "--steps 64 --epochs 1 --envs 2 --same-statement 1 --rollout 32 --batch-size 16 --rules release --horizon 7"
TRAININGS = {
    "ppo": f"ppo TowerFlipIt {FEW}",
    "game": f"game TowerFlipIt {FEW} --width 16 --protocol joint",
    "imitation": "imitation TowerScratch --updates 1",
    "parse-and-plan": "parse-and-plan --updates 1",
}


@pytest.fixture
def own(tmp_path, monkeypatch):
    """The option of a small corpus whose path has blanks."""
    (tmp_path / "a place").mkdir()
    monkeypatch.chdir(tmp_path / "a place")
    write_own_corpus(Path("own corpus.jsonl"))
    return "--corpus 'own corpus.jsonl'"


def printed(capsys, before):
    """The one command that was printed after these words."""
    (command,) = re.findall(rf"{before}: lilgym-mp (.*)", capsys.readouterr().out)
    return command


@pytest.mark.long
@pytest.mark.parametrize("learner", TRAININGS)
def test_train__names_an_evaluation_that_runs(learner, own, capsys):
    succeeds(f"train {TRAININGS[learner]} {own} --out 'a run'")
    succeeds(printed(capsys, "evaluate it with"), "--out", "results.json")


@pytest.mark.long
def test_train__when_interrupted_saves_and_names_the_command_that_resumes(own, monkeypatch, capsys):
    record = RunDirectory.record
    with monkeypatch.context() as patched:
        patched.setattr(RunDirectory, "record", lambda *given: (record(*given), os.kill(os.getpid(), signal.SIGINT)))
        assert lilgym(f"train {TRAININGS['ppo']} {own} --out 'a run'") == 130
    output = capsys.readouterr().out
    assert "saved a run/agent.safetensors" in output
    succeeds(re.findall("resume with: lilgym-mp (.*)", output)[0])


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_experiment__names_a_report_that_runs(own, monkeypatch, capsys):
    played = 'configurations = ["TowerScratch"]\npolicies = ["random-unmasked"]\n[[learners]]\nlearner = "ppo"\n'
    text = f'corpus = "own corpus.jsonl"\nrules = "release"\nhorizon = 5\n{played}'
    Path("an experiment.toml").write_text(text)
    command = "experiment 'an experiment.toml' --out 'the results' --only policies"
    succeeds(f"{command} --list")
    succeeds(printed(capsys, "policies"), "--record", "by hand")
    capsys.readouterr()
    succeeds(command)
    succeeds(printed(capsys, "tables"))
    (file,) = Path("by hand").glob("*.jsonl.gz")
    recording = read_episodes(file)
    title, _ = film_strip(recording, recording.episodes[0], "any")
    monkeypatch.setattr("sys.stdin", io.StringIO("quit\n"))
    assert recording.episodes[0].statement in output_of(capsys, title.partition("lilgym-mp ")[2])
