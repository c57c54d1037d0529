"""Episodes in process against a chat server on loopback."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
import verifiers.v1 as vf
from lilgym import LilgymConfig, LilgymTaskset
from verifiers.v1.utils.loaders import load_environment

from lilgym_mp.contrib.rlvr import Row, expert_reply


@contextmanager
def chat_server(answer: Callable[[list[dict[str, Any]]], str]) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            message = {"role": "assistant", "content": answer(body["messages"])}
            streams = body.get("stream", False)
            choice = {"index": 0, "delta" if streams else "message": message, "finish_reason": "stop"}
            reply: dict[str, Any] = {"id": "1", "created": 0, "model": "fake", "choices": [choice]}
            reply["object"] = "chat.completion.chunk" if streams else "chat.completion"
            reply["usage"] = {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2}
            text = json.dumps(reply)
            data = (f"data: {text}\n\ndata: [DONE]\n\n" if streams else text).encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream" if streams else "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *args: Any) -> None: ...

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/v1"
        server.shutdown()


def played(env: vf.Env, task: vf.Task, url: str) -> vf.Episode:
    async def play() -> vf.Episode:
        context = vf.ModelContext("fake", vf.EvalClientConfig(base_url=url, api_key_var="NO_KEY"))
        async with env.serving():
            return await env.run_episode(task, context)

    return asyncio.run(play())


@pytest.mark.parametrize("kind", ["plan", "truth"])
def test_one_reply__is_scored(kind: str):
    agent = {"harness": {"id": "null"}, "runtime": {"type": "subprocess"}}
    config = vf.SingleAgentEnvConfig(taskset=LilgymConfig(id="lilgym", kind=kind), agent=agent)
    env = load_environment(config)
    task = next(iter(env.taskset))
    for reply, reward in ((expert_reply(Row.from_json(task.data.row)), 1), ("no idea", 0)):
        with chat_server(lambda messages, reply=reply: reply) as url:
            episode = played(env, task, url)
        assert episode.errors == []
        assert episode.traces[0].rewards["verified"].score == reward


def test_taskset__is_bounded_and_repeatable():
    def ids() -> list[str]:
        return [task.data.id for task in LilgymTaskset(LilgymConfig(id="lilgym", size=5))]

    assert ids() == ids()
    assert len(set(ids())) == 5
