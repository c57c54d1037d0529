"""What policies see of many states, without repetition: distinct statements, and distinct boxes of the images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lilgym_mp.arrays import Int64Array, UInt8Array, UInt64Array
from lilgym_mp.render import image_shape
from lilgym_mp.render.drawing import SEPARATOR_RGB
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_WIDTH

IMAGE_SHAPE = image_shape("half")  # (50, 190, 3)
SIDE = IMAGE_SHAPE[0]  # pixels of a box
PITCH = BOX_PITCH * SIDE // BOX_SIDE  # pixels from a box to the next
assert IMAGE_SHAPE[1] == IMAGE_WIDTH * SIDE // BOX_SIDE
_BYTES = SIDE * SIDE * 3
_WORDS = -(-_BYTES // 8)  # of 8 bytes
_MULTIPLIERS = np.random.default_rng(0).integers(0, 2**63, _WORDS, dtype=np.uint64) * np.uint64(2) + np.uint64(1)


class States(NamedTuple):
    """N states of S statements with U boxes; each statement and box is used by some state."""

    statements: tuple[str, ...]  # S
    boxes: UInt8Array  # (U, 50, 50, 3)
    box_codes: UInt64Array  # (U,) the same for the same box in every table
    statement_of: Int64Array  # (N,)
    boxes_of: Int64Array  # (N, 3) left to right
    targets: Int64Array  # (N,) 1: make the statement true, 0: false

    def images(self) -> UInt8Array:
        """(N, 50, 190, 3) the half-size images, put together from their boxes."""
        images = np.full((len(self.targets), *IMAGE_SHAPE), SEPARATOR_RGB, np.uint8)
        for place in range(BOX_COUNT):
            images[:, :, place * PITCH : place * PITCH + SIDE] = self.boxes[self.boxes_of[:, place]]
        return images


class BoxTable:
    """Distinct boxes of images, numbered in the order in which they are met."""

    def __init__(self) -> None:
        self._known: dict[int, int] = {}
        self._boxes = np.empty((64, SIDE, SIDE, 3), np.uint8)
        self._codes = np.empty(64, np.uint64)
        self._padded = np.empty((0, 8 * _WORDS), np.uint8)

    def __len__(self) -> int:
        return len(self._known)

    @property
    def boxes(self) -> UInt8Array:
        """(U, 50, 50, 3)."""
        return self._boxes[: len(self._known)]

    def indices(self, images: UInt8Array) -> Int64Array:
        """(N, 3) the boxes of N half-size images (N, 50, 190, 3), entered where they are new."""
        boxes, codes = self._cut(images)
        found = np.empty(len(boxes), np.int64)
        for index, code in enumerate(codes.tolist()):
            place = self._known.get(code)
            if place is None:
                place = self._known[code] = len(self._known)
                if place == len(self._boxes):
                    self._boxes = np.concatenate([self._boxes, np.empty_like(self._boxes)])
                    self._codes = np.concatenate([self._codes, np.empty_like(self._codes)])
                self._boxes[place], self._codes[place] = boxes[index], code
            found[index] = place
        return found.reshape(-1, BOX_COUNT)

    def _cut(self, images: UInt8Array) -> tuple[UInt8Array, UInt64Array]:
        """The images' boxes (3 N, 50, 50, 3), overwritten by the next call, and their codes (3 N,).

        A code is a sum of products modulo 2^64: equal for two different boxes once in 2^63 or less.
        """
        count = BOX_COUNT * len(images)
        if len(self._padded) != count:
            self._padded = np.zeros((count, 8 * _WORDS), np.uint8)
        boxes = self._padded[:, :_BYTES].reshape(count, SIDE, SIDE, 3)  # a view
        for place in range(BOX_COUNT):
            boxes[place::BOX_COUNT] = images[:, :, place * PITCH : place * PITCH + SIDE]
        return boxes, self._padded.view(np.uint64) @ _MULTIPLIERS

    def states(
        self, statements: tuple[str, ...], statement_of: Int64Array, boxes_of: Int64Array, targets: Int64Array
    ) -> States:
        """`statement_of` (N,) are places in `statements`, of which any number may not be used."""
        kept, statement_of = np.unique(statement_of, return_inverse=True)
        used, places = np.unique(boxes_of, return_inverse=True)
        return States(
            tuple(statements[place] for place in kept.tolist()),
            self._boxes[used],
            self._codes[used],
            statement_of,
            places.reshape(-1, BOX_COUNT),
            targets,
        )
