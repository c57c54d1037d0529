"""Fuzzes every route of the web application: no request may get a 5xx response.

Requests are generated from the application's OpenAPI schema, with values omitted, repeated, or replaced by values of
another type and by ones that often break servers; some bodies are nonsense. They are sent to an in-process application.
"""

import json
import logging
import tempfile
from collections import Counter
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any
from urllib.parse import quote

HOSTILE_VALUES = (
    *(None, True, -1, 0, 2**31, 2**63, 10**400, -(10**30), 0.5, 1e308, [], {}, [[]] * 50, {"a": {"b": [1]}}),
    *("", " ", "\0", "a\0b", "\ud800", "\u202e", "é" * 300, "x" * 9_000),
    *("'; DROP TABLE annotations; --", "../../etc/passwd"),
    *("<script>alert(1)</script>", "{{7*7}}", "%00", "%2e%2e/", "NaN", "1e999", "exist(" * 70, "lambda x: " * 90),
    *("all_items + all_items", "unique(all_items)", "ADD(-1, 0, CIRCLE, BLUE, SMALL)", "STOP", "ADD(LEFT, BLUE)"),
)
BODIES = (
    *(b"", b"{", b"null", b"[]", b'"x"', b"\xff\xfe", b"{" * 5_000, b"[" * 100_000, b'{"a":' * 2_000),
    *(b"NaN", b'{"steps": NaN}', b'{"program": "\\ud800"}', b"x" * 300_000, b"\x1f\x8b\x08", b"1" * 6_000),
)
HEADERS = (
    *({"Content-Type": "text/plain"}, {"Content-Type": "application/json; charset=utf-99"}, {"Content-Type": "\x01"}),
    *({"Cookie": "lilgym_token=a.b"}, {"Cookie": "=;=;" * 40}, {"Origin": "http://["}, {"Host": "["}, {"Host": ""}),
    *({"Content-Length": "-1"}, {"Accept": "\xe9"}, {"Range": "bytes=5-1"}, {"Origin": "é"}),
)


class RequestGenerator:
    """Endless iterator of random requests for the operations of an OpenAPI schema."""

    def __init__(self, schema, random, known):
        self.random = random
        self.known = known  # existing values by parameter name
        self._components = schema.get("components", {}).get("schemas", {})
        self.operations = [
            (path, *operation) for path, methods in schema["paths"].items() for operation in methods.items()
        ]

    def __iter__(self):
        """Method, path, and further arguments of httpx's `request`."""
        while True:
            path, method, described = self.random.choice(self.operations)
            options: dict[str, Any] = {"params": []}
            for parameter in described.get("parameters", ()):
                name = parameter["name"]
                text = _text(self._value(parameter.get("schema", {}), name))
                if parameter["in"] == "path":
                    path = path.replace("{" + name + "}", quote(text, safe="")[:2_000])
                elif self.random.random() < 0.7:
                    options["params"] += [(name, text)] * self.random.choice((1, 1, 1, 2))
            content = described.get("requestBody", {}).get("content", {})
            if content:
                options |= self._body(content)
            if self.random.random() < 0.1:
                options["headers"] = self.random.choice(HEADERS)
            yield method, path, options

    def _body(self, content):
        if self.random.random() < 0.15 or "application/json" not in content:
            return {"content": self.random.choice(BODIES)}
        body = self._value(content["application/json"]["schema"], "", hostile=0.05)
        data = json.dumps(body).encode()
        if self.random.random() < 0.05:
            data = data[: self.random.randrange(1 + len(data))]
        return {"content": data, "headers": {"Content-Type": "application/json"}}

    def _value(self, schema, name, hostile=0.25):
        """A value that fits the schema, or with probability `hostile` one of HOSTILE_VALUES."""
        random = self.random
        if random.random() < hostile:
            return random.choice(HOSTILE_VALUES)
        if name in self.known and random.random() < 0.7:
            return random.choice(self.known[name])
        match schema:
            case {"$ref": reference}:
                return self._value(self._components[reference.rpartition("/")[2]], name, hostile)
            case {"anyOf": choices}:
                return self._value(random.choice(choices), name, hostile)
            case {"enum": values}:
                return random.choice(values)
            case {"type": "object"}:
                fields = schema.get("properties", {}).items()
                return {key: self._value(of, key, hostile=0.12) for key, of in fields if random.random() < 0.9}
            case {"type": "array"}:
                return [self._value(schema.get("items", {}), name) for _ in range(random.randrange(4))]
            case {"type": "integer" | "number" | "boolean" | "null" as kind}:
                simple = {"integer": random.randint(-1, 30), "number": random.uniform(-1, 30), "null": None}
                return simple.get(kind, random.random() < 0.5)
            case _:
                return random.choice(("x", "a-b_c", "blue", "STOP", "exist(all_items)", "scatter-dev-025-a"))


def _text(value):
    return (value if isinstance(value, str) else json.dumps(value)).encode(errors="replace").decode()


def _known(clients):
    """Creates episodes; returns existing ids by parameter name."""
    episodes = [
        client.post("/api/play/episodes", {"configuration": configuration}).json()["id"]
        for client in clients
        for configuration in ("TowerScratch", "ScatterFlipIt")
    ]
    return {"episode_id": episodes, "statement_id": ["tower-dev-001", "scatter-dev-025-a"]}


def send(count, seed):
    """Sends `count` requests; returns the responses by status, and the requests with a 5xx response."""
    from tests.web.web_app import Browser, server

    logging.getLogger("lilgym_mp.contrib.web").addHandler(logging.StreamHandler())
    random, statuses, failed = Random(seed), Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as name, server(Path(name)) as app:
        browsers = [Browser(app) for _ in range(3)]
        for method, path, options in islice(RequestGenerator(app.openapi(), random, _known(browsers)), count):
            client = random.choice(browsers)
            try:
                response = client.request(method, path, follow_redirects=False, **options)
            except (ValueError, UnicodeError, TypeError):
                statuses["httpx refuses to send it"] += 1
                continue
            statuses[str(response.status_code)] += 1
            if response.status_code >= 500:
                failed.append(f"{response.status_code} {method} {path} {str(options)[:300]}")
    return statuses, failed
