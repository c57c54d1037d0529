"""Statements and scenes as inputs of the network: distinct boxes with binary features, and exchanges of these features.

An exchange permutes colours, shapes or sides in words and scenes alike: in scenes it is a permutation of feature
columns. Truth does not depend on it, as far as the words name what is exchanged. So every statement is read as one that
names them in a standard order; else learning which word goes with which colour is a long plateau.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import accumulate, permutations, product
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.corpus.tokens import UNKNOWN, Vocabulary
from lilgym_mp.learning.common.attention import MIN_PADDED_WORDS
from lilgym_mp.learning.common.boxes import GAP_BINS, ITEM_SIDES, FeatureTable, gap_features
from lilgym_mp.learning.common.words import StatementTokenizer, exchange_table, pad_rows
from lilgym_mp.learning.reward_model.network import BoxFeatures
from lilgym_mp.scene import Box, Colour, Shape, Size
from lilgym_mp.scene.appearances import part_of
from lilgym_mp.scene.appearances.tower.geometry import CAPACITY
from lilgym_mp.scene.arrays import AnyDict, Int64Array, Rng, UInt8Array, one_hot

COLOURS = len(Colour)
SHAPES = len(Shape)
SIZES = len(Size)
CENTRE_BOUNDS = np.array([41, 81, 120, 160])  # bin edges of twice an item's centre, symmetric: 40 mirrors 160
CENTRE_BINS = len(CENTRE_BOUNDS) + 1
MOST_COUNTED = 8  # items; more count as that many
SHAPE_SYNONYM = re.compile(r"block|rect|cube|ball|dot|dis[ck]|round")  # begins words with which shapes are kept
MOST_BOXES = 100_000
Columns = tuple[Tensor, Tensor, Tensor]  # words (S, T), item columns (S, F), box columns (S, G)


class Exchange(NamedTuple):
    """A permutation of colours and of shapes, and whether left and right are swapped."""

    colours: tuple[int, ...] = tuple(range(COLOURS))  # colours[c] replaces colour c
    shapes: tuple[int, ...] = tuple(range(SHAPES))
    mirrored: bool = False

    def words(self) -> dict[str, str]:
        """The words it replaces."""
        colours, shapes = (
            {kind(old).name.lower(): kind(new).name.lower() for old, new in enumerate(after)}
            for kind, after in ((Colour, self.colours), (Shape, self.shapes))
        )
        plurals = {f"{old}s": f"{new}s" for old, new in shapes.items()}
        sides = {"left": "right", "right": "left"} if self.mirrored else {}
        return {**colours, **shapes, **plurals, **sides}

    def columns(self, appearance: str) -> tuple[Int64Array, Int64Array]:
        """For items and for boxes: feature i of the scene is feature `columns[i]` of the exchanged one."""
        colour = np.array(self.colours)
        neighbour = np.append(colour, COLOURS)  # no colour without a neighbour
        gaps = np.arange(4 * GAP_BINS).reshape(2, 2, GAP_BINS)
        centre = np.arange(2 * CENTRE_BINS).reshape(2, CENTRE_BINS)
        if self.mirrored:
            gaps[0], centre[0] = gaps[0, ::-1].copy(), centre[0, ::-1].copy()
        moved = {
            **dict.fromkeys(("colour", "top", "bottom"), colour),
            **dict.fromkeys(("below", "above"), neighbour),
            "shape": np.array(self.shapes),
            "gaps": gaps.ravel(),
            "centre": centre.ravel(),
            "counts": (colour[:, None] * CAPACITY + np.arange(CAPACITY)).ravel(),
            "pairs": (colour[:, None] * COLOURS + colour).ravel(),
        }
        features = features_of(appearance)
        return _columns(features.item, moved), _columns(features.box, moved)


def _columns(parts: Mapping[str, int], moved: Mapping[str, Int64Array]) -> Int64Array:
    firsts = accumulate(parts.values(), initial=0)
    return np.concatenate(
        [first + moved.get(name, np.arange(parts[name])) for name, first in zip(parts, firsts, strict=False)]
    )


@cache
def exchanges(appearance: str) -> tuple[Exchange, ...]:
    """All exchanges, the identity first."""
    colours = permutations(range(COLOURS))
    if not features_of(appearance).varied:
        return tuple(map(Exchange, colours))
    return tuple(Exchange(*one) for one in product(colours, permutations(range(SHAPES)), (False, True)))


def standard_exchanges(words: Sequence[str], appearance: str) -> list[int]:
    """The indices of the `exchanges` after which the words name colours, shapes and sides in the same order as all
    statements: they differ in what the words do not name."""
    named = {"colours": _first_named(words, Colour)}
    sides: list[bool] = []
    if features_of(appearance).varied:
        keeps_shapes = any(map(SHAPE_SYNONYM.match, words))
        named["shapes"] = tuple(range(SHAPES)) if keeps_shapes else _first_named(words, Shape)
        sides = [word == "right" for word in words if word in ("left", "right")]
    return [
        index
        for index, one in enumerate(exchanges(appearance))
        if all(getattr(one, kind)[old] == new for kind, olds in named.items() for new, old in enumerate(olds))
        and (not sides or one.mirrored == sides[0])
    ]


def _first_named(words: Sequence[str], kind: type[Colour] | type[Shape]) -> tuple[int, ...]:
    """The colours or shapes that the words name, in the order of their first mention."""
    by_name = {member.name.lower() + plural: int(member) for member in kind for plural in ("", "s")}
    return tuple(dict.fromkeys(by_name[word] for word in words if word in by_name))


class BoxTable(FeatureTable):
    """A growing table of N distinct boxes, with capacity for I items each."""

    _items: Int64Array  # (N, I) indices in `item_features`
    _box: UInt8Array  # (N, G)

    def __init__(self, appearance: str) -> None:
        super().__init__(CAPACITY, appearance)
        self.appearance = appearance
        parts = features_of(appearance)
        self.item_width = sum(parts.item.values())
        self.box_width = sum(parts.box.values())
        self._compute = parts.compute
        self._kinds = {bytes(self.item_width): 0}  # distinct items by their features; 0: no item
        self.item_features = np.zeros((1, self.item_width), np.uint8)  # (K, F)

    def features(self, indices: Int64Array) -> tuple[Int64Array, UInt8Array]:
        """Boxes (...) as items (..., I), indices in `item_features` of which 0 is none, and features (..., G)."""
        self.update_features()
        items = self._items[indices]
        return items[..., : max(1, int((items > 0).sum(-1).max(initial=0)))], self._box[indices]

    def columns(self, boxes: Sequence[Box], items: Int64Array) -> AnyDict:
        item_features, box_features = self._compute(items)
        rows = item_features.reshape(-1, self.item_width)
        kinds = [self._kinds.setdefault(row.tobytes(), len(self._kinds)) for row in rows]
        if len(self._kinds) > len(self.item_features):
            self.item_features = np.frombuffer(b"".join(self._kinds), np.uint8).reshape(-1, self.item_width)
        return {"_items": np.reshape(kinds, (len(boxes), -1)), "_box": box_features}


def scatter_item_features(items: Int64Array) -> UInt8Array:
    """(..., F) from (..., 5) items; rows of -1 give zeros."""
    x, y, shape, colour, size = np.moveaxis(items, -1, 0)
    centres = (np.digitize(2 * start + ITEM_SIDES[size], CENTRE_BOUNDS) for start in (x, y))
    parts = [
        one_hot(colour, COLOURS),
        one_hot(shape, SHAPES),
        one_hot(size, SIZES),
        gap_features(items),
        *(one_hot(centre, CENTRE_BINS) for centre in centres),
    ]
    return np.concatenate(parts, axis=-1) * (shape >= 0)[..., None].astype(np.uint8)


def look_counts(items: Int64Array) -> Int64Array:
    """(N, 9) how many of the (N, I, 5) items have each colour, shape and size."""
    kinds = ((3, COLOURS), (2, SHAPES), (4, SIZES))
    return np.concatenate([one_hot(items[..., field], count).sum(1, dtype=np.int64) for field, count in kinds], axis=-1)


def scatter_box_features(looks: Int64Array) -> UInt8Array:
    """(..., G) of boxes with these `look_counts` (..., 9)."""
    count = looks[..., :COLOURS].sum(-1).clip(0, MOST_COUNTED)
    distinct = (looks.reshape(*looks.shape[:-1], 3, 3) > 0).sum(-1)
    return np.concatenate(
        [one_hot(count, MOST_COUNTED + 1), *(one_hot(distinct[..., kind], 4) for kind in range(3))], axis=-1
    )


def _scatter_features(items: Int64Array) -> tuple[UInt8Array, UInt8Array]:
    return scatter_item_features(items), scatter_box_features(look_counts(items))


def _tower_features(items: Int64Array) -> tuple[UInt8Array, UInt8Array]:
    colour = items[..., :CAPACITY, 3]  # (N, 4), -1 where there is no block
    height = (colour >= 0).sum(1)
    level = np.where(colour >= 0, np.arange(CAPACITY), -1)
    none = np.full((len(colour), 1), -1)
    below = np.hstack([none, colour[:, :-1]])
    above = np.hstack([colour[:, 1:], none])
    neighbours = (np.where(colour >= 0, np.where(other >= 0, other, COLOURS), -1) for other in (below, above))
    item_parts = [
        one_hot(colour, COLOURS),
        one_hot(level, CAPACITY),
        one_hot(np.where(colour >= 0, height[:, None] - 1 - level, -1), CAPACITY),
        one_hot(np.where(colour >= 0, height[:, None] - 1, -1), CAPACITY),
        *(one_hot(other, COLOURS + 1) for other in neighbours),
    ]
    counts = one_hot(colour, COLOURS).sum(1)  # (N, 3)
    top = np.take_along_axis(colour, (height - 1).clip(0)[:, None], axis=1)[:, 0]
    pairs = np.where((colour >= 0) & (above >= 0), colour * COLOURS + above, -1)
    box_parts = [
        one_hot(height, CAPACITY + 1),
        (counts[..., None] > np.arange(CAPACITY)).reshape(len(colour), -1).astype(np.uint8),
        one_hot(top, COLOURS),
        one_hot(colour[:, 0], COLOURS),
        one_hot(pairs, COLOURS**2).max(1),
        one_hot((counts > 0).sum(1), COLOURS + 1),
    ]
    return np.concatenate(item_parts, axis=-1), np.concatenate(box_parts, axis=-1)


class Features(NamedTuple):
    """The features of one appearance: names and widths of their columns, in order."""

    item: Mapping[str, int]
    box: Mapping[str, int]
    compute: Callable[[Int64Array], tuple[UInt8Array, UInt8Array]]  # of items (N, I, 5): (N, I, F) and (N, G)
    varied: bool  # whether shapes and places vary, so that shapes and sides can be exchanged


FEATURES = {
    "tower": Features(
        {"colour": COLOURS, "level": CAPACITY, "from top": CAPACITY, "height": CAPACITY, "below": 4, "above": 4},
        {"height": 5, "counts": COLOURS * CAPACITY, "top": 3, "bottom": 3, "pairs": 9, "colours": 4},
        _tower_features,
        varied=False,
    ),
    "scatter": Features(
        {"colour": COLOURS, "shape": SHAPES, "size": SIZES, "gaps": 4 * GAP_BINS, "centre": 2 * CENTRE_BINS},
        {"count": MOST_COUNTED + 1, "colours": 4, "shapes": 4, "sizes": 4},
        _scatter_features,
        varied=True,
    ),
}


def features_of(appearance: str) -> Features:
    """Raises UnsupportedAppearance for one without."""
    return part_of(appearance, "features for a reward model", FEATURES)


class InputReader:
    """Encodes statements with a vocabulary, and boxes of one appearance."""

    def __init__(self, vocabulary: Vocabulary, table: BoxTable, device: torch.device) -> None:
        self.table = table
        self.device = device
        self.vocabulary = vocabulary
        self._tokenizer = StatementTokenizer(vocabulary)
        self._kinds: dict[str, list[int]] = {}
        kinds = exchanges(table.appearance)
        self._words = exchange_table(vocabulary, [kind.words() for kind in kinds])
        columns = [kind.columns(table.appearance) for kind in kinds]
        self._item_columns = np.stack([items for items, _ in columns])
        self._box_columns = np.stack([boxes for _, boxes in columns])

    def renewed_table(self) -> BoxTable:
        """Its table, or a new one if there are many boxes in it; for scenes that are not kept."""
        if len(self.table) > MOST_BOXES:
            self.table = BoxTable(self.table.appearance)
        return self.table

    def kinds(self, statement: str) -> list[int]:
        """The `standard_exchanges` of the statement."""
        found = self._kinds.get(statement)
        if found is None:
            words = self.vocabulary.decode(self._tokenizer.encode(statement).tolist())
            found = self._kinds[statement] = standard_exchanges(words, self.table.appearance)
        return found

    def statements(
        self, statements: Sequence[str], kinds: Sequence[int], unknown_words: float = 0.0, rng: Rng | None = None
    ) -> Columns:
        """The statements, each under the exchange of index `kinds[i]`; a fraction of the words becomes unknown."""
        rows = [
            self._words[kind][self._tokenizer.encode(statement)]
            for statement, kind in zip(statements, kinds, strict=True)
        ]
        if rng is not None and unknown_words:
            rows = [np.where(rng.random(len(row)) < unknown_words, UNKNOWN, row) for row in rows]
        arrays = pad_rows(rows, MIN_PADDED_WORDS), self._item_columns[list(kinds)], self._box_columns[list(kinds)]
        words, items, boxes = (torch.from_numpy(array).to(self.device) for array in arrays)
        return words, items, boxes

    def boxes(self, indices: Int64Array) -> BoxFeatures:
        """Features of the boxes (S, U)."""
        items, looks = self.table.features(indices)
        features = self.table.item_features
        rows = np.arange(len(items))[:, None, None]
        occurs = np.zeros((len(items), len(features)), bool)
        occurs[rows, items] = occurs[:, :1] = True
        members = (occurs.cumsum(1) - 1)[rows, items]
        features = features[pad_rows([row.nonzero()[0] for row in occurs])]
        arrays = features.astype(np.float32), members, looks.astype(np.float32)
        return BoxFeatures(*(torch.from_numpy(array).to(self.device) for array in arrays))

    def scenes(self, scenes: Int64Array) -> tuple[BoxFeatures, Tensor]:
        """The features of the distinct boxes of (S, N, 3) scenes, and the scenes as indices into them."""
        if self.table.distances is not None:  # few boxes: all of them
            indices = np.arange(len(self.table))[None]
            local = scenes
        else:
            distinct = [np.unique(row, return_inverse=True) for row in scenes]
            indices = pad_rows([boxes for boxes, _ in distinct])
            local = np.stack([inverse.reshape(scenes.shape[1:]) for _, inverse in distinct])
        return self.boxes(indices), torch.from_numpy(np.ascontiguousarray(local)).to(self.device)
