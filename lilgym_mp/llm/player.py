"""Episodes of text agents."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from lilgym_mp.actions import describe
from lilgym_mp.corpus import TaskSet
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.llm.agents import AgentError, Answer, LanguageAgent, Message, described
from lilgym_mp.llm.summary import progression
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.replies import ASK_AGAIN


@dataclass(frozen=True)
class Turn:
    """One answer of the agent."""

    answer: str
    understood: bool
    action: str | None  # the action taken; None if the agent was asked again
    seconds: float
    prompt_tokens: int | None
    completion_tokens: int | None


@dataclass(frozen=True)
class Episode:
    """An episode with its complete conversation."""

    task: str
    statement: str
    target: bool
    outcome: str
    reward: float  # sum over the episode
    progression: float
    actions: list[str]
    turns: list[Turn]
    messages: list[Message]

    @property
    def is_success(self) -> bool:
        return self.outcome == "success"

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass
class Player:
    """Plays the tasks of one configuration with a text agent.

    `history`: past observations kept in the conversation. `retries`: further attempts after an answer that names no
    action; then STOP is taken.
    """

    settings: Settings
    agent: LanguageAgent
    split: str = "dev"
    scene: str = "list"
    legal_actions: bool = True
    retries: int = 1
    history: int = 12
    conversation: list[Message] = field(init=False, default_factory=list[Message])  # of the last episode
    env: TextObservation = field(init=False)
    tasks: TaskSet = field(init=False)
    dynamics: Dynamics = field(init=False)

    def __post_init__(self) -> None:
        """Raises ValueError naming the invalid setting."""
        if self.retries < 0 or self.history < 0:
            raise ValueError(f"retries and history must be 0 or more, not {self.retries} and {self.history}")
        env = self.settings.make(self.split)
        self.env = TextObservation(env, scene=self.scene, legal_actions=self.legal_actions)
        self.tasks, self.dynamics = env.tasks, env.dynamics
        self._solver = Solver(env.dynamics)

    def task_ids(self) -> Sequence[str]:
        """All task ids of the split, in file order."""
        return self.env.get_wrapper_attr("evaluation_tasks")()

    def play(self, task_id: str, seed: int = 0) -> Episode:
        """One episode. Raises ValueError for an unknown task, AgentError where the agent raises an exception."""
        text, _ = self.env.reset(seed=seed, options={"task": task_id})
        start = self._state()
        messages = self.conversation = [{"role": "system", "content": self.env.instructions()}]
        if (begin := getattr(self.agent, "begin", None)) is not None:
            _call(begin, self.env, seed)
        turns: list[Turn] = []
        actions: list[str] = []
        total, ended, info = 0.0, False, dict[str, Any]()
        while not ended:
            messages.append({"role": "user", "content": text})
            action = self._choose_action(messages, turns)
            actions.append(describe(self.dynamics.appearance.decode(action)))
            text, reward, terminated, truncated, info = self.env.step(action)
            total, ended = total + float(reward), terminated or truncated
        success = bool(info["is_success"])
        task = start.task
        return Episode(
            task=task.id,
            statement=task.statement,
            target=task.target,
            outcome=str(info["outcome"]),
            reward=round(total, 6),
            progression=progression(self._solver, start, self._state(), success=success),
            actions=actions,
            turns=turns,
            messages=messages,
        )

    def _state(self) -> State:
        return self.env.get_wrapper_attr("state")

    def _choose_action(self, messages: list[Message], turns: list[Turn]) -> int:
        """Asks the agent, up to 1 + `retries` times; extends `messages` and `turns`."""
        for attempt in range(self.retries + 1):
            start = time.perf_counter()
            answer = _answer(_call(self.agent.answer, self._recent(messages)))
            seconds = time.perf_counter() - start
            parsed = self.env.parse_action(answer.text)
            acts = parsed.understood or attempt == self.retries
            name = describe(self.dynamics.appearance.decode(parsed.action)) if acts else None
            tokens = answer.prompt_tokens, answer.completion_tokens
            turns.append(Turn(answer.text, parsed.understood, name, round(seconds, 6), *tokens))
            messages.append({"role": "assistant", "content": answer.text})
            if acts:
                return parsed.action
            messages.append({"role": "user", "content": ASK_AGAIN})
        raise AssertionError("the last attempt acts")

    def _recent(self, messages: Sequence[Message]) -> list[Message]:
        """The system message, and the last 1 + `history` user messages with the answers in between."""
        user = [index for index, message in enumerate(messages) if message["role"] == "user"]
        first = user[max(0, len(user) - 1 - self.history)]
        return [messages[0], *messages[first:]]


def _call(method: Callable[..., Any], *arguments: Any) -> Any:
    """The result of an agent's method; its exceptions become AgentErrors."""
    try:
        return method(*arguments)
    except AgentError:
        raise
    except Exception as error:
        raise AgentError(f"the agent raised {described(error)}") from error


def _answer(reply: object) -> Answer:
    """An agent's reply, with text that can be written to files. Raises AgentError for another type."""
    answer = Answer(reply) if isinstance(reply, str) else reply
    if not isinstance(answer, Answer) or not isinstance(answer.text, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise AgentError(f"the agent's answer must be a text or an Answer, not {reply!r:.200}")
    return answer._replace(text=answer.text.encode(errors="replace").decode())
