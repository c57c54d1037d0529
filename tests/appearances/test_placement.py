"""The shipped placement tables against shapely: every pair of footprints and offset; and recorded plays."""

import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import shapely

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import BOX_PITCH, FOOTPRINT_SIDES, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.actions import named
from lilgym_mp.scene.appearances import Scatter
from lilgym_mp.scene.appearances.scatter.geometry import (
    AREA_UNIT,
    FIRST_TOO_FAR,
    OFFSET_COUNT,
    OFFSET_LIMIT,
    OVERLAPPING,
    cell_areas,
    placement_tables,
    shape_area,
)
from scripts import build_placement_tables as script

FOOTPRINTS = range(9)
SPAN = range(-OFFSET_LIMIT, OFFSET_LIMIT + 1)


def codes_of(new, older):
    """(n,) clearance codes of polygons, two by two."""
    distances = shapely.distance(new, older)
    codes = np.minimum(np.trunc(distances).astype(np.int64) + 1, FIRST_TOO_FAR)
    joined = np.nonzero(distances == 0)[0]
    shared = shapely.area(shapely.intersection(new[joined], older[joined]))
    codes[joined[shared > 0]] = OVERLAPPING
    return codes


def moves_of(new, older):
    """(n, 2) how far the truncated nearest point of each new polygon is from that of its older one."""
    ends = np.trunc(shapely.get_coordinates(shapely.shortest_line(new, older))).reshape(-1, 2, 2)
    return (ends[:, 1] - ends[:, 0]).astype(np.int64)


@pytest.mark.parametrize("footprint", FOOTPRINTS)
def test_outlines__are_a_64_sided_circle_a_square_and_an_upright_triangle(footprint):
    outline, side = script.footprint_polygon(footprint, 3, 7), FOOTPRINT_SIDES[footprint]
    corners, area, centre_y = {
        Shape.CIRCLE: (64, 8 * math.sin(math.pi / 32), 1 / 2),
        Shape.SQUARE: (4, 1, 1 / 2),
        Shape.TRIANGLE: (3, 1 / 2, 2 / 3),
    }[Shape(footprint // 3)]
    assert outline.bounds == (3, 7, 3 + side, 7 + side)
    assert len(outline.exterior.coords) == corners + 1
    assert outline.area == pytest.approx(area * side**2)
    assert (outline.centroid.x, outline.centroid.y) == pytest.approx((3 + side / 2, 7 + centre_y * side))


@pytest.mark.parametrize(
    ("older_footprint", "footprints"),
    [(8, (0, 4)), *(pytest.param(each, FOOTPRINTS, marks=pytest.mark.long) for each in FOOTPRINTS)],
)
def test_overlap_distance_and_move__equal_shapelys_at_every_offset_and_in_every_box(older_footprint, footprints):
    x, y = 37 + older_footprint, 45 - older_footprint  # not where the script puts it
    tables = placement_tables()
    older = Item(x, y, Shape(older_footprint // 3), Colour.BLUE, Size(older_footprint % 3))
    places = [(x + dx, y + dy) for dx in SPAN for dy in SPAN]
    for footprint in footprints:
        codes = np.array([tables.closest(footprint, *place, (older,))[0] for place in places])
        near = np.nonzero((codes > OVERLAPPING) & (codes < FIRST_TOO_FAR))[0]
        frame_x = BOX_PITCH * (footprint % 3)
        outlines = np.full(OFFSET_COUNT**2, script.footprint_polygon(older_footprint, x + frame_x, y))
        shapely.prepare(outlines[0])
        new = np.array([script.footprint_polygon(footprint, frame_x + place_x, place_y) for place_x, place_y in places])
        assert np.array_equal(codes, codes_of(new, outlines))
        moves = [tables.move(footprint, *places[index], older, frame_x) for index in near]
        assert np.array_equal(moves, moves_of(new[near], outlines[near]))


@pytest.mark.parametrize("footprint", [0, 4, 8])  # each shape and each size
def test_areas__of_shapes_and_of_their_parts_in_a_cell_equal_shapelys(footprint):
    assert shape_area(footprint) / AREA_UNIT == pytest.approx(script.footprint_polygon(footprint, 0, 0).area, abs=1e-6)
    for width, height in ((1, 1), (20, 20), (10, 5), (20, 100)):
        table = cell_areas(width, height)[footprint]
        places = [(dx, dy) for dx in range(1 - width, 30) for dy in range(1 - height, 30)]
        cells = np.array([shapely.box(dx, dy, dx + width, dy + height) for dx, dy in places])
        areas = shapely.area(shapely.intersection(script.footprint_polygon(footprint, 0, 0), cells))
        assert table.ravel() / AREA_UNIT == pytest.approx(areas, abs=1e-6)


@pytest.mark.parametrize("footprint", [0, 8])
@pytest.mark.long
def test_shipped_ties__equal_those_that_the_script_finds(footprint):
    other = (footprint + 3) % 9
    first = (footprint * 9 + other) * OFFSET_COUNT**2
    with np.load(files("lilgym_mp.data") / "placement.npz") as shipped:
        ends = shipped["tie_counts"].cumsum(dtype=int)
        pairs = zip(shipped["tie_placements"].tolist(), np.split(shipped["tie_segments"], ends[:-1]), strict=True)
    segments = dict(pairs)
    built = script.ties(footprint, other, script.clearance_codes(footprint, other))
    assert [first + index for index in built] == [i for i in segments if first <= i < first + OFFSET_COUNT**2]
    assert all(np.array_equal(segments[first + index], pairs) for index, pairs in built.items())


PLAYS = Path(__file__).with_name("edits.txt").read_text().strip().split("\n\n")


@pytest.mark.parametrize("rules", RULE_SETS)
def test_recorded_plays__have_the_places_that_shapely_gave(rules):
    """A play has its rules and grid, and lines of an edit and the places of items after it, or why it is invalid.

    They were recorded from a slow reference in shapely, polygon by polygon, of docs/spec.md, "Legality and effects".
    """
    plays = [play.splitlines() for play in PLAYS if play.startswith(rules)]
    assert len(plays) == 18
    for (_, *grid), *edits in ((title.split(), *edits) for title, *edits in plays):
        scatter, shown = Scatter(tuple(map(int, grid))), Scene.empty()
        for line in edits:
            action, expected = line.split(" | ")
            edit = scatter.apply(shown, named(action), RULE_SETS[rules].placement)
            places = " ".join(f"{item.x},{item.y}" for item in edit.scene.items())
            assert (edit.invalid or places) == expected, line
            shown = edit.scene
