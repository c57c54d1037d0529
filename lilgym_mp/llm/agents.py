"""Text agents: the interface and the built-in ones."""

from __future__ import annotations

import json
import os
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple, Protocol

import numpy as np

from lilgym_mp.actions import describe
from lilgym_mp.choices import choose
from lilgym_mp.solver import Expert
from lilgym_mp.wrappers import TextObservation

Message = dict[str, str]  # {"role": "system" | "user" | "assistant", "content"}

RETRIED_STATUSES = (408, 425, 429, 500, 502, 503, 504)  # HTTP status codes
FIRST_DELAY_SECONDS = 1.0  # before the first retry, doubled each time


class AgentError(ValueError):
    """The agent is unavailable or does not answer."""


class Answer(NamedTuple):
    """An agent's reply, with token counts if known."""

    text: str
    prompt_tokens: int | None = None
    completion_tokens: int | None = None


class LanguageAgent(Protocol):
    """Replies to a conversation.

    An agent may also define `begin(env, seed)`, called before each episode with the environment, for scripted agents
    that use the state.
    """

    def answer(self, messages: Sequence[Message]) -> Answer | str:
        """The reply to messages, oldest first; the first is the system message, the last a user message."""
        ...


class RandomAgent:
    """Uniformly random legal actions."""

    def begin(self, env: TextObservation, seed: int) -> None:
        self._env = env
        self._rng = np.random.default_rng(seed)

    def answer(self, messages: Sequence[Message]) -> str:
        appearance = self._env.get_wrapper_attr("dynamics").appearance
        index = int(self._rng.choice(np.flatnonzero(self._env.action_masks())))
        return describe(appearance.decode(index))


class ExpertAgent:
    """The next action of a shortest solution, found with the program."""

    def begin(self, env: TextObservation, seed: int) -> None:
        self._appearance = env.get_wrapper_attr("dynamics").appearance
        self._expert = Expert(env)

    def answer(self, messages: Sequence[Message]) -> str:
        return describe(self._appearance.decode(self._expert.act()))


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
        """`url`: such as "http://localhost:8000/v1". `key_variable`: environment variable with the API key, optional.
        `retries`: of a request to a busy or unreachable server."""
        if not url.startswith(("http://", "https://")):
            raise AgentError(f"url must begin with http:// or https://, not {url!r}")
        self._url = url.rstrip("/") + "/chat/completions"
        self._settings = {"model": model, "temperature": float(temperature), "max_tokens": int(max_tokens)}
        self._key_variable = key_variable
        self._timeout = float(timeout_seconds)
        self._retries = int(retries)

    def answer(self, messages: Sequence[Message]) -> Answer:
        """Raises AgentError when the server refuses, is unreachable, or replies in another format."""
        body = json.dumps({**self._settings, "messages": list(messages)}).encode()
        content = self._post(body)
        try:
            text = content["choices"][0]["message"]["content"]
            usage = content.get("usage") or {}
        except (KeyError, IndexError, TypeError, AttributeError):
            raise AgentError(
                f"{self._url}: the reply has no choices[0].message.content: {str(content)[:200]}"
            ) from None
        return Answer("" if text is None else str(text), usage.get("prompt_tokens"), usage.get("completion_tokens"))

    def _post(self, body: bytes) -> Any:
        headers = {"Content-Type": "application/json"}
        if key := os.environ.get(self._key_variable):
            headers["Authorization"] = f"Bearer {key}"
        request = urllib.request.Request(self._url, body, headers)
        for attempt in range(self._retries + 1):
            try:
                with urllib.request.urlopen(request, timeout=self._timeout) as response:
                    return json.load(response)
            except urllib.error.HTTPError as refusal:
                with refusal:
                    error = f"HTTP {refusal.code} {refusal.reason}: {refusal.read(200).decode(errors='replace')}"
                if refusal.code not in RETRIED_STATUSES:
                    raise AgentError(f"{self._url}: {error}") from None
            except (OSError, ValueError) as failure:
                error = str(failure)
            if attempt < self._retries:
                time.sleep(FIRST_DELAY_SECONDS * 2**attempt)
        raise AgentError(f"{self._url}: {error} ({self._retries + 1} attempts)")


def _transformers_agent(**options: Any) -> LanguageAgent:
    from lilgym_mp.llm.transformers_agent import TransformersAgent

    return TransformersAgent(**options)


AGENTS: Mapping[str, Callable[..., LanguageAgent]] = {
    "random": RandomAgent,
    "expert": ExpertAgent,
    "http": HTTPAgent,
    "transformers": _transformers_agent,
}


def make_agent(name: str, options: Mapping[str, Any] | None = None) -> LanguageAgent:
    """The agent called `name`, one of AGENTS or "module:Class", constructed with `options` as keyword arguments.

    Raises AgentError for a missing module or class, or invalid options.
    """
    maker = _imported(name) if ":" in name else choose("agent", name, AGENTS)
    try:
        agent = maker(**(options or {}))
    except TypeError as error:
        raise AgentError(
            f"agent {name!r} cannot be constructed with the options {dict(options or {})}: {error}"
        ) from None
    if not callable(getattr(agent, "answer", None)):
        raise AgentError(f"agent {name!r} has no method answer(messages)")
    return agent


def _imported(name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise AgentError(f"agent {name!r}: {error}; name it module:Class, importable from here") from None
