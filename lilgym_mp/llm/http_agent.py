"""A language model behind an OpenAI-compatible chat API. Whatever the server does, a request ends within its limits."""

from __future__ import annotations

import asyncio
import json
import os
import re
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from lilgym_mp.extras import install
from lilgym_mp.llm.agents import AgentError, Answer, Message

RETRIED_STATUSES = (408, 425, 429, 500, 502, 503, 504)  # HTTP status codes
FIRST_DELAY_SECONDS = 1.0  # before the first retry, doubled each time
MAX_BYTES = 4_000_000  # of a response
SHOWN = 200  # characters of a server's text in an error


class HTTPAgent:
    """A model behind an OpenAI-compatible chat API: POST `url`/chat/completions."""

    def __init__(
        self,
        url: str,
        model: str,
        *,
        key_variable: str = "OPENAI_API_KEY",
        temperature: float = 0.0,
        max_tokens: int = 512,
        timeout_seconds: float = 60.0,
        retries: int = 3,
    ) -> None:
        """`url`: such as "http://localhost:8000/v1". `key_variable`: environment variable with the API key, optional;
        it is sent to `url` only, since redirects are not followed. `timeout_seconds`: of each attempt, from the
        connection to the end of the response. `retries`: of a request to a busy or unreachable server."""
        try:
            import httpx
        except ImportError:
            raise AgentError(f'the agent "http" needs httpx: {install("llm")}') from None
        if not url.startswith(("http://", "https://")):
            raise AgentError(f"url must begin with http:// or https://, not {url!r}")
        if not float(timeout_seconds) > 0:
            raise AgentError(f"timeout_seconds must be positive, not {timeout_seconds!r}")
        self._httpx = httpx
        self._url = url.rstrip("/") + "/chat/completions"
        self._settings = {"model": model, "temperature": float(temperature), "max_tokens": int(max_tokens)}
        self._headers = {"Content-Type": "application/json", "Accept-Encoding": "identity"}
        if key := os.environ.get(key_variable, "").strip():
            if not (key.isascii() and key.isprintable()):
                raise AgentError(f"the key in {key_variable} must consist of printable ASCII characters")
            self._headers["Authorization"] = f"Bearer {key}"
        self._timeout = float(timeout_seconds)
        self._retries = int(retries)

    def answer(self, messages: Sequence[Message]) -> Answer:
        """Raises AgentError when the server refuses, is unreachable, exceeds a limit, or replies in another format."""
        content = self._post(json.dumps({**self._settings, "messages": list(messages)}).encode())
        try:
            text = content["choices"][0]["message"]["content"]
        except (KeyError, IndexError, TypeError):
            text = content
        if text is not None and not isinstance(text, str):
            raise self._error(f"the reply has no text choices[0].message.content: {str(content)[:SHOWN]}")
        usage = content.get("usage")
        tokens = usage if isinstance(usage, dict) else {}
        return Answer(text or "", *(_count(tokens.get(name)) for name in ("prompt_tokens", "completion_tokens")))

    def _post(self, body: bytes) -> Any:
        error = ""
        for attempt in range(self._retries + 1):
            if attempt:
                time.sleep(FIRST_DELAY_SECONDS * 2 ** (attempt - 1))
            try:
                status, content = _run(self._request(body))
            except TimeoutError:
                error = f"no complete reply within {self._timeout:g} seconds"
            except (self._httpx.HTTPError, self._httpx.InvalidURL, OSError, UnicodeError) as failure:
                error = f"{type(failure).__name__}: {failure}"
            else:
                if status == 200:
                    return self._parsed(content)
                error = f"HTTP {status}: {content[:SHOWN].decode(errors='replace')}"
                if status not in RETRIED_STATUSES:
                    hint = "; redirects are not followed" if 300 <= status < 400 else ""
                    raise self._error(error + hint)
        raise self._error(f"{error} ({self._retries + 1} attempts)")

    async def _request(self, body: bytes) -> tuple[int, bytes]:
        """Status and content of the response. Raises TimeoutError, AgentError for a response that is too large."""
        content = bytearray()
        async with (
            asyncio.timeout(self._timeout),
            self._httpx.AsyncClient(timeout=None) as client,
            client.stream("POST", self._url, content=body, headers=self._headers) as response,
        ):
            async for part in response.aiter_raw():
                content += part
                if len(content) > MAX_BYTES:
                    raise self._error(f"the reply has more than {MAX_BYTES:,} bytes")
            return response.status_code, bytes(content)

    def _parsed(self, content: bytes) -> Any:
        try:
            return json.loads(content)
        except (ValueError, RecursionError):
            shown = content[:SHOWN].decode(errors="replace")
            raise self._error(f"the reply is not JSON: {shown}") from None

    def _error(self, text: str) -> AgentError:
        return AgentError(f"{without_credentials(self._url)}: {text}")


def without_credentials(url: str) -> str:
    """The URL without query, fragment and all before its last @ but the scheme: what can contain keys."""
    return re.split("[?#]", re.sub(r"^(\w+://)?.*@", r"\1", url))[0]


def _run(request: Any) -> Any:
    """The result of a coroutine, also where an event loop is running, as in notebooks."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(request)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, request).result()


def _count(value: object) -> int | None:
    return value if type(value) is int and value >= 0 else None
