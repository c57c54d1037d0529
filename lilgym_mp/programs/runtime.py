"""The runtime library of generated code: the only names it can use."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from lilgym_mp.programs import box_functions
from lilgym_mp.programs.box_functions import FallbackError


def _bits(mask: int) -> list[int]:
    """The positions of the set bits of a mask, ascending."""
    positions: list[int] = []
    while mask:
        low = mask & -mask
        positions.append(low.bit_length() - 1)
        mask ^= low
    return positions


def _only(mask: int) -> int:
    """The position of the only set bit of a mask. Raises FallbackError unless there is exactly one."""
    if mask == 0 or mask & (mask - 1):
        raise FallbackError
    return mask.bit_length() - 1


def _only_in(masks: tuple[int, ...], tests: tuple[int, ...]) -> bool:
    """Whether the only item selected by the masks (one per box) is also in the test masks. Raises FallbackError unless
    exactly one item is selected."""
    if sum([mask.bit_count() for mask in masks]) != 1:
        raise FallbackError
    return any(mask & test for mask, test in zip(masks, tests, strict=True))


def _union(rows: Mapping[int, int], mask: int) -> int:
    union = 0
    for position in _bits(mask):
        union |= rows[position]
    return union


def _occurring(mask: int, *by_value: int) -> int:
    """Bitmask of the values that occur: bit v is set when `mask` intersects the v-th mask of `by_value`."""
    return sum([1 << value for value, with_value in enumerate(by_value) if mask & with_value])


def _mask_of(positions: list[int]) -> int:
    mask = 0
    for position in positions:
        mask |= 1 << position
    return mask


NAMES: dict[str, Any] = {
    "__builtins__": {"len": len, "sum": sum, "set": set, "bool": bool},
    "bits": _bits,
    "only": _only,
    "union": _union,
    "only_in": _only_in,
    "choose": itertools.combinations,
    "comb": math.comb,
    "empty": frozenset[Any](),
    "occurring": _occurring,
    "mask_of": _mask_of,
    "check_size": box_functions.check_size,
    "FallbackError": FallbackError,
}
