"""Deduplicated observations: a batch of states by its distinct statements, boxes and image patches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.observation import items_of
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_WIDTH, Scene
from lilgym_mp.scene.arrays import Int16Array, Int64Array, Strings, UInt8Array, UInt64Array
from lilgym_mp.scene.render import draw, image_shape

IMAGE_SHAPE = image_shape("half")  # (50, 190, 3)
SIDE = IMAGE_SHAPE[0]  # side of a box in pixels
PITCH = BOX_PITCH * SIDE // BOX_SIDE  # pixels from a box to the next
assert IMAGE_SHAPE[1] == IMAGE_WIDTH * SIDE // BOX_SIDE
PATCH = 10  # side of a patch in pixels
PATCHES = SIDE // PATCH  # patches along each side of a box
PATCH_BYTES = PATCH * PATCH * 3
_BOX_BYTES = SIDE * SIDE * 3


class States(NamedTuple):
    """N states with S distinct statements, U distinct boxes and Q distinct patches, all of them used."""

    statements: Strings  # S
    patches: UInt8Array  # (Q, 300) pixels in row-major order
    patches_of: Int64Array  # (U, 25) patch indices of each box in row-major order
    box_hashes: UInt64Array  # (U,) content hashes
    statement_of: Int64Array  # (N,) statement index
    boxes_of: Int64Array  # (N, 3) box indices, left to right
    targets: Int64Array  # (N,) 1: make the statement true, 0: false

    def boxes(self) -> UInt8Array:
        """(U, 50, 50, 3) pixels, assembled from the patches."""
        cut = self.patches[self.patches_of].reshape(-1, PATCHES, PATCHES, PATCH, PATCH, 3)
        return cut.transpose(0, 1, 3, 2, 4, 5).reshape(-1, SIDE, SIDE, 3)

    def scenes(self) -> tuple[Int64Array, Int64Array]:
        """(V, 3) box indices of the distinct scenes, and (N,) that of each state."""
        scenes, scene_of = np.unique(self.boxes_of, axis=0, return_inverse=True)
        return scenes, scene_of.reshape(-1)  # NumPy 2.0.0 has (N, 1)


class BoxImageTable:
    """Growing tables of distinct box images and of their distinct patches, indexed in order of first occurrence."""

    def __init__(self) -> None:
        self._boxes: dict[int, int] = {}  # hash -> index
        self._patches: dict[int, int] = {}
        self._box_hashes: list[UInt64Array] = []  # parts of arrays, joined when they are read
        self._patches_of: list[Int64Array] = []
        self._pixels: list[UInt8Array] = []
        self._padded = np.empty((0, 0), np.uint8)
        self._index_of_items: dict[int, int] = {}  # hash of an item array -> box index

    def __len__(self) -> int:
        return len(self._boxes)

    def indices(self, images: UInt8Array) -> Int64Array:
        """(N, 3) box indices of half-size images (N, 50, 190, 3); new boxes are added."""
        count = BOX_COUNT * len(images)
        if len(self._padded) != count:
            self._padded = padded_rows(count, _BOX_BYTES)
        boxes = self._padded[:, :_BOX_BYTES].reshape(count, SIDE, SIDE, 3)  # a view
        for box in range(BOX_COUNT):
            boxes[box::BOX_COUNT] = images[:, :, box * PITCH : box * PITCH + SIDE]
        hashes = row_hashes(self._padded)
        indices, new = assign_indices(hashes, self._boxes)
        if len(new):
            self._box_hashes.append(hashes[new])
            self._patches_of.append(self._patch_indices(boxes[new]))
        return indices.reshape(-1, BOX_COUNT)

    def item_indices(self, items: Int16Array) -> Int64Array:
        """(N, 3) box indices of scenes given as item arrays (N, 3, capacity, 5), drawn where they are new."""
        rows = items.reshape(-1, *items.shape[2:])
        hashes, firsts, inverse = np.unique(content_hashes(rows), return_index=True, return_inverse=True)
        known = self._index_of_items
        listed = hashes.tolist()
        for item_hash, row in zip(listed, firsts.tolist(), strict=True):
            if item_hash not in known:
                image = draw(Scene.of(items_of(rows[row]), (), ()), "half")
                known[item_hash] = int(self.indices(image[None])[0, 0])
        return np.array([known[item_hash] for item_hash in listed], np.int64)[inverse].reshape(-1, BOX_COUNT)

    def _patch_indices(self, boxes: UInt8Array) -> Int64Array:
        """(U, 25) patch indices of box images (U, 50, 50, 3); new patches are added."""
        padded = padded_rows(len(boxes) * PATCHES**2, PATCH_BYTES)
        patches = padded[:, :PATCH_BYTES]  # a view
        cut = boxes.reshape(-1, PATCHES, PATCH, PATCHES, PATCH * 3).swapaxes(2, 3)
        patches.reshape(cut.shape)[:] = cut
        hashes, firsts, inverse = np.unique(row_hashes(padded), return_index=True, return_inverse=True)
        indices, new = assign_indices(hashes, self._patches)
        self._pixels.append(patches[firsts[new]])
        return indices[inverse].reshape(-1, PATCHES**2)

    def states(
        self, statements: Strings, statement_of: Int64Array, boxes_of: Int64Array, targets: Int64Array
    ) -> States:
        """`statement_of` (N,) indexes `statements`, some of which may be unused."""
        statements_used, statement_of = distinct(statement_of, len(statements))
        boxes_used, boxes_of = distinct(boxes_of, len(self))
        patches_used, patches_of = distinct(_joined(self._patches_of)[boxes_used], len(self._patches))
        return States(
            tuple(statements[index] for index in statements_used.tolist()),
            _joined(self._pixels)[patches_used],
            patches_of,
            _joined(self._box_hashes)[boxes_used],
            statement_of,
            boxes_of,
            targets,
        )

    def states_of(self, statements: Sequence[str], boxes_of: Int64Array, targets: Int64Array) -> States:
        """N states, one of each of the statements (N,)."""
        indices: dict[str, int] = {}
        statement_of = [indices.setdefault(statement, len(indices)) for statement in statements]
        return self.states(tuple(indices), np.array(statement_of, np.int64), boxes_of, targets.astype(np.int64))


def distinct(indices: Int64Array, count: int) -> tuple[Int64Array, Int64Array]:
    """The sorted indices below `count` that occur, and `indices` (any shape) renumbered to refer to them."""
    occurs = np.zeros(count, bool)
    occurs[indices] = True
    return np.flatnonzero(occurs), (occurs.cumsum() - 1)[indices]


def _joined(parts: list[Any]) -> Any:
    """The array of these parts, which then are one."""
    if len(parts) > 1:
        parts[:] = [np.concatenate(parts)]
    return parts[0]


def padded_rows(count: int, size: int) -> UInt8Array:
    """(count, W) zeros: rows of `size` bytes, padded to whole 8-byte words."""
    return np.zeros((count, -(-size // 8) * 8), np.uint8)


_MULTIPLIERS = np.random.default_rng(0).integers(0, 2**63, -(-_BOX_BYTES // 8), dtype=np.uint64) * np.uint64(2)
_MULTIPLIERS += np.uint64(1)


def row_hashes(padded: UInt8Array | UInt64Array) -> UInt64Array:
    """A 64-bit multilinear hash of each row, whole 8-byte words; two rows collide with probability at most 2^-63."""
    words = padded.view(np.uint64)
    return words @ _MULTIPLIERS[: words.shape[1]]


def content_hashes(rows: NDArray[Any]) -> UInt64Array:
    """(N,) `row_hashes` of the bytes of rows (N, ...)."""
    padded = padded_rows(len(rows), rows[0].nbytes)
    padded[:, : rows[0].nbytes] = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
    return row_hashes(padded)


def assign_indices(hashes: UInt64Array, known: dict[int, int]) -> tuple[Int64Array, Int64Array]:
    """The index of each hash, added to `known` if new, and the positions where new ones first occur."""
    listed = hashes.tolist()
    indices = list(map(known.get, listed))
    new: list[int] = []
    for position in [position for position, index in enumerate(indices) if index is None]:
        if listed[position] not in known:
            known[listed[position]] = len(known)
            new.append(position)
        indices[position] = known[listed[position]]
    return np.array(indices, np.int64), np.array(new, np.int64)
