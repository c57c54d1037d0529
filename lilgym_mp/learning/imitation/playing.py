"""The network's actions: from scenes, many at once, under a rule for when to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.arrays import Float32Array, Int64Array
from lilgym_mp.learning.imitation.batches import Boxes, Numbering, box_inputs, padded
from lilgym_mp.learning.imitation.boxes import BoxTable
from lilgym_mp.learning.imitation.layout import STOP_HEAD, ActionLayout
from lilgym_mp.learning.imitation.losses import log_policy
from lilgym_mp.learning.imitation.network import FEWEST_PLACES, BoxesRead, ImitationNetwork, Inputs, Read
from lilgym_mp.rules import Dynamics, Outcome, State
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.task import Task

MOST_SCENES = 128  # that the network looks at together, and statements that it reads together
SCENE_LAYER = slice(-1, None)  # the last of the layers that attend to statements: scenes as wholes
MOST_PAIRS = 100_000  # of statements and boxes that are remembered


@dataclass(frozen=True, slots=True)
class StopRule:
    """When the network stops, chosen on statements kept apart from training."""

    threshold: float = 0.0  # the logit that the statement has the target's value above which greedy play stops
    never_first: bool = False  # no STOP as the first action; a FlipIt start is never solved
    always_last: bool = True  # STOP as the last action that the horizon allows: anything else fails
    sampled: bool = False  # whether drawn actions did better than the likeliest

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


class _Statement(NamedTuple):
    """What the network made of a statement: alike in every scene, hence calculated once."""

    key_values: list[Tensor]  # (T, 2 d) each, as in `Read`
    boxes: dict[int, int]  # by box in the table, its place among what was read of boxes


class Player:
    """Chooses actions for any number of statements and scenes.

    Each statement, and each box in its light, is read once and remembered, until `forget`: to be called when the
    network has changed.
    """

    def __init__(self, network: ImitationNetwork, table: BoxTable, layout: ActionLayout, numbering: Numbering) -> None:
        self.network = network
        self.table = table
        self.layout = layout
        self.numbering = numbering
        self.reduced_precision = False
        self.forget()

    def forget(self) -> None:
        """Forgets statements and boxes."""
        self._statements: dict[str, _Statement] = {}
        self._read: list[Tensor] = []  # (N, ...) the fields of `BoxesRead` for every pair of statement and box
        self._pairs = 0

    @property
    def device(self) -> torch.device:
        return next(self.network.parameters()).device

    @torch.no_grad()
    def log_probabilities(self, statements: Sequence[str], boxes: Int64Array, targets: Int64Array) -> Float32Array:
        """(B, heads) of B scenes, given as (B, 3) boxes by their index in the table."""
        if self.network.training:
            self.network.eval()
        if self._pairs > MOST_PAIRS:
            self.forget()
        self.table.describe()
        with precision(self.device, reduced=self.reduced_precision):
            self._read_statements([one for one in dict.fromkeys(statements) if one not in self._statements])
            self._read_boxes(statements, boxes)
            found = [
                self._judged(statements[first : first + MOST_SCENES], boxes[first:], targets[first:])
                for first in range(0, len(statements), MOST_SCENES)
            ]
        return np.concatenate(found) if found else np.empty((0, self.layout.heads), np.float32)

    def _read_statements(self, statements: Sequence[str]) -> None:
        numbers = {statement: self.numbering.numbers(statement) for statement in statements}
        ordered = sorted(numbers, key=lambda statement: len(numbers[statement]))  # statements of like length together
        for first in range(0, len(ordered), MOST_SCENES):
            some = ordered[first : first + MOST_SCENES]
            words = padded([numbers[one] for one in some], FEWEST_PLACES)
            read = self.network.read(torch.from_numpy(words).to(self.device))
            for row, statement in enumerate(some):
                count = len(numbers[statement])
                kept = [key_value[row, :count].clone() for key_value in read.key_values]
                self._statements[statement] = _Statement(kept, {})

    def _read_boxes(self, statements: Sequence[str], boxes: Int64Array) -> None:
        """Reads the boxes that are new to their statements."""
        new: dict[str, dict[int, None]] = {}
        for statement, row in zip(statements, boxes.tolist(), strict=True):
            for box in row:
                if box not in self._statements[statement].boxes:
                    new.setdefault(statement, {})[box] = None
        ordered = sorted(new, key=lambda statement: len(new[statement]))
        for first in range(0, len(ordered), MOST_SCENES):
            some = ordered[first : first + MOST_SCENES]
            rows = [np.array(list(new[statement]), np.int64) for statement in some]
            counts = np.array([len(row) for row in rows])
            present = np.arange(counts.max()) < counts[:, None]
            asked = Boxes(padded(rows), present, np.zeros((len(rows), 0, BOX_COUNT), np.int64), int(counts.max()))
            orders = np.zeros(len(rows), np.int64)
            words = torch.zeros((len(rows), 0), dtype=torch.int64)
            inputs = Inputs(words=words, **box_inputs(self.table, asked, orders, self.device))
            read = self.network.boxes_read(inputs, self._as_read(some, slice(None)))
            self._keep([part[torch.from_numpy(present)] for part in read if part is not None])
            places = iter(range(self._pairs - int(counts.sum()), self._pairs))
            for statement in some:
                self._statements[statement].boxes.update(zip(new[statement], places, strict=False))

    def _keep(self, parts: Sequence[Tensor]) -> None:
        """Adds what was read of some boxes to what is remembered, which doubles its room when it is full."""
        count = len(parts[0])
        room = len(self._read[0]) if self._read else 0
        if self._pairs + count > room:
            more = max(2 * room, self._pairs + count)
            grown = [part.new_empty((more, *part.shape[1:])) for part in parts]
            for new, old in zip(grown, self._read, strict=False):
                new[: self._pairs] = old[: self._pairs]
            self._read = grown
        for kept, part in zip(self._read, parts, strict=True):
            kept[self._pairs : self._pairs + count] = part
        self._pairs += count

    def _as_read(self, statements: Sequence[str], layers: slice) -> Read:
        """The statements as some of the layers that attend to them do."""
        known = [self._statements[statement].key_values[layers] for statement in statements]
        return Read.of_remembered(known)

    def _judged(self, statements: Sequence[str], boxes: Int64Array, targets: Int64Array) -> Float32Array:
        """(B, heads) of the B statements with the first B scenes."""
        rows = zip(statements, boxes.tolist(), strict=False)
        places = torch.tensor([[self._statements[statement].boxes[box] for box in row] for statement, row in rows])
        parts = [kept[places.to(self.device)] for kept in self._read]
        read = BoxesRead(parts[0], *(parts[1:] or (None, None)))
        scenes = torch.arange(BOX_COUNT, device=self.device).expand(len(places), 1, BOX_COUNT)
        wanted = torch.from_numpy(targets[: len(places), None]).to(self.device)
        outputs = self.network.judged(self._as_read(statements[: len(places)], SCENE_LAYER), read, scenes, wanted)
        return log_policy(outputs, wanted)[:, 0].cpu().numpy()


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
