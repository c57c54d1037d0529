"""Generated tasks for verifiers: one reply, or a reply for each action; docs/language_models.md has a command."""

from collections.abc import Iterator
from itertools import islice
from typing import Any

import verifiers.v1 as vf
from verifiers.v1.envs.single_agent.env import SingleAgentEnv

from lilgym_mp.contrib.rlvr import Conversation, Row, messages_of, rows, score
from lilgym_mp.wrappers.text import content_of


class LilgymConfig(vf.TasksetConfig):
    """The arguments of `lilgym_mp.contrib.rlvr.rows`, the number of tasks, and their form."""

    kind: str = "plan"
    appearance: str = "tower"
    level: int = 2
    seed: int = 0
    split: str = "train"
    min_actions: int = 2
    max_actions: int | None = None
    size: int = 500  # tasks
    turns: bool = False  # one action for each reply, of plans
    scene: str = "list"  # or "image", "both"


class LilgymData(vf.TaskData):
    """A row as JSON values, and the form of its task."""

    row: dict[str, Any]
    turns: bool
    scene: str


class LilgymTask(vf.Task[LilgymData, vf.State, vf.TaskConfig]):
    """A row with its reward."""

    @vf.reward
    async def verified(self, trace: vf.Trace) -> float:
        """1 or 0; in turns, that of the last one, which `LilgymEnv` keeps."""
        if self.data.turns:
            return trace.info.get("reward", 0.0)
        return score(trace.last_reply, Row.from_json(self.data.row), finish_reason=finish_reason(trace)).reward


def finish_reason(trace: vf.Trace) -> str | None:
    """How the last reply ended, as far as verifiers tells: "length" for one that was cut."""
    return trace.calls[-1].finish_reason if trace.calls else None


def message(text: str, talk: Conversation) -> dict[str, Any]:
    """A user's message with the pictures of the episode."""
    return {"role": "user", "content": content_of(text, talk.images)}


class LilgymTaskset(vf.Taskset[LilgymTask, LilgymConfig]):
    """Tasks made by the generator."""

    def load(self) -> Iterator[LilgymTask]:
        """The tasks in order. Raises ValueError for invalid settings."""
        names = ("kind", "appearance", "level", "seed", "split", "min_actions", "max_actions")
        endless = rows(**{name: getattr(self.config, name) for name in names})
        turns = self.config.turns
        scene = self.config.scene
        for row in islice(endless, self.config.size):
            talk = Conversation(row, scene=scene) if turns else None
            prompt = [message(talk.prompt, talk)] if talk else messages_of(row, scene)
            data = LilgymData(id=row.id, prompt=prompt, row=row.to_json(), turns=turns, scene=scene)
            yield LilgymTask(data, self.config.task)


class LilgymEnv(SingleAgentEnv):
    """One agent. In turns, its trace's `info` has the outcome, and each turn's regret (`Conversation`)."""

    async def run(self, task: LilgymTask, agents: vf.Agents) -> None:
        """Plays one task."""
        if not task.data.turns:
            await super().run(task, agents)
            return
        talk = Conversation(Row.from_json(task.data.row), scene=task.data.scene)
        regrets: list[float | None] = []
        async with agents.agent.interaction(task) as player:
            segment = await player.turn()
            while not segment.terminated:
                turn = talk.step(segment.last_reply, finish_reason(player.trace))
                regrets.append(turn.regret)
                player.trace.info.update(reward=turn.reward, outcome=turn.outcome, regrets=regrets)
                if talk.done:
                    return
                segment = await player.turn([message(turn.text, talk)])


__all__ = ["LilgymEnv", "LilgymTaskset"]
