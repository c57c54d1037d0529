"""Rollouts of the game: both agents' own turns, and the claims whose truth a game's end reveals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn, Partner, batch_actions
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, Role
from lilgym_mp.envs.proposer_verifier.rewards import ACCEPTANCE_THRESHOLD
from lilgym_mp.learning.common.model import as_numpy
from lilgym_mp.learning.common.states import BoxImageTable, States
from lilgym_mp.learning.common.tasks import TaskSampler, TrainingTasks
from lilgym_mp.learning.game.network import AgentPolicy
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.situations import CONTEXT, read_situations
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.scene.arrays import BoolArray, Float32Array, Float64Array, Int8Array, Int16Array, Int64Array

TURNS_PER_STATEMENT = 16  # after so many turns the groups of games move on to other statements


# The policy and the values (k,) of an agent that learns, in k games: from its role, states, context (k, 7) and, for the
# proposer with a mask, the legal actions of the MDP (k, actions).
Evaluate = Callable[[Role, States, Int64Array, BoolArray | None], tuple[AgentPolicy, Tensor]]


class Turns:
    """Both agents' own turns in a rollout of T turns of N games; entries are valid where the agent acted."""

    def __init__(self, turns: int, games: int, legal: int) -> None:
        """`legal`: the number of the MDP's actions for a proposer with a mask, otherwise 0."""
        shape = len(Role), turns, games
        self.acted: BoolArray = np.zeros(shape, np.bool_)  # (2, T, N) indexed by role, like the others
        self.boxes_of: Int64Array = np.zeros((*shape, BOX_COUNT), np.int64)  # (2, T, N, 3)
        self.context: Int64Array = np.zeros((*shape, len(CONTEXT)), np.int64)  # (2, T, N, 7)
        self.actions: Int64Array = np.zeros(shape, np.int64)
        self.log_probabilities, self.values = np.zeros((2, *shape), np.float32)
        self.rewards: Float32Array = np.zeros(shape, np.float32)  # of every turn
        self.legal: BoolArray | None = np.zeros((*shape[1:], legal), np.bool_) if legal else None  # (T, N, actions)


class Claims(NamedTuple):
    """Claims judged in the last turn of their game, when the truth came out."""

    items: Int16Array  # (C, 3, capacity, 5) the scene
    statement_of: Int64Array  # (C,)
    targets: Int64Array  # (C,)
    holds: BoolArray  # (C,)

    def rows(self, rows: Int64Array | slice) -> Claims:
        return self._make(part[rows] for part in self)

    @classmethod
    def joined(cls, parts: Sequence[Claims]) -> Claims:
        return cls._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


class Rollout(NamedTuple):
    """T turns of N games; row t * N + n of a flattened array is turn t of game n."""

    table: BoxImageTable
    statements: tuple[str, ...]
    statement_of: Int64Array  # (T, N)
    targets: Int64Array  # (T, N)
    ended: BoolArray  # (T, N)
    successes: BoolArray  # (T, N)
    probabilities: Float64Array  # (T, N) of judged claims, NaN without one
    holds: BoolArray  # (T, N) whether the judged claim holds
    turns: Turns
    last_values: Float32Array  # (2, N) of the situations after the last turn
    to_move: BoolArray  # (2, N) whether the agent is to move then
    claims: Claims

    @property
    def returns(self) -> Float64Array:
        """(2,) sums over the games that ended, indexed by role."""
        ends_later = np.maximum.accumulate(self.ended[::-1])[::-1]
        return np.array([(rewards * ends_later).sum(dtype=np.float64) for rewards in self.turns.rewards])

    def claim_rates(self) -> tuple[float, float, float]:
        """True-accept rate, false-accept rate, and their difference averaged over the targets; NaN without claims."""
        judged = ~np.isnan(self.probabilities)
        accepted = self.probabilities[judged] > ACCEPTANCE_THRESHOLD
        counts = np.zeros((2, 2, 2))  # by target, whether the claim holds, whether it was accepted
        np.add.at(counts, (self.targets[judged], self.holds[judged].astype(int), accepted.astype(int)), 1)
        counts = np.array([*counts, counts.sum(0)])
        with np.errstate(invalid="ignore"):
            shares = counts[..., 1] / counts.sum(-1)
        js = (shares[:2, 1] - shares[:2, 0])[~np.isnan(shares[:2].sum(-1))]
        return float(shares[2, 1]), float(shares[2, 0]), float(js.mean()) if len(js) else np.nan

    def states(self, boxes_of: Int64Array, rows: Int64Array) -> States:
        """States of rows (k,) with the given boxes (k, 3)."""
        return self.table.states(
            self.statements, self.statement_of.reshape(-1)[rows], boxes_of, self.targets.reshape(-1)[rows]
        )


class RolloutPlayer:
    """N games, started anew for each rollout, so that a run resumes exactly."""

    def __init__(
        self,
        game: Game,
        tasks: TrainingTasks,
        recipe: GameRecipe,
        partners: Mapping[Role, Sequence[Partner]],
    ) -> None:
        """`game`: of these tasks that reveals the truth. `partners`: who plays an agent that does not learn."""
        self._game, self._recipe, self._partners = game, recipe, partners
        self._arrays = ObservedGames(game, recipe.envs)
        self._sampler = TaskSampler(tasks, recipe)
        self._targets = np.array([task.target for task in tasks.tasks], np.int64)
        self._games = np.arange(recipe.envs)
        self._table = BoxImageTable()
        self._episodes = np.zeros(recipe.envs, np.int64)

    @torch.no_grad()
    def play(self, evaluate: Evaluate, rng: np.random.Generator) -> Rollout:
        """A rollout of the recipe's length."""
        recipe, arrays, count = self._recipe, self._arrays, self._recipe.envs
        self._table = BoxImageTable()  # anew, so that a resumed run numbers boxes alike
        length = recipe.rollout // count
        legal = arrays.game.config.dynamics.appearance.action_count if recipe.mask else 0
        turns = Turns(length, count, legal)
        statement_of, targets = np.zeros((2, length, count), np.int64)
        ended, successes, holds = np.zeros((3, length, count), np.bool_)
        probabilities = np.zeros((length, count))
        items: list[Int16Array] = []  # of claims judged in a game's last turn
        partner_of = {role: rng.integers(len(partners), size=count) for role, partners in self._partners.items()}
        for turn in range(length):
            if turn % TURNS_PER_STATEMENT == 0:
                self._sampler.resample_statements(rng)
            if turn == 0:
                self._start(self._games, rng)
            statement_of[turn] = self._sampler.statement_of[arrays.tasks]
            targets[turn] = self._targets[arrays.tasks]
            actions, judged_items = self._act(turn, turns, evaluate, partner_of, rng)
            arrays.step(actions[Role.PROPOSER], actions[Role.VERIFIER])
            over = ended[turn] = arrays.terminated | arrays.truncated
            turns.rewards[:, turn] = arrays.rewards
            successes[turn], probabilities[turn], holds[turn] = arrays.successes, arrays.probabilities, arrays.holds
            items.append(judged_items[over & ~np.isnan(probabilities[turn])])
            if over.any():
                self._start(np.flatnonzero(over), rng)
        known = ended & ~np.isnan(probabilities)
        return Rollout(
            self._table,
            self._sampler.statements,
            statement_of,
            targets,
            ended,
            successes,
            probabilities,
            holds,
            turns,
            np.stack([self._last_values(role, evaluate) for role in Role]),
            arrays.movers.copy(),
            Claims(np.concatenate(items), statement_of[known], targets[known], holds[known]),
        )

    def _start(self, indices: Int64Array, rng: np.random.Generator) -> None:
        intents = np.array([int(self._game.sample_intent(rng)) for _ in indices], np.int64)
        self._arrays.start(indices, np.array(self._sampler.sample(indices, rng), np.int64), intents)
        self._episodes[indices] = self._episodes.max() + 1 + np.arange(len(indices))

    def _act(
        self,
        turn: int,
        turns: Turns,
        evaluate: Evaluate,
        partner_of: dict[Role, Int64Array],
        rng: np.random.Generator,
    ) -> tuple[Int64Array, Int16Array]:
        """Both agents' actions (2, N), and the item arrays (N, 3, capacity, 5) that a verifier that learns judges."""
        arrays = self._arrays
        actions = np.zeros((len(Role), self._recipe.envs), np.int64)
        items = arrays.items().copy()
        cached: tuple[Int64Array, States] | None = None  # both agents see the same states in a simultaneous protocol
        for role in Role:
            moving = np.flatnonzero(arrays.movers[role])
            if not len(moving):
                continue
            if role in self._partners:
                for index, partner in enumerate(self._partners[role]):
                    played = moving[partner_of[role][moving] == index]
                    if len(played):
                        own_turn = BatchTurn(arrays, role, played, self._episodes[played], [rng] * len(played))
                        actions[role, played] = batch_actions(partner, own_turn)
                continue
            seen, context = read_situations(arrays, role, moving)
            if role is Role.VERIFIER:
                items[moving] = seen
            if cached is None or arrays.game.turn_based:
                boxes_of = self._table.item_indices(seen)
                cached = boxes_of, self._states(moving, boxes_of)
            boxes_of, states = cached
            legal = None
            if role is Role.PROPOSER and turns.legal is not None:
                masks, refused = arrays.masks(role, moving), arrays.refused[moving]
                legal = turns.legal[turn, moving] = proposer_choices(arrays.game, masks, refused)
            policy, values = evaluate(role, states, context, legal)
            chosen = policy.act(lambda part: part.sample(rng))
            own = role, turn, moving
            turns.acted[own], turns.boxes_of[own], turns.context[own] = True, boxes_of, context
            actions[role, moving] = turns.actions[own] = chosen
            turns.log_probabilities[own] = as_numpy(policy.log_prob(torch.from_numpy(chosen).to(values.device)))
            turns.values[own] = as_numpy(values)
        return actions, items

    def _states(self, indices: Int64Array, boxes_of: Int64Array) -> States:
        tasks = self._arrays.tasks[indices]
        return self._table.states(
            self._sampler.statements, self._sampler.statement_of[tasks], boxes_of, self._targets[tasks]
        )

    def _last_values(self, role: Role, evaluate: Evaluate) -> Float32Array:
        arrays, moving = self._arrays, np.flatnonzero(self._arrays.movers[role])
        values = np.zeros(self._recipe.envs, np.float32)
        if len(moving) and role not in self._partners:
            items, context = read_situations(arrays, role, moving)
            states = self._states(moving, self._table.item_indices(items))
            values[moving] = as_numpy(evaluate(role, states, context, None)[1])
        return values


def proposer_choices(game: Game, masks: Int8Array, refused: Int64Array) -> BoolArray:
    """(k, actions of the MDP) the choices of a proposer with masks (k, actions), whatever the message."""
    sizes, choices = game.message_sizes[Role.PROPOSER] + 1, game.config.dynamics.appearance.action_count
    return without_refused(masks[:, : choices * sizes : sizes].astype(np.bool_), refused)


def without_refused(legal: BoolArray, refused: Int64Array) -> BoolArray:
    """`legal` (k, actions), in place, without the action refused last, which a proposer would only repeat, in rows that
    have another one."""
    rows = np.flatnonzero((refused != NO_CHOICE) & (legal.sum(1) > 1))
    legal[rows, refused[rows]] = False
    return legal


def own_turn_advantages(
    turns: Turns,
    ended: BoolArray,
    last_values: Float32Array,
    to_move: BoolArray,
    gamma: float,
    gae_lambda: float,
) -> tuple[Float32Array, BoolArray]:
    """(2, T, N) advantages of the agents' own turns, and where they are complete.

    An own turn earns the rewards up to the agent's next own turn, or to the end of the game. The last one of a game
    still going on is incomplete if its successor is not known, and then only lends its value to the one before.
    """
    advantages, complete = np.zeros_like(turns.values), np.zeros_like(turns.acted)
    next_values, next_advantages = last_values, np.zeros_like(last_values)
    rewards, continues, known = np.zeros_like(last_values), np.ones_like(to_move), to_move
    for turn in range(len(ended) - 1, -1, -1):
        over, acted, values = ended[turn], turns.acted[:, turn], turns.values[:, turn]
        rewards = np.where(over, 0, rewards) + turns.rewards[:, turn]
        continues, known = continues & ~over, known | over
        delta = rewards + gamma * next_values * continues - values
        found = np.where(known, delta + gamma * gae_lambda * continues * next_advantages, 0)
        advantages[:, turn], complete[:, turn] = np.where(acted, found, 0), acted & known
        next_values, next_advantages = np.where(acted, values, next_values), np.where(acted, found, next_advantages)
        rewards, continues, known = np.where(acted, 0, rewards), continues | acted, known | acted
    return advantages, complete
