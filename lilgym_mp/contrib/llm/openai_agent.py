"""A language model behind OpenAI's chat API, or any server that is compatible with it."""

from __future__ import annotations

import json
import os
import re
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from lilgym_mp.contrib.llm.agents import (
    Answer,
    Message,
    ModelError,
    described,
    without_credentials,
    without_secrets,
)
from lilgym_mp.corpus.extras import install
from lilgym_mp.wrappers.replies import FAILED, FILTERED, REFUSED, reply_text, unusual_end

KEY_VARIABLE = "OPENAI_API_KEY"
TIMEOUT_SECONDS = 120.0  # of a whole request
DEFAULT_TOKENS = 512
REFUSED_FIELDS = ("messages", "stream", "n")
REFUSED_IN_BODY = ("model", *REFUSED_FIELDS)
OBJECTS = frozenset(("extra_body", "extra_headers", "extra_query"))
SHOWN = 300  # characters of a server's error
BUSY = (408, 409, 429)  # besides 500 and above: status codes after which a request is sent again
FIRST_PAUSE = 0.5  # seconds before another attempt; doubled each time
LONGEST_PAUSE = 8.0
LONGEST_WAIT = 120.0  # seconds that a server may ask to wait
MOST_TOKENS = 10**12  # of an answer; a higher count is none
_BUSY_WORDS = re.compile(
    r"rate.?limit|too many requests|overloaded|resource.?exhausted"
    r"""|['"](?:code|status)['"]: ?['"]?(?:429|50[023]|529)\b""",
    re.IGNORECASE,
)


class ServerError(ValueError):
    """A server's reply that is no chat completion; `is_busy`: whether another attempt can help."""

    def __init__(self, message: str, *, is_busy: bool = False) -> None:
        super().__init__(message)
        self.is_busy = is_busy


class OpenAIAgent:
    """Asks a model through the `openai` package. One agent can play many episodes at the same time."""

    concurrency = 32  # episodes played at the same time unless the caller says otherwise

    def __init__(
        self,
        model: str,
        *,
        url: str | None = None,
        retries: int = 5,
        timeout: float | None = TIMEOUT_SECONDS,
        temperature: float | None = 0.0,
        max_tokens: int | None = DEFAULT_TOKENS,
        **fields: Any,
    ) -> None:
        """`url`: such as "http://localhost:8000/v1"; by default the package's. The environment variable OPENAI_API_KEY
        has the API key; servers at a `url` may need none. `retries`: of a request to a busy or unreachable server.
        `timeout`: seconds for a whole request, to its last byte; None for no limit. `temperature`, `max_tokens`,
        `fields`: arguments of the package's `chat.completions.create`; None leaves one out, `max_completion_tokens`
        replaces `max_tokens`. Raises ModelError for invalid arguments and without the package."""
        try:
            import openai
        except ImportError:
            raise ModelError(f'the agent "openai" needs a package: {install("llm")}') from None
        self._key = os.environ.get(KEY_VARIABLE, "").strip()
        if not (self._key.isascii() and (self._key.isprintable())):
            raise ModelError(f"the key in {KEY_VARIABLE} must consist of printable ASCII characters")
        if not self._key and url is None:
            raise ModelError(f"set {KEY_VARIABLE} to the API key, or give the url of a server that needs none")
        if url is not None and not str(url).startswith(("http://", "https://")):
            raise ModelError(f"url must begin with http:// or https://, not {without_credentials(str(url))!r}")
        for name in fields:
            if name in REFUSED_FIELDS or "key" in name:
                raise ModelError(f"{name} cannot be set; the key is read from {KEY_VARIABLE}")
        for name in OBJECTS & fields.keys():
            if not isinstance(fields[name], dict | None):
                raise ModelError(f"{name} must be a JSON object")
        for name in REFUSED_IN_BODY:
            if name in (fields.get("extra_body") or ()):
                raise ModelError(f"extra_body cannot set {name}")
        if type(retries) is not int or retries < 0:
            raise ModelError(f"retries must be a whole number of at least 0, not {retries!r}")
        if timeout is not None and not (type(timeout) in (int, float) and 0 < timeout <= threading.TIMEOUT_MAX):
            raise ModelError(f"timeout must be a number of seconds above 0 or null, not {timeout!r}")
        self._openai: Any = openai
        self._timeout = timeout
        self._retries = retries
        self._client: Any = openai.OpenAI(api_key=self._key or "none", base_url=url, timeout=timeout, max_retries=0)
        if "max_completion_tokens" in fields and max_tokens == DEFAULT_TOKENS:
            max_tokens = None
        fields |= {"model": str(model), "temperature": temperature, "max_tokens": max_tokens}
        self._fields = {name: value for name, value in fields.items() if value is not None}
        self._shown_url = without_credentials(str(self._client.base_url))
        self._secrets = {**self._fields, "url": url}

    def answer(self, messages: Sequence[Message]) -> Answer:
        """Raises ModelError when the server refuses, cannot be reached after all retries, or gives no reply."""
        for attempt in range(self._retries + 1):
            try:
                return self._asked(list(messages))._replace(retries=attempt)
            except Exception as error:
                if attempt == self._retries or not self._is_busy(error):
                    text = without_secrets(_told(error), self._secrets, self._key)
                    raise ModelError(f"{self._shown_url}: {text[:SHOWN]}") from None
                time.sleep(_pause(error, attempt))
        raise AssertionError("retries is at least 0")

    def _asked(self, messages: list[Message]) -> Answer:
        create = self._client.chat.completions.with_raw_response.create
        raw = _within(self._timeout, lambda: create(messages=messages, **self._fields))
        return read_completion(raw.content if isinstance(raw.content, bytes) else str(raw.content).encode())

    def _is_busy(self, error: Exception) -> bool:
        status = getattr(error, "status_code", None)
        if isinstance(status, int):
            return status in BUSY or status >= 500
        return isinstance(error, self._openai.APIConnectionError) or bool(getattr(error, "is_busy", False))


def read_completion(body: bytes) -> Answer:
    """The answer in the body of a chat completion. Raises ServerError, with the server's words, for another body."""
    text = body.decode("utf-8-sig", errors="replace")
    completion: Message = {}
    with suppress(ValueError, TypeError, RecursionError):
        completion = dict(json.loads(text))
    _refuse_error(completion)
    try:
        choice: Message = completion["choices"][0]
        said: Message = dict(choice["message"])
    except (LookupError, TypeError, ValueError):
        reason = f"not a chat completion; is /v1 missing from the url? The server sent {text[:SHOWN]!r}"
        raise ServerError(reason, is_busy=_says_busy(completion or text)) from None
    _refuse_error(choice)
    reason = choice.get("finish_reason")
    problem = unusual_end(reason)
    if problem == FAILED:
        raise ServerError(f"the answer ended with finish_reason {reason!r:.80}")
    if said.get("refusal") and problem != FILTERED:
        problem = REFUSED
    refusal = said.get("refusal")
    answer = reply_text(said.get("content")) or (refusal if isinstance(refusal, str) else "")
    reasoning = reply_text(said.get("reasoning_content") or said.get("reasoning"))
    usage = completion.get("usage")
    counts = usage if isinstance(usage, dict) else {}
    read, written = (_count(counts.get(name)) for name in ("prompt_tokens", "completion_tokens"))
    return Answer(answer, read, written, reasoning=reasoning, problem=problem)


def _refuse_error(data: Message) -> None:
    """Raises ServerError for an error that a server reports with a status of success."""
    error = data.get("error")
    if error:
        words = json.dumps(error, ensure_ascii=False) if isinstance(error, dict | list) else str(error)
        raise ServerError(f"the server reported an error: {words}", is_busy=_says_busy(error))


def _says_busy(error: object) -> bool:
    """Whether what a server sent instead of an answer says that another attempt can help."""
    return _BUSY_WORDS.search(str(error)) is not None


def _within(seconds: float | None, call: Callable[[], Any]) -> Any:
    """The result of the call. Raises ServerError after this time; its thread then waits for the server on its own."""
    future = Future[Any]()

    def run() -> None:
        try:
            future.set_result(call())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    try:
        return future.result(seconds)
    except TimeoutError:
        if future.done():
            raise
        raise ServerError(f"the request took longer than {seconds:g} seconds", is_busy=True) from None


def _pause(error: Exception, attempt: int) -> float:
    """Seconds before the next attempt: as the server asks, else longer each time."""
    headers = getattr(getattr(error, "response", None), "headers", None) or {}
    try:
        asked = float(headers.get("retry-after", 0))
    except ValueError:
        asked = 0.0
    return asked if 0 < asked <= LONGEST_WAIT else min(FIRST_PAUSE * 2**attempt, LONGEST_PAUSE)


def _told(error: Exception) -> str:
    """The error with its body, or else the first cause of it."""
    text = described(error) if not isinstance(error, ServerError) else str(error)
    if (body := getattr(error, "body", None)) and str(body) not in text:
        text += f" {body}"
    cause = error.__cause__
    while cause is not None and cause.__cause__ is not None:
        cause = cause.__cause__
    return text if cause is None or str(cause) in text else f"{text} ({described(cause)})"


def _count(value: object) -> int | None:
    return value if type(value) is int and 0 <= value <= MOST_TOKENS else None
