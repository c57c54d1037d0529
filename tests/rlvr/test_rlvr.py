"""Rows for training language models: generation, prompts, exact scores, conversations, baselines."""

import json
import random
import re
from dataclasses import replace
from itertools import islice, product

import pytest

from lilgym_mp.contrib.rlvr import (
    KINDS,
    Conversation,
    Row,
    RowError,
    expert_reply,
    images_of,
    messages_of,
    rows,
    score,
)
from lilgym_mp.contrib.rlvr.checked_scenes import checked_truths
from lilgym_mp.corpus.generator import split_of
from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances import APPEARANCES, make_appearance
from lilgym_mp.solver import Solver
from tests.scenes import B, K, Y, scene, tower
from tests.stress.hostile_replies import examined

BLUE = "exist(filter_color(all_items, Color.BLUE))"
TASK = Task("t", "There is a blue block.", BLUE, True, scene(tower(K)))
PLAN = Row("plan", "tower", TASK)
TOLD = PLAN.to_json()["task"]


def some(kind, appearance="tower", count=4, **settings):
    return list(islice(rows(kind, appearance, **settings), count))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.long
def test_rows__are_deterministic_and_complete_and_only_the_expert_is_always_right(kind, appearance):
    found = some(kind, appearance)
    assert some(kind, appearance) == found
    assert [Row.from_json(json.loads(json.dumps(row.to_json()))) for row in found] == found
    assert len({row.id for row in found}) == len(found)
    told = found[0].to_json()  # no value of which lacks a type in a table
    assert {type(value) for record in (told, told["task"]) for value in record.values()} == {str, int, bool, dict}
    for row in found:
        assert score(expert_reply(row), row)[:2] == (1.0, "success")
        assert score("", row)[:2] == (0.0, "not_understood")


@pytest.mark.long
def test_expert__finds_the_plan_of_a_row_that_needs_a_long_search():
    *_, row = some("plan", "scatter", 26, seed=91)
    assert row.steps == 12
    assert score(expert_reply(row), row).reward == 1


@pytest.mark.parametrize("lengths", [(4, 5), (2, 2)])
def test_plans__have_the_wanted_length_which_the_solver_confirms(appearance, lengths):
    solver = Solver(make_dynamics(make_appearance(appearance)))
    for row in some("plan", appearance, 3, min_actions=lengths[0], max_actions=lengths[1]):
        assert row.steps in lengths
        assert solver.solve(row.task).steps == row.steps


@pytest.mark.long
def test_splits__share_no_meaning_and_statements_are_not_repeated():
    by_split = {split: some("program", count=25, level=2, seed=1, split=split) for split in ("train", "dev", "test")}
    for split, found in by_split.items():
        assert {split_of(row.task.program, "tower") for row in found} == {split}
    train = by_split["train"]
    assert len({(row.task.statement, row.task.program) for row in train}) == len(train)


@pytest.mark.parametrize("kind", ["truth", "verify"])
def test_truth_rows__come_in_pairs_one_edit_apart(kind):
    dynamics = make_dynamics(make_appearance("tower"))
    edits = [dynamics.appearance.decode(index) for index in range(1, dynamics.appearance.action_count)]

    def edited(task):
        return [dynamics.step(dynamics.start(task), edit).state.scene for edit in edits]

    for one, other in zip(*[iter(some(kind))] * 2, strict=True):
        assert one.task.statement == other.task.statement
        assert one.task.truth(one.task.start) != other.task.truth(other.task.start)
        assert other.task.start in edited(one.task) or one.task.start in edited(other.task)


def test_verify_rows__ask_whether_a_claim_about_the_target_is_true():
    targets = set[bool]()
    for row in islice(rows("verify", level=1, seed=2), 20):
        targets.add(row.task.target)
        holds = row.task.truth(row.task.start) == row.task.target
        assert f"Claim: the statement is {str(row.task.target).lower()}." in row.prompt
        assert score(str(holds), row).outcome == "success"
        assert score(str(not holds), row).outcome == "wrong"
    assert targets == {True, False}


def test_rows__end_a_search_after_the_given_time():
    with pytest.raises(TimeoutError, match=r"no tower plan of level 1 was found within 0\.001 seconds"):
        next(rows("plan", level=1, min_actions=12, seconds=0.001))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "essay"}, "unknown kind 'essay'; choose from plan, program, truth"),
        ({"appearance": "mosaic"}, "unknown appearance 'mosaic'"),
        ({"level": 6}, "unknown level 6; choose from 1, 2, 3, 4, 5"),
        ({"split": "all"}, "unknown split 'all'"),
        ({"min_actions": 1}, "min_actions and max_actions must be 2 to 12, ascending, not 1 and 12"),
        ({"min_actions": 5, "max_actions": 4}, "ascending, not 5 and 4"),
    ],
)
def test_invalid_settings__are_refused_at_once(settings, message):
    with pytest.raises(ValueError, match=message):
        rows(**{"kind": "plan", **settings})


ANSWERS = {  # by kind and outcome
    "plan": {
        "success": [
            "ADD(LEFT, BLUE)\nSTOP",
            "1. ADD(LEFT, BLUE)\n2. STOP",
            "ADD(LEFT, BLUE), STOP",
            "ADD(LEFT, BLUE); add right yellow -> stop",
            "Black is there already, so I add blue.\n- `add_left_blue`\n- `STOP`",
            "<think>\nSTOP\n</think>\nADD(LEFT, BLUE)\nSTOP",
            "STOP\nNo: <answer>\nADD(LEFT, BLUE)\nSTOP\n</answer>",
            "<answer>ADD(LEFT, BLUE) -> STOP</answer>",
            "<answer>\nADD(LEFT, BLUE)\nSTOP",  # generation stopped at </answer>
            "<action>ADD(LEFT, BLUE)</action>\n<action>STOP</action>",
            "<answer>ADD(LEFT, BLUE); STOP</answer> <answer>ADD(LEFT, BLUE); STOP</answer>",
            r"\boxed{\text{ADD(LEFT, BLUE)} \rightarrow \mathrm{STOP}}",
            "\\boxed{ADD(LEFT, BLUE)}\n\\boxed{STOP}",
            "Action: ADD(LEFT, BLUE)\nAction: STOP",
            "Action 1: ADD(LEFT, BLUE)\nThen STOP.",
            "Step 1: Look.\n**Step 2:** ADD(LEFT, BLUE)\n**Step 3:** STOP",
            "ADD(RIGHT, BLACK)\nSTOP\nFinal answer: ADD(LEFT, BLUE), then STOP",
            "1 ADD(LEFT, BLUE)\n2 STOP</s>",
            '{"plan": ["ADD(LEFT, BLUE)", "STOP"]}',
            "Stop when it is true.\nADD(LEFT, BLUE)\nSTOP",
            "ADD(LEFT, BLUE)\\nSTOP",
            "a) ADD(LEFT, BLUE)\nb) STOP",
            "i. ADD(LEFT, BLUE)\nii. STOP",
            "<answer>ADD(LEFT, BLUE) -&gt; STOP</answer>",
            "(ADD(LEFT, BLUE))\n(STOP)",
            "[ADD(LEFT, BLUE)]\n[STOP]",
            "Round #1) add left blue\nRound #2) stop",
            "First, ADD(LEFT, BLUE). After that, STOP.",
            "ADD(LEFT, BLUE), then finally STOP",
            "Adding a blue block left makes it true.\nADD(LEFT, BLUE)\nSTOP",
            "Put simply, blue is missing.\nADD(LEFT, BLUE)\nSTOP",
            "ADD(LEFT, BLUE)<br>STOP",
        ],
        "not_understood": [  # never a shorter plan
            "<answer>ADD(LEFT, BLUE); STOP</answer> <answer>STOP</answer>",
            "Action: ADD(LEFT, BLUE)\nAction: wait\nAction: STOP",
            "ADD(RIGHT, BLACK)\nAction: STOP",
            "ADD(LEFT, GREEN)\nADD(LEFT, BLUE)\nSTOP",
            "Add a green block.\nADD(LEFT, BLUE)\nSTOP",
            "ADD(RIGHT, BLUE) # since there is none\nADD(LEFT, BLUE)\nSTOP",
            "PLACE(RIGHT, BLUE)\nADD(LEFT, BLUE)\nSTOP",
            "I will ADD(RIGHT, BLACK)\nADD(LEFT, BLUE)\nSTOP",
            "place(RIGHT, BLACK) on the top\nADD(LEFT, BLUE)\nSTOP",
            "2x ADD(RIGHT, BLUE)\nADD(LEFT, BLUE)\nSTOP",
            "act(5)\nADD(LEFT, BLUE)\nSTOP",
            "Put a blue block left\nADD(LEFT, BLUE)\nSTOP",
            "1. Wait\n2. ADD(LEFT, BLUE)\n3. STOP",
            "Step 1: Taking the top block off the right tower\nADD(LEFT, BLUE)\nSTOP",
            "5\nADD(LEFT, BLUE)\nSTOP",
            "<answer>ADD(LEFT, GREEN)\nADD(LEFT, BLUE)\nSTOP</answer>",
            "\\boxed{2} blocks\n\\boxed{ADD(LEFT, BLUE); STOP}",
            "STOP\nADD(LEFT, BLUE)",
            "ADD(LEFT, BLUE)\nSTOP\nSTOP",
            "<think>\nADD(LEFT, BLUE)\nSTOP",
            "I would ADD(LEFT, BLUE) and STOP",
            "3",
            "",
        ],
        "no_stop": ["ADD(LEFT, BLUE)"],
        "wrong_stop": ["STOP", "ADD(LEFT, YELLOW)\nSTOP"],
        "invalid_action": ["REMOVE(RIGHT)\nADD(LEFT, BLUE)\nSTOP"],
        "horizon": ["ADD(LEFT, BLUE)\nREMOVE(LEFT)\n" * 6 + "STOP"],
    },
    "truth": {
        "success": [
            "false",
            "There is a black one only.\n**False.**",
            "Answer: false\nThat is not true",
            "(false)",
            "The answer is false.",
            r"$\boxed{\mathrm{False}}$",
            "false</s>",
            '{"answer": false}',
            [{"type": "text", "text": "fal"}, {"type": "text", "text": "se"}],
            [{"role": "user", "content": "true"}, {"role": "assistant", "content": "false"}],
            [{"type": "thinking", "thinking": "true"}, {"type": "text", "text": "false"}],
        ],
        "wrong": ["true"],
        "not_understood": [
            "true\nfalse",
            "It is false that it is true",
            "<answer>true</answer> <answer>false</answer>",
            "Answer: perhaps\nfalse",
            "!true",
            {"verdict": "false"},
        ],
    },
    "program": {
        "success": [
            BLUE,
            f"Blue exists:\n```python\n{BLUE}\n```",
            "Program: Any(all_items, is_blue)",
            f"<answer>{BLUE}</answer>",
            "<answer>count(filter_color(all_items, Color.BLUE)) > 0</answer>",
            "<answer>0 &lt; count(filter_color(all_items, Color.BLUE))</answer>",
            r"\boxed{count(filter\_color(all\_items, Color.BLUE)) \geq 1}",
            f"```\nexist(all_items) and\n{BLUE}\n```",
            f"```\n{BLUE}  # a blue item\n```",
            f"Program: {BLUE}\nThat is all.",
            f"**{BLUE}**</s>",
        ],
        "not_understood": [
            f"<answer>{BLUE}</answer> <answer>True</answer>",
            "exist(filter_color(all_items, Color.GREEN))",
            "import os",
        ],
        "wrong": ["exist(all_items)", "True"],
    },
}


@pytest.mark.parametrize("kind", ANSWERS)
def test_answer__is_read_and_checked(kind):
    for outcome, replies in ANSWERS[kind].items():
        for reply in replies:
            found = score(reply, replace(PLAN, kind=kind))
            assert found[:2] == (float(outcome == "success"), outcome), reply
            assert ("agreement" in found.details) == (kind == "program" and outcome != "not_understood"), reply


def test_program__that_is_always_true_cannot_be_checked():
    with pytest.raises(RowError, match="too rarely true or false"):
        score("True", replace(PLAN, kind="program", task=replace(TASK, program="True")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "lilgym_mp row 0"}, "a row must have the format 'lilgym_mp row 2', not 'lilgym_mp row 0'"),
        ({"format": ["lilgym_mp row 2"]}, "a row must have the format 'lilgym_mp row 2', not \\["),
        ({"kind": "essay"}, "row 't': unknown kind 'essay'"),
        ({"appearance": "mosaic"}, "row 't': unknown appearance 'mosaic'"),
        ({"level": "three"}, "level and steps must be whole numbers"),
        ({"task": None}, "row 't': a task must be an object"),
        ({"task": {**TOLD, "program": "exist("}}, "row 't': .* this bracket is never closed"),
        ({"task": {**TOLD, "program": "is_blue(unique(all_boxes))"}}, "row 't': unique: s must hold exactly one"),
        ({"task": {**TOLD, "target": False}}, "has the target value at the start, so there is no plan"),
        ({"task": {**TOLD, "start": [[], [], []]}}, "must be str, bytes or bytearray"),
        ({"task": {**TOLD, "start": "[" * 100_000}}, "row 't'"),
    ],
)
def test_row__that_cannot_be_scored_is_refused(change, message):
    with pytest.raises(RowError, match=message):
        Row.from_json({**PLAN.to_json(), **change})
    with pytest.raises(RowError, match="a row must have the format"):
        Row.from_json(list(change))


def test_conversation__plays_one_action_for_each_reply():
    for row in some("plan"):
        talk, solver = Conversation(row), Solver(make_dynamics(make_appearance("tower")))
        assert row.task.statement in talk.prompt
        total = 0.0
        while not talk.done:
            turn = talk.step(f"Thus\n{describe(solver.solve_from(talk.state).actions[0])}")
            total += turn.reward
        assert turn.outcome == "success"
        assert total == 1
        with pytest.raises(ValueError, match="the episode is over"):
            talk.step("STOP")


def test_conversation__without_a_said_stop_is_no_success():
    talk = Conversation(PLAN)
    turns = [talk.step(reply) for reply in ("ADD(LEFT, BLUE)", "I am done.", "Nothing more.")]
    assert PLAN.task.solved_by(talk.state.scene)
    assert [turn.done for turn in turns] == [False, False, True]  # after it was asked again
    assert (turns[-1].outcome, sum(turn.reward for turn in turns)) == ("not_understood", 0)
    assert Conversation(PLAN).step("STOP").reward == 0


@pytest.mark.parametrize(("finish_reason", "outcome"), [("length", "cut"), ("content_filter", "filtered")])
def test_reply__that_the_server_did_not_end_normally_is_not_read(finish_reason, outcome):
    right = "ADD(LEFT, BLUE)\nSTOP"
    assert score(right, PLAN, finish_reason="stop").reward == 1
    assert score(right, PLAN, finish_reason=finish_reason)[:2] == (0.0, outcome)
    talk = Conversation(PLAN)
    talk.step("ADD(LEFT, BLUE)", "stop")
    turns = [talk.step("STOP", finish_reason) for _ in range(2)]
    assert [(turn.outcome, turn.reward, turn.done) for turn in turns] == [(outcome, 0, False), (outcome, 0, True)]


def test_conversation__states_the_task_once_and_the_reward_that_it_gives():
    prompt = Conversation(PLAN).prompt
    for part in (TASK.statement, "Reward: 1 if you STOP", "Scene: three boxes", "Answer with one action"):
        assert prompt.count(part) == 1
    assert "-0.1" not in prompt


def test_turns__have_the_return_that_they_lose_against_the_expert():
    talk = Conversation(PLAN)
    turns = [talk.step(reply) for reply in ("hm", "ADD(LEFT, YELLOW)", "ADD(LEFT, BLUE)", "STOP")]
    assert [turn.regret for turn in turns] == [0, 0.1, 0, 0]
    assert [(turn.distance_before, turn.distance_after) for turn in turns] == [(2, 2), (2, 2), (2, 1), (1, 0)]
    assert score("ADD(LEFT, YELLOW)\nADD(LEFT, BLUE)\nSTOP", PLAN).details["regrets"] == [0.1, 0, 0]
    (turn,) = [Conversation(PLAN).step("STOP")]
    assert (turn.distance_before, turn.distance_after) == (2, None)
    assert turn.regret == pytest.approx(0.9 + 1)


def test_regrets__are_zero_for_the_experts_plan(appearance):
    for row in some("plan", appearance, 3, seed=5):
        details = score(expert_reply(row), row).details
        assert set(map(str, details["regrets"])) <= {"0.0", "None"}
        talk = Conversation(row, retries=0)
        assert talk.step("hm").outcome == "not_understood"


def test_reply__too_long_outside_of_thoughts_has_a_reason_of_its_own():
    thought = "So which block is where?\n" * 1_000
    assert score(f"<think>{thought}</think>ADD(LEFT, BLUE)\nSTOP", PLAN).reward == 1
    assert score(f"{thought[:15_000]}\nADD(LEFT, BLUE)\nSTOP", PLAN).reward == 1
    reason = score(f"{thought}ADD(LEFT, BLUE)\nSTOP", PLAN).details["reason"]
    assert reason == "25,020 characters outside of thoughts; at most 20,000 are read: enclose thoughts in <think>"
    assert score("<think>", PLAN).details["reason"] == "a thought does not end"
    assert "at most 500,000 are read" in score("a" * 500_001, PLAN).details["reason"]
    assert score(None, PLAN).details["reason"] == "the reply has no text"


def test_conversation__shows_pictures():
    talk = Conversation(PLAN, scene="image")
    assert [image.size for image in talk.images] == [(380, 100)]
    assert "black square" not in talk.prompt
    before = talk.images[0].tobytes()
    talk.step(3)
    assert talk.images[0].tobytes() != before
    talk.step("STOP")
    assert talk.images == Conversation(PLAN).images == []


def test_messages__have_a_picture_where_one_was_asked_for():
    (message,) = messages_of(PLAN, "both", inline=False)
    assert [part["type"] for part in message["content"]] == ["image", "text"]
    assert message["content"][1]["text"] != PLAN.prompt
    assert messages_of(PLAN) == [{"role": "user", "content": PLAN.prompt}]
    assert [len(images_of(replace(PLAN, kind=kind))) for kind in ("plan", "truth", "program")] == [1, 1, 0]
    with pytest.raises(ValueError, match="a program row has no picture to show; choose from plan, truth, verify rows"):
        messages_of(replace(PLAN, kind="program"), "image")


def test_conversation__is_of_plans_and_reads_numbers_that_were_shown():
    with pytest.raises(RowError, match="is a truth row; only plans have several turns"):
        Conversation(replace(PLAN, kind="truth"))
    row = some("plan", "scatter", 1, level=1)[0]
    assert [Conversation(row).step(number).action for number in ("17", "0")] == [None, "STOP"]  # 17 was not shown


def test_row__with_a_program_that_takes_seconds_is_refused_at_once():
    crowd = scene(tower(*[B, K, Y, B]), tower(*[K, B, Y, K]), tower(*[Y, B, K, B]))
    loops = "exist(filter_obj(all_items, lambda a: " * 6 + "True" + "))" * 6
    task = replace(TASK, program=f"not {loops}", start=crowd, target=True)
    with pytest.raises(RowError, match="needs more than 250000 steps"):
        Row.from_json(replace(PLAN, task=task).to_json())


def test_hostile_replies__are_scored_in_bounded_time():
    outcomes, slow = examined(240, seed=1, most_seconds=0.5)  # ten times what the stress test allows: machines differ
    assert slow == []
    assert sum(outcomes.values()) == 240
    assert outcomes["not_understood"] > 120


def word_mutants(program):
    """Programs in which one word, number or comparison is another."""
    groups = (
        "is_yellow is_blue is_black",
        "is_circle is_square is_triangle",
        "YELLOW BLUE BLACK",
        "and or",
        "All Any",
        "CIRCLE SQUARE TRIANGLE",
        "is_top is_bottom is_second is_third",
        "ge le",
        "== >= <= > <",
        "is_touching_wall is_closely_touching_wall",
        "get_touching get_closely_touching get_above get_below",
        "0 1 2",
        "2 1 3",
        "3 2 4",
    )
    for match in re.finditer(r"\w+|[<>=]+", program):
        for group in map(str.split, groups):
            for word in group if match[0] in group else ():
                if word != match[0]:
                    yield program[: match.start()] + word + program[match.end() :]
    for match in re.finditer(r"exist\((\w+\([^()]*(?:\([^()]*\)[^()]*)*\))\)", program):
        yield program.replace(match[0], f"(count({match[1]}) == 1)", 1)


@pytest.mark.long
def test_program_rows__under_a_hundredth_of_one_edit_mutants_is_right():
    rewards = []
    for appearance, level in product(APPEARANCES, (1, 3, 5)):
        rng = random.Random(3)
        scenes = [sampler_of(appearance).scene(rng) for _ in range(200)]
        for row in some("program", appearance, 2, level=level, seed=4):
            truths = list(map(compile_program(row.task.program), scenes))
            mutants = set(word_mutants(row.task.program))
            wrong = [mutant for mutant in mutants if list(map(compile_program(mutant), scenes)) != truths]
            rewards += [score(mutant, row).reward for mutant in wrong]
    assert len(rewards) > 100
    assert sum(rewards) < 0.01 * len(rewards)


def test_checked_truths__tell_exactly_one_from_at_least_one():
    boxes = "filter_obj(all_boxes, lambda b: exist(filter_color(b.all_items_in_box(), Color.BLUE)))"
    row = replace(PLAN, kind="program", task=replace(TASK, program=f"exist({boxes})"))
    assert score(f"count({boxes}) >= 1", row).reward == 1
    assert score(f"count({boxes}) == 1", row).outcome == "wrong"


NEAR_MISSES = [  # programs of generated statements, and one edit away
    (
        "exist(filter_obj(all_boxes, lambda b: count(filter_obj(b, lambda x: is_blue(x) and is_triangle(x))) == 3 and"
        " 1 <= count(get_set_sizes(b)) <= 2 and exist(filter_color(b, Color.YELLOW))))",
        ("== 3", ">= 3"),
    ),
    (
        "exist(filter_obj(all_boxes, lambda b: ge(count(filter_obj(b, lambda x: is_blue(x) and is_big(x))), 3) and"
        " exist(filter_obj(combinations(filter_color(b, Color.BLUE), 2), lambda p: all_same_shape(p))) and"
        " NOT(exist(filter_obj(b, lambda x: is_black(x) and is_circle(x))))))",
        ("NOT(exist(", "NOT(1 < count("),
    ),
]


@pytest.mark.parametrize(("program", "edit"), NEAR_MISSES)
@pytest.mark.long
def test_checked_truths__tell_a_program_from_one_that_differs_in_crowded_boxes_alone(program, edit):
    checked = checked_truths(program, "scatter")
    mutant = compile_program(program.replace(*edit))
    assert any(mutant(scene) != value for scene, value in checked.items())
    assert len(checked) <= 100
