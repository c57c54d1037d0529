"""The nearest points of two outlines, for snaps between several pairs of nearest points.

Source: docs/spec.md, "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, sqrt

from lilgym_mp.scene.appearances.scatter.geometry import Point, Ring

# The nearest points of two outlines, to the last bit as GEOS (shapely's engine) computes them. Snapping truncates them
# to integers, and which of several equally near pairs (parallel sides, symmetric circles) is chosen depends on how
# distances round at the items' positions. So ties are resolved as GEOS's brute-force facet distance does: segment by
# segment in ring order, in IEEE doubles, a later pair winning only when it is strictly nearer.


def nearest_points(
    first: Mapping[int, Point], second: Mapping[int, Point], pairs: Sequence[tuple[int, int]]
) -> tuple[Point, Point]:
    """The nearest points on two rings that do not intersect, the first ring's first.

    `pairs` are the segments (of `first`, of `second`) to consider, in ascending order; rings are given by the
    segments' end points: segment i goes from point i to point i + 1.
    """
    nearest = inf
    found = first[pairs[0][0]], second[pairs[0][1]]
    for i, j in pairs:
        a = first[i]
        b = first[i + 1]
        c = second[j]
        d = second[j + 1]
        if _envelope_distance_squared(a, b, c, d) > nearest * nearest:
            continue
        distance = min(_to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b))
        if distance < nearest:
            nearest = distance
            found = _closest_points(a, b, c, d)
    return found


def all_pairs(first: Ring, second: Ring) -> Sequence[tuple[int, int]]:
    """Every pair of segments of two rings, in the order of `nearest_points`."""
    return [(i, j) for i in range(len(first) - 1) for j in range(len(second) - 1)]


def _envelope_distance_squared(a: Point, b: Point, c: Point, d: Point) -> float:
    dx = max(0.0, min(c[0], d[0]) - max(a[0], b[0]), min(a[0], b[0]) - max(c[0], d[0]))
    dy = max(0.0, min(c[1], d[1]) - max(a[1], b[1]), min(a[1], b[1]) - max(c[1], d[1]))
    return dx * dx + dy * dy


def _distance(p: Point, q: Point) -> float:
    dx = p[0] - q[0]
    dy = p[1] - q[1]
    return sqrt(dx * dx + dy * dy)


def _along(p: Point, a: Point, b: Point) -> tuple[float, float, float, float]:
    """A segment's direction and squared length, and where `p` projects to on it: 0 at `a`, 1 at `b`."""
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    length_squared = dx * dx + dy * dy
    return dx, dy, length_squared, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length_squared


def _to_segment(p: Point, a: Point, b: Point) -> float:
    """Distance of a point from a segment."""
    dx, dy, length_squared, along = _along(p, a, b)
    if along <= 0.0:
        return _distance(p, a)
    if along >= 1.0:
        return _distance(p, b)
    across = ((a[1] - p[1]) * dx - (a[0] - p[0]) * dy) / length_squared
    return abs(across) * sqrt(length_squared)


def _projected(p: Point, a: Point, b: Point) -> Point:
    """The point of a segment nearest to `p`."""
    dx, dy, _, along = _along(p, a, b)
    if 0.0 < along < 1.0:
        return a[0] + along * dx, a[1] + along * dy
    return a if _distance(a, p) < _distance(b, p) else b


def _closest_points(a: Point, b: Point, c: Point, d: Point) -> tuple[Point, Point]:
    """Nearest points of two segments that do not intersect."""
    candidates = (
        (_projected(c, a, b), c),
        (_projected(d, a, b), d),
        (a, _projected(a, c, d)),
        (b, _projected(b, c, d)),
    )
    return min(candidates, key=lambda points: _distance(*points))
