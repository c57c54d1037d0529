"""Plays episodes with text agents, one or many at the same time."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.pool import ThreadPool

from lilgym_mp.contrib.llm.agents import LanguageAgent, Message, ModelError
from lilgym_mp.contrib.llm.asking import Asking, call
from lilgym_mp.contrib.llm.summary import Episode, Failure, Turn, progression
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.evaluation import Settings
from lilgym_mp.scene.actions import describe
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.replies import THOUGHTS
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
        self._asking = Asking(self.agent, self.retries, self.history, self.thoughts, self.system)
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
            call(begin, self.env, seed)
        turns: list[Turn] = []
        actions: list[str] = []
        total, ended, outcome = 0.0, False, ""
        while not ended:
            messages.append({"role": "user", "content": content_of(text, info.get(IMAGES, []))})
            action = self._asking.choose(messages, turns, self._named)
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

    def _named(self, reply: str) -> tuple[str, int] | None:
        parsed = self.env.parse_action(reply)
        return (describe(self.dynamics.appearance.decode(parsed.action)), parsed.action) if parsed.understood else None


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
