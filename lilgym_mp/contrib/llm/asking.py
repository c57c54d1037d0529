"""Asks a text agent until its reply names an action, within a conversation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from lilgym_mp.contrib.llm.agents import Answer, LanguageAgent, Message, ModelError, described
from lilgym_mp.contrib.llm.summary import Turn
from lilgym_mp.wrappers.replies import ASK_AGAIN, NOT_UNDERSTOOD, THOUGHTS, answer_text

Choice = TypeVar("Choice")
Named = tuple[str, Choice]  # a choice and its name


@dataclass(frozen=True)
class Asking:
    """How an agent is asked: the options of `Player` with these names."""

    agent: LanguageAgent
    retries: int = 1
    history: int = 12
    thoughts: Sequence[str] = THOUGHTS
    system: bool = True

    def __post_init__(self) -> None:
        """Raises ValueError naming the invalid setting."""
        if self.retries < 0 or self.history < 0:
            raise ValueError(f"retries and history must be 0 or more, not {self.retries} and {self.history}")

    def choose(
        self,
        messages: list[Message],
        turns: list[Turn],
        read: Callable[[str], Named[Choice] | None],
        *,
        again: str = ASK_AGAIN,
        recalled: list[Turn] | None = None,
    ) -> Choice | None:
        """The choice that `read` finds in a reply, or None after 1 + `retries` replies without one.

        Extends `messages` and `turns`, whose last says why there is no choice. `again`: asks for another reply.
        `recalled`: turns of an earlier run, which are used up before the agent is asked. Raises ModelError.
        """
        for attempt in range(self.retries + 1):
            start = time.perf_counter()
            if recalled:
                before = recalled.pop(0)
                answer = before.said
                seconds = before.seconds
            else:
                answer = checked_answer(call(self.agent.answer, self._recent(messages)))
                seconds = round(time.perf_counter() - start, 6)
            named = read(answer.text) if answer.problem is None else None
            problem = answer.problem or (None if named is not None else NOT_UNDERSTOOD)
            name = None if named is None else named[0]
            turns.append(Turn(answer.text, problem is None, name, seconds, *answer[1:-1], problem))
            said = (answer_text(answer.text, self.thoughts) or "").strip()
            if said:
                messages.append({"role": "assistant", "content": said})
            if named is not None:
                return named[1]
            if attempt == self.retries:
                break
            if said:
                messages.append({"role": "user", "content": again})
            elif attempt == 0:  # an empty message is refused by many servers, as are two of the user in a row
                messages[-1] = _extended(messages[-1], f"\n\n{again}")
        return None

    def _recent(self, messages: Sequence[Message]) -> list[Message]:
        """The rules, and the last 1 + `history` user messages with the answers in between."""
        user = [index for index, message in enumerate(messages) if message["role"] == "user"]
        first = user[max(0, len(user) - 1 - self.history)]
        if self.system:
            return [messages[0], *messages[first:]]
        return [_extended(messages[first], f"{messages[0]['content']}\n\n", before=True), *messages[first + 1 :]]


def _extended(message: Message, text: str, *, before: bool = False) -> Message:
    """The message with more text in its last part."""
    parts = message["content"]
    if isinstance(parts, str):
        return {**message, "content": text + parts if before else parts + text}
    last = {"type": "text", "text": text + parts[-1]["text"] if before else parts[-1]["text"] + text}
    return {**message, "content": [*parts[:-1], last]}


def call(method: Callable[..., Any], *arguments: Any) -> Any:
    """The result of an agent's method; its exceptions become ModelErrors."""
    try:
        return method(*arguments)
    except ModelError:
        raise
    except (Exception, SystemExit) as error:
        raise ModelError(f"the agent raised {described(error)}") from error


def checked_answer(reply: object) -> Answer:
    """An agent's reply, with text that can be written to files. Raises ModelError for another type."""
    answer = Answer(reply) if isinstance(reply, str) else reply
    if not isinstance(answer, Answer) or not isinstance(answer.text, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ModelError(f"the agent's answer must be a text or an Answer, not {reply!r:.200}")
    reasoning = None if answer.reasoning is None else _writable(answer.reasoning)
    return answer._replace(text=_writable(answer.text), reasoning=reasoning)


def _writable(text: str) -> str:
    return text.encode(errors="replace").decode()
