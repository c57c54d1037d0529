"""A language model in the seats of the proposer-verifier game."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from lilgym_mp.contrib.llm.agents import Answer
from lilgym_mp.contrib.llm.asking import Asking
from lilgym_mp.contrib.llm.game_player import LanguagePartner
from lilgym_mp.contrib.llm.game_text import Said, read_reply
from lilgym_mp.envs.proposer_verifier import GameSettings, Role, play_games
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.evaluation.game_partners import scripted_proposers, scripted_verifiers
from lilgym_mp.wrappers.replies import THOUGHTS
from tests.command_line import error_of, output_of
from tests.json_files import read_json, read_json_lines
from tests.llm.server import chat, failing, served

GUIDED = GameSettings("TowerScratch", protocol="critique", views="guide")


def seat(role, answer, **options):
    """A partner that gives the answers of a function of the last message."""
    model = SimpleNamespace(answer=lambda messages: answer(messages[-1]["content"]))
    return LanguagePartner(Asking(model), role, **options)


READ = {
    Role.VERIFIER: {
        "accept": Said(1),
        "<think>reject</think>\n**Accept.**": Said(1),
        "I would reject or accept.": None,
        "accept\nreject": None,
        "reject\nMessage: ADD(LEFT, BLUE)": Said(0, 3),
        "reject\nMessage: STOP": Said(0, 13),
        "reject\nMessage: DANCE": None,
        "reject\nMessage: ADD(LEFT, BLUE)\nMessage: STOP": None,
        "reject\nNote: build it a little higher": Said(0, 0, "build it a"),
        "reject\nNote: up\nNote: and down": Said(0, 0, "up and down"),
    },
    Role.PROPOSER: {"ADD(LEFT, BLUE)": Said(3), "Note: hi\nSTOP": Said(0, 0, "hi"), "accept": None},
}


@pytest.mark.parametrize(
    ("role", "reply", "said"), [(role, *read) for role, replies in READ.items() for read in replies.items()]
)
def test_reply__is_read_as_a_choice_a_message_and_a_note(role, reply, said):
    game = Game(GUIDED)
    assert read_reply(reply, game, role, np.ones(13, np.bool_), words=3, thoughts=THOUGHTS) == said


@pytest.mark.long
def test_builder__does_what_it_is_told_in_words_and_sees_no_statement():
    env = BaseGameEnv(**vars(GUIDED))
    first = "REMOVE(LEFT)"
    texts = []

    def answer(text):
        texts.append(text)
        told = re.findall(r"Message of the verifier: (.*)", text)[-1]
        legal = re.findall(r"\d+ (.*\))", text)
        return next(iter(legal), first) if told == "none" else told

    builder = seat(Role.PROPOSER, answer)
    tasks = env.tasks.ids[:12]
    records = play_games(env, builder, scripted_verifiers(env.dynamics)["guide"], tasks=tasks)
    assert [str(record.outcome) for record in records] == ["success"] * 12
    assert not any("Statement:" in text or "to be" in text for text in texts)
    assert "follow what it tells you" in builder.messages[tasks[0]][0]["content"]


def test_note__of_the_verifier_reaches_the_proposer_within_its_words():
    env = BaseGameEnv("TowerScratch", protocol="veto", views="guide")
    heard = []

    def proposes(text):
        heard.extend(re.findall("Note of the verifier: (.*)", text))
        return re.findall(r"\d+ (.*\))", text)[0]

    notes = {}
    players = [
        seat(Role.PROPOSER, proposes, words=2, notes=notes),
        seat(Role.VERIFIER, lambda text: "reject\nNote: a blue one", words=2, notes=notes),
    ]
    play_games(env, *players, tasks=env.tasks.ids[:1])
    assert set(heard) == {"a blue"}


@pytest.mark.parametrize(
    ("answer", "outcome"),
    [
        (Answer("STOP", problem="cut"), "cut"),
        (Answer("STOP", problem="filtered"), "filtered"),
        ("Let me STOP and think.", "not_understood"),
        ("REMOVE(LEFT)", "invalid_action"),
    ],
)
def test_game__that_a_model_does_not_answer_ends_so_and_is_no_success(answer, outcome):
    env = BaseGameEnv("TowerScratch", protocol="audit")
    partner = scripted_verifiers(env.dynamics)["always-accept"]
    (record,) = play_games(env, seat(Role.PROPOSER, lambda text: answer), partner, tasks=env.tasks.ids[:1])
    assert (record.outcome, record.judgements) == (outcome, ())
    assert record.returns == (-1.0, -1.0)


@pytest.mark.parametrize(("protocol", "answer"), [("veto", "accept"), ("audit", "holds"), ("joint", "stop")])
def test_claims__are_judged_exactly(protocol, answer):
    env = BaseGameEnv("TowerFlipIt", protocol=protocol)
    proposer = scripted_proposers(env.dynamics)["expert-deceptive"]
    records = play_games(env, proposer, seat(Role.VERIFIER, lambda text: answer), tasks=env.tasks.ids[:6])
    finals = [record.judgements[-1] for record in records]
    assert [judged.accepted for judged in finals] == [True] * 6
    assert [record.outcome == "success" for record in records] == [judged.holds for judged in finals]
    assert not all(judged.holds for judged in finals)


def command(out, url, more):
    url = url.replace("//", "//user:SECRET@")
    options = f"--option url={url} model=m --episodes 3 --out {out}"
    return f"llm play TowerFlipIt --agent openai {options} --protocol veto {more}"


def by_role(body, number):
    return 200, chat("reject" if "You are the verifier" in body["messages"][0]["content"] else "STOP")


@pytest.mark.long
def test_command__cross_plays_the_model_with_scripted_partners_and_itself(tmp_path, capsys):
    with served(by_role) as (url, _):
        shown = output_of(capsys, command(tmp_path, url, "--partner oracle expert ppo-tower"))
    summary = read_json(tmp_path / "summary.json")
    pairs = {f"{each['proposer']} with {each['verifier']}" for each in summary["results"]}
    assert {"openai m with openai m", "openai m with oracle", "expert with openai m"} <= pairs
    assert {"openai m with ppo-tower", "ppo-tower with openai m", "random with oracle", "expert with random"} <= pairs
    assert "lies accepted" in shown
    assert set(read_json_lines(tmp_path / "transcripts.jsonl")[0]["messages"]) == {"proposer", "verifier"}
    assert all("SECRET" not in path.read_text() for path in tmp_path.iterdir())


@pytest.mark.long
def test_command__continues_without_paying_twice(tmp_path, capsys):
    down = [3]
    with served(failing(down, by_role)) as (url, asked):
        arguments = command(tmp_path, url, "--role verifier --partner expert --concurrency 1")
        assert "1 games, not in the rates" in output_of(capsys, arguments)
        down.clear()
        before = len(asked)
        whole = read_json(tmp_path / "summary.json")
        assert f"{before - 1} answers are there" in output_of(capsys, arguments)
        summary = read_json(tmp_path / "summary.json")
        assert summary["results"][0]["games"] == 3 == whole["results"][0]["games"] + 1
        assert len(asked) == summary["answers"] + 1
        assert "was played with seed 0, not 5" in error_of(capsys, f"{arguments} --seed 5")
        del whole["results"]
        (tmp_path / "summary.json").write_text(
            json.dumps({**whole, "settings": {**whole["settings"], "corpus": "own"}})
        )
        assert "was played with corpus 'own', not None" in error_of(capsys, arguments)


@pytest.mark.parametrize(
    ("more", "error"),
    {
        "--role verifier": "--role is for the two-agent game",
        "--partner-option model=x": "--partner-option is for the two-agent game",
        "--protocol veto --role proposer --partner expert": "unknown partner as verifier 'expert'; choose from",
        "--protocol veto --partner nobody": "no partner 'nobody'; choose a run, from expert",
        "--protocol duel": "choose from veto",
    }.items(),
)
def test_command__wrong_options_are_one_line(more, error, tmp_path, capsys):
    with served(by_role) as (url, _):
        words = f"llm play TowerFlipIt --agent openai --option url={url} model=m --out {tmp_path / 'run'} {more}"
        told = error_of(capsys, words)
    assert error in told
    assert "Traceback" not in told
