"""Rollouts of the game: both agents' own turns, and the claims whose truth a game's end reveals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.metrics import claim_rates, mean_j
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn, Partner, batch_actions
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, Role
from lilgym_mp.learning.common.factored_policy import as_numpy
from lilgym_mp.learning.common.states import BoxImageTable, States
from lilgym_mp.learning.common.tasks import TaskSampler, TrainingTasks
from lilgym_mp.learning.game.network import AgentPolicy
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.situations import HIDDEN_STATEMENT, REFUSED, context_sizes, read_situations, seen_tasks
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.scene.arrays import (
    BoolArray,
    Float32Array,
    Float64Array,
    Int8Array,
    Int16Array,
    Int64Array,
    Rng,
    Strings,
)

TURNS_PER_STATEMENT = 16  # after so many turns the groups of games move on to other statements


class Situation(NamedTuple):
    """What is known in k games."""

    states: States
    boxes_of: Int64Array  # (k, 3) in the rollout's table
    context: Int64Array  # (k, C)


# The policy and the values (k,) of an agent that learns, in k games: from its role, what it sees there, then what a
# central critic sees if there is one, and for the proposer with a mask the legal actions of the MDP (k, actions).
Evaluate = Callable[[Role, Sequence[Situation], BoolArray | None], tuple[AgentPolicy, Tensor]]


class Seen(NamedTuple):
    """What agents see in each turn, by role, with the views of a game."""

    game: Game
    boxes_of: Int64Array  # (2, T, N, 3)
    context: Int64Array  # (2, T, N, C)


class Claims(NamedTuple):
    """Claims judged in the last turn of their game, when the truth came out."""

    items: Int16Array  # (C, 3, capacity, 5) the scene
    statement_of: Int64Array  # (C,)
    targets: Int64Array  # (C,)
    holds: BoolArray  # (C,)

    def rows(self, rows: Int64Array | slice) -> Claims:
        """The claims at the given indices."""
        return self._make(part[rows] for part in self)

    @classmethod
    def joined(cls, parts: Sequence[Claims]) -> Claims:
        """The claims of all parts, in order."""
        return cls._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


class Rollout:
    """T turns of N games; row t * N + n of a flattened array is turn t of game n.

    Arrays of both agents, indexed by role, are valid where the agent acted.
    """

    claims: Claims

    def __init__(
        self, game: Game, statements: Strings, turns: int, games: int, legal: int = 0, *, central: bool = False
    ) -> None:
        """Zeros, to be filled. `legal`: the number of the MDP's actions for a proposer with a mask, otherwise 0.
        `central`: whether there is a critic that sees everything."""
        self.game = game
        self.table = BoxImageTable()
        self.statements = statements
        shape = turns, games
        self.statement_of, self.targets = np.zeros((2, *shape), np.int64)  # (T, N)
        self.verdicts = np.zeros(shape, np.int64)  # (T, N) on judged claims, NO_CHOICE without one
        self.ended, self.successes = np.zeros((2, *shape), bool)  # (T, N)
        self.holds = np.zeros(shape, bool)  # (T, N) whether the judged claim holds
        self.legal = np.zeros((*shape, legal), bool)  # (T, N, actions of the MDP), of the proposer
        both = len(Role), *shape
        views = [game, game.showing_everything()] if central else [game]
        self.seen = [  # by the agents, then by a central critic
            Seen(each, *(np.zeros((*both, size), np.int64) for size in (BOX_COUNT, len(context_sizes(each)))))
            for each in views
        ]
        self.acted = np.zeros(both, bool)  # (2, T, N)
        self.actions = np.zeros(both, np.int64)  # (2, T, N)
        self.log_probabilities, self.values = np.zeros((2, *both), np.float32)  # (2, T, N)
        self.rewards = np.zeros(both, np.float32)  # (2, T, N) of every turn
        self.last_values = np.zeros((len(Role), games), np.float32)  # (2, N) after the last turn
        self.to_move = np.zeros((len(Role), games), bool)  # (2, N) who is to move then

    @property
    def returns(self) -> Float64Array:
        """(2,) sums over the games that ended, indexed by role."""
        ends_later = np.maximum.accumulate(self.ended[::-1])[::-1]
        return np.array([(rewards * ends_later).sum(dtype=np.float64) for rewards in self.rewards])

    def claim_rates(self) -> tuple[float, float, float]:
        """True-accept rate, false-accept rate, and their difference averaged over the targets; NaN without claims."""
        judged = self.verdicts != NO_CHOICE
        counts = np.zeros((2, 6))  # by target, as `claim_rates` takes them
        first = np.where(self.holds[judged], 2, 4)
        np.add.at(counts, (self.targets[judged], first), 1)
        np.add.at(counts, (self.targets[judged], first + 1), self.verdicts[judged])
        rates = claim_rates(counts.sum(0))
        has_both = np.all(counts[:, [2, 4]] > 0, axis=1, keepdims=True)[:, 0]
        j = mean_j(counts, has_both)
        return float(rates["true_accept_rate"]), float(rates["false_accept_rate"]), float(j)

    @property
    def unfinished(self) -> float:
        """The share of the games played side by side of which none ended."""
        return float((~self.ended.any(0)).mean())

    def states(
        self, game: Game, roles: Role | Int64Array, statement_of: Int64Array, boxes_of: Int64Array, targets: Int64Array
    ) -> States:
        """States (k,) with the given boxes (k, 3), as the agents (k,) see them with the views of `game`."""
        statements = *self.statements, HIDDEN_STATEMENT
        seen, goals = seen_tasks(game, roles, statement_of, targets, len(self.statements))
        return self.table.states(statements, seen, boxes_of, goals)


class RolloutPlayer:
    """N games, started again for each rollout, so that a run resumes exactly."""

    def __init__(
        self,
        game: Game,
        tasks: TrainingTasks,
        recipe: GameRecipe,
        partners: Mapping[Role, Sequence[Partner]],
    ) -> None:
        """`game`: of these tasks that reveals the truth. `partners`: who plays an agent that does not learn."""
        self._game = game
        self._recipe = recipe
        self._partners = partners
        self._arrays = ObservedGames(game, recipe.envs)
        self._sampler = TaskSampler(tasks, recipe)
        self._targets = np.array([task.target for task in tasks.tasks], np.int64)
        self._learners = [role for role in Role if role not in partners]
        self._games = np.arange(recipe.envs)
        self._episodes = np.zeros(recipe.envs, np.int64)

    @torch.no_grad()
    def play(self, evaluate: Evaluate, rng: Rng) -> Rollout:
        """A rollout of the recipe's length."""
        recipe = self._recipe
        arrays = self._arrays
        legal = arrays.game.dynamics.appearance.action_count if recipe.mask else 0
        turns = recipe.rollout // recipe.envs
        central = recipe.critic == "central"
        rollout = Rollout(arrays.game, self._sampler.statements, turns, recipe.envs, legal, central=central)
        items: list[Int16Array] = []  # of claims judged in a game's last turn
        partner_of = {role: rng.integers(len(some), size=recipe.envs) for role, some in self._partners.items()}
        for turn in range(len(rollout.ended)):
            if turn % TURNS_PER_STATEMENT == 0:
                self._sampler.resample_statements(rng)
            if turn == 0:
                self._start(self._games, rng)
            rollout.statement_of[turn] = self._sampler.statement_of[arrays.tasks]
            rollout.targets[turn] = self._targets[arrays.tasks]
            claimed = arrays.items().copy()  # an agent's STOP judges the scene as it is, without a pending edit
            actions = self._act(rollout, turn, evaluate, partner_of, rng)
            arrays.step(actions[Role.PROPOSER], actions[Role.VERIFIER])
            over = rollout.ended[turn] = arrays.terminated | arrays.truncated
            rollout.rewards[:, turn] = arrays.rewards
            rollout.successes[turn] = arrays.successes
            rollout.verdicts[turn] = arrays.verdicts
            rollout.holds[turn] = arrays.holds
            items.append(claimed[over & (arrays.verdicts != NO_CHOICE)])
            if over.any():
                self._start(np.flatnonzero(over), rng)
        known = rollout.ended & (rollout.verdicts != NO_CHOICE)
        rollout.claims = Claims(
            np.concatenate(items), rollout.statement_of[known], rollout.targets[known], rollout.holds[known]
        )
        rollout.to_move[:] = arrays.movers
        for role in self._learners:
            moving = np.flatnonzero(arrays.movers[role])
            if len(moving):
                situations = [self._situation(rollout, seen, role, moving) for seen in rollout.seen]
                rollout.last_values[role, moving] = as_numpy(evaluate(role, situations, None)[1])
        return rollout

    def _start(self, indices: Int64Array, rng: Rng) -> None:
        intents = np.array([int(self._game.sample_intent(rng)) for _ in indices], np.int64)
        self._arrays.start(indices, np.array(self._sampler.sample(indices, rng), np.int64), intents)
        self._episodes[indices] = self._episodes.max() + 1 + np.arange(len(indices))

    def _act(
        self,
        rollout: Rollout,
        turn: int,
        evaluate: Evaluate,
        partner_of: dict[Role, Int64Array],
        rng: Rng,
    ) -> Int64Array:
        """Both agents' actions (2, N)."""
        arrays = self._arrays
        actions = np.zeros((len(Role), self._recipe.envs), np.int64)
        latest: Situation | None = None  # of the other agent
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
            own = role, turn, moving
            situations: list[Situation] = []
            for seen in rollout.seen:
                situation = self._situation(rollout, seen, role, moving, latest)
                situations.append(situation)
                seen.boxes_of[own] = situation.boxes_of
                seen.context[own] = situation.context
            latest = None if arrays.game.turn_based else situations[0]
            legal = None
            if role is Role.PROPOSER and self._recipe.mask:
                masks = arrays.masks(role, moving)
                refused = situations[0].context[:, REFUSED] - 1
                legal = rollout.legal[turn, moving] = proposer_choices(arrays.game, masks, refused)
            policy, values = evaluate(role, situations, legal)
            chosen = policy.act(lambda part: part.sample(rng))
            rollout.acted[own] = True
            actions[role, moving] = rollout.actions[own] = chosen
            rollout.log_probabilities[own] = as_numpy(policy.log_prob(torch.from_numpy(chosen).to(values.device)))
            rollout.values[own] = as_numpy(values)
        return actions

    def _situation(
        self, rollout: Rollout, seen: Seen, role: Role, indices: Int64Array, latest: Situation | None = None
    ) -> Situation:
        """What an agent in games (k,) sees, or a critic beside it. `latest`: what the other one has seen there."""
        game = seen.game
        arrays = self._arrays
        items, context = read_situations(arrays, role, indices, game)
        if latest is not None and game is arrays.game and game.views[0] == game.views[1]:
            return latest._replace(context=context)  # so that a shared network encodes its states once
        tasks = arrays.tasks[indices]
        boxes_of = rollout.table.item_indices(items)
        statements = self._sampler.statement_of[tasks]
        targets = self._targets[tasks]
        return Situation(rollout.states(game, role, statements, boxes_of, targets), boxes_of, context)


def proposer_choices(game: Game, masks: Int8Array, refused: Int64Array) -> BoolArray:
    """(k, actions of the MDP) the choices of a proposer with masks (k, actions), whatever the message."""
    sizes = game.message_sizes[Role.PROPOSER] + 1
    choices = game.dynamics.appearance.action_count
    return without_refused(masks[:, : choices * sizes : sizes].astype(bool), refused)


def without_refused(legal: BoolArray, refused: Int64Array) -> BoolArray:
    """`legal` (k, actions), in place, without the action refused last, which a proposer would only repeat, in rows that
    have another one."""
    rows = np.flatnonzero((refused != NO_CHOICE) & (legal.sum(1) > 1))
    legal[rows, refused[rows]] = False
    return legal


def own_turn_advantages(rollout: Rollout, gamma: float, gae_lambda: float) -> tuple[Float32Array, BoolArray]:
    """(2, T, N) advantages of the agents' own turns, and where they are complete.

    An own turn earns the rewards up to the agent's next own turn, or to the end of the game. The last one of a game
    still going on is incomplete if its successor is not known, and then only lends its value to the one before.
    """
    advantages = np.zeros_like(rollout.values)
    complete = np.zeros_like(rollout.acted)
    next_values = rollout.last_values
    next_advantages = np.zeros_like(rollout.last_values)
    rewards = np.zeros_like(next_values)
    continues = np.ones_like(rollout.to_move)
    known = rollout.to_move
    for turn in range(len(rollout.ended) - 1, -1, -1):
        over = rollout.ended[turn]
        acted = rollout.acted[:, turn]
        values = rollout.values[:, turn]
        rewards = np.where(over, 0, rewards) + rollout.rewards[:, turn]
        continues = continues & ~over
        known = known | over
        delta = rewards + gamma * next_values * continues - values
        found = np.where(known, delta + gamma * gae_lambda * continues * next_advantages, 0)
        advantages[:, turn] = np.where(acted, found, 0)
        complete[:, turn] = acted & known
        next_values = np.where(acted, values, next_values)
        next_advantages = np.where(acted, found, next_advantages)
        rewards = np.where(acted, 0, rewards)
        continues = continues | acted
        known = known | acted
    return advantages, complete
