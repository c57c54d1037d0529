"""Usage errors print one line and exit with code 2, without traceback; and the help of every command."""

import sys

import pytest

from lilgym_mp.cli import COMMANDS, USAGE_ERROR, parse_args
from tests.command_line import error_of, lilgym, output_of, python

ERRORS = {
    "evaluate --seed 1 --seed 2": "argument --seed: given more than once",
    "trian": "bench, serve); did you mean train? See lilgym-mp --help",
    "train ppo TowerScratch --step 3 --learning-rat 3 --recip paper --upda 3": "unrecognized arguments: --upda 3",
    "play --split tset": "(choose from train, dev, test); did you mean test? See lilgym-mp",
    "evaluate --passes 1e-1": "argument --passes: '1e-1' is not a whole number",
    "train ppo TowerScrach": "lilgym-mp train: unknown configuration 'TowerScrach'; choose from ScatterFlipIt, ",
    "explain": "name a statement, a task with --task, a program with --program",
    "explain --program": "name a program, or a task with --task",
    "play --partner nobody": "unknown partner 'nobody'; choose from ",
    "explain --task none": "no task 'none' in corpus 'builtin'; tasks include ",
    "train ppo": "name a configuration to train on; choose from TowerScratch",
    "play TowerScratch --corpus nowhere": "no corpus 'nowhere': no such file or directory",
    "play TowerScratch --task tower-train-xyz": "no task 'tower-train-xyz'",
    "evaluate --policy expert --passes 0": "--passes must be at least 1, not 0",
    "bench --num-envs 8 0": "--num-envs must be at least 1, not 0",
    "evaluate nowhere": "no trained agent at nowhere",
    "evaluate": "name run directories of trained agents, policies with --policy",
    "train imitation TowerFlipIt --width 12": "width must be a multiple of 8, not 12",
    "train ppo --resume": "name what to resume: --out DIR, or a configuration",
}


@pytest.mark.parametrize("command", ERRORS)
def test_usage_error__is_one_line(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert lilgym(command) == USAGE_ERROR
    *notes, last = capsys.readouterr().err.splitlines()
    assert last.startswith("lilgym-mp")
    assert ERRORS[command] in last
    assert not [note for note in notes if not note.endswith(" ...") and "preparing data" not in note]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["train ppo TowerScratch", "train parse-and-plan", "evaluate --policy expert"])
def test_output__unwritable_directory_is_an_error_before_any_work(command, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert lilgym(command, "--out", tmp_path / "file" / "deeper" / "out") == USAGE_ERROR
    written = capsys.readouterr()
    assert "cannot write results to" in written.err
    assert str(tmp_path / "file") in written.err
    assert not written.out


def test_options__with_several_values_add_up_when_given_again():
    command = "evaluate --policy expert random-legal --configuration TowerScratch --policy random-type expert"
    args = parse_args(f"{command} --configuration TowerFlipIt".split())
    assert args.policy == ["expert", "random-legal", "random-type"]
    assert args.configuration == ["TowerScratch", "TowerFlipIt"]


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help__of_every_command(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        lilgym(command or "", "--help")
    assert f"usage: lilgym-mp{' ' + command if command else ''}" in capsys.readouterr().out


def test_help__imports_no_heavy_package():
    program = (
        "import sys; from lilgym_mp.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print('loaded', *sys.modules.keys() & {'torch', 'stable_baselines3', 'tqdm', 'shapely', 'tensorboard'})"
    )
    assert python("-c", program).stdout.splitlines()[-1] == "loaded"


def test_missing_package__error_names_what_to_install(tmp_path, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("lilgym_mp.learning")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr("lilgym_mp.learning", None, raising=False)  # the import below replaces it until the end
    monkeypatch.setitem(sys.modules, "safetensors", None)
    written = error_of(capsys, "train ppo TowerScratch --steps 1 --out", tmp_path)
    assert "needs safetensors: pip install" in written
    assert "(the extra train)" in written


def test_explain_program__shows_truth_and_satisfying_items(capsys):
    shown = output_of(
        capsys, "explain --task tower-dev-001 --program 'exist(filter_obj(all_items, lambda x: is_blue(x)))'"
    )
    assert '"I can see a blue block."' in shown
    assert "= False" in shown
    assert "satisfied by none of 0" in shown


@pytest.mark.parametrize("source", ["exist(filter_obj(all_items, is_blue))", "is_blue(unique(all_items))"])
def test_explain_program__draws_scenes_where_the_program_holds_and_where_it_fails(source, capsys):
    output = output_of(capsys, "explain --configuration ScatterScratch --program", source)
    assert output.index("true in this scene") < output.index("= True") < output.index("false in this scene")
    assert "= False" in output


def test_explain_program__shows_the_position_of_an_error(capsys):
    lines = error_of(capsys, "explain --program 'exist(all_itmes)'").splitlines()
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
@pytest.mark.parametrize("command", ["evaluate", "train ppo --resume --out"])
def test_damaged_run__is_reported_in_one_line(damage, command, tmp_path, capsys):
    (tmp_path / "run.json").write_text(DAMAGES[damage])
    output = error_of(capsys, command, tmp_path)
    assert str(tmp_path) in output
    assert output.count("\n") == 1
