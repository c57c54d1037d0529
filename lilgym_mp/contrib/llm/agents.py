"""Text agents: the interface and the built-in ones."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pkgutil import resolve_name
from typing import Any, NamedTuple, Protocol, cast
from urllib.parse import unquote

from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.choices import choose
from lilgym_mp.solver import Expert
from lilgym_mp.wrappers import TextObservation

# {"role": "system" | "user" | "assistant", "content"}: a text, or content parts of OpenAI's chat API for pictures
Message = dict[str, Any]


class ModelError(ValueError):
    """The agent is unavailable or does not answer."""


class Answer(NamedTuple):
    """An agent's reply, with token counts if known.

    Attributes:
        text: The reply, without separate thoughts.
        prompt_tokens: Tokens read.
        completion_tokens: Tokens written.
        reasoning: Thoughts that the model gave apart from the text; kept in transcripts.
        retries: Failed calls before this one.
        problem: Why the text is not the model's answer: "cut", "filtered" or "refused".
    """

    text: str
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    reasoning: str | None = None  # thoughts that the model gave apart from the text; kept in transcripts
    retries: int = 0  # failed calls before this one
    problem: str | None = None  # why the text is not the model's answer: "cut", "filtered" or "refused"


class LanguageAgent(Protocol):
    """Replies to a conversation.

    An agent may also define `begin(env, seed)`, called before each episode with the environment, for scripted agents
    that use the state, and `concurrency`, the number of episodes that it plays at the same time in threads by default.
    """

    def answer(self, messages: Sequence[Message]) -> Answer | str:
        """The reply to a conversation.

        Args:
            messages: Oldest first; the first is the system message if there is one, the last a user's.
        """
        ...


class ExpertAgent:
    """The next action of a shortest solution, found with the program."""

    def begin(self, env: TextObservation, seed: int) -> None:
        """Makes an expert for the episode that `env` has just begun."""
        self._appearance = env.get_wrapper_attr("dynamics").appearance
        self._expert = Expert(env)

    def answer(self, messages: Sequence[Message]) -> str:
        """The text of the expert's next action; it does not read the messages."""
        return describe(self._appearance.decode(self._expert.act()))


AGENTS: Mapping[str, str] = {  # as "module:Class", since the last two need further libraries
    "expert": f"{__name__}:ExpertAgent",
    "openai": "lilgym_mp.contrib.llm.openai_agent:OpenAIAgent",
    "transformers": "lilgym_mp.contrib.llm.transformers_agent:TransformersAgent",
}


def make_agent(name: str, options: Mapping[str, Any] | None = None) -> LanguageAgent:
    """A text agent by its name.

    Args:
        name: One of AGENTS, or "module:Class".
        options: Keyword arguments of its constructor.

    Returns:
        The agent.

    Raises:
        ModelError: For a missing module or class, or invalid options, whose values the message does not show.
    """
    given = dict(options or {})
    path = name if ":" in name else choose("agent", name, AGENTS)
    try:
        agent = resolve_name(path)(**given)
    except ModelError:
        raise
    except Exception as error:
        hint = "name it module:Class, importable from here" if ":" in name else "give options as --option KEY=VALUE"
        known = f"with the options {', '.join(given) or 'none'}; {hint}"
        reason = without_secrets(described(error), given)
        raise ModelError(f"agent {name!r} cannot be constructed {known}: {reason}") from None
    if not callable(getattr(agent, "answer", None)):
        raise ModelError(f"agent {name!r} has no method answer(messages)")
    return agent


def described(error: BaseException) -> str:
    """The type and message of an error."""
    return f"{type(error).__name__}: {error}"


_SECRET_NAME = re.compile(
    "key|secret|passw|pwd|token(?!s|i)|auth|bearer|credential|cookie|header|signature|query", re.IGNORECASE
)
_SECRET_VALUE = re.compile(r"(?:sk|pk|hf|gsk|ghp|xai)[-_]\w|bearer\s|basic\s", re.IGNORECASE)


def is_secret(name: str, value: object) -> bool:
    """Whether an option, or a field within one, can hold a key, by its name or its value."""
    return bool(_SECRET_NAME.search(name) or (isinstance(value, str) and _SECRET_VALUE.match(value)))


def without_credentials(url: str) -> str:
    """The URL without query, fragment and all before its last @ but the scheme: what can contain keys."""
    return re.split("[?#]", re.sub(r"^(\w+://)?.*@", r"\1", url))[0]


def without_secrets(text: str, options: Mapping[str, Any], *others: str) -> str:
    """The text with "..." for the secrets among the options' values, and for `others`."""
    found = {each for name, value in options.items() for each in _secrets(name, value, secret=False)}
    for secret in sorted({*found, *others} - {""}, key=len, reverse=True):
        text = text.replace(secret, "...")
    return text


def _secrets(name: str, value: object, *, secret: bool) -> set[str]:
    """The secret texts in an option's value; all of them if what contains it is `secret`."""
    secret = secret or is_secret(name, value)
    if isinstance(value, Mapping):
        fields = cast("Mapping[str, Any]", value)
        return {each for key in fields for each in _secrets(str(key), fields[key], secret=secret)}
    if isinstance(value, list):
        return {each for item in cast("list[Any]", value) for each in _secrets(name, item, secret=secret)}
    text = str(value)
    if secret:
        return {text}
    if "://" not in text and "@" not in text:
        return set()
    user, sign, _ = text.partition("://")[2].rpartition("@")
    parts = [user, *user.split(":", 1)[1:], *text.split("?", 1)[1:]] if sign else text.split("?", 1)[1:]
    parts += [given for part in parts for _, equals, given in [part.partition("=")] if equals]
    return {form for part in parts for form in (part, unquote(part))}
