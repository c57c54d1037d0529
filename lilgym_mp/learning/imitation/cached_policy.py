"""The network's actions: from scenes, many at once, under a rule for when to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from lilgym_mp.arrays import BoolArray, Float32Array, Int64Array
from lilgym_mp.learning.imitation.action_heads import STOP_INDEX, ActionHeads
from lilgym_mp.learning.imitation.batches import Boxes, StatementTokenizer, box_inputs, padded
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.losses import log_policy, stop_log_probabilities
from lilgym_mp.learning.imitation.network import (
    MIN_PADDED_WORDS,
    ImitationNetwork,
    Inputs,
    Outputs,
    StatementEncodings,
    word_mask,
)
from lilgym_mp.rules import Dynamics, Outcome, State
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.task import Task

MOST_SCENES = 128  # that the network looks at together, and statements that it reads together
MOST_PAIRS = 50_000  # of statements and boxes that are remembered
MOST_NUMBERED = 1 << 32  # boxes


@dataclass(frozen=True, slots=True)
class StopRule:
    """When the network stops, chosen on statements kept apart from training."""

    threshold: float = 0.0  # the logit that the statement has the target's value above which greedy play stops
    never_first: bool = False  # no STOP as the first action; a FlipIt start is never solved
    always_last: bool = True  # STOP as the last action that the horizon allows: anything else fails
    sampled: bool = False  # whether drawn actions did better than the likeliest

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


class _Bank:
    """Rows of equal shape, in tensors that double when they are full."""

    def __init__(self) -> None:
        self.parts: list[Tensor] = []
        self.count = 0
        self._taken: list[Tensor] = []  # of each part, room for the rows that are taken

    def add(self, parts: Sequence[Tensor]) -> range:
        """Where the rows of the parts, (R, ...) each, are kept."""
        first, count = self.count, self.count + len(parts[0])
        room = len(self.parts[0]) if self.parts else 0
        if count > room:
            grown = [part.new_empty((max(2 * room, count), *part.shape[1:])) for part in parts]
            for new, old in zip(grown, self.parts, strict=False):
                new[:first] = old[:first]
            self.parts = grown
        for kept, part in zip(self.parts, parts, strict=True):
            kept[first:count] = part
        self.count = count
        return range(first, count)

    def take(self, part: int, places: Tensor) -> Tensor:
        """(*places.shape, ...) rows of a part, in memory that is written over when its rows are taken again."""
        rows = self.parts[part]
        if len(self._taken) != len(self.parts):
            self._taken = [rows.new_empty(0) for rows in self.parts]
        room, count = self._taken[part], places.numel()
        if len(room) < count:
            room = self._taken[part] = rows.new_empty((count, *rows.shape[1:]))
        return torch.index_select(rows, 0, places.flatten(), out=room[:count]).unflatten(0, places.shape)


class _Statement(NamedTuple):
    """What the network made of a statement: alike in every scene, hence calculated once."""

    number: int  # among all statements
    key_values: list[Tensor]  # (T, 2 d) each, as in `StatementEncodings`, for what attends to the statement but scenes
    room: int  # for words, in the bank of those that scenes attend to
    row: int  # there


class _Asked(NamedTuple):
    """Scenes that are looked at together."""

    rows: Int64Array  # (B,) where they stand among all
    read: StatementEncodings  # the statements as scenes attend to them
    places: Tensor  # (B, 1, 3) of their boxes among all that were read


class Player:
    """Chooses actions for any number of statements and scenes.

    Each statement, and each box in its light, is read once and remembered, until `forget`: to be called when the
    network has changed.
    """

    def __init__(
        self, network: ImitationNetwork, table: BoxFeatureTable, heads: ActionHeads, tokenizer: StatementTokenizer
    ) -> None:
        self.network = network
        self.table = table
        self.heads = heads
        self.tokenizer = tokenizer
        self.reduced_precision = False
        self.forget()

    def forget(self) -> None:
        """Forgets statements and boxes."""
        self._statements: dict[str, _Statement] = {}
        self._words: dict[int, _Bank] = {}  # by room for words, what scenes attend to: keys and values, and masks
        self._boxes = _Bank()  # sums, again and acts of `BoxEncodings` and what cells offer, by statement and box
        self._joined: tuple[Tensor, Tensor] | None = None  # what is asked of cells
        self._places: dict[int, int] = {}  # there, by MOST_NUMBERED times the statement's number, plus the box

    @property
    def device(self) -> torch.device:
        return next(self.network.parameters()).device

    @torch.inference_mode()
    def log_probabilities(self, statements: Sequence[str], boxes: Int64Array, targets: Int64Array) -> Float32Array:
        """(B, heads) of B scenes, given as (B, 3) boxes by their index in the table."""
        found = np.empty((len(statements), self.heads.size), np.float32)
        with precision(self.device, reduced=self.reduced_precision):
            for asked in self._asked(statements, boxes):
                wanted = torch.from_numpy(targets[asked.rows, None]).to(self.device)
                scene, truth = self._understood(asked)
                log_probabilities = log_policy(self._outputs(scene, truth, asked.places, wanted), wanted)
                found[asked.rows] = log_probabilities[:, 0].cpu().numpy()
        return found

    @torch.inference_mode()
    def likeliest(
        self,
        statements: Sequence[str],
        boxes: Int64Array,
        targets: Int64Array,
        steps: Int64Array,
        horizon: int,
        rule: StopRule,
    ) -> tuple[Int64Array, Float32Array]:
        """(B,) heads, as `decide` has them without random numbers, and (B,) the log-probabilities of STOP.

        Edits are calculated only for scenes in which one is made.
        """
        log_stops = np.empty(len(statements), np.float32)
        chosen = np.full(len(statements), STOP_INDEX, np.int64)
        with precision(self.device, reduced=self.reduced_precision):
            for asked in self._asked(statements, boxes):
                wanted = torch.from_numpy(targets[asked.rows, None]).to(self.device)
                scene, truth = self._understood(asked)
                log_stop = stop_log_probabilities(truth.float(), wanted)[0][:, 0].cpu().numpy()
                log_stops[asked.rows] = log_stop
                going = np.flatnonzero(~stopping(log_stop, steps[asked.rows], horizon, rule, None))
                kept = torch.from_numpy(going).to(self.device)
                outputs = self._outputs(scene[kept], truth[kept], asked.places[kept], wanted[kept])
                chosen[asked.rows[going]] = self._likeliest_edits(outputs)
        return chosen, log_stops

    def _likeliest_edits(self, outputs: Outputs) -> Int64Array:
        """(B,) heads."""
        types = outputs.types.log_softmax(-1)[:, 0]
        best: list[Float32Array] = []
        places: list[Int64Array] = []
        for kind, logits in enumerate((outputs.adds[:, 0], outputs.removes[:, 0])):
            place = logits.cpu().numpy().argmax(1)  # NumPy's is several times as fast as torch's
            highest = logits.gather(1, torch.from_numpy(place[:, None]).to(logits.device))[:, 0]
            best.append((types[:, kind] + highest - logits.logsumexp(-1)).cpu().numpy())
            places.append(place)
        return STOP_INDEX + 1 + np.where(best[0] >= best[1], places[0], self.heads.adds + places[1])

    def _asked(self, statements: Sequence[str], boxes: Int64Array) -> Iterator[_Asked]:
        """The scenes, those together whose statements have the same room."""
        if self.network.training:
            self.network.eval()
        if len(self._places) > MOST_PAIRS:
            self.forget()
        self.table.describe()
        self._read_statements([one for one in dict.fromkeys(statements) if one not in self._statements])
        said = [self._statements[statement] for statement in statements]
        places = self._places_of(statements, said, boxes).to(self.device)
        rooms = np.array([one.room for one in said], np.int64)
        rows = np.array([one.row for one in said], np.int64)
        for room, bank in self._words.items():
            every = np.flatnonzero(rooms == room)
            for first in range(0, len(every), MOST_SCENES):
                some = every[first : first + MOST_SCENES]
                chosen = torch.from_numpy(rows[some]).to(self.device)
                key_values, masks = (bank.take(part, chosen) for part in range(2))
                yield _Asked(some, StatementEncodings((key_values,), masks), places[torch.from_numpy(some), None])

    def _understood(self, asked: _Asked) -> tuple[Tensor, Tensor]:
        """(B, 1, d) the scenes, and (B, 1) the logits of their truth."""
        sums, again = (self._boxes.take(part, asked.places) for part in range(2))
        return self.network.understood(sums, again, asked.read)

    def _outputs(self, scene: Tensor, truth: Tensor, places: Tensor, targets: Tensor) -> Outputs:
        """What the network says of scenes that it has understood."""
        network = self.network
        each = network.to_act(scene, self._boxes.take(2, places), targets)
        if network.scatter is not None:
            if self._joined is None:
                self._joined = network.scatter.joined()
            cells, legal = (self._boxes.take(part, places) for part in (3, 4))
            return network.outputs(truth, each, network.scatter.of_offered(each, cells, legal, self._joined))
        assert network.tower is not None
        return network.outputs(truth, each, network.tower(each))

    def _read_statements(self, statements: Sequence[str]) -> None:
        numbers = {statement: self.tokenizer.encode(statement) for statement in statements}
        ordered = sorted(numbers, key=lambda statement: len(numbers[statement]))  # statements of like length together
        for first in range(0, len(ordered), MOST_SCENES):
            some = ordered[first : first + MOST_SCENES]
            words = padded([numbers[one] for one in some], MIN_PADDED_WORDS)
            read = self.network.read(torch.from_numpy(words).to(self.device))
            by_heads = self.network.scene_reading.by_heads(read.key_values[-1])
            for row, statement in enumerate(some):
                count = len(numbers[statement])
                kept = [key_value[row, :count].clone() for key_value in read.key_values[:-1]]
                room = MIN_PADDED_WORDS * 2 ** ((count - 1) // MIN_PADDED_WORDS).bit_length()
                heard = F.pad(by_heads[row, ..., :count, :], (0, 0, 0, room - count))
                hidden = word_mask(torch.arange(room, device=self.device)[None] < count)
                place = self._words.setdefault(room, _Bank()).add([heard[None], hidden])
                self._statements[statement] = _Statement(len(self._statements), kept, room, place[0])

    def _places_of(self, statements: Sequence[str], said: Sequence[_Statement], boxes: Int64Array) -> Tensor:
        """(B, 3) where the boxes, in the light of their statements, are kept; those that are new are read."""
        keys = (np.array([one.number for one in said], np.int64)[:, None] * MOST_NUMBERED + boxes).ravel().tolist()
        new = [place for place, key in enumerate(keys) if key not in self._places]
        if new:
            asked: dict[str, dict[int, int]] = {}
            of_boxes = boxes.ravel().tolist()
            for place in new:
                asked.setdefault(statements[place // BOX_COUNT], {})[of_boxes[place]] = keys[place]
            self._read_boxes(asked)
        known = self._places
        return torch.tensor([known[key] for key in keys]).view(-1, BOX_COUNT)

    def _read_boxes(self, asked: Mapping[str, Mapping[int, int]]) -> None:
        """Reads boxes in the light of their statements; `asked`: the boxes' keys."""
        ordered = sorted(asked, key=lambda statement: len(asked[statement]))
        for first in range(0, len(ordered), MOST_SCENES):
            some = ordered[first : first + MOST_SCENES]
            rows = [np.array(list(asked[statement]), np.int64) for statement in some]
            counts = np.array([len(row) for row in rows])
            present = np.arange(counts.max()) < counts[:, None]
            distinct = Boxes(padded(rows), present, np.zeros((len(rows), 0, BOX_COUNT), np.int64), int(counts.max()))
            orders = np.zeros(len(rows), np.int64)
            words = torch.zeros((len(rows), 0), dtype=torch.int64)
            inputs = Inputs(words=words, **box_inputs(self.table, distinct, orders, self.device))
            read = StatementEncodings.from_cache([self._statements[one].key_values for one in some])
            found = self.network.boxes_read(inputs, read)
            parts = [found.sums, found.again, found.acts]
            if self.network.scatter is not None:
                assert found.cells is not None
                assert found.legal is not None
                parts.extend(self.network.scatter.offered(found.cells, found.legal))
            places = self._boxes.add([part[torch.from_numpy(present)] for part in parts])
            self._places.update(zip((key for one in some for key in asked[one].values()), places, strict=True))


def precision(device: torch.device, *, reduced: bool) -> AbstractContextManager[Any]:
    """Calculation in bfloat16 where that does, if `reduced`."""
    return torch.autocast(device.type, torch.bfloat16) if reduced else nullcontext()


def decide(
    log_probabilities: Float32Array, steps: Int64Array, horizon: int, rule: StopRule, rng: np.random.Generator | None
) -> Int64Array:
    """(B,) heads chosen: drawn with `rng`, the likeliest without. `log_probabilities` is (B, heads)."""
    stops = stopping(log_probabilities[:, STOP_INDEX], steps, horizon, rule, rng)
    edits = log_probabilities[:, STOP_INDEX + 1 :]
    best = (edits if rng is None else edits + rng.gumbel(size=edits.shape)).argmax(1)
    return np.where(stops, STOP_INDEX, STOP_INDEX + 1 + best)


def stopping(
    log_stops: Float32Array, steps: Int64Array, horizon: int, rule: StopRule, rng: np.random.Generator | None
) -> BoolArray:
    """(B,) whether to stop, from the log-probabilities of STOP: drawn with `rng`, by the threshold without."""
    stop = log_stops.astype(np.float64)
    if rng is None:
        stops = stop - np.log(-np.expm1(np.minimum(stop, -1e-12))) > rule.threshold  # the logit of STOP
    else:
        stops = np.log(rng.random(len(stop))) < stop
    if rule.never_first:
        stops &= steps > 0
    if rule.always_last:
        stops |= steps >= horizon - 1
    return stops


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
        chosen = choose([states[index] for index in going])
        still: list[int] = []
        for index, head in zip(going, chosen.tolist(), strict=True):
            visited[index].append(states[index].scene)
            action = dynamics.appearance.decode(int(player.heads.action_of[head]))
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
        statements = [state.task.statement for state in states]
        boxes = player.table.indices([state.scene for state in states])
        targets = np.array([state.task.target for state in states], np.int64)
        steps = np.array([state.steps for state in states])
        if rng is None:
            return player.likeliest(statements, boxes, targets, steps, horizon, rule)[0]
        return decide(player.log_probabilities(statements, boxes, targets), steps, horizon, rule, rng)

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
