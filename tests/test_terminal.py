"""What terminals show: bars, and lines where there is no terminal; tables."""

from __future__ import annotations

import threading
from io import StringIO

import pytest

from lilgym_mp.cli import main
from lilgym_mp.terminal import DownloadBar, Progress, table


class _Terminal(StringIO):
    """What a progress bar draws on."""

    def isatty(self) -> bool:
        return True


def test_download_bar__shows_how_far_a_file_has_come(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm")
    terminal = _Terminal()
    with DownloadBar(terminal) as bar:
        bar.show("first", 2048, 2048)
        bar.show("second", 1024, 2048)
    assert "1.0/2.0 kB" in terminal.getvalue()
    assert "second" in terminal.getvalue()


def test_progress__on_a_terminal_is_a_bar_with_its_note(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm")
    terminal = _Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with Progress(10, "tasks", done=2) as progress:
        progress.advance(5, "8 solved")
    assert "7/10" in terminal.getvalue()
    assert "8 solved" in terminal.getvalue()


def test_progress__without_a_terminal_tells_the_time_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    with Progress(100, "tasks") as progress:
        now[0] = 30.0
        progress.advance(20, "all well")
        now[0] = 60.0
        progress.advance(80)
    assert capsys.readouterr().err.splitlines() == ["20 of 100 tasks, all well, 2:00 left", "100 of 100 tasks"]


def test_progress__of_a_resumed_run_takes_its_pace_from_what_is_new(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    with Progress(100, "steps", done=None) as progress:
        now[0] = 5.0  # loading
        progress.reach(60)
        now[0] = 15.0
        progress.reach(70)
    assert capsys.readouterr().err.splitlines() == ["70 of 100 steps, 0:30 left"]


def test_progress__leaves_output_that_goes_to_a_file_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("TERM", "xterm")
    terminal = _Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with Progress(2, "tasks") as progress:
        print("a result")
        progress.advance()
    assert capsys.readouterr().out == "a result\n"
    assert "a result" not in terminal.getvalue()


def test_progress__may_draw_only_when_told_something(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm")
    terminal = _Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with Progress(3, "rounds", redraws_by_itself=False) as progress:
        threads = threading.active_count()
        progress.advance()
        assert "1/3" in terminal.getvalue()
    assert threads == threading.active_count()


COMMANDS = {  # that take a while, and what they count
    "evaluate --policy random-legal --configuration TowerScratch": "150 of 150 episodes",
    "llm TowerScratch --agent expert --episodes 1": "1 of 1 episodes",  # prints a line for each, so on a terminal only
    "solve TowerScratch --limit 2": "2 of 2 tasks",
}


@pytest.mark.parametrize("command", [command for command in COMMANDS if not command.startswith("llm")])
def test_commands__say_on_stderr_how_far_they_are(command: str, capsys: pytest.CaptureFixture[str]):
    assert main(command.split()) == 0
    assert COMMANDS[command] in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_commands__show_a_bar_with_the_time_left_on_a_terminal(command: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm")
    terminal = _Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    assert main(command.split()) == 0
    assert COMMANDS[command].split(" ", 1)[0] + "/" in terminal.getvalue()
    assert "0:00:00" in terminal.getvalue()


def test_download_bar__without_a_terminal_is_a_line_for_each_file(capsys: pytest.CaptureFixture[str]):
    with DownloadBar() as bar:
        bar.show("file", 1, 2048)
        bar.show("file", 2048, 2048)
    assert capsys.readouterr().err == "file: 2,048 bytes\n"


def test_table__numbers_stand_to_the_right_texts_to_the_left():
    assert table(["name", "count"], [("a", 1_000), ("long", None), ("b", 2.5)]).splitlines() == [
        "name  count",
        "----  -----",
        "a     1,000",
        "long      -",
        "b       2.5",
    ]
