"""The observation in words, and replies read back."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.actions import describe
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.text import Reply

Make = Callable[..., gym.Env[Any, Any]]

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "language_model_agent.py"

TOWER_TEXT = """\
Statement: There are exactly two blocks.
Make the statement true, then STOP. Actions left: 12.
Scene: three boxes of 100 x 100 pixels; (x, y) is an item's top-left corner in its box, y grows downwards.
LEFT box:
  medium blue square of 20 x 20 pixels at (40, 80)
MIDDLE box: empty
RIGHT box: empty
Legal actions, each with its number:
  0 STOP
  1 ADD(LEFT, YELLOW)
  2 ADD(LEFT, BLACK)
  3 ADD(LEFT, BLUE)
  4 ADD(MIDDLE, YELLOW)
  5 ADD(MIDDLE, BLACK)
  6 ADD(MIDDLE, BLUE)
  7 ADD(RIGHT, YELLOW)
  8 ADD(RIGHT, BLACK)
  9 ADD(RIGHT, BLUE)
  10 REMOVE(LEFT)
Answer with one action."""


def test_tower__is_told_in_full(make: Make):
    text, _ = TextObservation(make("TowerFlipIt")).reset(options={"task": "pair-no"})
    assert text == TOWER_TEXT


def test_scatter__tells_legal_actions_by_cells(make: Make):
    text, _ = TextObservation(make("ScatterScratch")).reset(seed=0)
    lines = text.splitlines()
    looks = "CIRCLE|SQUARE|TRIANGLE, YELLOW|BLACK|BLUE"
    assert f"  ADD(column, row, {looks}, SMALL|MEDIUM): row 0-4: column 0-4, 7-11, 14-18" in lines
    assert f"  ADD(column, row, {looks}, LARGE): row 0-3: column 0-3, 7-10, 14-17" in lines
    assert not any("REMOVE" in line for line in lines)


def test_scatter__tells_all_legal_actions_and_no_other(make: Make):
    """Reads the lines by cells back into the set of names."""
    env = TextObservation(make("ScatterFlipIt"))
    text, _ = env.reset(options={"task": "round-yes"})
    names = {"STOP"} if "  0 STOP" in text.splitlines() else set[str]()
    for line in text.splitlines():
        if line.startswith(("  ADD(column", "  REMOVE(column")):
            names |= set(_names(line.strip()))
    appearance = env.unwrapped.dynamics.appearance  # pyright: ignore[reportAttributeAccessIssue]
    legal = {describe(appearance.decode(number)) for number in np.flatnonzero(env.action_masks()).tolist()}
    assert names == legal


def _names(line: str) -> list[str]:
    form, cells = line.split("): ", 1)
    word, *looks = form.replace("(column, row", "").split(", ")
    combinations = [""]
    for alternatives in looks:
        combinations = [f"{done}, {name}" for done in combinations for name in alternatives.split("|")]
    places = []
    for group in cells.split("; "):
        rows, columns = group.removeprefix("row ").split(": column ")
        places += [(column, row) for row in _numbers(rows) for column in _numbers(columns)]
    return [f"{word}({column}, {row}{look})" for column, row in places for look in combinations]


def _numbers(ranges: str) -> list[int]:
    numbers: list[int] = []
    for part in ranges.split(", "):
        first, _, last = part.partition("-")
        numbers += range(int(first), int(last or first) + 1)
    return numbers


def test_pixels__are_not_told_one_by_one(make: Make):
    text, _ = TextObservation(make("ScatterScratch", grid="native")).reset(seed=0)
    assert "of 1064001 actions are legal, from STOP to REMOVE(379, 99)." in text


@pytest.mark.parametrize(
    ("reply", "action"),
    [
        ("3", 3),
        ("I choose action 12.", 12),
        ("ADD(LEFT, BLUE)", 3),
        ("There are 2 blocks, so: remove ( left )", 10),
        ("First ADD(LEFT, BLUE), no, better STOP", 0),
        ("Thinking of (40, 80)...\n\nAnswer: 5\n", 5),
    ],
)
def test_reply__names_an_action(make: Make, reply: str, action: int):
    assert TextObservation(make("TowerScratch")).parse_action(reply) == Reply(action, understood=True)


@pytest.mark.parametrize(
    "reply", ["", "no idea", "13", "-1", "2.5", "ADD(NORTH, BLUE)", "ADD(3, 4, CIRCLE, BLUE, SMALL)"]
)
def test_reply__that_names_none_gives_the_default(make: Make, reply: str):
    env = TextObservation(make("TowerScratch"), default="REMOVE(RIGHT)")
    assert env.parse_action(reply) == Reply(12, understood=False)


def test_default__must_be_an_action(make: Make):
    with pytest.raises(ValueError, match="default must be the number or the name of an action, not 99"):
        TextObservation(make("TowerScratch"), default=99)


@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterScratch"])
def test_example__plays_with_a_stub_for_a_model(
    configuration: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    options = ["--id", f"lilgym_mp/{configuration}-v0", "--episodes", "2", "--steps", "3"]
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), *options])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["episode 0", "episode 1"]
    assert all(line.endswith("0 replies named no action") for line in lines)


def test_space__holds_the_longest_texts(make: Make):
    env = TextObservation(make("ScatterFlipIt", grid=(38, 10)))
    generator = np.random.default_rng(0)
    text, _ = env.reset(options={"task": "round-yes"})
    for _ in range(11):
        assert text in env.observation_space
        text = env.step(generator.choice(np.flatnonzero(env.action_masks())[1:]))[0]
