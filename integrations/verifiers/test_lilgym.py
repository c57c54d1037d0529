"""The documented commands, against a chat server on loopback whose replies a function of the messages gives."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from lilgym import LilgymTaskset

from lilgym_mp.contrib.adapters.verifiers import LilgymConfig
from lilgym_mp.contrib.rlvr import Row, expert_reply
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.scene.actions import describe
from lilgym_mp.solver import Solver

START = "-m MODEL --client.base-url URL --no-push --env.taskset.size"
SEAT = "--env.{0}.harness.id null --env.{0}.runtime.type subprocess"
ONE = f"lilgym {START} 2 --env.taskset.level 2 {SEAT.format('agent')}"
PAIR = f"lilgym-game {START} 1 {SEAT.format('proposer')} {SEAT.format('verifier')}"
Told = list[tuple[str, str]]  # roles and texts of a conversation


class Chat:
    """Gives the replies, and keeps each request's messages."""

    def __init__(self, reply: Callable[[Told], tuple[str, str]]) -> None:
        self.requests: list[Any] = []
        chat = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                chat.requests.append(body["messages"])
                text, reason = reply([(each["role"], text_of(each["content"])) for each in body["messages"]])
                choice = {"index": 0, "finish_reason": reason, "delta": {"role": "assistant", "content": text}}
                usage = {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2}
                made = {"id": "1", "object": "chat.completion.chunk", "created": 0, "model": "fake"}
                data = f"data: {json.dumps({**made, 'choices': [choice], 'usage': usage})}\n\ndata: [DONE]\n\n".encode()
                self.send_response(200)
                self.send_header("Content-Type", "text/event-stream")
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_: object) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)

    def evaluated(self, line: str, folder: Path) -> tuple[str, list[dict[str, Any]]]:
        """What the command prints, and its traces."""
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        words = line.replace("URL", f"http://127.0.0.1:{self.server.server_address[1]}/v1").split()
        command = [str(Path(sys.executable).with_name("vf-eval")), *words]
        path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
        here = {**os.environ, "PYTHONPATH": path}
        done = subprocess.run(command, cwd=folder, env=here, capture_output=True, text=True, check=False)
        self.server.shutdown()
        self.server.server_close()
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
        lines = [text for file in folder.rglob("traces.jsonl") for text in file.read_text().splitlines()]
        return done.stdout, [trace for text in lines for trace in json.loads(text)["traces"]]


def text_of(content: Any) -> str:
    return content if isinstance(content, str) else content[-1]["text"]


def plans(**settings: Any) -> dict[str, list[str]]:
    """The expert's actions, by prompt."""
    tasks = LilgymTaskset(LilgymConfig(id="lilgym", size=2, **settings)).load()
    return {task.data.prompt_text: expert_reply(Row.from_json(task.data.row)).splitlines() for task in tasks}


@pytest.mark.parametrize(("reason", "reward"), [("stop", "0.50"), ("length", "0.00")])
def test_command__scores_one_reply_to_each_task_unless_it_was_cut(tmp_path: Path, reason: str, reward: str):
    known = plans()
    first = next(iter(known))

    def reply(told: Told) -> tuple[str, str]:
        return ("\n".join(known[first]) if told[-1][1] == first else "no idea"), reason

    printed, _ = Chat(reply).evaluated(ONE, tmp_path)
    assert f"verified {reward}" in printed, printed


def test_turns__with_pictures_give_the_regret_of_each(tmp_path: Path):
    known = plans(turns=True, scene="image")

    def reply(told: Told) -> tuple[str, str]:
        replies = [text for role, text in told if role == "assistant"]
        if not replies:
            return "ADD(LEFT, BLUE)", "length"  # was cut, and so is asked for again
        first = next(text for role, text in told if role == "user")
        return known[first][len(replies) - 1], "stop"

    chat = Chat(reply)
    _, traces = chat.evaluated(f"{ONE} --env.taskset.turns true --env.taskset.scene image", tmp_path)
    assert [trace["info"]["outcome"] for trace in traces] == ["success"] * 2
    assert [trace["rewards"]["verified"]["score"] for trace in traces] == [1, 1]
    lengths = sorted(1 + len(plan) for plan in known.values())
    assert sorted(len(trace["info"]["regrets"]) for trace in traces) == lengths
    assert all(regret == 0 for trace in traces for regret in trace["info"]["regrets"][1:])
    longest = max(chat.requests, key=len)
    pictures = [message for message in longest if message["role"] == "user" and "image_url" in str(message["content"])]
    assert len(pictures) == max(lengths)


def test_game__is_won_by_a_builder_who_sees_no_statement_and_a_guide(tmp_path: Path):
    env = BaseGameEnv("TowerScratch", protocol="critique", views="guide")
    task = env.tasks.by_id(env.tasks.ids[0])
    plan = [describe(action) for action in Solver(env.dynamics).solve(task).actions]
    done = 0

    def reply(told: Told) -> tuple[str, str]:
        nonlocal done
        last = told[-1][1]
        if "You are the proposer" in told[0][1]:
            said = re.findall(r"Message of the verifier: (.*)", last)[-1]
            return (re.findall(r"\d+ (.*\))", last)[0] if said == "none" else said), "stop"
        agreed = f"proposes {plan[done]}" in last or (plan[done] == "STOP" and "proposes STOP" in last)
        done = min(done + agreed, len(plan) - 1)
        return f"{'accept' if agreed else 'reject'}\nMessage: {plan[done]}", "stop"

    chat = Chat(reply)
    _, traces = chat.evaluated(PAIR, tmp_path)
    assert {trace["agent"]["name"] for trace in traces} == {"proposer", "verifier"}
    assert [trace["info"]["outcome"] for trace in traces] == ["success"] * 2
    assert all(trace["rewards"]["game_return"]["score"] > 0 for trace in traces)
    seen = [str(messages) for messages in chat.requests if "You are the proposer" in messages[0]["content"]]
    assert not any(task.statement in text for text in seen)
