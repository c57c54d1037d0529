"""The network as a policy on scenes: batched, with cached encodings, under a stop rule."""

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
from lilgym_mp.learning.imitation.batches import DistinctBoxes, StatementTokenizer, box_inputs, pad_rows
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.losses import log_policy, stop_log_probabilities
from lilgym_mp.learning.imitation.network import (
    MIN_PADDED_WORDS,
    ImitationNetwork,
    Inputs,
    Outputs,
    StatementEncodings,
    attention_mask,
)
from lilgym_mp.rules import Dynamics, Outcome, State
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.task import Task

BATCH_SIZE = 128  # scenes, or statements, per forward pass
MAX_CACHED_PAIRS = 50_000  # pairs of a statement and a box
MAX_BOX_INDICES = 1 << 32  # multiplier of the statement index in cache keys


@dataclass(frozen=True, slots=True)
class StopRule:
    """When to take STOP; tuned on held-out training statements."""

    threshold: float = 0.0  # greedy play stops when STOP's logit exceeds it
    never_first: bool = False  # no STOP as the first action: a FlipIt start is never solved
    always_last: bool = True  # STOP as the last action within the horizon: anything else fails
    sampled: bool = False  # whether sampled actions did better than greedy ones

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


class _RowCache:
    """Parallel tensors of cached rows, doubled in size when full."""

    def __init__(self) -> None:
        self.parts: list[Tensor] = []
        self.count = 0
        self._buffers: list[Tensor] = []  # one buffer per part, reused by `take`

    def add(self, parts: Sequence[Tensor]) -> range:
        """Appends rows, (R, ...) of each part; returns their indices."""
        first, count = self.count, self.count + len(parts[0])
        capacity = len(self.parts[0]) if self.parts else 0
        if count > capacity:
            grown = [part.new_empty((max(2 * capacity, count), *part.shape[1:])) for part in parts]
            for new, old in zip(grown, self.parts, strict=False):
                new[:first] = old[:first]
            self.parts = grown
        for cached, part in zip(self.parts, parts, strict=True):
            cached[first:count] = part
        self.count = count
        return range(first, count)

    def take(self, part: int, indices: Tensor) -> Tensor:
        """(*indices.shape, ...) rows of a part, in a buffer that the next `take` of the part overwrites."""
        rows = self.parts[part]
        if len(self._buffers) != len(self.parts):
            self._buffers = [rows.new_empty(0) for rows in self.parts]
        buffer, count = self._buffers[part], indices.numel()
        if len(buffer) < count:
            buffer = self._buffers[part] = rows.new_empty((count, *rows.shape[1:]))
        return torch.index_select(rows, 0, indices.flatten(), out=buffer[:count]).unflatten(0, indices.shape)


class _CachedStatement(NamedTuple):
    """A statement's encoding, shared by all of its scenes."""

    index: int  # index among all cached statements
    key_values: list[Tensor]  # (T, 2 d) of each layer but the last, which attends from scenes
    length: int  # padded number of words; selects the cache of the last layer's keys and values
    row: int  # row in that cache


class _SceneBatch(NamedTuple):
    """Scenes of one forward pass."""

    rows: Int64Array  # (B,) their indices in the call
    statements: StatementEncodings  # encodings for the last layer alone
    pairs: Tensor  # (B, 1, 3) indices of their statement-box pairs in the cache


class CachedPolicy:
    """Action probabilities and choices for any number of statements and scenes.

    Encodings of statements and of statement-box pairs are cached: call `clear_cache` when the network has changed.
    """

    def __init__(
        self, network: ImitationNetwork, table: BoxFeatureTable, heads: ActionHeads, tokenizer: StatementTokenizer
    ) -> None:
        self.network = network
        self.table = table
        self.heads = heads
        self.tokenizer = tokenizer
        self.reduced_precision = False
        self.clear_cache()

    def clear_cache(self) -> None:
        self._statements: dict[str, _CachedStatement] = {}
        self._words: dict[int, _RowCache] = {}  # by padded length: keys and values that scenes attend to, and masks
        self._boxes = _RowCache()  # terms of `BoxEncodings` and `fused_inputs`, by statement-box pair
        self._fused_layer: tuple[Tensor, Tensor] | None = None
        self._pairs: dict[int, int] = {}  # MAX_BOX_INDICES * statement index + box index -> row in `_boxes`

    @property
    def device(self) -> torch.device:
        return next(self.network.parameters()).device

    @torch.inference_mode()
    def log_probabilities(self, statements: Sequence[str], boxes: Int64Array, targets: Int64Array) -> Float32Array:
        """(B, logits) for B scenes, given as (B, 3) box indices in the table."""
        log_probabilities = np.empty((len(statements), self.heads.size), np.float32)
        with precision(self.device, reduced=self.reduced_precision):
            for batch in self._batches(statements, boxes):
                batch_targets = torch.from_numpy(targets[batch.rows, None]).to(self.device)
                scene, truth = self._encode_scenes(batch)
                batch_logs = log_policy(self._outputs(scene, truth, batch.pairs, batch_targets), batch_targets)
                log_probabilities[batch.rows] = batch_logs[:, 0].cpu().numpy()
        return log_probabilities

    @torch.inference_mode()
    def greedy(
        self,
        statements: Sequence[str],
        boxes: Int64Array,
        targets: Int64Array,
        steps: Int64Array,
        horizon: int,
        rule: StopRule,
    ) -> tuple[Int64Array, Float32Array]:
        """(B,) logit indices, as `choose_actions` without random numbers, and (B,) log-probabilities of STOP.

        Edit logits are computed only for scenes that are not stopped in.
        """
        log_stops = np.empty(len(statements), np.float32)
        chosen = np.full(len(statements), STOP_INDEX, np.int64)
        with precision(self.device, reduced=self.reduced_precision):
            for batch in self._batches(statements, boxes):
                batch_targets = torch.from_numpy(targets[batch.rows, None]).to(self.device)
                scene, truth = self._encode_scenes(batch)
                log_stop = stop_log_probabilities(truth.float(), batch_targets)[0][:, 0].cpu().numpy()
                log_stops[batch.rows] = log_stop
                going = np.flatnonzero(~stop_mask(log_stop, steps[batch.rows], horizon, rule, None))
                kept = torch.from_numpy(going).to(self.device)
                outputs = self._outputs(scene[kept], truth[kept], batch.pairs[kept], batch_targets[kept])
                chosen[batch.rows[going]] = self._greedy_edits(outputs)
        return chosen, log_stops

    def _greedy_edits(self, outputs: Outputs) -> Int64Array:
        """(B,) logit indices of the most probable edits."""
        types = outputs.types.log_softmax(-1)[:, 0]
        best: list[Float32Array] = []
        arguments: list[Int64Array] = []
        for action_type, logits in enumerate((outputs.adds[:, 0], outputs.removes[:, 0])):
            argument = logits.cpu().numpy().argmax(1)  # NumPy's is several times as fast as torch's
            highest = logits.gather(1, torch.from_numpy(argument[:, None]).to(logits.device))[:, 0]
            best.append((types[:, action_type] + highest - logits.logsumexp(-1)).cpu().numpy())
            arguments.append(argument)
        return STOP_INDEX + 1 + np.where(best[0] >= best[1], arguments[0], self.heads.add_count + arguments[1])

    def _batches(self, statements: Sequence[str], boxes: Int64Array) -> Iterator[_SceneBatch]:
        """The scenes, batched by the padded length of their statements."""
        if self.network.training:
            self.network.eval()
        if len(self._pairs) > MAX_CACHED_PAIRS:
            self.clear_cache()
        self.table.update_features()
        self._encode_statements([one for one in dict.fromkeys(statements) if one not in self._statements])
        cached = [self._statements[statement] for statement in statements]
        pairs = self._pair_rows(statements, cached, boxes).to(self.device)
        lengths = np.array([one.length for one in cached], np.int64)
        rows = np.array([one.row for one in cached], np.int64)
        for length, cache in self._words.items():
            same_length = np.flatnonzero(lengths == length)
            for first in range(0, len(same_length), BATCH_SIZE):
                some = same_length[first : first + BATCH_SIZE]
                chosen = torch.from_numpy(rows[some]).to(self.device)
                key_values, masks = (cache.take(part, chosen) for part in range(2))
                yield _SceneBatch(some, StatementEncodings((key_values,), masks), pairs[torch.from_numpy(some), None])

    def _encode_scenes(self, batch: _SceneBatch) -> tuple[Tensor, Tensor]:
        """(B, 1, d) scene vectors and (B, 1) truth logits."""
        scene_terms, refinement_terms = (self._boxes.take(part, batch.pairs) for part in range(2))
        return self.network.encode_scenes(scene_terms, refinement_terms, batch.statements)

    def _outputs(self, scene: Tensor, truth: Tensor, pairs: Tensor, targets: Tensor) -> Outputs:
        network = self.network
        features = network.action_features(scene, self._boxes.take(2, pairs), targets)
        if network.scatter is not None:
            if self._fused_layer is None:
                self._fused_layer = network.scatter.fused_layer()
            cells, legal = (self._boxes.take(part, pairs) for part in (3, 4))
            heads = network.scatter.fused_forward(features, cells, legal, self._fused_layer)
            return network.outputs(truth, features, heads)
        assert network.tower is not None
        return network.outputs(truth, features, network.tower(features))

    def _encode_statements(self, statements: Sequence[str]) -> None:
        """Encodes and caches new statements."""
        indices = {statement: self.tokenizer.encode(statement) for statement in statements}
        ordered = sorted(indices, key=lambda statement: len(indices[statement]))  # similar lengths together
        for first in range(0, len(ordered), BATCH_SIZE):
            some = ordered[first : first + BATCH_SIZE]
            words = pad_rows([indices[one] for one in some], MIN_PADDED_WORDS)
            encodings = self.network.encode_statements(torch.from_numpy(words).to(self.device))
            by_heads = self.network.scene_reading.by_heads(encodings.key_values[-1])
            for row, statement in enumerate(some):
                count = len(indices[statement])
                key_values = [key_value[row, :count].clone() for key_value in encodings.key_values[:-1]]
                length = MIN_PADDED_WORDS * 2 ** ((count - 1) // MIN_PADDED_WORDS).bit_length()
                scene_key_value = F.pad(by_heads[row, ..., :count, :], (0, 0, 0, length - count))
                mask = attention_mask(torch.arange(length, device=self.device)[None] < count)
                (cache_row,) = self._words.setdefault(length, _RowCache()).add([scene_key_value[None], mask])
                self._statements[statement] = _CachedStatement(len(self._statements), key_values, length, cache_row)

    def _pair_rows(self, statements: Sequence[str], cached: Sequence[_CachedStatement], boxes: Int64Array) -> Tensor:
        """(B, 3) cache rows of the statement-box pairs; new pairs are encoded."""
        keys = (np.array([one.index for one in cached], np.int64)[:, None] * MAX_BOX_INDICES + boxes).ravel().tolist()
        new = [position for position, key in enumerate(keys) if key not in self._pairs]
        if new:
            new_boxes: dict[str, dict[int, int]] = {}
            flat_boxes = boxes.ravel().tolist()
            for position in new:
                statement = statements[position // BOX_COUNT]
                new_boxes.setdefault(statement, {})[flat_boxes[position]] = keys[position]
            self._encode_boxes(new_boxes)
        known = self._pairs
        return torch.tensor([known[key] for key in keys]).view(-1, BOX_COUNT)

    def _encode_boxes(self, new_boxes: Mapping[str, Mapping[int, int]]) -> None:
        """Encodes and caches statement-box pairs; `new_boxes`: statement -> box index -> cache key."""
        ordered = sorted(new_boxes, key=lambda statement: len(new_boxes[statement]))
        for first in range(0, len(ordered), BATCH_SIZE):
            some = ordered[first : first + BATCH_SIZE]
            rows = [np.array(list(new_boxes[statement]), np.int64) for statement in some]
            counts = np.array([len(row) for row in rows])
            present = np.arange(counts.max()) < counts[:, None]
            no_scenes = np.zeros((len(rows), 0, BOX_COUNT), np.int64)
            distinct = DistinctBoxes(pad_rows(rows), present, no_scenes, int(counts.max()))
            orders = np.zeros(len(rows), np.int64)
            words = torch.zeros((len(rows), 0), dtype=torch.int64)
            inputs = Inputs(words=words, **box_inputs(self.table, distinct, orders, self.device))
            statements = StatementEncodings.from_cache([self._statements[one].key_values for one in some])
            encodings = self.network.encode_boxes(inputs, statements)
            parts = [encodings.scene_terms, encodings.refinement_terms, encodings.action_terms]
            if self.network.scatter is not None:
                assert encodings.cells is not None
                assert encodings.legal is not None
                parts.extend(self.network.scatter.fused_inputs(encodings.cells, encodings.legal))
            cache_rows = self._boxes.add([part[torch.from_numpy(present)] for part in parts])
            keys = (key for one in some for key in new_boxes[one].values())
            self._pairs.update(zip(keys, cache_rows, strict=True))


def precision(device: torch.device, *, reduced: bool) -> AbstractContextManager[Any]:
    """Autocast to bfloat16 if `reduced`."""
    return torch.autocast(device.type, torch.bfloat16) if reduced else nullcontext()


def choose_actions(
    log_probabilities: Float32Array, steps: Int64Array, horizon: int, rule: StopRule, rng: np.random.Generator | None
) -> Int64Array:
    """(B,) logit indices from (B, logits): sampled with `rng`, greedy without."""
    stops = stop_mask(log_probabilities[:, STOP_INDEX], steps, horizon, rule, rng)
    edits = log_probabilities[:, STOP_INDEX + 1 :]
    best = (edits if rng is None else edits + rng.gumbel(size=edits.shape)).argmax(1)
    return np.where(stops, STOP_INDEX, STOP_INDEX + 1 + best)


def stop_mask(
    log_stops: Float32Array, steps: Int64Array, horizon: int, rule: StopRule, rng: np.random.Generator | None
) -> BoolArray:
    """(B,) whether to stop, from the log-probabilities of STOP: sampled with `rng`, by the threshold without."""
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


class PlayedEpisode(NamedTuple):
    task: Task
    scenes: tuple[Scene, ...]  # the scene before each action
    outcome: Outcome


Choose = Callable[[Sequence[State]], Int64Array]


def play_episodes(
    policy: CachedPolicy, dynamics: Dynamics, tasks: Iterable[Task], choose: Choose
) -> list[PlayedEpisode]:
    """One episode of each task, in parallel; `choose` returns a logit index for each state."""
    states = [dynamics.start(task) for task in tasks]
    visited: list[list[Scene]] = [[] for _ in states]
    outcomes = [Outcome.CONTINUES] * len(states)
    running = list(range(len(states)))
    while running:
        chosen = choose([states[index] for index in running])
        still_running: list[int] = []
        for index, logit_index in zip(running, chosen.tolist(), strict=True):
            visited[index].append(states[index].scene)
            action = dynamics.appearance.decode(int(policy.heads.action_of[logit_index]))
            transition = dynamics.step(states[index], action)
            states[index], outcomes[index] = transition.state, transition.outcome
            if transition.outcome is Outcome.CONTINUES:
                still_running.append(index)
        running = still_running
    return [
        PlayedEpisode(state.task, tuple(scenes), outcome)
        for state, scenes, outcome in zip(states, visited, outcomes, strict=True)
    ]


def action_chooser(policy: CachedPolicy, horizon: int, rule: StopRule, rng: np.random.Generator | None) -> Choose:
    """`choose` for `play_episodes`: sampled with `rng`, greedy without."""

    def choose(states: Sequence[State]) -> Int64Array:
        statements = [state.task.statement for state in states]
        boxes = policy.table.indices([state.scene for state in states])
        targets = np.array([state.task.target for state in states], np.int64)
        steps = np.array([state.steps for state in states])
        if rng is None:
            return policy.greedy(statements, boxes, targets, steps, horizon, rule)[0]
        return choose_actions(policy.log_probabilities(statements, boxes, targets), steps, horizon, rule, rng)

    return choose


def accuracy(episodes: Sequence[PlayedEpisode]) -> float:
    return float(np.mean([episode.outcome is Outcome.SUCCESS for episode in episodes]))


THRESHOLDS = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)


def tune_stop_rule(
    policy: CachedPolicy, dynamics: Dynamics, tasks: Sequence[Task], rng: np.random.Generator
) -> tuple[StopRule, float]:
    """The stop rule with the highest accuracy on the tasks, and that accuracy; ties go to the first one tried."""
    tried: list[tuple[float, StopRule]] = []

    def attempt(rule: StopRule) -> float:
        choose = action_chooser(policy, dynamics.horizon, rule, rng if rule.sampled else None)
        tried.append((accuracy(play_episodes(policy, dynamics, tasks, choose)), rule))
        return tried[-1][0]

    never_first = attempt(StopRule(never_first=True)) > attempt(StopRule())
    for threshold in sorted(THRESHOLDS, key=abs)[1:]:
        attempt(StopRule(threshold, never_first))
    attempt(StopRule(never_first=never_first, sampled=True))
    best, rule = max(tried, key=lambda pair: pair[0])
    return rule, best
