"""Agents that read and write: the interface, and those that come with the package."""

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

RETRIED_STATUSES = (408, 425, 429, 500, 502, 503, 504)
FIRST_PAUSE_SECONDS = 1.0  # before a request is repeated; then twice as long each time


class AgentError(ValueError):
    """An agent that cannot be had, or that gives no answer."""


class Answer(NamedTuple):
    """What an agent writes, and what it took if the agent knows."""

    text: str
    prompt_tokens: int | None = None
    completion_tokens: int | None = None


class LanguageAgent(Protocol):
    """Answers a conversation. One may also have `begin(env, seed)`, called before each episode with the
    environment, which scripts may look into."""

    def answer(self, messages: Sequence[Message]) -> Answer | str:
        """The reply to messages, oldest first; the first is the system's, the last the user's."""
        ...


class RandomAgent:
    """Names a legal action, all equally likely."""

    def begin(self, env: TextObservation, seed: int) -> None:
        self._env = env
        self._generator = np.random.default_rng(seed)

    def answer(self, messages: Sequence[Message]) -> str:
        appearance = self._env.get_wrapper_attr("dynamics").appearance
        number = int(self._generator.choice(np.flatnonzero(self._env.action_masks())))
        return describe(appearance.decode(number))


class ExpertAgent:
    """Names the next action of a shortest solution; it looks at the program."""

    def begin(self, env: TextObservation, seed: int) -> None:
        self._appearance = env.get_wrapper_attr("dynamics").appearance
        self._expert = Expert(env)

    def answer(self, messages: Sequence[Message]) -> str:
        return describe(self._appearance.decode(self._expert.act()))


class HTTPAgent:
    """A model behind an HTTP server that speaks OpenAI's chat protocol: POST `url`/chat/completions."""

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
        """`url`: such as "http://localhost:8000/v1". `key_variable`: the environment variable with the key, sent
        where it is set. `retries`: repetitions of a request that met a busy or unreachable server."""
        if not url.startswith(("http://", "https://")):
            raise AgentError(f"url must begin with http:// or https://, not {url!r}")
        self._url = url.rstrip("/") + "/chat/completions"
        self._settings = {"model": model, "temperature": float(temperature), "max_tokens": int(max_tokens)}
        self._key_variable = key_variable
        self._timeout = float(timeout_seconds)
        self._retries = int(retries)

    def answer(self, messages: Sequence[Message]) -> Answer:
        """Raises AgentError when the server refuses, stays out of reach, or says what is no answer."""
        body = json.dumps({**self._settings, "messages": list(messages)}).encode()
        content = self._posted(body)
        try:
            text = content["choices"][0]["message"]["content"]
            usage = content.get("usage") or {}
        except (KeyError, IndexError, TypeError, AttributeError):
            raise AgentError(
                f"{self._url}: the reply has no choices[0].message.content: {str(content)[:200]}"
            ) from None
        return Answer("" if text is None else str(text), usage.get("prompt_tokens"), usage.get("completion_tokens"))

    def _posted(self, body: bytes) -> Any:
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
            except (OSError, ValueError) as broken:
                error = str(broken)
            if attempt < self._retries:
                time.sleep(FIRST_PAUSE_SECONDS * 2**attempt)
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
    """The agent called `name`, one of AGENTS or "module:Class", made with `options` as keywords.

    Raises AgentError for a module or class that is not there, or options that it does not take.
    """
    maker = _imported(name) if ":" in name else choose("agent", name, AGENTS)
    try:
        agent = maker(**(options or {}))
    except TypeError as error:
        raise AgentError(f"agent {name!r} cannot be made with the options {dict(options or {})}: {error}") from None
    if not callable(getattr(agent, "answer", None)):
        raise AgentError(f"agent {name!r} has no method answer(messages)")
    return agent


def _imported(name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise AgentError(f"agent {name!r}: {error}; name it module:Class, importable from here") from None
