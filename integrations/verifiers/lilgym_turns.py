"""The plans of `lilgym` over several turns: one action for each reply."""

import verifiers.v1 as vf
from lilgym import LilgymConfig, LilgymData, LilgymTaskset

from lilgym_mp.contrib.rlvr import Conversation, Row


class TurnsTask(vf.Task[LilgymData, vf.State, vf.TaskConfig]):
    """Rewarded by the environment below."""


class TurnsTaskset(vf.Taskset[TurnsTask, LilgymConfig]):
    def load(self):
        for task in LilgymTaskset(self.config).load():
            prompt = Conversation(Row.from_json(task.data.row)).prompt
            yield TurnsTask(task.data.model_copy(update={"prompt": prompt}), self.config.task)


class TurnsConfig(vf.EnvConfig):
    player: vf.AgentConfig = vf.AgentConfig()


class TurnsEnv(vf.Env[TurnsConfig]):
    async def run(self, task, agents) -> None:
        talk, reward = Conversation(Row.from_json(task.data.row)), 0.0
        async with agents.player.interaction(task) as interaction:
            segment = await interaction.turn()
            while not segment.terminated:
                turn = talk.step(segment.last_reply)
                reward += turn.reward
                if turn.done:
                    break
                segment = await interaction.turn(turn.text)
        interaction.trace.record_reward("verified", reward, 1.0)


__all__ = ["TurnsEnv", "TurnsTaskset"]
