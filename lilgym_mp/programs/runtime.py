"""The names that generated source may use, and nothing else of Python."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from lilgym_mp.programs import box_functions
from lilgym_mp.programs.box_functions import FallbackError


def _bits(mask: int) -> list[int]:
    """The positions of the ones of a mask, ascending."""
    positions: list[int] = []
    while mask:
        low = mask & -mask
        positions.append(low.bit_length() - 1)
        mask ^= low
    return positions


def _only(mask: int) -> int:
    """The position of the only one of a mask."""
    if mask == 0 or mask & (mask - 1):
        raise FallbackError
    return mask.bit_length() - 1


def _only_meets(masks: tuple[int, ...], tests: tuple[int, ...]) -> bool:
    """Whether the test holds for the only item of the masks, one mask and one test a box."""
    if sum([mask.bit_count() for mask in masks]) != 1:
        raise FallbackError
    return any(mask & test for mask, test in zip(masks, tests, strict=True))


def _united(rows: Mapping[int, int], mask: int) -> int:
    united = 0
    for position in _bits(mask):
        united |= rows[position]
    return united


def _occurring(mask: int, *by_value: int) -> int:
    """Which values occur: bit v is set when the mask meets the v-th of the masks by value."""
    return sum([1 << value for value, having in enumerate(by_value) if mask & having])


def _mask_of(numbers: list[int]) -> int:
    mask = 0
    for number in numbers:
        mask |= 1 << number
    return mask


NAMES: dict[str, Any] = {
    "__builtins__": {"len": len, "sum": sum, "set": set, "bool": bool},
    "bits": _bits,
    "only": _only,
    "united": _united,
    "only_meets": _only_meets,
    "choices": itertools.combinations,
    "ways": math.comb,
    "none": frozenset[Any](),
    "occurring": _occurring,
    "mask_of": _mask_of,
    "check_size": box_functions.check_size,
    "FallbackError": FallbackError,
}
