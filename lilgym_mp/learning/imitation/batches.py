"""Batches of entries as tensors, each distinct box of a statement once, with colours exchanged at random."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lilgym_mp.arrays import Int64Array
from lilgym_mp.corpus.spelling import normalised_words
from lilgym_mp.corpus.tokens import PAD, UNKNOWN, Vocabulary
from lilgym_mp.learning.imitation.action_heads import COLOUR_ORDERS, ActionHeads
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DatasetEntry
from lilgym_mp.learning.imitation.network import MAX_STEPS, MAX_WORDS, MIN_PADDED_WORDS, Inputs
from lilgym_mp.scene import BOX_COUNT, Colour

KEPT_STATEMENTS = 20_000
LONGEST_TEXT = 1_000  # characters; the rest is cut off
Rng = np.random.Generator


class Batch(NamedTuple):
    """What one step of learning sees; the first A scenes of each of the S statements have optimal actions."""

    inputs: Inputs
    targets: Tensor  # (S, A) the other truth value: what is to be brought about
    truths: Tensor  # (S, N) 0.0 or 1.0
    steps: Tensor  # (S, A) how many actions to success, 2 to MAX_STEPS + 1, less 2
    optimal: Tensor  # (S, A, heads) whether each action starts a shortest solution
    legal: Tensor  # (S, V, 25, 10); (S, V, 0, 1) where there are no cells
    box_mask: Tensor  # (S, V) whether there is such a box


FEW = 100  # statements; where there are more, a word that stands in one alone is taken for a slip
DIGITS = tuple(map(str, range(1, 10)))


def vocabulary_of(statements: Iterable[str]) -> Vocabulary:
    """The words of the statements, normalised, and the digits; not those that may be slips."""
    every = [set(normalised_words(statement, ())) for statement in statements]
    counts = Counter(word for said in every for word in said)
    least = 2 if len(every) > FEW else 1
    return Vocabulary(tuple(sorted({*DIGITS, *(word for word, count in counts.items() if count >= least)})))


class StatementTokenizer:
    """Statements as rows of word numbers, after `normalised_words`: digits for number words, slips repaired."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self._known = frozenset(vocabulary.words)
        names = [colour.name.lower() for colour in Colour]
        self._swaps = np.tile(np.arange(len(vocabulary)), (len(COLOUR_ORDERS), 1))
        if all(vocabulary.number(name) != UNKNOWN for name in names):
            for row, order in zip(self._swaps, COLOUR_ORDERS, strict=True):
                row[[vocabulary.number(name) for name in names]] = [vocabulary.number(names[new]) for new in order]
        self._kept: dict[str, Int64Array] = {}

    def encode(self, statement: str) -> Int64Array:
        """(T,) at least one number, MAX_WORDS at most."""
        found = self._kept.get(statement)
        if found is None:
            said = normalised_words(statement[:LONGEST_TEXT], self._known)[:MAX_WORDS]
            found = np.array([self.vocabulary.number(word) for word in said] or [UNKNOWN], np.int64)
            if len(self._kept) < KEPT_STATEMENTS:
                self._kept[statement] = found
        return found

    def recoloured(self, numbers: Int64Array, order: int) -> Int64Array:
        return self._swaps[order][numbers]


def padded(rows: Sequence[Int64Array], fewest: int = 0) -> Int64Array:
    """(B, T) the rows with PAD after their ends; T is `fewest` at least."""
    found = np.full((len(rows), max(fewest, *map(len, rows))), PAD, np.int64)
    for row, numbers in zip(found, rows, strict=True):
        row[: len(numbers)] = numbers
    return found


class Boxes(NamedTuple):
    """The distinct boxes of each statement's scenes, those of the first A scenes first."""

    indices: Int64Array  # (S, U) in the table
    present: NDArray[np.bool_]  # (S, U) whether there is such a box
    scenes: Int64Array  # (S, N, 3) the scenes by these boxes
    acting: int  # V: how many, at most, the first A scenes have

    @classmethod
    def of(cls, scenes: Int64Array, acting: int) -> Boxes:
        """From (S, N, 3) scenes by their boxes' indices in the table; `acting` is A."""
        found = [_distinct(row, acting) for row in scenes]
        rows = [row for row, _, _ in found]
        counts = np.array([len(row) for row in rows])
        indices = padded(rows)
        present = np.arange(indices.shape[1]) < counts[:, None]
        return cls(indices, present, np.stack([within for _, within, _ in found]), max(count for _, _, count in found))


def _distinct(scenes: Int64Array, acting: int) -> tuple[Int64Array, Int64Array, int]:
    """(U,) the distinct boxes, (N, 3) the scenes by them, and how many the first `acting` scenes have."""
    places: dict[int, int] = {}
    within = [places.setdefault(box, len(places)) for box in scenes[:acting].ravel().tolist()]
    count = len(places)
    within += [places.setdefault(box, len(places)) for box in scenes[acting:].ravel().tolist()]
    return np.array(list(places), np.int64), np.array(within, np.int64).reshape(scenes.shape), count


def box_inputs(table: BoxFeatureTable, boxes: Boxes, orders: Int64Array, device: torch.device) -> dict[str, Tensor]:
    """What the network is told of the boxes and scenes, recoloured by statement."""
    statements, most = boxes.indices.shape
    counts = np.where(boxes.present, table.counts[boxes.indices], 0)
    room = max(1, int(counts.max()))
    statement, box, slot = np.nonzero(np.arange(room) < counts[..., None])
    held = counts.sum(1)
    items = max(1, int(held.max()))
    place = np.arange(len(statement)) - np.repeat(held.cumsum() - held, held)  # of each item in its statement
    source = boxes.indices[statement, box]
    features = np.zeros((statements, items, table.features.shape[-1]), np.uint8)
    features[statement, place] = table.features[source, slot]
    colours = np.zeros((statements, items), np.int64)
    colours[statement, place] = np.array(COLOUR_ORDERS)[orders[statement], table.colours[source, slot]]
    by_box = np.full((statements, most, room), statements * items, np.int64)
    by_box[statement, box, slot] = statement * items + place
    by_item = np.zeros((statements, items), np.int64)
    by_item[statement, place] = (statement * most + box) * room + slot
    acting = box < boxes.acting
    arrays = {
        "features": features,
        "colours": colours,
        "by_box": by_box,
        "by_item": by_item,
        "relations": table.relations[boxes.indices, :room, :room].astype(np.int32),
        "cell_boxes": boxes.indices[:, : boxes.acting],
        "cell_items": (statement * items + place)[acting],
        "cell_places": (statement * boxes.acting + box)[acting],
        "offsets": table.offsets[source, slot][acting].astype(np.int32),
        "scenes": boxes.scenes,
    }
    return {name: torch.from_numpy(array).to(device) for name, array in arrays.items()}


class BatchSampler:
    def __init__(
        self,
        table: BoxFeatureTable,
        heads: ActionHeads,
        tokenizer: StatementTokenizer,
        device: torch.device,
        *,
        recolours: bool = True,
        unknown_words: float = 0.0,
        single_action: bool = False,
    ) -> None:
        """`unknown_words`: the share of words made unknown; `single_action`: mark one optimal action alone."""
        self._table = table
        self._heads = heads
        self._tokenizer = tokenizer
        self._device = device
        self._recolours = recolours
        self._unknown_words = unknown_words
        self._single_action = single_action

    def batch(self, entries: Sequence[DatasetEntry], solved: int, judged: int, rng: Rng) -> Batch:
        """`solved` scenes with actions and `judged` of any kind of each entry, which must have some with actions."""
        rows = [_drawn(entry, solved, judged, rng) for entry in entries]
        scenes = np.array(
            [[entry.scenes[index] for index in row] for entry, row in zip(entries, rows, strict=True)], np.int64
        )
        truths = np.array(
            [[entry.truths[index] for index in row] for entry, row in zip(entries, rows, strict=True)], np.float32
        )
        steps = np.array(
            [[entry.steps[index] for index in row[:solved]] for entry, row in zip(entries, rows, strict=True)]
        )
        orders = np.array(
            [
                rng.integers(len(COLOUR_ORDERS)) if self._recolours and entry.exchanges_colours else 0
                for entry in entries
            ]
        )
        text = padded(
            [self._numbers(entry, order, rng) for entry, order in zip(entries, orders.tolist(), strict=True)],
            MIN_PADDED_WORDS,
        )
        boxes = Boxes.of(scenes, solved)
        self._table.describe()
        device = self._device
        inputs = Inputs(
            words=torch.from_numpy(text).to(device),
            **box_inputs(self._table, boxes, orders, device),
        )
        acting = boxes.indices[:, : boxes.acting]
        legal = self._table.legal[acting] if self._heads.cells > 1 else np.zeros((*acting.shape, 0, 1), np.bool_)
        return Batch(
            inputs,
            torch.from_numpy((1 - truths[:, :solved]).astype(np.int64)).to(device),
            torch.from_numpy(truths).to(device),
            torch.from_numpy((steps - 2).clip(0, MAX_STEPS - 1)).to(device),
            torch.from_numpy(self._optimal(entries, rows, orders, solved)).to(device),
            torch.from_numpy(legal).to(device),
            torch.from_numpy(boxes.present[:, : boxes.acting]).to(device),
        )

    def _numbers(self, entry: DatasetEntry, order: int, rng: Rng) -> Int64Array:
        numbers = self._tokenizer.recoloured(self._tokenizer.encode(entry.statement), order)
        if self._unknown_words:
            numbers = np.where(rng.random(len(numbers)) < self._unknown_words, UNKNOWN, numbers)
        return numbers

    def _optimal(
        self, entries: Sequence[DatasetEntry], rows: Sequence[Int64Array], orders: Int64Array, solved: int
    ) -> NDArray[np.bool_]:
        found = np.zeros((len(entries), solved, self._heads.size), np.bool_)
        for entry, row, order, of_entry in zip(entries, rows, orders.tolist(), found, strict=True):
            recoloured = self._heads.recoloured[order]
            for index, marks in zip(row[:solved].tolist(), of_entry, strict=True):
                actions = entry.actions[index]
                assert actions is not None
                if self._single_action:
                    actions = actions[:1]
                marks[recoloured[actions]] = True
        return found


def _drawn(entry: DatasetEntry, solved: int, judged: int, rng: Rng) -> Int64Array:
    """Indices of scenes: some with actions, then others of which as many are true as false, where there are such."""
    known = np.array(entry.with_actions)
    with_actions = rng.choice(known, solved, replace=len(known) < solved)
    truths = np.array(entry.truths)
    sides = [np.flatnonzero(truths), np.flatnonzero(~truths)]
    halves = [rng.choice(side, judged // 2, replace=len(side) < judged // 2) for side in sides if len(side)]
    if len(halves) < len(sides):
        halves.append(rng.choice(len(truths), judged // 2))
    return np.concatenate([with_actions, *halves])


assert BOX_COUNT == 3
