"""Rollout collection: parallel environments whose episodes continue across rollouts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.learning.common.factored_policy import STOP, FactoredPolicy, as_numpy
from lilgym_mp.learning.common.model import Model
from lilgym_mp.learning.common.states import BoxImageTable, States
from lilgym_mp.learning.common.tasks import TRAINING_SPLIT, TaskSampler, TrainingTasks
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Float32Array, Int64Array, Rng, Strings


class Rollout(NamedTuple):
    """Rollout buffer of T steps in N environments; row t * N + n of a flattened array is step t of environment n."""

    table: BoxImageTable
    statements: Strings
    statement_of: Int64Array  # (T, N)
    boxes_of: Int64Array  # (T, N, 3)
    targets: Int64Array  # (T, N)
    legal: BoolArray | None  # (T, N, actions); None without masking
    actions: Int64Array  # (T, N)
    log_probabilities: Float32Array  # (T, N)
    values: Float32Array  # (T, N)
    rewards: Float32Array  # (T, N)
    ended: BoolArray  # (T, N)
    forced: BoolArray  # (T, N) STOP forced by PPO+SF
    last_values: Float32Array  # (N,) bootstrap values of the states after the last step

    def states(self, rows: Int64Array) -> States:
        """The states of some rows."""
        return self.table.states(
            self.statements,
            self.statement_of.reshape(-1)[rows],
            self.boxes_of.reshape(-1, 3)[rows],
            self.targets.reshape(-1)[rows],
        )


@dataclass
class EpisodeStatistics:
    """Statistics of the episodes that ended since the last update."""

    ends: Counter[str] = field(default_factory=Counter)
    reward: float = 0.0
    steps: int = 0  # actions in these episodes
    forced: int = 0  # forced STOPs


class RolloutCollector:
    """N environments and their current episodes."""

    def __init__(self, settings: EnvConfig, recipe: PPORecipe, tasks: TrainingTasks) -> None:
        self._recipe = recipe
        self._envs = settings.make_batch(TRAINING_SPLIT, recipe.envs)
        self._envs.change_tasks(lambda _: tasks.tasks)
        self._sampler = TaskSampler(tasks, recipe)
        self._ids = tasks.tasks.ids
        self._task_of = np.zeros(recipe.envs, np.int64)  # task index of each environment
        self._actions: list[list[int]] = [[] for _ in range(recipe.envs)]  # actions of the current episodes
        self._returns = np.zeros(recipe.envs)  # undiscounted returns of the current episodes so far
        self._observations: AnyDict = {}
        self.statistics = EpisodeStatistics()

    def reset(self, rng: Rng) -> None:
        """Starts an episode in every environment."""
        self._sampler.resample_statements(rng)
        self._reset(np.ones(self._recipe.envs, bool), self._sampler.sample(np.arange(self._recipe.envs), rng))

    def to_json(self) -> AnyDict:
        """The current episodes, for `restore_episodes`."""
        return {
            "statements": self._sampler.current.tolist(),
            "tasks": self._task_of.tolist(),
            "actions": [list(actions) for actions in self._actions],
            "rewards": self._returns.tolist(),
        }

    def restore_episodes(self, data: AnyDict) -> None:
        """Replays the saved episodes to their current states. Raises ValueError, KeyError, TypeError."""
        count = self._recipe.envs
        self._sampler.current = np.array(data["statements"], np.int64)
        tasks = list(map(int, data["tasks"]))
        actions = [list(map(int, row)) for row in data["actions"]]
        if len(tasks) != count or len(actions) != count or max(tasks) >= len(self._ids):
            raise ValueError("the saved episodes are of other environments")
        self._reset(np.ones(count, bool), tasks)
        for left in range(max(map(len, actions)), 0, -1):
            waiting = np.array([len(row) < left for row in actions])  # shorter episodes: take STOP and reset meanwhile
            chosen = [STOP if len(row) < left else row[len(row) - left] for row in actions]
            self._observations = self._envs.step(np.array(chosen, np.int64))[0]
            if waiting.any():
                self._reset(waiting, [task for task, waits in zip(tasks, waiting, strict=True) if waits])
        self._actions = actions
        self._returns = np.array(data["rewards"], np.float64)

    def _reset(self, mask: BoolArray, tasks: list[int]) -> None:
        """Starts episodes of the tasks in the environments of the mask."""
        task_ids: list[str | None] = [None] * len(mask)
        for index, task in zip(np.flatnonzero(mask).tolist(), tasks, strict=True):
            task_ids[index] = self._ids[task]
            self._task_of[index] = task
            self._actions[index] = []
            self._returns[index] = 0.0
        options = {"task": task_ids, "reset_mask": mask}
        self._observations, _ = self._envs.reset(seed=0 if mask.all() else None, options=options)

    def collect(self, model: Model, rng: Rng) -> Rollout:
        """A rollout of the recipe's length."""
        recipe = self._recipe
        count = self._recipe.envs
        if recipe.same_statement > 1:
            self._sampler.resample_statements(rng)
        table = BoxImageTable()
        steps = recipe.rollout // count
        collected: list[AnyDict] = []
        for _ in range(steps):
            observed, states = self._observe(table)
            legal = self._envs.action_masks() if recipe.mask else None
            actions, forced, log_probabilities, values = self._act(model, states, legal, rng)
            rewards, ended = self._step(actions, rng)
            decided = {"actions": actions, "log_probabilities": log_probabilities, "values": values, "forced": forced}
            collected.append({**observed, **decided, "legal": legal, "rewards": rewards, "ended": ended})
        with torch.no_grad():
            last_values = as_numpy(policy_and_values(model, self._observe(table)[1], None)[1])
        columns = {name: [step[name] for step in collected] for name in collected[0]}
        arrays: AnyDict = {name: None if rows[0] is None else np.stack(rows) for name, rows in columns.items()}
        return Rollout(table=table, statements=self._sampler.statements, last_values=last_values, **arrays)

    def _observe(self, table: BoxImageTable) -> tuple[dict[str, Int64Array], States]:
        """The current observations as rollout columns and as states."""
        statement_of = self._sampler.statement_of[self._task_of]
        boxes_of = table.indices(self._observations["image"])
        targets = self._observations["target"].astype(np.int64)
        columns = {"statement_of": statement_of, "boxes_of": boxes_of, "targets": targets}
        return columns, table.states(self._sampler.statements, statement_of, boxes_of, targets)

    def _act(
        self, model: Model, states: States, legal: BoolArray | None, rng: Rng
    ) -> tuple[Int64Array, BoolArray, Float32Array, Float32Array]:
        """Actions, forced-STOP mask, log-probabilities under the unforced policy, and values."""
        with torch.no_grad():
            policy, values = policy_and_values(model, states, legal)
        actions = policy.sample(rng)
        forced = self._envs.goal_reached() if self._recipe.stop_forcing else np.zeros(len(actions), bool)
        actions[forced] = STOP
        with torch.no_grad():
            log_probabilities = policy.log_prob(torch.from_numpy(actions).to(values.device))
        self.statistics.forced += int(forced.sum())
        return actions, forced, as_numpy(log_probabilities), as_numpy(values)

    def _step(self, actions: Int64Array, rng: Rng) -> tuple[Float32Array, BoolArray]:
        """Steps the environments and restarts those whose episode ended; returns rewards and the ended mask."""
        self._observations, rewards, terminated, truncated, infos = self._envs.step(actions)
        ended = terminated | truncated
        self._returns += rewards
        for episode_actions, action in zip(self._actions, actions.tolist(), strict=True):
            episode_actions.append(action)
        env_ids = np.flatnonzero(ended)
        for env_id in env_ids.tolist():
            self.statistics.ends[infos["outcome"][env_id]] += 1
            self.statistics.reward += float(self._returns[env_id])
            self.statistics.steps += len(self._actions[env_id])
        if len(env_ids):
            self._reset(ended, self._sampler.sample(env_ids, rng))
        return rewards.astype(np.float32), ended

    def close(self) -> None:
        """Closes the environments."""
        self._envs.close()


def policy_and_values(model: Model, states: States, legal: BoolArray | None) -> tuple[FactoredPolicy, torch.Tensor]:
    """The policy, masked if `legal` (N, actions) is given, and the values (N,)."""
    prediction = model(model.inputs(states))
    mask = None if legal is None else torch.from_numpy(legal).to(prediction.types.device)
    return FactoredPolicy(model.factorisation, prediction.types, prediction.heads, mask), prediction.values
