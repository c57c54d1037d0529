"""Builds data/placement.npz, the lookup tables of `lilgym_mp.scene.appearances.scatter.geometry`, with shapely.

    python scripts/build_placement_tables.py [--out data/placement.npz]

Overlap, truncated distance and, for most placements, the snap move depend on footprints and offset only. Where
two outlines have several pairs of nearest points that snap differently, which of them shapely returns hangs
on rounding, and so on where in the picture it is asked: those placements are listed as ties, with the
segments to compare in place. Needs the `geometry` extra. Takes under a minute.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lilgym_mp.scene import FOOTPRINT_COUNT, FOOTPRINT_SIDES, Shape
from lilgym_mp.scene.appearances.scatter.geometry import (
    AREA_UNIT,
    FIRST_TOO_FAR,
    LARGEST_SIDE,
    OFFSET_COUNT,
    OFFSET_LIMIT,
    OVERLAPPING,
)

REFERENCE = (35, 35)  # where the older item lies in its box
TIE_MARGIN = 1e-9  # pixels: far above rounding, far below any true difference of distances
FOOTPRINTS = range(FOOTPRINT_COUNT)

Points = NDArray[np.float64]  # (points, 2)


def footprint_polygon(footprint: int, x: float, y: float) -> shapely.Polygon:
    """The exact outline of a footprint with its bounding square's top-left at (x, y)."""
    side = FOOTPRINT_SIDES[footprint]
    shape = Shape(footprint // 3)
    if shape is Shape.CIRCLE:
        return shapely.Point(x + side / 2, y + side / 2).buffer(side / 2)
    if shape is Shape.SQUARE:
        return shapely.Polygon([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])
    return shapely.Polygon([(x + side / 2, y), (x + side, y + side), (x, y + side)])


def outline(footprint: int, x: float, y: float) -> Points:
    """(points, 2) the closed ring of a footprint."""
    return shapely.get_coordinates(footprint_polygon(footprint, x, y).exterior)


def centred_outline(footprint: int) -> Points:
    """(points, 2) the closed ring of a footprint whose bounding square's centre is the origin."""
    half = FOOTPRINT_SIDES[footprint] / 2
    return outline(footprint, -half, -half)


def offsets() -> Iterator[tuple[int, int]]:
    span = range(-OFFSET_LIMIT, OFFSET_LIMIT + 1)
    return ((dx, dy) for dx in span for dy in span)


def clearance_codes(footprint: int, other: int) -> NDArray[np.uint8]:
    """(69 * 69,) clearance code by offset."""
    older = footprint_polygon(other, *REFERENCE)
    new = np.array([footprint_polygon(footprint, REFERENCE[0] + dx, REFERENCE[1] + dy) for dx, dy in offsets()])
    distances = np.trunc(shapely.distance(new, older)).astype(int)
    codes = np.minimum(distances + 1, FIRST_TOO_FAR)
    codes[shapely.area(shapely.intersection(new, older)) > 0] = OVERLAPPING
    return codes.astype(np.uint8)


def near_offsets(codes: NDArray[np.uint8]) -> list[int]:
    return [index for index, code in enumerate(codes) if OVERLAPPING < code < FIRST_TOO_FAR]


def snap_moves(footprint: int, other: int, codes: NDArray[np.uint8]) -> NDArray[np.int8]:
    """(69 * 69, 2) snap move by offset, with the older item at REFERENCE; zero where nothing snaps."""
    moves = np.zeros((OFFSET_COUNT**2, 2), np.int8)
    near = near_offsets(codes)
    if near:
        older = footprint_polygon(other, *REFERENCE)
        places = list(offsets())
        new = np.array(
            [footprint_polygon(footprint, REFERENCE[0] + places[i][0], REFERENCE[1] + places[i][1]) for i in near]
        )
        ends = np.trunc(shapely.get_coordinates(shapely.shortest_line(new, older))).reshape(-1, 2, 2)
        moves[near] = ends[:, 1] - ends[:, 0]
    return moves


def vertex_to_segments(vertices: Points, ring: Points) -> tuple[NDArray[np.float64], Points]:
    """(vertices, segments) distances, and (vertices, segments, 2) the nearest points on the segments."""
    start, along = ring[:-1], np.diff(ring, axis=0)
    share = ((vertices[:, None] - start) * along).sum(-1) / (along**2).sum(-1)
    points = start + share.clip(0, 1)[..., None] * along
    return np.linalg.norm(points - vertices[:, None], axis=-1), points


def moves_of_nearest(new: Points, older: Points) -> set[tuple[int, int]]:
    """Every snap move that some pair of nearest points gives."""
    to_older, on_older = vertex_to_segments(new[:-1], older)
    to_new, on_new = vertex_to_segments(older[:-1], new)
    nearest = min(to_older.min(), to_new.min())
    if nearest < TIE_MARGIN:
        return {(0, 0)}  # they touch, and both nearest points are the common one
    i, j = np.nonzero(to_older < nearest + TIE_MARGIN)
    k, m = np.nonzero(to_new < nearest + TIE_MARGIN)
    new_points = np.concatenate([new[i], on_new[k, m]])
    older_points = np.concatenate([on_older[i, j], older[k]])
    return {(int(x), int(y)) for x, y in np.trunc(older_points) - np.trunc(new_points)}


def nearest_segments(new: Points, older: Points) -> list[tuple[int, int]]:
    """The pairs of segments that are nearest to each other, up to rounding, in ascending order."""
    segments = [np.array([shapely.LineString(ring[i : i + 2]) for i in range(len(ring) - 1)]) for ring in (new, older)]
    distances = shapely.distance(segments[0][:, None], segments[1][None, :])
    return [(int(i), int(j)) for i, j in np.argwhere(distances < distances.min() + TIE_MARGIN)]


def ties(footprint: int, other: int, codes: NDArray[np.uint8]) -> dict[int, list[tuple[int, int]]]:
    """The nearest segments of every offset (its index) at which equally near points snap differently."""
    older = outline(other, *REFERENCE)
    places = list(offsets())
    found: dict[int, list[tuple[int, int]]] = {}
    for index in near_offsets(codes):
        new = outline(footprint, REFERENCE[0] + places[index][0], REFERENCE[1] + places[index][1])
        if len(moves_of_nearest(new, older)) > 1:
            found[index] = nearest_segments(new, older)
    return found


def pixel_areas(footprint: int) -> NDArray[np.int64]:
    """(30, 30) area of the footprint at the origin in each pixel, by x and y."""
    outline = footprint_polygon(footprint, 0, 0)
    corners = [(x, y) for x in range(LARGEST_SIDE) for y in range(LARGEST_SIDE)]
    pixels = np.array([shapely.box(x, y, x + 1, y + 1) for x, y in corners])
    areas = shapely.area(shapely.intersection(outline, pixels))
    return np.rint(areas * AREA_UNIT).astype(np.int64).reshape(LARGEST_SIDE, LARGEST_SIDE)


def build() -> dict[str, Any]:
    """The arrays of the file, by name; `PlacementTables` says what they hold."""
    codes = np.stack([[clearance_codes(footprint, other) for other in FOOTPRINTS] for footprint in FOOTPRINTS])
    moves = np.stack(
        [[snap_moves(footprint, other, codes[footprint, other]) for other in FOOTPRINTS] for footprint in FOOTPRINTS]
    )
    tied = {
        (footprint * FOOTPRINT_COUNT + other) * OFFSET_COUNT**2 + index: pairs
        for footprint in FOOTPRINTS
        for other in FOOTPRINTS
        for index, pairs in ties(footprint, other, codes[footprint, other]).items()
    }
    return {
        "clearance": codes,
        "moves": moves,
        "tie_placements": np.array(list(tied), np.int32),
        "tie_counts": np.array([len(pairs) for pairs in tied.values()], np.uint8),
        "tie_segments": np.concatenate([np.array(pairs, np.uint8) for pairs in tied.values()]),
        "outline_lengths": np.array([len(centred_outline(footprint)) for footprint in FOOTPRINTS], np.uint8),
        "outlines": np.concatenate([centred_outline(footprint) for footprint in FOOTPRINTS]),
        "pixel_areas": np.stack([pixel_areas(footprint) for footprint in FOOTPRINTS]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Build the placement tables with shapely.")
    default = Path(__file__).parent.parent / "data" / "placement.npz"
    parser.add_argument("--out", type=Path, default=default)
    output = parser.parse_args().out
    np.savez_compressed(output, **build())
    print(f"wrote {output}: {output.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
