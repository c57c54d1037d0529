"""A language model behind OpenAI's chat API, or any server that is compatible with it."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import Any

from lilgym_mp.contrib.llm.agents import AgentError, Answer, Message, described
from lilgym_mp.corpus.extras import install
from lilgym_mp.wrappers.replies import reply_text

KEY_VARIABLE = "OPENAI_API_KEY"
TIMEOUT_SECONDS = 120.0
DEFAULT_TOKENS = 512
REFUSED = ("messages", "stream", "n")
SHOWN = 300  # characters of a server's error


class OpenAIAgent:
    """Asks a model through the `openai` package. One agent can play many episodes at the same time."""

    concurrency = 32  # episodes played at the same time unless the caller says otherwise

    def __init__(
        self,
        model: str,
        *,
        url: str | None = None,
        retries: int = 5,
        temperature: float | None = 0.0,
        max_tokens: int | None = DEFAULT_TOKENS,
        **fields: Any,
    ) -> None:
        """`url`: such as "http://localhost:8000/v1"; by default the package's. The environment variable OPENAI_API_KEY
        has the API key; servers at a `url` may need none. `retries`: of a request to a busy or unreachable server.
        `temperature`, `max_tokens`, `fields`: arguments of the package's `chat.completions.create`; None leaves one
        out, `max_completion_tokens` replaces `max_tokens`. Raises AgentError for invalid arguments and without the
        package."""
        try:
            import openai
        except ImportError:
            raise AgentError(f'the agent "openai" needs a package: {install("llm")}') from None
        self._key = os.environ.get(KEY_VARIABLE, "").strip()
        if not (self._key.isascii() and (self._key.isprintable())):
            raise AgentError(f"the key in {KEY_VARIABLE} must consist of printable ASCII characters")
        if not self._key and url is None:
            raise AgentError(f"set {KEY_VARIABLE} to the API key, or give the url of a server that needs none")
        if url is not None and not url.startswith(("http://", "https://")):
            raise AgentError(f"url must begin with http:// or https://, not {without_credentials(url)!r}")
        for name in fields:
            if name in REFUSED or "key" in name:
                raise AgentError(f"{name} cannot be set; the key is read from {KEY_VARIABLE}")
        self._client: Any = openai.OpenAI(
            api_key=self._key or "none", base_url=url, timeout=TIMEOUT_SECONDS, max_retries=int(retries)
        )
        if "max_completion_tokens" in fields and max_tokens == DEFAULT_TOKENS:
            max_tokens = None
        fields |= {"model": str(model), "temperature": temperature, "max_tokens": max_tokens}
        self._fields = {name: value for name, value in fields.items() if value is not None}

    def answer(self, messages: Sequence[Message]) -> Answer:
        """Raises AgentError when the server refuses, cannot be reached after all retries, or gives no reply."""
        try:
            raw = self._client.chat.completions.with_raw_response.create(messages=list(messages), **self._fields)
            response: Any = raw.parse()
            message = response.choices[0].message
        except Exception as error:
            url = without_credentials(str(self._client.base_url))
            text = described(error)
            if (body := getattr(error, "body", None)) and str(body) not in text:
                text += f" {body}"
            hidden = text.replace(self._key, "...") if self._key else text
            raise AgentError(f"{url}: {hidden[:SHOWN]}") from None
        text = reply_text(message.content) or getattr(message, "refusal", None) or ""
        reasoning = getattr(message, "reasoning_content", None) or getattr(message, "reasoning", None)
        counts = (_count(getattr(response.usage, name, None)) for name in ("prompt_tokens", "completion_tokens"))
        return Answer(text, *counts, reasoning=reply_text(reasoning), retries=raw.retries_taken)


def without_credentials(url: str) -> str:
    """The URL without query, fragment and all before its last @ but the scheme: what can contain keys."""
    return re.split("[?#]", re.sub(r"^(\w+://)?.*@", r"\1", url))[0]


def _count(value: object) -> int | None:
    return value if type(value) is int and value >= 0 else None
