"""Text agents: the interface and the built-in ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pkgutil import resolve_name
from typing import Any, NamedTuple, Protocol

from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.choices import choose
from lilgym_mp.solver import Expert
from lilgym_mp.wrappers import TextObservation

# {"role": "system" | "user" | "assistant", "content"}: a text, or content parts of OpenAI's chat API for pictures
Message = dict[str, Any]


class AgentError(ValueError):
    """The agent is unavailable or does not answer."""


class Answer(NamedTuple):
    """An agent's reply, with token counts if known."""

    text: str
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    reasoning: str | None = None  # thoughts that the model gave apart from the text; kept in transcripts
    retries: int = 0  # failed calls before this one


class LanguageAgent(Protocol):
    """Replies to a conversation.

    An agent may also define `begin(env, seed)`, called before each episode with the environment, for scripted agents
    that use the state, and `concurrency`, the number of episodes that it plays at the same time in threads by default.
    """

    def answer(self, messages: Sequence[Message]) -> Answer | str:
        """The reply to messages, oldest first; the first is the system message if there is one, the last a user's."""
        ...


class ExpertAgent:
    """The next action of a shortest solution, found with the program."""

    def begin(self, env: TextObservation, seed: int) -> None:
        self._appearance = env.get_wrapper_attr("dynamics").appearance
        self._expert = Expert(env)

    def answer(self, messages: Sequence[Message]) -> str:
        return describe(self._appearance.decode(self._expert.act()))


AGENTS: Mapping[str, str] = {  # as "module:Class", since the last two need further libraries
    "expert": f"{__name__}:ExpertAgent",
    "openai": "lilgym_mp.contrib.llm.openai_agent:OpenAIAgent",
    "transformers": "lilgym_mp.contrib.llm.transformers_agent:TransformersAgent",
}


def make_agent(name: str, options: Mapping[str, Any] | None = None) -> LanguageAgent:
    """The agent called `name`, one of AGENTS or "module:Class", constructed with `options` as keyword arguments.

    Raises AgentError for a missing module or class, or invalid options.
    """
    path = name if ":" in name else choose("agent", name, AGENTS)
    try:
        agent = resolve_name(path)(**(options or {}))
    except AgentError:
        raise
    except Exception as error:
        hint = "name it module:Class, importable from here" if ":" in name else "give options as --option KEY=VALUE"
        given = f"with the options {dict(options or {})}; {hint}"
        raise AgentError(f"agent {name!r} cannot be constructed {given}: {described(error)}") from error
    if not callable(getattr(agent, "answer", None)):
        raise AgentError(f"agent {name!r} has no method answer(messages)")
    return agent


def described(error: BaseException) -> str:
    """The type and message of an error."""
    return f"{type(error).__name__}: {error}"
