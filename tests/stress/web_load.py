"""Load test with many concurrent users: measures latencies and checks that every acknowledged submission is stored.

    python -m tests.stress.web_load [--annotators 50] [--players 50] [--seconds 300] [--pause 1.0]
    python -m tests.stress.web_load --annotators 10 --players 10 --seconds 60 --heavy 60 --unfinished 1500

Starts `lilgym-mp serve` with a new database in a separate process. Each user sends a request, waits for the response,
then pauses for `--pause` seconds on average. Annotators save drafts, run programs and submit; players act, request
legal actions and start new episodes. `--heavy`: one more annotator keeps sending that many programs at once that take
longer than the time limit. `--unfinished`: that many connections send all but the last byte of a request's body. The
other users must then get 95 % of their responses within half a second.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from random import Random
from typing import Any

import httpx

from tests.stress.program_language import ATTACKS

PROGRAM = "exist(filter_obj(all_items, lambda x: is_black(x)))"
BLOCK = {"x_loc": 40, "y_loc": 80, "type": "square", "color": "Black", "size": 20}
ASSIGNMENTS_EACH = 400  # per annotator
ACTIONS = ("ADD(LEFT, BLUE)", "ADD(MIDDLE, BLACK)", "REMOVE(LEFT)", "ADD(RIGHT, YELLOW)", "STOP")

MAX_P95_UNDER_ATTACK = 500.0  # milliseconds

Latencies = dict[str, list[float]]  # seconds, by kind of request


class User:
    """A simulated browser session."""

    def __init__(self, url: str, latencies: Latencies, random: Random, pause: float) -> None:
        self.client = httpx.AsyncClient(base_url=url, timeout=60)
        self.latencies = latencies
        self.random = random
        self.pause = pause
        self.failures: Counter[str] = Counter()  # responses with 429 and 5xx, by kind of request and status

    async def open(self, path: str) -> None:
        """Opens a page and takes the session's CSRF token."""
        await self.client.get(path)
        self.client.headers["X-CSRF-Token"] = (await self.client.get("/api/session")).json()["csrf_token"]

    async def request(self, kind: str, method: str, path: str, **options: Any) -> httpx.Response:
        """Pauses, then sends a request and records its latency under `kind`."""
        await asyncio.sleep(self.random.expovariate(1 / self.pause))
        start = time.perf_counter()
        response = await self.client.request(method, path, **options)
        self.latencies[kind].append(time.perf_counter() - start)
        if response.status_code >= 500 or response.status_code == 429:
            self.failures[f"{kind} {response.status_code}"] += 1
        return response


async def play(user: User, end: float) -> None:
    await user.open("/play")
    while time.monotonic() < end:
        configuration = user.random.choice(("TowerScratch", "TowerFlipIt"))
        response = await user.request("begin", "POST", "/api/play/episodes", json={"configuration": configuration})
        episode = response.json()
        while not episode["over"] and time.monotonic() < end:
            path = f"/api/play/episodes/{episode['id']}"
            if user.random.random() < 0.3:
                await user.request("legal", "GET", f"{path}/legal")
            action = {"action": user.random.choice(ACTIONS), "steps": episode["steps"]}
            response = await user.request("act", "POST", f"{path}/actions", json=action)
            episode = response.json() if response.status_code == 200 else episode
        await user.request("explain", "GET", f"/api/play/episodes/{episode['id']}/explanation")


async def annotate(user: User, login: str, end: float, acknowledged: set[tuple[str, str]]) -> None:
    await user.open(login)
    lines = (await user.client.get("/api/annotate/assignments")).json()
    for line in lines:
        if time.monotonic() > end:
            return
        path = f"/api/annotate/assignments/{line['id']}"
        await user.request("open", "GET", path)
        await user.request("check", "POST", "/api/annotate/check", json={"program": PROGRAM[:-3]})
        await user.request("draft", "PUT", f"{path}/draft", json={"program": PROGRAM, "version": 0})
        await user.request("run", "POST", f"{path}/run", json={"program": PROGRAM})
        key = f"key-{line['id']}"
        body = {"key": key, "program": PROGRAM, "comment": key}
        response = await user.request("submit", "POST", f"{path}/submissions", json=body)
        if response.status_code == 201:
            acknowledged.add((login, key))


async def send_heavy_programs(url: str, login: str, seconds: float, count: int) -> Counter[str]:
    """Returns the responses by status."""
    user, end = User(url, defaultdict(list), Random(0), 1.0), time.monotonic() + seconds
    statuses: Counter[str] = Counter()
    await user.open(login)
    assignment = (await user.client.get("/api/annotate/assignments")).json()[0]["id"]

    async def send() -> None:
        while time.monotonic() < end:
            path = f"/api/annotate/assignments/{assignment}/run"
            response = await user.request("heavy", "POST", path, json={"program": ATTACKS["text of filters"]})
            statuses[f"status {response.status_code}"] += 1

    await asyncio.gather(*(send() for _ in range(count)))
    return statuses


async def leave_unfinished(url: str, count: int) -> float:
    """Opens connections that never finish their request; returns the seconds until the server has closed all."""
    user = User(url, defaultdict(list), Random(0), 1.0)
    await user.open("/play")
    host, _, port = url.rpartition("//")[2].partition(":")
    cookie = "; ".join(f"{name}={value}" for name, value in user.client.cookies.items())
    head = f"POST /api/annotate/check HTTP/1.1\r\nHost: {host}:{port}\r\nCookie: {cookie}\r\n"
    head += f"X-CSRF-Token: {user.client.headers['X-CSRF-Token']}\r\nContent-Length: 20\r\n\r\n{{"

    async def leave() -> None:
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(head.encode())
        await reader.read()
        writer.close()

    start = time.monotonic()
    await asyncio.gather(*(leave() for _ in range(count)))
    return time.monotonic() - start


def run_heavy_programs(*args: Any) -> Counter[str]:
    return asyncio.run(send_heavy_programs(*args))


def run_unfinished(*args: Any) -> float:
    return asyncio.run(leave_unfinished(*args))


async def visit(user: User, end: float) -> None:
    while time.monotonic() < end:
        await user.request("healthz", "GET", "/healthz")


async def prepare(url: str, organiser: str, count: int) -> list[str]:
    """Imports statements and creates `count` annotators with assignments; returns their login paths."""
    statements = count * ASSIGNMENTS_EACH // 10
    lines = [
        json.dumps(
            {
                "sentence": f"Sentence {number} speaks of a black block.",
                "identifier": f"{number}-{part}",
                "label": "true" if part else "false",
                "structured_rep": [[BLOCK] * part, [], []],
            }
        )
        for number in range(statements)
        for part in (0, 1)
    ]
    user = User(url, defaultdict(list), Random(0), 1e-6)
    await user.open(organiser)
    (await user.client.post("/api/annotate/imports", content="\n".join(lines).encode())).raise_for_status()
    logins = [
        (await user.client.post("/api/annotate/people", json={"name": f"Annotator {number}"})).json()["path"]
        for number in range(count)
    ]
    people = [
        line["id"] for line in (await user.client.get("/api/annotate/people")).json() if line["role"] == "annotator"
    ]
    body = {
        "name": "all",
        "people": people,
        "statements": count * ASSIGNMENTS_EACH // 10,
        "annotators_each": min(10, count),
    }
    (await user.client.post("/api/annotate/batches", json=body)).raise_for_status()
    await user.client.aclose()
    return logins


async def count_lost(url: str, logins: list[str], acknowledged: set[tuple[str, str]]) -> int:
    """The number of acknowledged submissions that are not stored."""
    stored: set[tuple[str, str]] = set()
    for login in logins:
        user = User(url, defaultdict(list), Random(0), 1e-6)
        await user.open(login)
        for line in (await user.client.get("/api/annotate/history")).json():
            stored.add((login, line["comment"]))
        await user.client.aclose()
    return len(acknowledged - stored)


def quantile(values: list[float], share: float) -> float:
    """In milliseconds."""
    return 1000 * sorted(values)[min(len(values) - 1, int(share * len(values)))]


async def measure(url: str, organiser: str, args: argparse.Namespace) -> int:
    logins = await prepare(url, organiser, args.annotators + 1)
    latencies: Latencies = defaultdict(list)
    acknowledged: set[tuple[str, str]] = set()
    users = [User(url, latencies, Random(seed), args.pause) for seed in range(args.annotators + args.players)]
    end = time.monotonic() + args.seconds
    tasks = [annotate(*pair, end, acknowledged) for pair in zip(users[: args.annotators], logins, strict=False)]
    tasks += [play(user, end) for user in users[args.annotators :]]
    tasks.append(visit(User(url, latencies, Random(0), 0.1), end))
    with ProcessPoolExecutor(2) as attackers:
        heavy = attackers.submit(run_heavy_programs, url, logins[-1], args.seconds, args.heavy)
        unfinished = attackers.submit(run_unfinished, url, args.unfinished)
        await asyncio.gather(*tasks)
        print(f"{args.heavy} heavy programs at once: {dict(heavy.result())}")
        print(f"{args.unfinished} unfinished requests, all closed after {unfinished.result():.0f} s")
    lost = await count_lost(url, logins, acknowledged)
    every = [value for values in latencies.values() for value in values]
    for kind, values in sorted({**latencies, "all": every}.items()):
        p50, p95 = quantile(values, 0.5), quantile(values, 0.95)
        print(f"{kind:8} {len(values):7} requests   p50 {p50:7.1f} ms   p95 {p95:7.1f} ms")
    failures = sum((user.failures for user in users), Counter())
    print(f"{len(acknowledged)} submissions acknowledged, {lost} lost; responses with 429 or 5xx: {dict(failures)}")
    attacked = bool(args.heavy or args.unfinished)
    return 1 if lost or failures or (attacked and quantile(every, 0.95) > MAX_P95_UNDER_ATTACK) else 0


def main() -> int:
    parser = argparse.ArgumentParser(description="Load test of `lilgym-mp serve`.")
    parser.add_argument("--annotators", type=int, default=50)
    parser.add_argument("--players", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--pause", type=float, default=1.0, help="mean seconds between a user's requests")
    parser.add_argument("--heavy", type=int, default=0, help="heavy programs at once, by one more annotator")
    parser.add_argument("--unfinished", type=int, default=0, help="connections that never finish their request")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        command = [sys.executable, "-m", "lilgym_mp", "serve", "--port", "0"]
        running = subprocess.Popen(command, cwd=directory, stdout=subprocess.PIPE, text=True)
        assert running.stdout is not None
        lines = [running.stdout.readline().split() for _ in range(2)]
        try:
            return asyncio.run(measure(lines[0][-1], "/login" + lines[1][-1].rpartition("/login")[2], args))
        finally:
            running.send_signal(signal.SIGINT)
            running.wait(30)


if __name__ == "__main__":
    sys.exit(main())
