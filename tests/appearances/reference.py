"""Scatter's ADD and REMOVE (docs/spec.md, "Legality and effects") with shapely, polygon by polygon: slow and plain."""

import math

import shapely

from lilgym_mp.scene.appearances import InvalidReason
from scripts.build_placement_tables import footprint_polygon

ROUNDING = 1e-9  # square pixels: areas that differ by less are equal
Place = tuple[int, int]


def polygon(item, frame_x=0):
    return footprint_polygon(item.footprint, item.x + frame_x, item.y)


def overlap(one, other):
    return shapely.intersection(one, other).area > 0


def fits(item, others):
    """Whether the item lies in its box and overlaps no other."""
    inside = 0 <= item.x <= 100 - item.side and 0 <= item.y <= 100 - item.side
    return inside and not any(overlap(polygon(item), polygon(other)) for other in others)


def snap_move(item, other, frame_x):
    """The move of the item's nearest point to the other's, both truncated, the box's border being at `frame_x`."""
    p, q = shapely.shortest_line(polygon(item, frame_x), polygon(other, frame_x)).coords
    return math.trunc(q[0]) - math.trunc(p[0]), math.trunc(q[1]) - math.trunc(p[1])


def snap_target(item, others):
    """The first of those at the smallest truncated distance, when that is at most 4."""
    distances = [math.trunc(shapely.distance(polygon(item), polygon(other))) for other in others]
    nearest = min(distances, default=5)
    return others[distances.index(nearest)] if nearest <= 4 else None


def may_be_searched(item, cell):
    """Whether half of the item lies in the cell, or the item covers half of the cell."""
    shared = shapely.intersection(polygon(item), cell).area + ROUNDING
    return shared >= polygon(item).area / 2 or shared >= cell.area / 2


def searched(item, cell, others):
    """The item at the first place of its cell where it may go; it now lies at the cell's top-left."""
    square = shapely.box(item.x, item.y, item.x + cell[0], item.y + cell[1])
    places = (item._replace(x=item.x + x, y=item.y + y) for x in range(cell[0]) for y in range(cell[1]))
    return next((place for place in places if may_be_searched(place, square) and fits(place, others)), None)


def added(item, cell, others, box_index, rules):
    """Where the item, put at its cell's top-left, comes to rest, or why it does not."""
    if not fits(item, []):
        return InvalidReason.OUT_OF_BOX
    if not fits(item, others):
        found = searched(item, cell, others) if rules.searches_cell else None
        if found is None:
            return InvalidReason.OVERLAP
        item = found
    target = snap_target(item, others)
    if target is None:
        return item
    move_x, move_y = snap_move(item, target, 140 * box_index if rules.rounds_in_image else 0)
    moved = item._replace(x=item.x + move_x, y=item.y + move_y)
    return moved if rules.keeps_unfit_snaps or fits(moved, others) else item


def removed(cell_place, cell, items):
    """The position of the item that covers most of the cell; None when none does."""
    (x, y), (width, height) = cell_place, cell
    square = shapely.box(x, y, x + width, y + height)
    areas = [shapely.intersection(polygon(item), square).area for item in items]
    largest = max(areas, default=0)
    return next(i for i, area in enumerate(areas) if area > largest - ROUNDING) if largest > 0 else None
