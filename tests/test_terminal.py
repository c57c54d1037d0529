"""Progress bars on a terminal, lines of progress elsewhere, and tables."""

from queue import Queue

import pytest

from lilgym_mp.evaluation.terminal import Progress, shows_colours, table
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.render.characters import text
from tests.command_line import succeeds, terminal_as_stderr


def test_progress__on_a_terminal_is_a_bar_with_a_note_and_leaves_stdout_alone(monkeypatch, capsys):
    terminal = terminal_as_stderr(monkeypatch)
    with Progress(10, "tasks", done=2) as progress:
        print("a result")
        progress.advance(5, "8 solved")
    assert "7/10" in terminal.getvalue()
    assert "8 solved" in terminal.getvalue()
    assert capsys.readouterr().out == "a result\n"
    assert "a result" not in terminal.getvalue()


def test_progress__on_a_dumb_terminal_writes_no_escapes(monkeypatch):
    terminal = terminal_as_stderr(monkeypatch)
    monkeypatch.setattr("sys.stdout", terminal)
    assert shows_colours()
    monkeypatch.setenv("TERM", "dumb")
    with Progress(2, "tasks") as progress:
        progress.advance(2)
    assert terminal.getvalue() == "2 of 2 tasks\n"
    assert not shows_colours()


def test_progress__without_a_terminal_prints_the_time_left_of_new_work(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    with Progress(100, "tasks") as progress:
        now[0] = 30.0
        progress.advance(20, "no failures")
        now[0] = 60.0
        progress.advance(80)
    assert capsys.readouterr().err.splitlines() == ["20 of 100 tasks, no failures, 2:00 left", "100 of 100 tasks"]
    with Progress(100, "steps", done=None) as progress:  # of a resumed run
        now[0] += 5.0  # loading
        progress.reach(60)
        now[0] += 10.0
        progress.reach(70)
    assert capsys.readouterr().err.splitlines() == ["70 of 100 steps, 0:30 left"]


def test_progress__says_at_once_what_it_is_doing_and_goes_on_saying_so(monkeypatch):
    monkeypatch.setattr("lilgym_mp.evaluation.terminal.SILENT_SECONDS", 0.01)
    lines = Queue[str]()
    monkeypatch.setattr("lilgym_mp.evaluation.terminal.write_note", lines.put)
    with Progress(10, "updates", doing="ppo: preparing data") as progress:
        assert lines.get(timeout=60) == "ppo: preparing data"
        assert lines.get(timeout=60).startswith("ppo: preparing data, 0:0")
        progress.reach(3, "loss 0.5")
        while not lines.get(timeout=60).startswith("3 of 10 updates, loss 0.5, 0:0"):
            pass


COMMANDS = {  # long-running commands, and the progress they end with
    "evaluate --policy random-legal --configuration TowerScratch": "150 of 150 episodes",
    "llm play TowerScratch --agent expert --episodes 1": "1 of 1 episodes",  # progress on a terminal only
    "solve TowerScratch --episodes 2": "2 of 2 tasks",
}


def test_commands__print_progress_on_stderr(capsys):
    succeeds("solve TowerScratch --episodes 2")
    assert "2 of 2 tasks" in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_commands__show_a_bar_with_the_time_left_on_a_terminal(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # `llm play` writes its transcripts
    terminal = terminal_as_stderr(monkeypatch)
    succeeds(command)
    assert COMMANDS[command].split(" ", 1)[0] + "/" in terminal.getvalue()
    assert "0:00\x1b[0m left" in terminal.getvalue()


def test_table__aligns_numbers_right_and_text_left():
    shown = table(["name", "count"], [("a", 1_000), ("long", None), ("b", 2.5)])
    assert shown.split("\n") == ["name  count", "-----------", "a     1,000", "long      -", "b       2.5"]


@pytest.mark.parametrize(("width", "parts"), [(30, 6), (120, 1)])
def test_table__continues_below_what_does_not_fit(width, parts):
    names = ["mean reward", "wrong stop", "invalid action", "horizon", "words", "seen"]
    text = table(["policy", *names], [("imitation", *[1_000] * 6), ("expert", *["94.7 % of 150"] * 6)], width)
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    assert all(f" {name}" in text for name in names)
    assert sum(line.startswith("expert ") for line in lines) == parts


def test_table__fits_columns_without_a_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    lines = table(["agent", "accuracy", "reward", "length"], [["parse and plan", 99.5, 0.5, 3.25]]).splitlines()
    assert max(map(len, lines)) <= 30


def test_table__repeats_the_columns_that_name_a_row():
    text = table(["proposer", "verifier", "games", "success"], [["expert", "oracle", 788, 100.0]], 28, keys=2)
    rows = [line.split() for line in text.splitlines() if "expert" in line]
    assert rows == [["expert", "oracle", "788"], ["expert", "oracle", "100.0"]]


def test_text__has_letters_beside_colours_and_a_seam_below_each_block():
    blocks = [Item(40, y, Shape.SQUARE, Colour.BLUE, Size.MEDIUM) for y in (80, 59)]
    *_, upper, lower, _ = text(Scene.of(blocks, [], []), []).splitlines()
    assert "\x1b[1;34mb\x1b[0m\x1b[1;34m#" in upper
    assert "\x1b[4;1;34mb\x1b[0m\x1b[4;1;34m#" in lower
