"""Text observations and parsing of replies."""

import re
import runpy
import sys

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.scene.actions import STOP, describe
from lilgym_mp.scene.appearances import RELEASED_GRID, make_appearance
from lilgym_mp.scene.render import draw
from lilgym_mp.wrappers import TextObservation, text_observation_v0
from lilgym_mp.wrappers.replies import Reply, parse_reply
from tests.scripts import ROOT

EXAMPLE = ROOT / "examples" / "language_model_agent.py"

TOWER_TEXT = """\
Statement: There are exactly two blocks.
Make the statement true, then STOP. Actions left: 12.
Rewards: STOP +1 if the statement is as wanted, else -1; an illegal action -1; each of these ends the episode. Any \
other action -0.1; the episode also ends with action 12, and if that is no STOP, its reward is -1.
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
Answer with one action: its name on a line of its own, such as ADD(LEFT, BLUE)."""


SCATTER_ACTIONS = """\
  0 STOP
  ADD(column, row, CIRCLE|SQUARE|TRIANGLE, YELLOW|BLACK|BLUE, SMALL): row 0-3: column 0-4, 7-11, 14-18; \
row 4: column 0-4, 8-11, 14-18
  ADD(column, row, CIRCLE|SQUARE|TRIANGLE, YELLOW|BLACK|BLUE, MEDIUM): row 0-2: column 0-4, 7-11, 14-18; \
row 3-4: column 0-4, 8-11, 14-18
  ADD(column, row, CIRCLE|TRIANGLE, YELLOW|BLACK|BLUE, LARGE): row 0: column 0-3, 7-8, 14-17; \
row 1-2: column 0-3, 7-10, 14-17; row 3: column 0-3, 9-10, 14-17
  ADD(column, row, SQUARE, YELLOW|BLACK|BLUE, LARGE): row 0: column 0-3, 7-8, 10, 14-17; \
row 1-2: column 0-3, 7-10, 14-17; row 3: column 0-3, 8-10, 14-17
  REMOVE(column, row): row 0: column 10; row 3-4: column 7-8
Answer"""


def test_tower_text__is_complete(make):
    text, _ = TextObservation(make("TowerFlipIt")).reset(options={"task": "pair-no"})
    assert text == TOWER_TEXT


def test_scatter__lists_exactly_the_legal_actions(make):
    """A large yellow circle lies at (0, 70) of the middle box, a small blue triangle at (60, 5)."""
    text, _ = TextObservation(make("ScatterFlipIt")).reset(options={"task": "round-yes"})
    assert SCATTER_ACTIONS in text


def test_native_grid__only_counts_legal_actions(make):
    text, _ = TextObservation(make("ScatterScratch", grid="native")).reset(seed=0)
    assert "of 1064001 actions are legal, from STOP to REMOVE(379, 99)." in text


TOWER_REPLIES = {
    "3": 3,
    "I choose action 12.": 12,
    "ADD(LEFT, BLUE)": 3,
    "**ADD(LEFT, BLUE)**": 3,
    "- ADD(LEFT, BLUE)": 3,
    "Action: `add(left, blue)`.": 3,
    "**Action:** ADD(LEFT, BLUE)": 3,
    '{"action": "ADD(LEFT, BLUE)"}': 3,
    "```\nADD(LEFT, BLUE)\n```": 3,
    "Thinking of (40, 80)...\n\nAnswer: 5\n": 5,
    "ADD(LEFT, BLUE)\nbecause exactly 2 blocks are needed.": 3,
    "If I STOP now I lose, so ADD(MIDDLE, BLACK) is needed.\nADD(MIDDLE, BLACK)": 5,
    "Action: ADD(LEFT, BLUE)\nSTOP": 3,
    "STOP\nFinal answer: ADD(LEFT, BLUE)": 3,
    "Action:\nADD(LEFT, BLUE)": 3,
    r"So the answer is \boxed{ADD(LEFT, BLUE)}": 3,
    r"Answer: $\boxed{\text{ADD(LEFT, BLUE)}}$": 3,
    "<answer>\nADD(LEFT, BLUE)\n</answer>": 3,
    "<think>STOP or ADD(LEFT, BLUE), and 2 of them?</think>ADD(LEFT, BLACK)": 2,
    "STOP\n</think>\n<think>Action: STOP</think>ADD(LEFT, BLACK)": 2,
    "3 ADD(LEFT, BLUE)": 3,
    "add left blue": 3,
    "add_left_blue": 3,
    "Answer: remove_left": 10,
    "add a blue block to the left box": 3,
    "STOP</s>": 0,
    "<|channel|>analysis<|message|>STOP<|end|><|start|>assistant<|channel|>final<|message|>act(3)<|return|>": 3,
    **{
        f"{begin}\nSTOP\n{end}\nADD(LEFT, BLUE)": 3
        for begin, end in (
            ("<thoughts>", "</thoughts>"),
            ("<think >", "</think >"),
            ('<thinking kind="long">', "</thinking>"),
            ("[THINK]", "[/THINK]"),
            ("<seed:think>", "</seed:think>"),
            ("<|begin_of_thought|>", "<|end_of_thought|>"),
            ("◁think▷", "◁/think▷"),
        )
    },
    "act(3)": 3,
    "act(action='ADD(LEFT, BLUE)')": 3,
    r"\boxed{\mathrm{ADD}(\text{LEFT}, \text{BLUE})}": 3,
    r"$\boxed{\texttt{add\_left\_blue}}$": 3,
    "<answer>ADD(LEFT, BLUE)": 3,
    "• “ADD(LEFT, BLUE)”": 3,
    "stop": 0,
    "My answer is STOP": 0,
}
UNCLEAR_TOWER_REPLIES = (
    "",
    "no idea",
    "13",
    "-1",
    "2.5",
    "ADD(NORTH, BLUE)",
    "ADD(3, 4, CIRCLE, BLUE, SMALL)",
    "exactly 2 blocks are needed.",
    "1\n2 blocks would do, but there are three",
    "do not STOP yet",
    "The left box needs a block, so ADD(LEFT, BLUE)",
    "ADD(LEFT, BLUE), then STOP",
    "ADD(LEFT, BLUE)\nSTOP",
    "Action: ADD(LEFT, BLUE)\nAction: STOP",
    "Action: ADD(LEFT, NORTH)\nADD(LEFT, BLUE)",
    r"\boxed{ADD(LEFT, BLUE)} or \boxed{STOP}",
    "1. ADD(LEFT, BLUE)\n2. REMOVE(LEFT)",
    "ADD(LEFT, BLUE) or ADD(RIGHT, BLUE)",
    "action 4: ADD(LEFT, BLUE)",
    "4 ADD(LEFT, BLUE)",
    "ADD(LEFT, GREEN)\nSTOP",
    "[THINK]\nSTOP",
    "<seed:think>\nSTOP",
    "add a block",
    "add left blue then right black",
    "we could stop here or go on",
    "<think> ... I could try\nADD(LEFT, BLUE)\nand",
    "<think>STOP",
    "ADD(LEFT, BLUE)\n<think>\nor rather",
    "ADD(LEFT, BLUE)" + " " * 20_000,
    "9" * 5_000,
)


def test_reply__names_an_action(make):
    env = TextObservation(make("TowerScratch"))
    found = {reply: env.parse_action(reply) for reply in TOWER_REPLIES}
    assert found == {reply: Reply(action, understood=True) for reply, action in TOWER_REPLIES.items()}


def test_reply__thought_tags_can_be_set(make):
    env = TextObservation(make("TowerScratch"), thoughts=["hm", "{{...}}"])
    assert env.parse_action("<hm>\nSTOP\n</hm> {{\nSTOP\n}}\n3") == Reply(3, understood=True)
    assert not env.parse_action("{{ 3").understood
    assert env.parse_action("<think>\n3").understood


@pytest.mark.parametrize("reply", [3, [{"type": "text", "text": "ADD(LEFT, "}, {"type": "text", "text": "BLUE)"}]])
def test_reply__may_be_a_number_or_content_parts(make, reply):
    assert TextObservation(make("TowerScratch")).parse_action(reply) == Reply(3, understood=True)


def test_pictures__are_in_infos_of_single_environments_and_batches(make):
    env = TextObservation(make("TowerFlipIt"), scene="image")
    text, info = env.reset(options={"task": "pair-no"})
    assert "medium blue square" not in text
    np.testing.assert_array_equal(np.asarray(info["images"][0]), draw(env.unwrapped.state.scene))
    *_, info = env.step(3)
    np.testing.assert_array_equal(np.asarray(info["images"][0]), draw(env.unwrapped.state.scene))
    assert "medium blue square" in TextObservation(make("TowerFlipIt"), scene="both").reset(seed=0)[0]
    batch = text_observation_v0(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=2), scene="image")
    for *_, infos in (batch.reset(seed=0), batch.step(np.zeros(2, int))):
        assert [image.size for images in infos["images"] for image in images] == [(380, 100)] * 2


def test_ambiguous_reply__gives_the_default(make):
    env = TextObservation(make("TowerScratch"), default="REMOVE(RIGHT)")
    default = Reply(12, understood=False)
    assert {reply: found for reply in UNCLEAR_TOWER_REPLIES if (found := env.parse_action(reply)) != default} == {}


@pytest.mark.parametrize(
    "reply",
    [
        "Add a small blue circle at column 3 row 4",
        "add_3_4_small_blue_circle",
        "Add a small blue circle at row 4, column 3.",
        "add 3 4 small blue circle",
        "ADD(3, 4, SMALL, BLUE, CIRCLE)",
        "The 2 boxes at the right are done.\nADD(3, 4, CIRCLE, BLUE, SMALL)\nThat makes 3 circles.",
    ],
)
def test_reply__in_scatter_may_use_words(make, reply):
    env = TextObservation(make("ScatterScratch"))
    env.reset(seed=0)
    found = make_appearance("scatter", RELEASED_GRID).decode(env.parse_action(reply).action)
    assert describe(found) == "ADD(3, 4, CIRCLE, BLUE, SMALL)"


@pytest.mark.parametrize(
    "reply", ["4", "action 17", "add 3 small blue circles at row 4", "ADD(99, 4, CIRCLE, BLUE, SMALL)"]
)
def test_reply__in_scatter_ignores_numbers_that_were_not_shown(make, reply):
    env = TextObservation(make("ScatterScratch"))
    assert env.parse_action("remove 3 4").understood  # before the first reset
    env.reset(seed=0)
    assert env.parse_action(reply) == Reply(0, understood=False)
    assert env.parse_action("0") == Reply(0, understood=True)


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
@pytest.mark.parametrize("form", [describe, lambda action: re.sub(r"[(),]+", " ", describe(action).lower())])
def test_reply__can_name_every_action(appearance, form):
    known = make_appearance(appearance, RELEASED_GRID)
    for index in range(0, known.action_count, 1 if known.action_count < 100 else 29):
        assert parse_reply(form(known.decode(index)), known, -1) == Reply(index, understood=True)
    assert parse_reply(form(STOP), known, -1) == Reply(0, understood=True)


def test_scatter__cells_and_pixels_are_consistent(make):
    """The cells in the text match the scene that ADD produces."""
    env = TextObservation(make("ScatterScratch"))
    text, _ = env.reset(seed=0)
    assert (
        "Cells (column, row) of 20 x 20 pixels: columns of the boxes LEFT 0-4, MIDDLE 7-11, RIGHT 14-18; columns 5-6"
        " and 12-13 are separators, where nothing can be; rows 0-4 from the top."
    ) in text
    text, *_ = env.step(env.parse_action("ADD(8, 3, SQUARE, BLUE, SMALL)").action)
    x, y = 20 * (8 - 7), 20 * 3
    assert f"MIDDLE box:\n  small blue square of 10 x 10 pixels at ({x}, {y}), its centre in cell (8, 3)" in text


@pytest.mark.parametrize(("rules", "last"), [("paper", "-1"), ("release", "-0.1")])
def test_text__states_the_rewards_of_the_rule_set(make, rules, last):
    text, _ = TextObservation(make("TowerScratch", rules=rules, horizon=7)).reset(seed=0)
    assert f"the episode also ends with action 7, and if that is no STOP, its reward is {last}." in text


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scene": "picture"}, "unknown scene 'picture'; choose from both, image, list"),
        ({"default": 99}, "default must be the number or name of an action, not 99"),
    ],
)
def test_invalid_settings__are_refused(make, settings, message):
    with pytest.raises(ValueError, match=message):
        TextObservation(make("TowerScratch"), **settings)


def test_example__plays_with_a_stub_for_a_model(monkeypatch, capsys):
    options = ["--id", "lilgym_mp/ScatterScratch-v0", "--episodes", "2", "--max-actions", "3"]
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), *options])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["episode 0", "episode 1"]
    assert all(line.endswith("0 replies named no action") for line in lines)


def test_space__contains_the_longest_texts(make):
    env = TextObservation(make("ScatterFlipIt", grid=(38, 10)))
    generator = np.random.default_rng(0)
    text, _ = env.reset(options={"task": "round-yes"})
    for _ in range(11):
        assert text in env.observation_space
        text = env.step(generator.choice(np.flatnonzero(env.action_masks())[1:]))[0]
