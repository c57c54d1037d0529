"""`lilgym-mp play` in the terminal, with scripted commands."""

import io
import signal
import subprocess
import sys

import pytest

from lilgym_mp.cli.play import read_action
from lilgym_mp.envs.proposer_verifier.protocols import PROTOCOLS
from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import ActionError, AddItem, describe
from lilgym_mp.scene.appearances import Scatter, Tower
from lilgym_mp.scene.render.characters import ruled, text
from tests.command_line import succeeds
from tests.scenes import B, scene, square, tower

BLUE_TASK = "play TowerScratch --split dev --task tower-dev-001"  # "I can see a blue block."
BLUE_GAME = f"{BLUE_TASK} --protocol veto"


@pytest.fixture
def play(monkeypatch, capsys):
    """Plays with lines of input and returns the output."""

    def run(command, *lines):
        monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))
        succeeds(command)
        return capsys.readouterr().out

    return run


def test_play__solves_a_task(play):
    output = play(BLUE_TASK, "add left blue", "stop")
    assert '"I can see a blue block."' in output
    assert "Make this true, then stop. Actions left: 12." in output
    assert "ADD(LEFT, BLUE): reward -0.1" in output
    assert "STOP: reward +1.0, success" in output
    assert output.endswith("1 of 1 episodes succeeded, reward +0.9\n")


def test_play__hint_is_an_action(play):
    assert "try: ADD(" in play(BLUE_TASK, "hint")


def test_play__invalid_commands_are_explained_and_take_no_step(play):
    output = play(BLUE_TASK, "dance", "add", "add up blue", "add left bl", "remove 3", "", "show")
    choices = "write stop, remove BOX or add BOX COLOUR, such as: ADD(LEFT, BLUE)"
    assert f"'add up blue' is not an action; {choices}" in output
    assert output.count("is not an action") == 5
    assert output.count("Actions left: 12.") == 2
    assert output.endswith("no episode completed, reward +0.0\n")


def test_play__invalid_action_ends_the_episode_with_its_reason(play):
    output = play(BLUE_TASK, "remove left", "add left blue", "back", "add left blue")
    assert "REMOVE(LEFT): reward -1.0, invalid action (empty tower)\nType next, back or quit." in output
    assert "this episode is over; type next for another task, back for its start, or quit" in output
    assert output.count('"I can see a blue block."') == 4


def test_play__next_samples_another_task_and_quit_leaves(play):
    output = play(f"{BLUE_TASK} --seed 1", "next", "quit", "add left blue")
    assert output.count("Make this") == 2
    assert "add left blue" not in output


def test_play__seed_determines_the_tasks(play):
    drawn = [play(f"play ScatterFlipIt --seed {seed}", "next") for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]


def test_play__scatter_actions_name_cells(play):
    output = play("play ScatterScratch", "add 18 4 small blue circle", "add 19 0 small blue circle", "remove 18 4")
    assert "ADD(18, 4, CIRCLE, BLUE, SMALL): reward -0.1" in output
    assert "COLUMN, 0 .. 18, and ROW, 0 .. 4" in output
    assert "REMOVE(18, 4): reward -0.1" in output


def test_play__ctrl_c_exits():
    command = [sys.executable, "-m", "lilgym_mp", *BLUE_TASK.split()]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, **pipes, text=True) as process:
        while "Actions left" not in process.stdout.readline():
            pass
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
    assert "no episode completed" in output


def test_play_game__as_proposer_with_the_oracle(play):
    pytest.importorskip("pettingzoo")
    output = play(BLUE_GAME, "nonsense", "REMOVE(LEFT)", "add(left, blue)", "STOP")
    shown = ("proposer_0, one of: STOP, ADD(LEFT, YELLOW)", "'nonsense' is not an action of proposer_0")
    for words in (*shown, "REMOVE(LEFT) is not legal now", "verifier_0: accept"):
        assert words in output
    assert output.endswith("\nsuccess; proposer_0 +0.9, verifier_0 +0.9\n")
    assert play(BLUE_GAME, "quit").endswith("quit before the end of the game\n")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_play_game__as_verifier_in_every_protocol(protocol, play):
    pytest.importorskip("pettingzoo")
    output = play(f"play --as verifier --protocol {protocol} --seed 0", *["accept", "continue"] * 30)
    assert "proposer_0: " in output


@pytest.mark.parametrize("appearance", [Tower(), Scatter(), Scatter((38, 10))])
def test_read_action__accepts_every_action_as_it_is_shown(appearance):
    for index in range(0, appearance.action_count, 7):
        assert read_action(describe(appearance.decode(index)), appearance) == index


def test_read_action__accepts_attributes_in_any_order():
    item = AddItem(3, 4, Shape.TRIANGLE, Colour.YELLOW, Size.LARGE)
    assert Scatter().decode(read_action("add 3 4 large yellow triangle", Scatter())) == item


@pytest.mark.parametrize("line", ["stop now", "add 3 4 small large circle", "add 3 5 small blue circle", "remove a b"])
def test_read_action__refuses_what_is_no_action(line):
    with pytest.raises(ActionError, match="is not an action; write stop"):
        read_action(line, Scatter())


def test_ruled__numbers_are_at_the_start_of_their_cells():
    picture = ruled(text(scene(tower(B), [], [square(80, 80)]), [], coloured=False), (19, 5))
    numbers, _, *rows, _ = picture.split("\n")
    assert numbers.index("18") == rows[-1].index("y#y#")
    assert rows[-2].endswith(" 4")
    assert [line.split()[-1] for line in rows if line[-1].isdigit()] == ["0", "1", "2", "3", "4"]
