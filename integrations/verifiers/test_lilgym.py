"""The documented command, against a chat server on loopback that gives the expert's replies."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from lilgym import LilgymTaskset

from lilgym_mp.contrib.adapters.verifiers import LilgymConfig
from lilgym_mp.contrib.rlvr import Row, expert_reply

LINE = (
    "lilgym -m MODEL --client.base-url URL --env.taskset.level 2 --env.taskset.size 2"
    " --env.agent.harness.id null --env.agent.runtime.type subprocess --no-push"
)


def test_command__scores_the_replies_of_a_bounded_number_of_tasks(tmp_path: Path):
    rows = [Row.from_json(task.data.row) for task in LilgymTaskset(LilgymConfig(id="lilgym", size=2)).load()]
    replies = {rows[0].prompt: expert_reply(rows[0]), rows[1].prompt: "no idea"}

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            content = body["messages"][-1]["content"]
            prompt = content if isinstance(content, str) else content[-1]["text"]
            choice = {"index": 0, "finish_reason": "stop", "delta": {"role": "assistant", "content": replies[prompt]}}
            usage = {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2}
            made = {"id": "1", "object": "chat.completion.chunk", "created": 0, "model": "fake"}
            text = json.dumps({**made, "choices": [choice], "usage": usage})
            data = f"data: {text}\n\ndata: [DONE]\n\n".encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        line = LINE.replace("URL", f"http://127.0.0.1:{server.server_address[1]}/v1")
        command = [str(Path(sys.executable).with_name("vf-eval")), *line.split()]
        here = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
        done = subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True, check=False)
        server.shutdown()
    assert done.returncode == 0, done.stderr
    assert "verified 0.50" in done.stdout, done.stdout
