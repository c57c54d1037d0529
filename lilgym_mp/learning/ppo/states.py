"""What policies see of many states, without repetition: distinct statements, boxes, and patches of the boxes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.arrays import Int64Array, UInt8Array, UInt64Array
from lilgym_mp.render import image_shape
from lilgym_mp.render.drawing import SEPARATOR_RGB
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_WIDTH

IMAGE_SHAPE = image_shape("half")  # (50, 190, 3)
SIDE = IMAGE_SHAPE[0]  # pixels of a box
PITCH = BOX_PITCH * SIDE // BOX_SIDE  # pixels from a box to the next
assert IMAGE_SHAPE[1] == IMAGE_WIDTH * SIDE // BOX_SIDE
PATCH = 10  # pixels a side
PATCHES = SIDE // PATCH  # along each side of a box
PATCH_BYTES = PATCH * PATCH * 3
_BOX_BYTES = SIDE * SIDE * 3


class States(NamedTuple):
    """N states of S statements with U boxes of Q patches; each statement, box and patch is used by some state."""

    statements: tuple[str, ...]  # S
    patches: UInt8Array  # (Q, 300) pixels, row by row
    patches_of: Int64Array  # (U, 25) of each box, row by row
    box_codes: UInt64Array  # (U,) the same for the same box in every table
    statement_of: Int64Array  # (N,)
    boxes_of: Int64Array  # (N, 3) left to right
    targets: Int64Array  # (N,) 1: make the statement true, 0: false

    def boxes(self) -> UInt8Array:
        """(U, 50, 50, 3) pixels, put together from the patches."""
        cut = self.patches[self.patches_of].reshape(-1, PATCHES, PATCHES, PATCH, PATCH, 3)
        return cut.transpose(0, 1, 3, 2, 4, 5).reshape(-1, SIDE, SIDE, 3)

    def images(self) -> UInt8Array:
        """(N, 50, 190, 3) the half-size images, put together from their boxes."""
        images = np.full((len(self.targets), *IMAGE_SHAPE), SEPARATOR_RGB, np.uint8)
        boxes = self.boxes()
        for place in range(BOX_COUNT):
            images[:, :, place * PITCH : place * PITCH + SIDE] = boxes[self.boxes_of[:, place]]
        return images


class BoxImageTable:
    """Distinct boxes of images and the distinct patches they are made of, numbered in the order they are met."""

    def __init__(self) -> None:
        self._boxes: dict[int, int] = {}  # indices by code
        self._patches: dict[int, int] = {}
        self._box_codes = _GrowingArray(np.uint64)
        self._patches_of = _GrowingArray(np.int64, PATCHES**2)
        self._pixels = _GrowingArray(np.uint8, PATCH_BYTES)
        self._padded = np.empty((0, 0), np.uint8)

    def __len__(self) -> int:
        return len(self._boxes)

    def indices(self, images: UInt8Array) -> Int64Array:
        """(N, 3) the boxes of N half-size images (N, 50, 190, 3), entered where they are new."""
        count = BOX_COUNT * len(images)
        if len(self._padded) != count:
            self._padded = _padded(count, _BOX_BYTES)
        boxes = self._padded[:, :_BOX_BYTES].reshape(count, SIDE, SIDE, 3)  # a view
        for place in range(BOX_COUNT):
            boxes[place::BOX_COUNT] = images[:, :, place * PITCH : place * PITCH + SIDE]
        codes = _codes(self._padded)
        indices, new = _numbered(codes, self._boxes)
        if len(new):
            self._box_codes.extend(codes[new])
            self._patches_of.extend(self._patch_indices(boxes[new]))
        return indices.reshape(-1, BOX_COUNT)

    def _patch_indices(self, boxes: UInt8Array) -> Int64Array:
        """(U, 25) the patches of some boxes (U, 50, 50, 3), entered where they are new."""
        padded = _padded(len(boxes) * PATCHES**2, PATCH_BYTES)
        patches = padded[:, :PATCH_BYTES]  # a view
        cut = boxes.reshape(-1, PATCHES, PATCH, PATCHES, PATCH * 3).swapaxes(2, 3)
        patches.reshape(cut.shape)[:] = cut
        codes, firsts, places = np.unique(_codes(padded), return_index=True, return_inverse=True)
        indices, new = _numbered(codes, self._patches)
        self._pixels.extend(patches[firsts[new]])
        return indices[places].reshape(-1, PATCHES**2)

    def states(
        self, statements: tuple[str, ...], statement_of: Int64Array, boxes_of: Int64Array, targets: Int64Array
    ) -> States:
        """`statement_of` (N,) are places in `statements`, of which any number may not be used."""
        statements_used, statement_of = distinct(statement_of, len(statements))
        boxes_used, boxes_of = distinct(boxes_of, len(self))
        patches_used, patches_of = distinct(self._patches_of.rows[boxes_used], len(self._patches))
        return States(
            tuple(statements[place] for place in statements_used.tolist()),
            self._pixels.rows[patches_used],
            patches_of,
            self._box_codes.rows[boxes_used],
            statement_of,
            boxes_of,
            targets,
        )


def distinct(indices: Int64Array, count: int) -> tuple[Int64Array, Int64Array]:
    """Those of `count` indices that occur, in order, and the places of `indices` (any shape) among them."""
    occurs = np.zeros(count, np.bool_)
    occurs[indices] = True
    return np.flatnonzero(occurs), (occurs.cumsum() - 1)[indices]


class _GrowingArray:
    """Rows of one type and width, to which more are added."""

    def __init__(self, dtype: Any, *width: int) -> None:
        self._room = np.empty((64, *width), dtype)
        self._count = 0

    @property
    def rows(self) -> Any:
        return self._room[: self._count]

    def extend(self, rows: Any) -> None:
        last = self._count + len(rows)
        if last > len(self._room):
            larger = np.empty((max(last, 2 * len(self._room)), *rows.shape[1:]), rows.dtype)
            larger[: self._count] = self.rows
            self._room = larger
        self._room[self._count : last] = rows
        self._count = last


def _padded(count: int, size: int) -> UInt8Array:
    """(count, W) zeros: rows of `size` bytes and as many more as make whole words of 8 bytes."""
    return np.zeros((count, -(-size // 8) * 8), np.uint8)


_MULTIPLIERS = np.random.default_rng(0).integers(0, 2**63, -(-_BOX_BYTES // 8), dtype=np.uint64) * np.uint64(2)
_MULTIPLIERS += np.uint64(1)


def _codes(padded: UInt8Array) -> UInt64Array:
    """A code of each row: a sum of products modulo 2^64, equal for two different rows once in 2^63 or less."""
    words = padded.view(np.uint64)
    return words @ _MULTIPLIERS[: words.shape[1]]


def _numbered(codes: UInt64Array, known: dict[int, int]) -> tuple[Int64Array, Int64Array]:
    """The indices of the codes, entered in `known` where they are new; and the places where new ones first occur."""
    listed = codes.tolist()
    indices = list(map(known.get, listed))
    new: list[int] = []
    for place in [place for place, index in enumerate(indices) if index is None]:
        if listed[place] not in known:
            known[listed[place]] = len(known)
            new.append(place)
        indices[place] = known[listed[place]]
    return np.array(indices, np.int64), np.array(new, np.int64)
