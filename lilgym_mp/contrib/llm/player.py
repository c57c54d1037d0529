"""Plays episodes with text agents, one or many at the same time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.pool import ThreadPool
from typing import Any

from lilgym_mp.contrib.llm.agents import Answer, LanguageAgent, Message, ModelError, described
from lilgym_mp.contrib.llm.summary import Episode, Failure, Turn, progression
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.evaluation import Settings
from lilgym_mp.scene.actions import describe
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.replies import ASK_AGAIN, NOT_UNDERSTOOD, THOUGHTS, answer_text
from lilgym_mp.wrappers.text import IMAGES, content_of


@dataclass
class Player:
    """Plays the tasks of one configuration with a text agent.

    Args:
        settings: The environment, such as `Settings("TowerFlipIt")`.
        agent: The agent that replies.
        split: The split whose tasks are played.
        scene: "list", "image" or "both", as for TextObservation; pictures are content parts of OpenAI's chat API.
        legal_actions: Whether observations list the legal actions.
        retries: Further attempts after an answer that names no action, or is cut, filtered or refused; then the episode
            ends so, without success and with the reward of an illegal action, as in `rlvr.Conversation`.
        history: Past observations kept in the conversation.
        thoughts: Tags of thoughts, which are neither read nor sent again.
        system: False puts the rules into the first user message, for models without a system role.

    Raises:
        ValueError: For an invalid setting, which the message names.
    """

    settings: Settings
    agent: LanguageAgent
    split: str = "dev"
    scene: str = "list"
    legal_actions: bool = True
    retries: int = 1
    history: int = 12
    thoughts: Sequence[str] = THOUGHTS
    system: bool = True
    conversation: list[Message] = field(init=False, default_factory=list[Message])  # of the last episode
    env: TextObservation = field(init=False)
    dynamics: Dynamics = field(init=False)

    def __post_init__(self) -> None:
        """Raises ValueError naming the invalid setting."""
        if self.retries < 0 or self.history < 0:
            raise ValueError(f"retries and history must be 0 or more, not {self.retries} and {self.history}")
        env = self.settings.make(self.split)
        self.env = TextObservation(
            env, scene=self.scene, legal_actions=self.legal_actions, thoughts=tuple(self.thoughts)
        )
        self.dynamics = env.dynamics
        self._solver = Solver(env.dynamics)

    def task_ids(self) -> Sequence[str]:
        """All task ids of the split, in file order."""
        return self.env.get_wrapper_attr("evaluation_tasks")()

    def play(self, task_id: str, seed: int = 0) -> Episode:
        """One episode.

        Args:
            task_id: The task's id.
            seed: Seed of the environment, and of agents that take one.

        Raises:
            ValueError: For an unknown task.
            ModelError: Where the agent raises an exception.
        """
        text, info = self.env.reset(seed=seed, options={"task": task_id})
        start = self._state()
        messages = self.conversation = [{"role": "system", "content": self.env.instructions()}]
        if (begin := getattr(self.agent, "begin", None)) is not None:
            _call(begin, self.env, seed)
        turns: list[Turn] = []
        actions: list[str] = []
        total, ended, outcome = 0.0, False, ""
        while not ended:
            messages.append({"role": "user", "content": content_of(text, info.get(IMAGES, []))})
            action = self._choose_action(messages, turns)
            if action is None:
                outcome, ended = str(turns[-1].problem), True
                total += self.dynamics.rules.signals[Outcome.INVALID_ACTION].reward
                continue
            actions.append(describe(self.dynamics.appearance.decode(action)))
            text, reward, terminated, truncated, info = self.env.step(action)
            total, ended = total + float(reward), terminated or truncated
            outcome = str(info.get("outcome", ""))
        success = outcome == str(Outcome.SUCCESS)
        task = start.task
        return Episode(
            task=task.id,
            statement=task.statement,
            target=task.target,
            outcome=outcome,
            reward=round(total, 6),
            progression=progression(self._solver, start, self._state(), success=success),
            actions=actions,
            turns=turns,
            messages=messages,
        )

    def _state(self) -> State:
        return self.env.get_wrapper_attr("state")

    def _choose_action(self, messages: list[Message], turns: list[Turn]) -> int | None:
        """Asks the agent, up to 1 + `retries` times; extends `messages` and `turns`. None if no answer names one."""
        for attempt in range(self.retries + 1):
            start = time.perf_counter()
            answer = _answer(_call(self.agent.answer, self._recent(messages)))
            seconds = time.perf_counter() - start
            parsed = self.env.parse_action(answer.text)
            problem = answer.problem or (None if parsed.understood else NOT_UNDERSTOOD)
            name = describe(self.dynamics.appearance.decode(parsed.action)) if problem is None else None
            turns.append(Turn(answer.text, problem is None, name, round(seconds, 6), *answer[1:-1], problem))
            said = (answer_text(answer.text, self.thoughts) or "").strip()
            if said:
                messages.append({"role": "assistant", "content": said})
            if problem is None:
                return parsed.action
            if attempt == self.retries:
                break
            if said:
                messages.append({"role": "user", "content": ASK_AGAIN})
            elif attempt == 0:  # an empty message is refused by many servers, as are two of the user in a row
                messages[-1] = _extended(messages[-1], f"\n\n{ASK_AGAIN}")
        return None

    def _recent(self, messages: Sequence[Message]) -> list[Message]:
        """The rules, and the last 1 + `history` user messages with the answers in between."""
        user = [index for index, message in enumerate(messages) if message["role"] == "user"]
        first = user[max(0, len(user) - 1 - self.history)]
        if self.system:
            return [messages[0], *messages[first:]]
        return [_extended(messages[first], f"{messages[0]['content']}\n\n", before=True), *messages[first + 1 :]]


def play_all(player: Player, jobs: Sequence[tuple[str, int]], concurrency: int) -> Iterator[Episode | Failure]:
    """The episodes of the jobs, task ids with seeds, as they end; `concurrency` of them are played at the same time.

    An agent's failure ends its episode only. Each thread has its own environment; they share the agent.
    """
    local = threading.local()

    def play(job: tuple[str, int]) -> Episode | Failure:
        if not hasattr(local, "player"):
            local.player = replace(player)
        try:
            return local.player.play(*job)
        except ModelError as error:
            return Failure(job[0], str(error), local.player.conversation)

    with ThreadPool(max(1, min(concurrency, len(jobs)))) as pool:  # its threads end after their current episode
        yield from pool.imap_unordered(play, jobs)


def _extended(message: Message, text: str, *, before: bool = False) -> Message:
    """The message with more text in its last part."""
    parts = message["content"]
    if isinstance(parts, str):
        return {**message, "content": text + parts if before else parts + text}
    last = {"type": "text", "text": text + parts[-1]["text"] if before else parts[-1]["text"] + text}
    return {**message, "content": [*parts[:-1], last]}


def _call(method: Callable[..., Any], *arguments: Any) -> Any:
    """The result of an agent's method; its exceptions become ModelErrors."""
    try:
        return method(*arguments)
    except ModelError:
        raise
    except (Exception, SystemExit) as error:
        raise ModelError(f"the agent raised {described(error)}") from error


def _answer(reply: object) -> Answer:
    """An agent's reply, with text that can be written to files. Raises ModelError for another type."""
    answer = Answer(reply) if isinstance(reply, str) else reply
    if not isinstance(answer, Answer) or not isinstance(answer.text, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ModelError(f"the agent's answer must be a text or an Answer, not {reply!r:.200}")
    reasoning = None if answer.reasoning is None else _writable(answer.reasoning)
    return answer._replace(text=_writable(answer.text), reasoning=reasoning)


def _writable(text: str) -> str:
    return text.encode(errors="replace").decode()
