"""Training batches of dataset entries as tensors, and the loss on them.

Each distinct box of a statement is there once, and colours are permuted at random. The loss is the negative
log-probability of the set of optimal first actions, with auxiliary losses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from lilgym_mp.corpus.tokens import UNKNOWN
from lilgym_mp.learning.common.attention import MIN_PADDED_WORDS
from lilgym_mp.learning.common.augmentation import RECOLOURINGS
from lilgym_mp.learning.common.words import StatementTokenizer, pad_rows
from lilgym_mp.learning.imitation.action_heads import ActionHeads
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DatasetEntry
from lilgym_mp.learning.imitation.learner import ImitationRecipe
from lilgym_mp.learning.imitation.network import MAX_STEPS, Inputs, Outputs
from lilgym_mp.scene.arrays import BoolArray, Int64Array, Rng

MIN_PROBABILITY = 1e-13  # clamp; sets of actions below it have no gradient


class Batch(NamedTuple):
    """Inputs and labels of one optimiser step; the first A scenes of each of the S statements have optimal actions."""

    inputs: Inputs
    targets: Tensor  # (S, A) the truth value to bring about: the opposite of the scene's
    truths: Tensor  # (S, N) 0.0 or 1.0
    steps: Tensor  # (S, A) steps to success minus 2, clipped to MAX_STEPS - 1
    optimal: Tensor  # (S, A, logits) whether each action starts a shortest solution
    legal: Tensor  # (S, V, 25, 10) legal edits; (S, V, 0, 1) without cells (Tower)
    box_mask: Tensor  # (S, V) false for padding boxes


class DistinctBoxes(NamedTuple):
    """The distinct boxes of each statement's scenes, those of the first A scenes first."""

    indices: Int64Array  # (S, U) in the feature table
    present: BoolArray  # (S, U) false for padding
    scenes: Int64Array  # (S, N, 3) scenes as indices 0 .. U - 1
    acting: int  # V: the maximum number of boxes in the first A scenes

    @classmethod
    def of(cls, scenes: Int64Array, acting: int) -> DistinctBoxes:
        """The distinct boxes of (S, N, 3) scenes, given as indices into the feature table; `acting` is A."""
        parts = [_distinct(row, acting) for row in scenes]
        rows = [row for row, _, _ in parts]
        counts = np.array([len(row) for row in rows])
        indices = pad_rows(rows)
        present = np.arange(indices.shape[1]) < counts[:, None]
        return cls(indices, present, np.stack([local for _, local, _ in parts]), max(count for _, _, count in parts))


def _distinct(scenes: Int64Array, acting: int) -> tuple[Int64Array, Int64Array, int]:
    """(U,) distinct boxes, (N, 3) scenes as indices into them, and the number of boxes in the first `acting` scenes."""
    positions: dict[int, int] = {}
    local = [positions.setdefault(box, len(positions)) for box in scenes[:acting].ravel().tolist()]
    count = len(positions)
    local += [positions.setdefault(box, len(positions)) for box in scenes[acting:].ravel().tolist()]
    return np.array(list(positions), np.int64), np.array(local, np.int64).reshape(scenes.shape), count


def make_inputs(
    table: BoxFeatureTable, words: Sequence[Int64Array], boxes: DistinctBoxes, orders: Int64Array, device: torch.device
) -> Inputs:
    """The network's inputs; `words` and `orders` (S,), which index RECOLOURINGS, of each statement."""
    statements, most = boxes.indices.shape
    counts = np.where(boxes.present, table.counts[boxes.indices], 0)
    capacity = max(1, int(counts.max()))
    statement, box, slot = np.nonzero(np.arange(capacity) < counts[..., None])
    item_counts = counts.sum(1)
    items = max(1, int(item_counts.max()))
    position = np.arange(len(statement)) - np.repeat(item_counts.cumsum() - item_counts, item_counts)  # in statement
    source = boxes.indices[statement, box]
    features = np.zeros((statements, items, table.features.shape[-1]), np.uint8)
    features[statement, position] = table.features[source, slot]
    colours = np.zeros((statements, items), np.int64)
    colours[statement, position] = np.array([recolouring.colours for recolouring in RECOLOURINGS])[
        orders[statement], table.colours[source, slot]
    ]
    by_box = np.full((statements, most, capacity), statements * items, np.int64)
    by_box[statement, box, slot] = statement * items + position
    by_item = np.zeros((statements, items), np.int64)
    by_item[statement, position] = (statement * most + box) * capacity + slot
    acting = box < boxes.acting
    arrays = {
        "words": pad_rows(words, MIN_PADDED_WORDS),
        "features": features,
        "colours": colours,
        "by_box": by_box,
        "by_item": by_item,
        "relations": table.relations[boxes.indices, :capacity, :capacity].astype(np.int32),
        "cell_boxes": boxes.indices[:, : boxes.acting],
        "cell_items": (statement * items + position)[acting],
        "item_boxes": (statement * boxes.acting + box)[acting],
        "offsets": table.offsets[source, slot][acting].astype(np.int32),
        "scenes": boxes.scenes,
    }
    return Inputs(**{name: torch.from_numpy(array).to(device) for name, array in arrays.items()})


@dataclass(frozen=True)
class BatchSampler:
    """Samples batches from dataset entries."""

    table: BoxFeatureTable
    heads: ActionHeads
    tokenizer: StatementTokenizer
    device: torch.device
    recipe: ImitationRecipe

    def batch(self, entries: Sequence[DatasetEntry], solved: int, truth_only: int, rng: Rng) -> Batch:
        """`solved` scenes with optimal actions and `truth_only` scenes of any kind from each entry.

        Every entry must have a scene with optimal actions.
        """
        rows = [_sample_scenes(entry, solved, truth_only, rng) for entry in entries]

        def column(name: str, count: int | None = None) -> np.ndarray:
            pairs = zip(entries, rows, strict=True)
            return np.array([[getattr(entry, name)[index] for index in row[:count]] for entry, row in pairs])

        scenes = column("scenes")
        truths = column("truths").astype(np.float32)
        steps = column("steps", solved)
        recolours = self.recipe.recolour
        orders = np.array(
            [rng.integers(len(RECOLOURINGS)) if recolours and entry.exchanges_colours else 0 for entry in entries]
        )
        words = [self._words(entry, order, rng) for entry, order in zip(entries, orders.tolist(), strict=True)]
        boxes = DistinctBoxes.of(scenes, solved)
        self.table.update_features()
        inputs = make_inputs(self.table, words, boxes, orders, self.device)
        acting = boxes.indices[:, : boxes.acting]
        legal = self.table.legal[acting] if self.heads.cells > 1 else np.zeros((*acting.shape, 0, 1), bool)
        arrays = (
            (1 - truths[:, :solved]).astype(np.int64),
            truths,
            (steps - 2).clip(0, MAX_STEPS - 1),
            self._optimal(entries, rows, orders, solved),
            legal,
            boxes.present[:, : boxes.acting],
        )
        return Batch(inputs, *(torch.from_numpy(array).to(self.device) for array in arrays))

    def _words(self, entry: DatasetEntry, order: int, rng: Rng) -> Int64Array:
        indices = self.tokenizer.recoloured(self.tokenizer.encode(entry.statement), order)
        if self.recipe.unknown_words:
            indices = np.where(rng.random(len(indices)) < self.recipe.unknown_words, UNKNOWN, indices)
        return indices

    def _optimal(
        self, entries: Sequence[DatasetEntry], rows: Sequence[Int64Array], orders: Int64Array, solved: int
    ) -> BoolArray:
        optimal = np.zeros((len(entries), solved, self.heads.size), bool)
        for entry, row, order, masks in zip(entries, rows, orders.tolist(), optimal, strict=True):
            recoloured = self.heads.recoloured[order]
            for index, mask in zip(row[:solved].tolist(), masks, strict=True):
                actions = entry.actions[index]
                assert actions is not None
                mask[recoloured[actions]] = True
        return optimal


def _sample_scenes(entry: DatasetEntry, solved: int, truth_only: int, rng: Rng) -> Int64Array:
    """Scene indices: `solved` with actions, then `truth_only`, half of them true and half false where both exist."""
    known = np.array(entry.with_actions)
    with_actions = rng.choice(known, solved, replace=len(known) < solved)
    truths = np.array(entry.truths)
    classes = [np.flatnonzero(truths), np.flatnonzero(~truths)]
    halves = [rng.choice(side, truth_only // 2, replace=len(side) < truth_only // 2) for side in classes if len(side)]
    if len(halves) < len(classes):
        halves.append(rng.choice(len(truths), truth_only // 2))
    return np.concatenate([with_actions, *halves])


class Losses(NamedTuple):
    """Means over the batch."""

    truth: Tensor  # binary cross-entropy of the statement's truth, which determines STOP
    actions: Tensor  # -log P(set | not STOP)
    steps: Tensor  # cross-entropy of the steps to go
    legal: Tensor  # binary cross-entropy of legal edits (Scatter)


def set_log_probabilities(outputs: Outputs, optimal: Tensor) -> Tensor:
    """(S, A) log P(set | not STOP) of the edits in the boolean mask `optimal` (S, A, logits)."""
    add_count = outputs.adds.shape[-1]
    types = outputs.types.log_softmax(-1)
    added = _log_masked_probability(outputs.adds, optimal[..., 1 : 1 + add_count])
    removed = _log_masked_probability(outputs.removes, optimal[..., 1 + add_count :])
    return torch.logaddexp(types[..., 0] + added, types[..., 1] + removed)


def _log_masked_probability(logits: Tensor, mask: Tensor) -> Tensor:
    """The log of the softmax probability inside the mask, clamped to MIN_PROBABILITY."""
    return (logits.softmax(-1) * mask).sum(-1).clamp(min=MIN_PROBABILITY).log()


def losses(outputs: Outputs, batch: Batch) -> Losses:
    """Mean losses of a batch: truth, optimal actions, steps left and, where predicted, legality."""
    truth = F.binary_cross_entropy_with_logits(outputs.truth, batch.truths)
    actions = -set_log_probabilities(outputs, batch.optimal).mean()
    steps = F.cross_entropy(outputs.steps.flatten(0, 1), batch.steps.flatten())
    legal = truth.new_zeros(())
    if outputs.legal is not None:
        each = F.binary_cross_entropy_with_logits(outputs.legal, batch.legal.float(), reduction="none")
        legal = each.mean((-1, -2))[batch.box_mask].mean()
    return Losses(truth, actions, steps, legal)
