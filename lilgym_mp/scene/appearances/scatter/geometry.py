"""Overlap, distance, snapping and cell coverage of items, as lookup tables.

The relation of two items depends only on their footprints (shape and size) and integer offset. So the exact geometry
is computed once, by `scripts/build_placement_tables.py` with shapely, and shipped as
`lilgym_mp.data/placement.npz`. Only ties between several pairs of nearest points are resolved at run time. Source:
docs/spec.md, "Legality and effects"; the circle is shapely's 64-sided polygon.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import TypeVar

import numpy as np

from lilgym_mp.scene import BOX_PITCH, FOOTPRINT_COUNT, FOOTPRINT_SIDES, FOOTPRINTS, Item, SceneError
from lilgym_mp.scene.appearances.base import PlacementRules, fits_box
from lilgym_mp.scene.arrays import BoolArray, Int64Array, UInt8Array

Value = TypeVar("Value")
Point = tuple[float, float]
Ring = Sequence[Point]  # closed: the last point repeats the first

SNAP_REACH = 4  # pixels: the largest truncated distance over which a new item snaps
LARGEST_SIDE = max(FOOTPRINT_SIDES)
OFFSET_LIMIT = LARGEST_SIDE + SNAP_REACH  # no two items further apart than this, in x or y, affect each other
OFFSET_COUNT = 2 * OFFSET_LIMIT + 1
NO_OFFSET = OFFSET_LIMIT * OFFSET_COUNT + OFFSET_LIMIT  # index of equal top-left corners in a pair's table
LARGEST_MOVE = 8  # snap moves are smaller than this, in x and y
TIED = 0  # sentinel instead of the code of a move
CACHED_MOVES = 16_384  # moves resolved at run time; on a grid they recur
AREA_UNIT = 10**9  # covered areas are whole numbers of 1e-9 square pixels, so that equal areas are equal

OVERLAPPING = 0  # clearance code; code 1 + d is truncated distance d
FIRST_TOO_FAR = SNAP_REACH + 2  # clearance code of everything beyond the snapping distance


@dataclass(frozen=True, slots=True)
class PlacementTables:
    """The shipped tables, by new footprint, other footprint, and new minus other top-left plus OFFSET_LIMIT."""

    clearance: UInt8Array  # (9, 9, 69, 69) clearance codes
    moves: UInt8Array  # (9, 9, 69, 69) snap move, (x + 8) * 16 + y + 8; TIED where several pairs of points are nearest
    clearance_bytes: Sequence[Sequence[bytes]]  # (9, 9, 69 * 69) `clearance`, for fast scalar access
    # keyed by flat index in `clearance`: the nearest segments, where they matter
    ties: Mapping[int, Sequence[tuple[int, int]]]
    outlines: Sequence[Ring]  # by footprint: relative to the bounding square's centre
    pixel_areas: Int64Array  # (9, 30, 30) by footprint, x, y: area of the shape in that pixel, in AREA_UNITs

    def closest(self, footprint: int, x: int, y: int, items: Iterable[Item]) -> tuple[int, Item | None]:
        """Clearance of a new `footprint` at (x, y) to the closest of `items`, and that item (the first if several).

        OVERLAPPING, or 1 + truncated distance; FIRST_TOO_FAR and None when none is near.
        """
        by_footprint = self.clearance_bytes[footprint]
        smallest = FIRST_TOO_FAR
        closest = None
        for item in items:
            dx = x - item[0]
            dy = y - item[1]
            if -OFFSET_LIMIT <= dx <= OFFSET_LIMIT and -OFFSET_LIMIT <= dy <= OFFSET_LIMIT:
                code = by_footprint[FOOTPRINTS[item[2]][item[4]]][dx * OFFSET_COUNT + dy + NO_OFFSET]
                if code < smallest:
                    smallest = code
                    closest = item
        return smallest, closest

    def move(self, footprint: int, x: int, y: int, other: Item, frame_x: int) -> tuple[int, int]:
        """The snap move of a new item towards `other`, which must be within SNAP_REACH.

        `frame_x`: x of the box's left border in the coordinates that are rounded.
        """
        other_footprint = other.footprint
        other_x = other[0] + frame_x
        other_y = other[1]
        at = footprint, other_footprint, x - other[0] + OFFSET_LIMIT, y - other_y + OFFSET_LIMIT
        code = int(self.moves[at])
        if code == TIED or other_x < 0 or other_y < 0:
            index = int(np.ravel_multi_index(at, self.moves.shape))
            return _resolved_move(index, footprint, x + frame_x, y, other_footprint, other_x, other_y)
        return (code >> 4) - LARGEST_MOVE, (code & 15) - LARGEST_MOVE

    def points(self, footprint: int, x: int, y: int, segments: Iterable[int]) -> Mapping[int, Point]:
        """End points of outline segments of an item of `footprint` at (x, y), by index."""
        centre_x = x + FOOTPRINT_SIDES[footprint] / 2
        centre_y = y + FOOTPRINT_SIDES[footprint] / 2
        outline = self.outlines[footprint]
        return {
            i: (centre_x + outline[i][0], centre_y + outline[i][1])
            for segment in segments
            for i in (segment, segment + 1)
        }


@lru_cache(maxsize=CACHED_MOVES)
def _resolved_move(
    index: int, footprint: int, x: int, y: int, other_footprint: int, other_x: int, other_y: int
) -> tuple[int, int]:
    """`PlacementTables.move`, computed from the nearest points of the two outlines.

    `index`: the key of the pair in `PlacementTables.ties`.
    """
    from lilgym_mp.scene.appearances.scatter.nearest_points import all_pairs, nearest_points

    tables = placement_tables()
    pairs = tables.ties.get(index) or all_pairs(tables.outlines[footprint], tables.outlines[other_footprint])
    new_ring = tables.points(footprint, x, y, {i for i, _ in pairs})
    other_ring = tables.points(other_footprint, other_x, other_y, {j for _, j in pairs})
    p, q = nearest_points(new_ring, other_ring, pairs)
    return int(q[0]) - int(p[0]), int(q[1]) - int(p[1])


@cache
def placement_tables() -> PlacementTables:
    """The tables of data/placement.npz, loaded once."""
    with (files("lilgym_mp.data") / "placement.npz").open("rb") as file, np.load(file) as arrays:
        segments = [(i, j) for i, j in arrays["tie_segments"].tolist()]
        outlines = [(px, py) for px, py in arrays["outlines"].tolist()]
        ties = dict(zip(arrays["tie_placements"].tolist(), _runs(segments, arrays["tie_counts"]), strict=True))
        shape = FOOTPRINT_COUNT, FOOTPRINT_COUNT, OFFSET_COUNT, OFFSET_COUNT
        clearance = arrays["clearance"].astype(np.uint8).reshape(shape)
        moves = ((arrays["moves"].astype(np.int64) + LARGEST_MOVE) @ (16, 1)).astype(np.uint8).reshape(shape)
        moves.flat[list(ties)] = TIED
        return PlacementTables(
            clearance=clearance,
            moves=moves,
            clearance_bytes=[[pair.tobytes() for pair in row] for row in clearance],
            ties=ties,
            outlines=_runs(outlines, arrays["outline_lengths"]),
            pixel_areas=arrays["pixel_areas"],
        )


def _runs(values: Sequence[Value], lengths: UInt8Array) -> list[Sequence[Value]]:
    """`values` cut into consecutive runs of the given lengths."""
    ends = lengths.cumsum(dtype=np.int64).tolist()
    return [values[start:end] for start, end in zip([0, *ends], ends, strict=False)]


def is_free(footprint: int, x: int, y: int, items: Iterable[Item]) -> bool:
    """Whether an item of `footprint` at (x, y) overlaps none of `items`."""
    return placement_tables().closest(footprint, x, y, items)[0] != OVERLAPPING


def snapped(
    footprint: int, x: int, y: int, closest: Item, items: Sequence[Item], box_index: int, rules: PlacementRules
) -> tuple[int, int]:
    """Position of a new item after snapping, from its free position (x, y) among `items`.

    `closest` is the first of `items` with the smallest truncated distance, within SNAP_REACH.
    """
    frame_x = box_index * BOX_PITCH if rules.rounds_in_image else 0
    move_x, move_y = placement_tables().move(footprint, x, y, closest, frame_x)
    if not (move_x or move_y):
        return x, y
    new_x = x + move_x
    new_y = y + move_y
    if rules.keeps_unfit_snaps or (fits_box(footprint, new_x, new_y) and is_free(footprint, new_x, new_y, items)):
        return new_x, new_y
    return x, y


@cache
def clear_templates() -> BoolArray:
    """(9, 9, 61, 61) by other footprint, new footprint, offset in x and y from -30: whether the two do not overlap."""
    inner = slice(SNAP_REACH, OFFSET_COUNT - SNAP_REACH)
    return np.ascontiguousarray((placement_tables().clearance[:, :, inner, inner] != OVERLAPPING).transpose(1, 0, 2, 3))


@cache
def _areas_before() -> Int64Array:
    """(9, 31, 31) by footprint, x, y: area of the shape left of x and above y."""
    areas = placement_tables().pixel_areas
    before = np.zeros((FOOTPRINT_COUNT, LARGEST_SIDE + 1, LARGEST_SIDE + 1), np.int64)
    before[:, 1:, 1:] = areas.cumsum(axis=1).cumsum(axis=2)
    return before


def shape_area(footprint: int) -> int:
    """Area of a shape, in AREA_UNITs."""
    return int(_areas_before()[footprint, -1, -1])


@cache
def cell_areas(cell_width: int, cell_height: int) -> Int64Array:
    """Area of a shape in a cell, in AREA_UNITs, by footprint and by cell minus item top-left.

    Indexed [footprint, dx + cell_width - 1, dy + cell_height - 1]; an offset outside the table means no overlap.
    """
    before = _areas_before()
    width = LARGEST_SIDE + cell_width - 1
    height = LARGEST_SIDE + cell_height - 1
    start_x = np.arange(width) - (cell_width - 1)
    start_y = np.arange(height) - (cell_height - 1)
    low_x = start_x.clip(0)
    high_x = (start_x + cell_width).clip(max=LARGEST_SIDE)
    low_y = start_y.clip(0)
    high_y = (start_y + cell_height).clip(max=LARGEST_SIDE)
    right = before[:, high_x]
    left = before[:, low_x]
    return right[:, :, high_y] - right[:, :, low_y] - left[:, :, high_y] + left[:, :, low_y]


def check_apart(items: Sequence[Item]) -> None:
    """Raises SceneError when an item lies outside the box or overlaps another."""
    for index, item in enumerate(items):
        if not fits_box(item.footprint, item.x, item.y):
            raise SceneError(f"item {index} at ({item.x}, {item.y}), {item.side} pixels wide, lies outside its box")
        if not is_free(item.footprint, item.x, item.y, items[:index]):
            raise SceneError(f"item {index} at ({item.x}, {item.y}) overlaps an earlier item of its box")
