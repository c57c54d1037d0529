"""Playing the training tasks: environments side by side, whose episodes go on from one rollout to the next."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode

from lilgym_mp.arrays import BoolArray, Float32Array, Int64Array
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.ppo.factored_policy import STOP, FactoredPolicy, mask_of
from lilgym_mp.learning.ppo.models.protocol import Model
from lilgym_mp.learning.ppo.recipe import PPORecipe
from lilgym_mp.learning.ppo.states import BoxImageTable, States
from lilgym_mp.learning.ppo.tasks import TRAINING_SPLIT, TaskSampler, TrainingTasks


class Rollout(NamedTuple):
    """T steps in N environments; rows of the flattened arrays are counted step by step."""

    table: BoxImageTable
    statements: tuple[str, ...]
    statement_of: Int64Array  # (T, N)
    boxes_of: Int64Array  # (T, N, 3)
    targets: Int64Array  # (T, N)
    legal: BoolArray | None  # (T, N, actions) with a mask
    actions: Int64Array  # (T, N)
    log_probabilities: Float32Array  # (T, N)
    values: Float32Array  # (T, N)
    rewards: Float32Array  # (T, N)
    ended: BoolArray  # (T, N)
    forced: BoolArray  # (T, N) a STOP that the policy was made to take
    last_values: Float32Array  # (N,) of the states after the last step

    def states(self, rows: Int64Array) -> States:
        """What the policy saw in some rows."""
        return self.table.states(
            self.statements,
            self.statement_of.reshape(-1)[rows],
            self.boxes_of.reshape(-1, 3)[rows],
            self.targets.reshape(-1)[rows],
        )


@dataclass
class EpisodeStatistics:
    """The episodes that ended since the last update."""

    ends: Counter[str] = field(default_factory=Counter[str])
    reward: float = 0.0
    steps: int = 0  # actions in them
    forced: int = 0  # states, of all episodes, in which STOP was forced


class RolloutCollector:
    """N environments and the episodes in them."""

    def __init__(self, settings: Settings, recipe: PPORecipe, tasks: TrainingTasks) -> None:
        self._recipe = recipe
        self._envs = cast(
            "BatchedEnv",
            gym.make_vec(
                settings.id,
                num_envs=recipe.envs,
                copy=False,
                autoreset_mode=AutoresetMode.DISABLED,
                **settings.arguments(TRAINING_SPLIT),
            ),
        )

        def ours(_: TaskSet) -> TaskSet:
            return tasks.tasks

        self._envs.change_tasks(ours)
        self._draw = TaskSampler(tasks, recipe)
        self._ids = tasks.tasks.ids
        self._playing = np.zeros(recipe.envs, np.int64)  # number of each environment's task
        self._taken: list[list[int]] = [[] for _ in range(recipe.envs)]  # actions of the episodes under way
        self._rewards = np.zeros(recipe.envs)  # of the episodes under way
        self._seen: dict[str, Any] = {}
        self.statistics = EpisodeStatistics()

    def begin(self, rng: np.random.Generator) -> None:
        """Begins an episode everywhere."""
        self._draw.resample_statements(rng)
        self._reset(np.ones(self._recipe.envs, np.bool_), self._draw.draw(np.arange(self._recipe.envs), rng))

    def to_json(self) -> dict[str, Any]:
        """The episodes under way, for `restore_episodes`."""
        return {
            "statements": self._draw.current.tolist(),
            "tasks": self._playing.tolist(),
            "actions": [list(actions) for actions in self._taken],
            "rewards": self._rewards.tolist(),
        }

    def restore_episodes(self, data: dict[str, Any]) -> None:
        """Plays the episodes again up to where they were. Raises ValueError, KeyError, TypeError for other data."""
        count = self._recipe.envs
        self._draw.current = np.array(data["statements"], np.int64)
        tasks, actions = list(map(int, data["tasks"])), [list(map(int, row)) for row in data["actions"]]
        if len(tasks) != count or len(actions) != count or max(tasks) >= len(self._ids):
            raise ValueError("the episodes under way are of other environments")
        self._reset(np.ones(count, np.bool_), tasks)
        for left in range(max(map(len, actions)), 0, -1):
            late = np.array([len(row) < left for row in actions])  # these begin later, and are begun anew till then
            chosen = [STOP if len(row) < left else row[len(row) - left] for row in actions]
            self._seen = self._envs.step(np.array(chosen, np.int64))[0]
            if late.any():
                self._reset(late, [task for task, is_late in zip(tasks, late, strict=True) if is_late])
        self._taken = actions
        self._rewards = np.array(data["rewards"], np.float64)

    def _reset(self, which: BoolArray, tasks: list[int]) -> None:
        """Begins episodes of the tasks in some environments."""
        ids: list[str | None] = [None] * len(which)
        for place, task in zip(np.flatnonzero(which).tolist(), tasks, strict=True):
            ids[place] = self._ids[task]
            self._playing[place] = task
            self._taken[place] = []
            self._rewards[place] = 0.0
        self._seen, _ = self._envs.reset(seed=0 if which.all() else None, options={"task": ids, "reset_mask": which})

    def play(self, model: Model, rng: np.random.Generator) -> Rollout:
        """As many steps as the recipe's rollout has."""
        recipe, count = self._recipe, self._recipe.envs
        if recipe.same_statement > 1:
            self._draw.resample_statements(rng)
        table, steps = BoxImageTable(), recipe.rollout // count
        kept: dict[str, list[Any]] = {name: [] for name in Rollout._fields}
        for _ in range(steps):
            seen, states = self._observe(table)
            legal = self._envs.action_masks() if recipe.mask else None
            actions, forced, log_probabilities, values = self._act(model, states, legal, rng)
            rewards, ended = self._step(actions, rng)
            told = {
                **seen,
                "legal": legal,
                "actions": actions,
                "log_probabilities": log_probabilities,
                "values": values,
                "rewards": rewards,
                "ended": ended,
                "forced": forced,
            }
            for name, value in told.items():
                kept[name].append(value)
        with torch.no_grad():
            last_values = _numpy(model(self._observe(table)[1]).values)
        arrays = {name: np.stack(rows) for name, rows in kept.items() if rows and rows[0] is not None}
        return Rollout(
            table=table,
            statements=self._draw.statements,
            legal=arrays.pop("legal", None),
            last_values=last_values,
            **arrays,
        )

    def _observe(self, table: BoxImageTable) -> tuple[dict[str, Int64Array], States]:
        statement_of = self._draw.statement_of[self._playing]
        boxes_of, targets = table.indices(self._seen["image"]), self._seen["target"].astype(np.int64)
        seen = {"statement_of": statement_of, "boxes_of": boxes_of, "targets": targets}
        return seen, table.states(self._draw.statements, statement_of, boxes_of, targets)

    def _act(
        self, model: Model, states: States, legal: BoolArray | None, rng: np.random.Generator
    ) -> tuple[Int64Array, BoolArray, Float32Array, Float32Array]:
        """Actions, which of them were forced, their log-probabilities by the policy left free, and values."""
        with torch.no_grad():
            policy, values = policy_and_values(model, states, legal)
        actions = policy.sample(rng)
        forced = self._envs.goal_reached() if self._recipe.stop_forcing else np.zeros(len(actions), np.bool_)
        actions[forced] = STOP
        with torch.no_grad():
            found = policy.log_prob(torch.from_numpy(actions).to(values.device))
        self.statistics.forced += int(forced.sum())
        return actions, forced, _numpy(found), _numpy(values)

    def _step(self, actions: Int64Array, rng: np.random.Generator) -> tuple[Float32Array, BoolArray]:
        """Rewards and ends of a step; new episodes are begun where some ended."""
        self._seen, rewards, terminated, truncated, infos = self._envs.step(actions)
        ended = terminated | truncated
        self._rewards += rewards
        for taken, action in zip(self._taken, actions.tolist(), strict=True):
            taken.append(action)
        places = np.flatnonzero(ended)
        for place in places.tolist():
            self.statistics.ends[infos["outcome"][place]] += 1
            self.statistics.reward += float(self._rewards[place])
            self.statistics.steps += len(self._taken[place])
        if len(places):
            self._reset(ended, self._draw.draw(places, rng))
        return rewards.astype(np.float32), ended

    def close(self) -> None:
        self._envs.close()


def policy_and_values(model: Model, states: States, legal: BoolArray | None) -> tuple[FactoredPolicy, torch.Tensor]:
    """The policy in the states, over the legal actions where a mask is given, and the values."""
    found = model(states)
    mask = None if legal is None else mask_of(legal, found.types.device)
    return FactoredPolicy(model.factorisation, found.types, found.heads, mask), found.values


def _numpy(tensor: torch.Tensor) -> Float32Array:
    return tensor.detach().float().cpu().numpy()
