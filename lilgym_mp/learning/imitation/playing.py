"""The network's actions: from scenes, many at once, under a rule for when to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import torch

from lilgym_mp.arrays import Float32Array, Int64Array
from lilgym_mp.learning.imitation.batches import Boxes, Numbering, box_inputs, padded
from lilgym_mp.learning.imitation.boxes import BoxTable
from lilgym_mp.learning.imitation.layout import STOP_HEAD, ActionLayout
from lilgym_mp.learning.imitation.losses import log_policy
from lilgym_mp.learning.imitation.network import ImitationNetwork, Inputs
from lilgym_mp.rules import Dynamics, Outcome, State
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

MOST_GROUPS = 64  # statements that the network reads at once


@dataclass(frozen=True, slots=True)
class StopRule:
    """When the network stops, chosen on statements kept apart from training."""

    threshold: float = 0.0  # the logit that the statement has the target's value above which greedy play stops
    never_first: bool = False  # no STOP as the first action; a FlipIt start is never solved
    always_last: bool = True  # STOP as the last action that the horizon allows: anything else fails
    sampled: bool = False  # whether drawn actions did better than the likeliest

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


class Player:
    """Chooses actions for any number of statements and scenes."""

    def __init__(self, network: ImitationNetwork, table: BoxTable, layout: ActionLayout, numbering: Numbering) -> None:
        self.network = network
        self.table = table
        self.layout = layout
        self.numbering = numbering
        self.reduced_precision = False

    @property
    def device(self) -> torch.device:
        return next(self.network.parameters()).device

    def log_probabilities(self, statements: Sequence[str], boxes: Int64Array, targets: Int64Array) -> Float32Array:
        """(B, heads) of B scenes, given as (B, 3) boxes by their index in the table."""
        groups: dict[str, list[int]] = {}
        for row, statement in enumerate(statements):
            groups.setdefault(statement, []).append(row)
        found = np.empty((len(statements), self.layout.heads), np.float32)
        self.table.describe()
        ordered = sorted(groups, key=lambda statement: len(groups[statement]))  # groups of like size together
        for first in range(0, len(ordered), MOST_GROUPS):
            chosen = ordered[first : first + MOST_GROUPS]
            rows = [np.array(groups[statement]) for statement in chosen]
            self._fill(found, chosen, rows, boxes, targets)
        return found

    def _fill(
        self,
        found: Float32Array,
        statements: Sequence[str],
        rows: Sequence[Int64Array],
        boxes: Int64Array,
        targets: Int64Array,
    ) -> None:
        most = max(map(len, rows))
        places = np.stack([np.pad(row, (0, most - len(row)), mode="edge") for row in rows])  # (S, N)
        distinct = Boxes.of(boxes[places], most)
        device = self.device
        inputs = Inputs(
            words=torch.from_numpy(padded([self.numbering.numbers(statement) for statement in statements])).to(device),
            **box_inputs(self.table, distinct, np.zeros(len(rows), np.int64), device),
        )
        wanted = torch.from_numpy(targets[places]).to(device)
        self.network.eval()
        with torch.no_grad(), precision(device, reduced=self.reduced_precision):
            outputs = self.network(inputs, wanted)
        found[places] = log_policy(outputs, wanted).cpu().numpy()


def precision(device: torch.device, *, reduced: bool) -> AbstractContextManager[Any]:
    """Calculation in bfloat16 where that does, if `reduced`."""
    return torch.autocast(device.type, torch.bfloat16) if reduced else nullcontext()


def decide(
    log_probabilities: Float32Array, steps: Int64Array, horizon: int, rule: StopRule, rng: np.random.Generator | None
) -> Int64Array:
    """(B,) heads chosen: drawn with `rng`, the likeliest without. `log_probabilities` is (B, heads)."""
    stop = log_probabilities[:, STOP_HEAD].astype(np.float64)
    edits = log_probabilities[:, STOP_HEAD + 1 :]
    if rng is None:
        stops = stop - np.log(-np.expm1(np.minimum(stop, -1e-12))) > rule.threshold  # the logit of STOP
        best = edits.argmax(1)
    else:
        stops = np.log(rng.random(len(stop))) < stop
        best = (edits + rng.gumbel(size=edits.shape)).argmax(1)
    if rule.never_first:
        stops &= steps > 0
    if rule.always_last:
        stops |= steps >= horizon - 1
    return np.where(stops, STOP_HEAD, STOP_HEAD + 1 + best)


class Played(NamedTuple):
    """An episode of the network."""

    task: Task
    scenes: tuple[Scene, ...]  # before each action
    outcome: Outcome


Choose = Callable[[Sequence[State]], Int64Array]


def play(player: Player, dynamics: Dynamics, tasks: Iterable[Task], choose: Choose) -> list[Played]:
    """One episode of each task, all side by side; `choose` gives a head for each state."""
    states = [dynamics.start(task) for task in tasks]
    visited: list[list[Scene]] = [[] for _ in states]
    outcomes = [Outcome.CONTINUES] * len(states)
    going = list(range(len(states)))
    while going:
        heads = choose([states[index] for index in going])
        still: list[int] = []
        for index, head in zip(going, heads.tolist(), strict=True):
            visited[index].append(states[index].scene)
            action = dynamics.appearance.decode(int(player.layout.action_of[head]))
            moved = dynamics.step(states[index], action)
            states[index], outcomes[index] = moved.state, moved.outcome
            if moved.outcome is Outcome.CONTINUES:
                still.append(index)
        going = still
    return [
        Played(state.task, tuple(scenes), outcome)
        for state, scenes, outcome in zip(states, visited, outcomes, strict=True)
    ]


def chooser(player: Player, horizon: int, rule: StopRule, rng: np.random.Generator | None) -> Choose:
    """The network as `play` asks it."""

    def choose(states: Sequence[State]) -> Int64Array:
        found = player.log_probabilities(
            [state.task.statement for state in states],
            player.table.indices([state.scene for state in states]),
            np.array([state.task.target for state in states], np.int64),
        )
        return decide(found, np.array([state.steps for state in states]), horizon, rule, rng)

    return choose


def accuracy(episodes: Sequence[Played]) -> float:
    return float(np.mean([episode.outcome is Outcome.SUCCESS for episode in episodes]))


THRESHOLDS = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)


def best_rule(
    player: Player, dynamics: Dynamics, tasks: Sequence[Task], rng: np.random.Generator
) -> tuple[StopRule, float]:
    """The rule with which most of these tasks are completed, and the share; of equals the one nearest to none."""
    tried: list[tuple[float, StopRule]] = []

    def attempt(rule: StopRule) -> float:
        episodes = play(player, dynamics, tasks, chooser(player, dynamics.horizon, rule, rng if rule.sampled else None))
        tried.append((accuracy(episodes), rule))
        return tried[-1][0]

    never_first = attempt(StopRule(never_first=True)) > attempt(StopRule())
    for threshold in sorted(THRESHOLDS, key=abs)[1:]:
        attempt(StopRule(threshold, never_first))
    attempt(StopRule(never_first=never_first, sampled=True))
    share, rule = max(tried, key=lambda pair: pair[0])
    return rule, share
