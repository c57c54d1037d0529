"""Text agents: built-in agents, episodes, transcripts and summaries."""

import base64
import io
import json
import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lilgym_mp.cli import main
from lilgym_mp.cli.llm_play import drawn
from lilgym_mp.contrib.llm import (
    Player,
    make_agent,
    progression,
    success_interval,
    summarise_transcripts,
    wilson_interval,
)
from lilgym_mp.contrib.llm.agents import Answer, ModelError
from lilgym_mp.contrib.llm.openai_agent import OpenAIAgent, ServerError, read_completion
from lilgym_mp.envs.rules import State
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.files import locked
from lilgym_mp.scene.render import draw
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers.replies import parse_reply
from tests.json_files import read_json, read_json_lines
from tests.llm.server import chat, failing, served, stops

TOWER = Settings("TowerFlipIt")


@pytest.fixture(autouse=True)
def in_a_directory_of_its_own(tmp_path, monkeypatch):
    """Runs have a default directory below the current one."""
    monkeypatch.chdir(tmp_path)


class Scripted:
    """Gives the scripted answers, then STOP."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.received = []

    def answer(self, messages):
        self.received.append(list(messages))
        return Answer(self.answers.pop(0) if self.answers else "STOP", 10, 2)


def play(arguments, *more):
    """The status of `lilgym-mp llm play TowerFlipIt` with these arguments, separated by blanks, and `more`."""
    return main(["llm", "play", "TowerFlipIt", *arguments.split(), *more])


def refused(capsys, arguments, *more):
    """What such a command prints that is refused."""
    assert play(arguments, *more) == 2
    return capsys.readouterr().err


def play_first(agent, settings=TOWER, **options):
    """The episode of the first task."""
    player = Player(settings, agent, **options)
    return player.play(player.task_ids()[0])


def answer_of(reply, **options):
    """What an agent on a server that replies so answers to an empty conversation."""
    with served(reply) as (url, _):
        return OpenAIAgent("tiny", url=url, **options).answer([])


def summary_in(directory):
    return read_json(directory / "summary.json")


@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterScratch"])
def test_expert__succeeds_through_text(configuration):
    player = Player(Settings(configuration), make_agent("expert"), scene="list")
    episodes = [player.play(task) for task in player.task_ids()[:5]]
    assert [episode.outcome for episode in episodes] == ["success"] * 5
    assert all(episode.progression == 1 for episode in episodes)


def test_unparseable_answer__is_retried_and_then_ends_the_episode_without_a_stop():
    agent = Scripted("hm", "ADD(LEFT, BLUE)", "what?", "whatever")
    episode = play_first(agent, Settings("TowerScratch"), retries=1)
    assert [turn.understood for turn in episode.turns] == [False, True, False, False]
    assert [turn.action for turn in episode.turns] == [None, "ADD(LEFT, BLUE)", None, None]
    assert episode.actions == ["ADD(LEFT, BLUE)"]
    assert (episode.outcome, episode.is_success) == ("not_understood", False)
    assert "Rewards: STOP +1" in agent.received[0][0]["content"]
    assert [message["role"] for message in agent.received[1]] == ["system", "user", "assistant", "user"]


@pytest.mark.parametrize(("system", "roles"), [(True, ["system", "user"]), (False, ["user"])])
def test_history__limits_the_messages_sent_and_the_system_role_can_be_left_out(system, roles):
    agent = Scripted(*["ADD(LEFT, BLUE)", "REMOVE(LEFT)"] * 3)
    play_first(agent, system=system, history=0)
    assert [[message["role"] for message in messages] for messages in agent.received] == [roles] * len(agent.received)
    assert all(messages[0]["content"].startswith("You edit a picture") for messages in agent.received)


def test_progression__is_relative_to_the_experts_distance():
    settings = Settings("ScatterScratch")
    solver, tasks = Solver(settings.dynamics()), settings.tasks("dev")
    task = next(task for task in tasks if solver.solve(task).steps == 4)
    state = start = State(task, task.start, 0)
    assert progression(solver, start, start, success=False) == 0
    for done, action in enumerate(solver.solve(task).actions[:-1], 1):
        state = solver.dynamics.step(state, action).state
        assert progression(solver, start, state, success=False) == pytest.approx(done / 4)
    assert progression(solver, start, state, success=True) == 1


def test_wilson_interval__known_values():
    low, high = wilson_interval(8, 10)
    assert (low, high) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert wilson_interval(0, 5)[0] == 0
    with pytest.raises(ValueError, match="no success rate from 0 successes in 0 episodes"):
        wilson_interval(0, 0)


def test_success_interval__resamples_statements_with_all_of_their_starts():
    starts = [(str(statement), float(statement < 10)) for statement in range(20) for _ in range(10)]
    once = [(str(statement), float(statement < 10)) for statement in range(20)]
    assert success_interval(starts) == success_interval(once)
    low, high = success_interval(starts)
    assert low < wilson_interval(100, 200)[0]
    assert high > wilson_interval(100, 200)[1]
    assert success_interval([("a", 0.0)] * 50 + [("b", 0.0)]) == wilson_interval(0, 2)
    with pytest.raises(ValueError, match="no success rate"):
        success_interval([])


def test_summary__counts_answers_tokens_and_outcomes():
    player = Player(TOWER, Scripted("hm", "hm", "ADD(LEFT, BLUE)"), retries=1)
    episodes = [player.play(task) for task in player.task_ids()[:3]]
    summary = summarise_transcripts(episodes)
    assert summary["answers"] == sum(len(episode.turns) for episode in episodes)
    assert summary["misunderstood"] == 2
    assert summary["prompt_tokens"] == 10 * summary["answers"]
    assert sum(summary["outcomes"].values()) == 3
    assert summary["success_low"] <= summary["success"] <= summary["success_high"]


@pytest.mark.parametrize(
    ("options", "fields"),
    [
        ({"max_tokens": 5}, {"temperature": 0, "max_tokens": 5}),
        (
            {"temperature": None, "max_completion_tokens": 9, "top_p": 0.5, "extra_body": {"top_k": 3}},
            {"max_completion_tokens": 9, "top_p": 0.5, "top_k": 3},
        ),
    ],
    ids=["few", "renamed, set and left out"],
)
def test_openai__sends_the_conversation_with_its_options_and_reads_the_answer(options, fields, monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "secret")
    messages = [{"role": "user", "content": "Well?"}]
    with served(stops) as (url, requests):
        assert OpenAIAgent("tiny", url=url, **options).answer(messages) == Answer("STOP", 7, 3)
    sent = {"path": "/v1/chat/completions", "key": "Bearer secret", "model": "tiny", "messages": messages}
    assert requests == [{**sent, **fields}]


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ({"content": [{"type": "text", "text": "ADD(LEFT, "}, {"type": "text", "text": "BLUE)"}]}, "ADD(LEFT, BLUE)"),
        ({"content": "STOP", "reasoning_content": "Hm."}, "STOP"),
        ({"content": None, "reasoning": "Hm."}, ""),
        ({"content": None, "refusal": "No."}, "No."),
    ],
)
def test_openai__reads_parts_and_reasoning(message, answer):
    body = {"choices": [{"message": message}], "usage": {"prompt_tokens": "?"}}
    given = answer_of(lambda request, number: (200, body))
    reasoning = "Hm." if "Hm." in message.values() else None
    assert given == Answer(answer, None, None, reasoning, problem="refused" if "refusal" in message else None)


BUSY = {"error": {"code": 429, "message": "Rate limit reached"}}


@pytest.mark.parametrize("first", [(503, {}), (200, BUSY)], ids=["status", "error in a 200"])
@pytest.mark.long
def test_openai__retries_a_server_that_is_busy_and_counts_the_calls(first):
    assert answer_of(lambda body, number: (200, chat("ok")) if number > 1 else first) == Answer("ok", 7, 3, retries=1)


def test_thoughts_and_empty_replies__are_not_sent_again():
    agent = Scripted("<think>\nSTOP?\n</think>\nADD(LEFT, BLUE)", "", "<think> no end")
    play_first(agent, Settings("TowerScratch"), retries=2)
    sent = [(message["role"], message["content"]) for message in agent.received[-1]]
    assert [role for role, _ in sent] == ["system", "user", "assistant", "user"]
    assert sent[2][1] == "ADD(LEFT, BLUE)"
    assert sent[3][1].count("That does not name exactly one action") == 1


@pytest.mark.parametrize("scene", ["image", "both"])
def test_pictures__arrive_at_the_server_in_native_size(scene, tmp_path):
    with served(lambda body, number: (200, chat("ADD(LEFT, BLUE)" if number == 1 else "STOP"))) as (url, requests):
        command = f"llm play TowerScratch --agent openai --option url={url} model=sees --episodes 1 --scene {scene}"
        assert main([*command.split(), "--out", str(tmp_path)]) == 0
    contents = [message["content"] for message in requests[1]["messages"] if message["role"] == "user"]
    player = Player(Settings("TowerScratch"), Scripted())
    player.env.reset(options={"task": player.task_ids()[0]})
    for picture, text in contents:
        header, data = picture["image_url"]["url"].split(",")
        assert header == "data:image/png;base64"
        shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
        np.testing.assert_array_equal(shown, draw(player.env.get_wrapper_attr("state").scene))
        assert "Make the statement true, then STOP." in text["text"]
        assert ("LEFT box:" in text["text"]) == (scene == "both")
        player.env.step(3)


class Failing:
    """Plays one action, then raises; its module can be named on the command line."""

    def answer(self, messages):
        if len(messages) > 2:
            raise RuntimeError("out of\x1b[31m memory")
        return "ADD(LEFT, BLUE)\ud800"


def test_command__failing_in_every_episode_is_one_error(tmp_path, capsys):
    error = refused(capsys, f"--agent {__name__}:Failing --episodes 3 --out {tmp_path}").splitlines()[-1]
    assert "the agent raised RuntimeError: out of\\x1b[31m memory (all of 3 episodes failed)" in error
    failed = read_json_lines(tmp_path / "transcripts.jsonl")
    assert [message["role"] for message in failed[0]["messages"]] == ["system", "user", "assistant", "user"]
    assert "out of" in failed[0]["error"]


def test_command__plays_episodes_at_the_same_time(tmp_path):
    together = threading.Barrier(8)

    def reply(body, number):
        together.wait(60)  # until eight requests are there
        return 200, chat("STOP")

    with served(reply) as (url, requests):
        command = f"--agent openai --option url={url} model=m --episodes 8 --concurrency 8 --out {tmp_path}"
        assert play(command) == 0
    assert len(requests) == 8


def test_command__given_again_continues_an_unfinished_run_and_refuses_a_finished_one(
    capsys,
):
    down, directory = [2], Path("runs/llm-TowerFlipIt-openai-m")
    with served(failing(down)) as (url, asked):
        command = f"--agent openai --option url={url} model=m --episodes 3 --concurrency 1 --prices 1 10"
        assert play(command) == 0
        printed = capsys.readouterr().out
        assert f"results      {directory}\n" in printed
        assert "failed       1 episodes, not in the rates" in printed
        summary = summary_in(directory)
        assert (summary["episodes"], summary["failed_episodes"], summary["failed_calls"]) == (2, 1, 1)
        assert summary["cost"] == pytest.approx(2 * (7 * 1 + 3 * 10) / 1e6)
        with (directory / "transcripts.jsonl").open("a") as file:
            file.write('{"cut')
        assert play(command) == 0
        assert f"continues    {directory}, 2 of 3 episodes are there" in capsys.readouterr().out
        assert f"{directory} has this run, all 3 episodes" in refused(capsys, command)
        assert len(asked) == 4
        told = refused(capsys, f"{command} --scene image --resume --out {directory}")
        assert "was played with scene 'list', not 'image'" in told
        tasks = [line["task"] for line in read_json_lines(directory / "transcripts.jsonl")]
        assert len(set(tasks)) == len(tasks) == summary_in(directory)["episodes"] == 3
        assert play(command.replace("model=m", "model=m top_p=0.6")) == 0
        assert f"results      {directory}-2\n" in capsys.readouterr().out
        assert play(f"{command} --force") == 0
        assert len(asked) == 10


@pytest.mark.parametrize("game", ["", "--protocol veto --role verifier"])
def test_command__refuses_a_run_that_another_process_is_playing(tmp_path, capsys, game):
    with served(stops) as (url, asked), locked(tmp_path):
        told = refused(capsys, f"--agent openai --option url={url} model=m --episodes 1 --out {tmp_path} {game}")
    assert f"{tmp_path} is in use by process {os.getpid()}; wait for it, or stop it" in told
    assert not asked


def test_command__refuses_to_continue_after_an_edit_of_the_corpus(capsys):
    command = "--agent expert --episodes 1"
    assert play(command) == 0
    summary = Path("runs/llm-TowerFlipIt-expert/summary.json")
    stored = read_json(summary)
    sha256 = stored["settings"]["tasks_sha256"]
    stored["settings"]["tasks_sha256"] = "other"
    summary.write_text(json.dumps(stored))
    assert f"was played with tasks_sha256 'other', not '{sha256}'" in refused(capsys, command)


def test_command__stores_every_setting_and_shows_both_values_of_one_that_differs(tmp_path, capsys):
    with served(stops) as (url, asked):
        command = f"--agent openai --episodes 1 --resume --out {tmp_path} --option url={url} model=1e3"
        assert play(command.replace("--resume", ""), 'extra_body={"top_k": 3, "api_token": "SECRET"}') == 0
        assert asked[0]["model"] == "1e3"
        stored = summary_in(tmp_path)["settings"]["option"]
        assert stored["extra_body"]["top_k"] == 3
        assert stored["extra_body"]["api_token"].startswith("sha256:")
        error = refused(capsys, command, 'extra_body={"top_k": 4, "api_token": "SECRET"}')
    assert "'top_k': 3" in error
    assert "'top_k': 4" in error
    assert "SECRET" not in error


@pytest.mark.parametrize("text", ["[]", "null", "{}", '{"settings": 5}', '{"settings": {', None])
@pytest.mark.parametrize(
    ("more", "told"), [("--resume", "no run to resume"), ("--protocol audit --resume", "no run to continue")]
)
def test_command__continues_no_directory_without_a_whole_summary(text, more, told, tmp_path, capsys):
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    with served(stops) as (url, _):
        printed = refused(capsys, f"--agent openai --option url={url} model=m --episodes 1 --out {tmp_path} {more}")
    assert f"{tmp_path}: {told}" in printed
    assert "object " not in printed


def test_limited_episodes__are_drawn_over_statements():
    tasks = TOWER.tasks("dev")
    statements = len({task.statement for task in tasks})
    chosen = drawn(tasks, statements, 0)
    assert len({tasks.by_id(task_id).statement for task_id in chosen}) == statements
    assert set(drawn(tasks, 5, 0)) < set(chosen)
    assert drawn(tasks, 5, 0) != list(tasks.ids[:5])
    assert drawn(tasks, None, 0) == drawn(tasks, 10**6, 1) == list(tasks.ids)


def ended(text, finish_reason, **message):
    return {"choices": [{"message": {"content": text, **message}, "finish_reason": finish_reason}]}


@pytest.mark.parametrize(
    ("body", "outcome"),
    [
        (ended("STOP", "length"), "cut"),
        (ended("STOP", "content_filter"), "filtered"),
        (ended(None, "stop", refusal="STOP"), "refused"),
        (ended("STOP", "stop", refusal="STOP"), "refused"),
        (ended(None, "stop"), "not_understood"),
        (ended("STOP", "stop"), "wrong_stop"),
        *(
            ({"choices": [{"message": {"content": content, "reasoning": [3]}}], "usage": [1]}, "not_understood")
            for content in (5.5, {"a": 1}, [None], [{"type": "text", "text": 3}])
        ),
    ],
)
def test_command__counts_what_was_not_said_as_an_outcome_of_its_own(body, outcome, tmp_path, capsys):
    with served(lambda request, number: (200, body)) as (url, _):
        assert play(f"--agent openai --option url={url} model=m --episodes 2 --out {tmp_path}") == 0
    summary = summary_in(tmp_path)
    assert summary["outcomes"] == {outcome: 2}
    assert summary["successes"] == 0
    assert f"outcomes     {outcome} 2" in capsys.readouterr().out
    problems = {name: number for name, number in summary["problems"].items() if number}
    assert problems == ({} if outcome == "wrong_stop" else {outcome: 4})
    for line in read_json_lines(tmp_path / "transcripts.jsonl"):
        assert ("STOP" in line["actions"]) == (outcome == "wrong_stop")


@pytest.mark.parametrize(
    ("finish_reason", "problem"),
    [
        *dict.fromkeys((None, "", "STOP", " stop", "tool_use", "COMPLETE")).items(),
        *dict.fromkeys(
            ("MAX_TOKENS", "model_length", "max_output_tokens", "model_context_window_exceeded"), "cut"
        ).items(),
        *dict.fromkeys(("SAFETY", "RECITATION", "sensitive", "guardrail_intervened"), "filtered").items(),
    ],
)
def test_openai__knows_the_reasons_for_an_end_of_several_servers(finish_reason, problem):
    body = json.dumps(ended("STOP", finish_reason)).encode()
    assert read_completion(b"\xef\xbb\xbf" + body) == Answer("STOP", problem=problem)


def test_openai__ignores_counts_of_tokens_that_no_answer_has():
    counted = {**ended("STOP", "stop"), "usage": {"prompt_tokens": 10**400, "completion_tokens": -1}}
    assert read_completion(json.dumps(counted).encode()) == Answer("STOP")


@pytest.mark.parametrize(
    ("body", "is_busy"),
    [
        ({"object": "error", "message": "Too many requests", "code": 40001}, True),
        ({"message": "later", "code": 429}, True),
        ({"detail": "RateLimitReached"}, True),
        ({"error": {"status": "RESOURCE_EXHAUSTED"}}, True),
        ({"error": "quota"}, False),
        ({"choices": []}, False),
    ],
)
def test_openai__asks_again_after_an_error_in_a_200_only_if_that_can_help(body, is_busy):
    with pytest.raises(ServerError) as caught:
        read_completion(json.dumps(body).encode())
    assert caught.value.is_busy == is_busy


ODD_BODIES = {
    "error in a 200": (200, {"error": {"message": "no such model SECRET"}}, "no such model"),
    "error as text": (200, {"error": "quota is used up"}, "quota is used up"),
    "key": (401, {"error": "no such key: SECRET"}, "AuthenticationError: Error code: 401"),
    "broken": (500, b"broken", "InternalServerError"),
    "HTML": (200, b"<html><body>Welcome SECRET</body></html>", "not a chat completion; is /v1 missing"),
    "empty": (200, b"", "not a chat completion"),
    "nested": (200, b"[" * 100_000, "not a chat completion"),
    "no choice": (200, {"choices": []}, "not a chat completion"),
    "choice text": (200, {"choices": ["STOP"]}, "not a chat completion"),
    "message null": (200, {"choices": [{"message": None}]}, "not a chat completion"),
    "choice's error": (200, {"choices": [{"message": {}, "error": {"message": "upstream"}}]}, "upstream"),
    "other end": (200, ended("STOP", "error"), "ended with finish_reason 'error'"),
    "odd end": (200, {"choices": [{"message": {"content": "STOP"}, "finish_reason": [1]}]}, "finish_reason [1]"),
    "not text": (401, b"\xff\xfe SECRET", "401"),
    "detail": (404, {"detail": "Not Found SECRET"}, "Not Found"),
}


@pytest.mark.parametrize("case", ODD_BODIES)
def test_command__shows_the_servers_words_and_no_secret(case, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("OPENAI_API_KEY", "SECRET-KEY")
    status, content, message = ODD_BODIES[case]
    with served(lambda request, number: (status, content)) as (url, _):
        url = f"{url.replace('//', '//user:SECRET@')}?token=SECRET"
        headers = 'extra_headers={"X-Pass": "SECRET"}'
        words = ["--option", f"url={url}", "model=m", "retries=0", headers]
        assert play(f"--agent openai --episodes 1 --out {tmp_path}", *words) == 2
    printed = "".join(capsys.readouterr())
    assert message in printed
    for text in (printed, *(file.read_text() for file in tmp_path.iterdir())):
        for bad in ("object has no attribute", "Traceback", "SECRET", "object is not"):
            assert bad not in text


def test_openai__names_an_unknown_host_and_the_cause():
    with pytest.raises(ModelError, match=r"http://nowhere.invalid/v1/: APIConnectionError.*\(ConnectError: .*\w"):
        OpenAIAgent("tiny", url="http://nowhere.invalid/v1", retries=0).answer([])


def test_openai__ends_a_request_of_one_byte_a_second_after_the_time_limit():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def drip():
            connection, _ = server.accept()
            with connection, suppress(OSError):
                for byte in b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n":
                    connection.send(bytes([byte]))
                    time.sleep(0.1)

        threading.Thread(target=drip, daemon=True).start()
        url = f"http://127.0.0.1:{server.getsockname()[1]}/v1"
        with pytest.raises(ModelError, match=r"the request took longer than 0\.5 seconds"):
            OpenAIAgent("tiny", url=url, retries=0, timeout=0.5).answer([])


class Rejecting:
    """Raises an error with its options, when constructed or when asked."""

    def __init__(self, password, at_once=False):
        self.password = password
        if at_once:
            raise ValueError(f"bad {password}")

    def answer(self, messages):
        raise ValueError(f"bad {self.password}")


@pytest.mark.parametrize("at_once", ["true", "false"])
@pytest.mark.parametrize("more", ["", "--protocol audit --role verifier"])
def test_command__errors_do_not_show_the_options_of_an_agent(at_once, more, capsys):
    words = ["--option", "password=SECRET", f"at_once={at_once}"]
    assert play(f"--agent {__name__}:Rejecting --episodes 1 {more}", *words) == 2
    printed = "".join(capsys.readouterr())
    assert "bad ..." in printed
    assert "SECRET" not in printed
    assert all("SECRET" not in file.read_text() for file in Path().rglob("*.json*"))


@pytest.mark.parametrize("reply", [b"STOP", Answer(None)])
def test_answer_of_another_type__is_an_agent_error(reply):
    agent = Scripted()
    agent.answer = lambda messages: reply
    with pytest.raises(ModelError, match="the agent's answer must be a text or an Answer, not "):
        play_first(agent)


@pytest.mark.long
def test_command__imports_an_agent_from_the_current_directory(tmp_path):
    (tmp_path / "my_agents.py").write_text("class Mine:\n    def answer(self, messages):\n        return 'STOP'\n")
    command = [Path(sys.executable).with_name("lilgym-mp"), "llm", "play", "TowerFlipIt"]
    command += ["--agent", "my_agents:Mine"]
    done = subprocess.run([*command, "--episodes", "1"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert ", STOP\n" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    {
        "--agent nobody": "unknown agent 'nobody'; choose from expert, openai, transformers",
        "--agent openai": "cannot be constructed with the options",
        "--agent openai --option url": "--option takes KEY=VALUE, not 'url'",
        "--agent openai --option model=a model=b": "--option model is given twice",
        "--agent openai --option =SECRET": "--option takes KEY=VALUE, not what stands in place 1",
        "--agent openai --option top_p=NaN": "--option top_p must be finite",
        '--agent openai --option extra_body={"a":1,"a":2}': "--option extra_body: duplicate key 'a'",
        "--agent expert --prices 1 -1": "must be a finite number of at least 0, not -1",
        "--agent json:loads": "cannot be constructed with the options",
        "--agent os:abort.x": "name it module:Class, importable from here",
        "--agent openai --option url=ftp://x model=m": "url must begin with http:// or https://",
        "--agent openai --option url=http://x model=m api_key=x": "api_key cannot be set",
        '--agent openai --option url=http://x model=m extra_body={"model":"b"}': "extra_body cannot set model",
        '--agent openai --option url=http://x model=m extra_body={"stream":true}': "extra_body cannot set stream",
        "--agent openai --option url=http://x model=m extra_query=3": "extra_query must be a JSON object",
        "--agent openai --option url=http://x model=m retries=-1": (
            "retries must be a whole number of at least 0, not -1"
        ),
        "--agent openai --option url=http://x model=m retries=2.5": "of at least 0, not 2.5",
        "--agent openai --option url=http://x model=m timeout=1e12": "timeout must be a number of seconds above 0",
        "--agent openai --option url=http://x model=m timeout=true": "timeout must be a number of seconds above 0",
        "--agent openai --option model=m": "set OPENAI_API_KEY to the API key, or give the",
        "--agent expert --resume --out nowhere": "nowhere: no run to resume",
        "--agent collections:OrderedDict": "has no method answer",
        "--agent expert --concurrency 2": "--concurrency 2: the agent expert answers one prompt at a time",
        "--agent expert --episodes 0": "--episodes must be at least 1, not 0",
    }.items(),
)
def test_command__invalid_arguments_are_reported(arguments, message, capsys, monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    assert message in refused(capsys, arguments)


TEMPLATE = "<bos> {% for message in messages %}{{ message.content }} {% endfor %}"


def tiny_model(directory, chat_template=TEMPLATE):
    """Saves a random model whose tokenizer begins every text with <bos>."""
    transformers = pytest.importorskip("transformers")
    import tokenizers

    words = {word: index for index, word in enumerate(("<eos>", "<bos>", "<think>", "</think>", "STOP", "the", "Hm"))}
    backend = tokenizers.Tokenizer(tokenizers.models.WordLevel(words, unk_token="<eos>"))
    backend.pre_tokenizer = tokenizers.pre_tokenizers.WhitespaceSplit()
    backend.post_processor = tokenizers.processors.TemplateProcessing("<bos> $A", special_tokens=[("<bos>", 1)])
    backend.add_special_tokens([tokenizers.AddedToken(word, special=True) for word in list(words)[:4]])
    tokenizer = transformers.PreTrainedTokenizerFast(tokenizer_object=backend, eos_token="<eos>", bos_token="<bos>")
    tokenizer.chat_template = chat_template
    tokenizer.save_pretrained(directory)
    config = transformers.GPT2Config(
        vocab_size=7, bos_token_id=1, eos_token_id=0, n_embd=8, n_layer=1, n_head=1, n_positions=4_096
    )
    transformers.GPT2LMHeadModel(config).save_pretrained(directory)


def test_transformers__generates_from_a_local_directory(tmp_path):
    tiny_model(tmp_path)
    agent = make_agent("transformers", {"directory": str(tmp_path), "max_new_tokens": 3})
    answer = agent.answer([{"role": "user", "content": "STOP the"}])
    assert answer.prompt_tokens == 3  # <bos> STOP the
    assert 1 <= (answer.completion_tokens or 0) <= 3
    assert play_first(agent).turns[0].completion_tokens is not None
    with pytest.raises(ModelError, match="reads no pictures"):
        agent.answer([{"role": "user", "content": [{"type": "text", "text": "STOP"}]}])
    with pytest.raises(ModelError, match="no such directory"):
        make_agent("transformers", {"directory": str(tmp_path / "nowhere")})
    tiny_model(tmp_path / "bare", None)
    with pytest.raises(ModelError, match="has no chat template"):
        make_agent("transformers", {"directory": str(tmp_path / "bare")})


def test_transformers__batches_begin_once_and_keep_the_tags_of_thoughts(tmp_path):
    tiny_model(tmp_path)
    agent = make_agent("transformers", {"directory": str(tmp_path), "max_new_tokens": 5})
    batches = []
    import torch

    def generate(input_ids, attention_mask, **settings):
        batches.append(input_ids.tolist())
        made = {4: [2, 6, 3, 4, 0], 5: [4, 0, 0, 0, 0]}  # <think> Hm </think> STOP <eos>; STOP <eos>
        return torch.tensor([row + made[row[-1]] for row in input_ids.tolist()])

    agent._model.generate = generate
    answers = {}
    with agent._lock:  # until both wait
        threads = [
            threading.Thread(target=lambda text=text: answers.update({text: agent.answer([{"content": text}])}))
            for text in ("Hm Hm STOP", "the")
        ]
        for thread in threads:
            thread.start()
        while len(agent._waiting) < 2:
            time.sleep(0.01)
    for thread in threads:
        thread.join()
    assert [sorted(batch) for batch in batches] == [[[0, 0, 1, 5], [1, 6, 6, 4]]]  # padded on the left
    assert answers == {"Hm Hm STOP": Answer("<think> Hm </think> STOP", 4, 5), "the": Answer("STOP", 2, 2)}
    assert parse_reply(answers["Hm Hm STOP"].text, TOWER.dynamics().appearance, 9) == (0, True)


class Model(Scripted):
    """Has the options of a model."""

    def __init__(self, model, secret=""):
        super().__init__()


@pytest.mark.parametrize(
    ("agent", "options", "shown"),
    [
        ("openai", ["--option", "url=URL?key=SECRET", "model=m"], {"model": "m", "url": "SAFE (sha256:"}),
        (f"{__name__}:Model", ["--option=secret=SECRET", "--option=model=m"], {"model": "m", "secret": "sha256:"}),
    ],
)
def test_command__writes_no_secrets(agent, options, shown, tmp_path):
    with served(stops) as (url, _):
        options = [option.replace("URL", url.replace("//", "//user:SECRET@")) for option in options]
        assert play(f"--agent {agent} --episodes 1 --out {tmp_path}", *options) == 0
    recorded = summary_in(tmp_path)["settings"]["option"]
    assert recorded.keys() == shown.keys()
    for name, value in shown.items():
        assert recorded[name].startswith(value.replace("SAFE", url))
    for name in ("summary.json", "transcripts.jsonl"):
        assert "SECRET" not in (tmp_path / name).read_text()
