"""The proposer-verifier game for verifiers: a model in each seat, with views and messages in words."""

import asyncio
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import verifiers.v1 as vf

from lilgym_mp.contrib.adapters.verifiers import finish_reason
from lilgym_mp.contrib.llm.agents import Answer, Message, ModelError
from lilgym_mp.contrib.llm.asking import Asking
from lilgym_mp.contrib.llm.game_player import LanguagePartner
from lilgym_mp.contrib.llm.game_text import rules_of
from lilgym_mp.envs.proposer_verifier import Role, play_games
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.wrappers.replies import unusual_end


class GameConfig(vf.TasksetConfig):
    """The game, as `parallel_env` has it, and the number of its tasks."""

    configuration: str = "TowerScratch"
    corpus: str = "builtin"
    split: str = "train"
    protocol: str = "critique"
    rewards: str = "common"
    views: str = "guide"
    size: int = 500  # tasks at most
    scene: str = "list"  # or "image", "both"


class GameData(vf.TaskData):
    """The game's settings; `id` is the task in its corpus."""

    game: dict[str, Any]
    scene: str


class GameTask(vf.Task[GameData, vf.State, vf.TaskConfig]):
    """One game, whose rewards `GameEnv` gives."""


class GameTaskset(vf.Taskset[GameTask, GameConfig]):
    """Games over the tasks of a corpus."""

    def load(self) -> Iterator[GameTask]:
        """The tasks in the corpus's order. Raises ValueError for invalid settings."""
        names = ("configuration", "corpus", "split", "protocol", "rewards", "views")
        game = {name: getattr(self.config, name) for name in names}
        for task in islice(BaseGameEnv(**game).tasks.ids, self.config.size):
            yield GameTask(GameData(id=task, game=game, scene=self.config.scene), self.config.task)


class PairConfig(vf.EnvConfig):
    """The models of both seats."""

    proposer: vf.AgentConfig = vf.AgentConfig(harness={"id": "null"})
    verifier: vf.AgentConfig = vf.AgentConfig(harness={"id": "null"})


class Seat:
    """Answers for the thread that plays the game by a turn of verifiers' conversation in the event loop."""

    def __init__(self, interaction: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._interaction = interaction
        self._loop = loop

    def answer(self, messages: Sequence[Message]) -> Answer:
        """The reply to the last message; verifiers keeps those before."""
        segment = asyncio.run_coroutine_threadsafe(self._interaction.turn([messages[-1]]), self._loop).result()
        if segment.terminated:
            raise ModelError(f"verifiers ended the conversation: {self._interaction.trace.stop_condition}")
        return Answer(segment.last_reply, problem=unusual_end(finish_reason(self._interaction.trace)))


class GameEnv(vf.Env[PairConfig]):
    """Both seats talk through the game. Each trace has the reward `game_return`, and the game's outcome in `info`."""

    async def run(self, task: GameTask, agents: vf.Agents) -> None:
        """Plays one task."""
        env = BaseGameEnv(**task.data.game)
        loop = asyncio.get_running_loop()
        rules = [vf.Task(vf.TaskData(system_prompt=rules_of(env.engine.game, role, 0))) for role in Role]
        async with (
            agents.proposer.interaction(rules[Role.PROPOSER]) as proposer,
            agents.verifier.interaction(rules[Role.VERIFIER]) as verifier,
        ):
            talks = (proposer, verifier)
            seats = [
                LanguagePartner(Asking(Seat(talk, loop)), role, scene=task.data.scene)
                for talk, role in zip(talks, Role, strict=True)
            ]
            (record,) = await asyncio.to_thread(play_games, env, *seats, tasks=[task.data.id])
        for talk, earned in zip(talks, record.returns, strict=True):
            talk.trace.record_reward("game_return", earned)
            talk.trace.info.update(outcome=str(record.outcome), rounds=record.rounds)


__all__ = ["GameEnv", "GameTaskset"]
