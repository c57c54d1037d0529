"""The search of a grid cell for a free position, where an item would overlap others at the cell's corner.

Source: docs/spec.md, "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

import numpy as np

from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_COUNT, FOOTPRINT_SIDES, FOOTPRINTS, Item
from lilgym_mp.scene.appearances.placement import AREA_UNIT, LARGEST_SIDE, cell_areas, clear_templates, shape_area
from lilgym_mp.scene.arrays import BoolArray


@cache
def search_offsets(cell_width: int, cell_height: int) -> BoolArray:
    """(9, cell width, cell height) by footprint and offset in the cell: whether the search may place an item there.

    It may if half of the item lies in the cell or the item covers half of the cell.
    """
    areas = np.array(cell_areas(cell_width, cell_height))[:, :cell_width, :cell_height]
    inside = areas[:, ::-1, ::-1]
    half_items = np.array([shape_area(footprint) for footprint in range(FOOTPRINT_COUNT)])[:, None, None]
    half_cell = cell_width * cell_height * AREA_UNIT
    return np.ascontiguousarray((2 * inside >= half_items) | (2 * inside >= half_cell))


def _as_bits(flags: BoolArray, pitch: int) -> int:
    """Flags (columns, rows) as a bitmask, with bit column * pitch + row."""
    padded = np.zeros((len(flags), pitch), np.bool_)
    padded[:, : flags.shape[1]] = flags
    return int.from_bytes(np.packbits(padded, bitorder="little").tobytes(), "little")


def _search_pitch(cell_height: int) -> int:
    """Bits per column: enough that shifted masks never spill into the next column's cell."""
    return cell_height + 2 * LARGEST_SIDE


@cache
def _search_bits(footprint: int, fitting: tuple[int, int], cell: tuple[int, int]) -> int:
    """Bitmask of the positions in a cell that the search may choose in an empty box.

    `fitting`: number of columns and rows of the cell at which the item stays in the box.
    """
    places = search_offsets(*cell)[footprint].copy()
    places[max(0, fitting[0]) :] = False
    places[:, max(0, fitting[1]) :] = False
    return _as_bits(places, _search_pitch(cell[1]))


@cache
def _overlap_bits(cell_height: int) -> Sequence[Sequence[int]]:
    """(9, 9) by other footprint and new footprint: bitmask of the offsets from -30 that overlap."""
    pitch = _search_pitch(cell_height)
    return [[_as_bits(~clear, pitch) for clear in by_new] for by_new in clear_templates()]


def searched(
    footprint: int, cell_x: int, cell_y: int, cell: tuple[int, int], items: Iterable[Item]
) -> tuple[int, int] | None:
    """The first free position in the cell whose top-left pixel is (cell_x, cell_y), or None.

    The search goes by column from the left, and from top to bottom within a column.
    """
    width, height = cell
    pitch = _search_pitch(height)
    beyond = BOX_SIDE - FOOTPRINT_SIDES[footprint] + 1
    free = _search_bits(footprint, (min(width, beyond - cell_x), min(height, beyond - cell_y)), cell)
    overlaps = _overlap_bits(height)
    for item in items:
        left, top = cell_x - item[0] + LARGEST_SIDE, cell_y - item[1] + LARGEST_SIDE
        if -width < left <= 2 * LARGEST_SIDE and -height < top <= 2 * LARGEST_SIDE:
            taken, shift = overlaps[FOOTPRINTS[item[2]][item[4]]][footprint], left * pitch + top
            free &= ~(taken >> shift if shift >= 0 else taken << -shift)
    if not free:
        return None
    offset_x, offset_y = divmod((free & -free).bit_length() - 1, pitch)
    return cell_x + offset_x, cell_y + offset_y
