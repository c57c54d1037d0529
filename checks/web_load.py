"""Many people at once: how long the server takes to answer, and whether it keeps every submission.

    python -m checks.web_load [--annotators 50] [--players 50] [--seconds 300] [--pause 1.0]

Starts `lilgym-mp serve` on a new database in a process of its own. Each person sends a request, waits for the answer
and then for `--pause` seconds on average. Annotators save drafts, run programs and submit; players act, ask for legal
places and begin anew. At the end every acknowledged submission is looked for.
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
from collections import defaultdict
from random import Random
from typing import Any

import httpx

PROGRAM = "exist(filter_obj(all_items, lambda x: is_black(x)))"
BLOCK = {"x_loc": 40, "y_loc": 80, "type": "square", "color": "Black", "size": 20}
EACH = 400  # statements for each annotator
ACTIONS = ("ADD(LEFT, BLUE)", "ADD(MIDDLE, BLACK)", "REMOVE(LEFT)", "ADD(RIGHT, YELLOW)", "STOP")

Times = dict[str, list[float]]  # seconds, by kind of request


class Person:
    """Somebody with a browser."""

    def __init__(self, url: str, times: Times, random: Random, pause: float) -> None:
        self.client = httpx.AsyncClient(base_url=url, timeout=60)
        self.times = times
        self.random = random
        self.pause = pause
        self.refused: dict[int, int] = defaultdict(int)

    async def enter(self, path: str) -> None:
        await self.client.get(path)
        self.client.headers["X-CSRF-Token"] = (await self.client.get("/api/session")).json()["csrf_token"]

    async def ask(self, kind: str, method: str, path: str, **more: Any) -> httpx.Response:
        await asyncio.sleep(self.random.expovariate(1 / self.pause))
        began = time.perf_counter()
        answer = await self.client.request(method, path, **more)
        self.times[kind].append(time.perf_counter() - began)
        if answer.status_code >= 500 or answer.status_code == 429:
            self.refused[answer.status_code] += 1
        return answer


async def play(person: Person, end: float) -> None:
    await person.enter("/play")
    while time.monotonic() < end:
        kind = person.random.choice(("TowerScratch", "TowerFlipIt"))
        begun = await person.ask("begin", "POST", "/api/play/episodes", json={"configuration": kind})
        episode = begun.json()
        while not episode["over"] and time.monotonic() < end:
            path = f"/api/play/episodes/{episode['id']}"
            if person.random.random() < 0.3:
                await person.ask("legal", "GET", f"{path}/legal")
            action = {"action": person.random.choice(ACTIONS), "steps": episode["steps"]}
            answer = await person.ask("act", "POST", f"{path}/actions", json=action)
            episode = answer.json() if answer.status_code == 200 else episode
        await person.ask("explain", "GET", f"/api/play/episodes/{episode['id']}/explanation")


async def annotate(person: Person, login: str, end: float, acknowledged: set[tuple[str, str]]) -> None:
    await person.enter(login)
    lines = (await person.client.get("/api/annotate/assignments")).json()
    for line in lines:
        if time.monotonic() > end:
            return
        path = f"/api/annotate/assignments/{line['id']}"
        await person.ask("open", "GET", path)
        await person.ask("check", "POST", "/api/annotate/check", json={"program": PROGRAM[:-3]})
        await person.ask("draft", "PUT", f"{path}/draft", json={"program": PROGRAM, "version": 0})
        await person.ask("run", "POST", f"{path}/run", json={"program": PROGRAM})
        key = f"key-{line['id']}"
        body = {"key": key, "program": PROGRAM, "comment": key}
        answer = await person.ask("submit", "POST", f"{path}/submissions", json=body)
        if answer.status_code == 201:
            acknowledged.add((login, key))


async def prepare(url: str, organiser: str, count: int) -> list[str]:
    """Statements and people; gives the annotators' login paths."""
    lines = [
        json.dumps(
            {
                "sentence": f"Sentence {number} speaks of a black block.",
                "identifier": f"{number}-{part}",
                "label": "true" if part else "false",
                "structured_rep": [[BLOCK] * part, [], []],
            }
        )
        for number in range(count * EACH // 10)
        for part in (0, 1)
    ]
    person = Person(url, defaultdict(list), Random(0), 1e-6)
    await person.enter(organiser)
    (await person.client.post("/api/annotate/imports", content="\n".join(lines).encode())).raise_for_status()
    made = [
        (await person.client.post("/api/annotate/people", json={"name": f"Annotator {number}"})).json()["path"]
        for number in range(count)
    ]
    people = [
        line["id"] for line in (await person.client.get("/api/annotate/people")).json() if line["role"] == "annotator"
    ]
    body = {"name": "all", "people": people, "statements": count * EACH // 10, "annotators_each": min(10, count)}
    (await person.client.post("/api/annotate/batches", json=body)).raise_for_status()
    await person.client.aclose()
    return made


async def lost(url: str, logins: list[str], acknowledged: set[tuple[str, str]]) -> int:
    """How many acknowledged submissions are not there."""
    there: set[tuple[str, str]] = set()
    for login in logins:
        person = Person(url, defaultdict(list), Random(0), 1e-6)
        await person.enter(login)
        for line in (await person.client.get("/api/annotate/history")).json():
            there.add((login, line["comment"]))
        await person.client.aclose()
    return len(acknowledged - there)


def quantile(values: list[float], share: float) -> float:
    return 1000 * sorted(values)[min(len(values) - 1, int(share * len(values)))]


async def measure(url: str, organiser: str, args: argparse.Namespace) -> int:
    logins = await prepare(url, organiser, args.annotators)
    times: Times = defaultdict(list)
    acknowledged: set[tuple[str, str]] = set()
    people = [Person(url, times, Random(number), args.pause) for number in range(args.annotators + args.players)]
    end = time.monotonic() + args.seconds
    work = [annotate(*pair, end, acknowledged) for pair in zip(people, logins, strict=False)]
    work += [play(person, end) for person in people[args.annotators :]]
    await asyncio.gather(*work)
    missing = await lost(url, logins, acknowledged)
    every = [value for values in times.values() for value in values]
    for kind, values in sorted({**times, "all": every}.items()):
        middle, high = quantile(values, 0.5), quantile(values, 0.95)
        print(f"{kind:8} {len(values):7} requests   p50 {middle:7.1f} ms   p95 {high:7.1f} ms")
    refused = sum(sum(person.refused.values()) for person in people)
    print(f"{len(acknowledged)} submissions acknowledged, {missing} lost; {refused} answers of 429 or 5xx")
    return 1 if missing or refused else 0


def main() -> int:
    parser = argparse.ArgumentParser(description="Many people at once.")
    parser.add_argument("--annotators", type=int, default=50)
    parser.add_argument("--players", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--pause", type=float, default=1.0, help="seconds between one's requests, on average")
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
