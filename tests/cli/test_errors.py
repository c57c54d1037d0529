"""Usage errors print one line and exit with code 2, without traceback; and the help of every command."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lilgym_mp.cli import COMMANDS, USAGE_ERROR, main, parse_args

CASES = {
    "option given twice": (["evaluate", "--seed", "1", "--seed", "2"], "argument --seed: given more than once"),
    "unknown command": (["trian"], "bench, serve); did you mean train? See lilgym-mp --help"),
    "unknown option": (
        ["train", "ppo", "TowerScratch", "--step", "3", "--learning-rat", "3", "--recip", "paper", "--upda", "3"],
        "unrecognized arguments: --upda 3",
    ),
    "unknown choice": (["play", "--split", "tset"], "(choose from train, dev, test); did you mean test? See lilgym-mp"),
    "no whole number": (["evaluate", "--passes", "1e-1"], "argument --passes: '1e-1' is not a whole number"),
    "unknown configuration to train": (
        ["train", "ppo", "TowerScrach"],
        "lilgym-mp train: unknown configuration 'TowerScrach'; choose from ScatterFlipIt, ScatterScratch, TowerFlipIt,"
        " TowerScratch",
    ),
    "nothing to explain": (["explain"], "name a statement, a task with --task, a program with --program"),
    "no program to run": (["explain", "--program"], "name a program, or a task with --task"),
    "unknown partner": (["play", "--partner", "nobody"], "unknown partner 'nobody'; choose from "),
    "unknown task to explain": (["explain", "--task", "none"], "no task 'none' in corpus 'builtin'; tasks include "),
    "no configuration": (["train", "ppo"], "name a configuration to train on; choose from TowerScratch"),
    "unknown corpus": (
        ["play", "TowerScratch", "--corpus", "nowhere"],
        "no corpus 'nowhere': no such file or directory",
    ),
    "unknown task": (["play", "TowerScratch", "--task", "tower-train-xyz"], "no task 'tower-train-xyz'"),
    "no passes": (["evaluate", "--policy", "expert", "--passes", "0"], "--passes must be at least 1, not 0"),
    "no agent to evaluate": (["evaluate"], "name run directories of trained agents, policies with --policy"),
    "width": (["train", "imitation", "TowerFlipIt", "--width", "12"], "width must be a multiple of 8, not 12"),
    "nothing to resume": (["train", "ppo", "--resume"], "name what to resume: --out DIR, or a configuration"),
}


@pytest.mark.parametrize("case", CASES)
def test_usage_error__is_one_line(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    words, message = CASES[case]
    monkeypatch.chdir(tmp_path)
    assert main(words) == USAGE_ERROR
    written = capsys.readouterr()
    last = written.err.splitlines()[-1]
    assert last.startswith("lilgym-mp")
    assert message in last
    assert written.err.count("\n") == 1 or "preparing data" in written.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "words",
    [
        ["train", "ppo", "TowerScratch", "--out"],
        ["train", "parse-and-plan", "--out"],
        ["evaluate", "--policy", "expert", "--out"],
    ],
)
def test_output__unwritable_directory_is_an_error_before_any_work(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / "deeper"
    assert main([*words, str(place / "out")]) == USAGE_ERROR
    written = capsys.readouterr()
    assert "cannot write results to" in written.err
    assert str(tmp_path / "file") in written.err
    assert written.err.count("\n") == 1 or "preparing data" in written.err
    assert not written.out


def test_options__with_several_values_add_up_when_given_again():
    words = ["evaluate", "--policy", "expert", "random-legal", "--configuration", "TowerScratch"]
    again = ["--policy", "random-type", "expert", "--configuration", "TowerFlipIt"]
    args = parse_args([*words, *again])
    assert args.policy == ["expert", "random-legal", "random-type"]
    assert args.configuration == ["TowerScratch", "TowerFlipIt"]
    assert parse_args(["data", "download", "--split", "dev", "--split", "test"]).split == ["dev", "test"]


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help__of_every_command(command: str | None, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as end:
        main([*([command] if command else []), "--help"])
    assert end.value.code == 0
    assert f"usage: lilgym-mp{' ' + command if command else ''}" in capsys.readouterr().out


def test_help__imports_no_heavy_package():
    program = (
        "import sys; from lilgym_mp.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print('loaded', *sys.modules.keys() & {'torch', 'stable_baselines3', 'tqdm', 'shapely', 'tensorboard'})"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded"


def test_missing_package__error_names_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    for name in [name for name in sys.modules if name.startswith("lilgym_mp.learning")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr("lilgym_mp.learning", None, raising=False)  # the import below replaces it until the end
    monkeypatch.setitem(sys.modules, "safetensors", None)
    assert main(["train", "ppo", "TowerScratch", "--steps", "1", "--out", str(tmp_path)]) == USAGE_ERROR
    written = capsys.readouterr().err
    assert "needs safetensors: pip install" in written
    assert "(the extra train)" in written


def test_explain_program__shows_truth_and_satisfying_items(capsys: pytest.CaptureFixture[str]):
    assert (
        main(["explain", "--program", "exist(filter_obj(all_items, lambda x: is_blue(x)))", "--task", "tower-dev-001"])
        == 0
    )
    shown = capsys.readouterr().out
    assert '"I can see a blue block."' in shown
    assert "= False" in shown
    assert "satisfied by none of 0" in shown


@pytest.mark.parametrize("source", ["exist(filter_obj(all_items, is_blue))", "is_blue(unique(all_items))"])
def test_explain_program__draws_scenes_where_the_program_holds_and_where_it_fails(
    source: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["explain", "--program", source, "--configuration", "ScatterScratch"]) == 0
    output = capsys.readouterr().out
    assert output.index("true in this scene") < output.index("= True") < output.index("false in this scene")
    assert "= False" in output


def test_explain_program__shows_the_position_of_an_error(capsys: pytest.CaptureFixture[str]):
    assert main(["explain", "--program", "exist(all_itmes)"]) == USAGE_ERROR
    written = capsys.readouterr()
    assert not written.out
    lines = written.err.splitlines()
    assert "exist(all_itmes)" in lines[1]
    assert lines[2].index("^") == lines[1].index("all_itmes")
    assert "line 1, column 7" in lines[3]


DAMAGES = {
    "deep": "[" * 100_000,
    "a list": "[]",
    "a text": '"run"',
    "nothing": "",
    "an empty object": "{}",
    "other types": '{"format": "lilgym_mp-training-run", "version": 1, "identity": {"environment": 5, "recipe": []}}',
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("words", [["evaluate"], ["train", "ppo", "--resume", "--out"]])
def test_damaged_run__is_reported_in_one_line(
    damage: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.json").write_text(DAMAGES[damage], encoding="utf-8")
    assert main([*words, str(tmp_path)]) == USAGE_ERROR
    output = capsys.readouterr().err
    assert str(tmp_path) in output
    assert output.count("\n") == 1
