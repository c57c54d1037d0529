"""Validation of arguments, done before any state changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np


def check_open(*, closed: bool) -> None:
    """Raises ClosedEnvironmentError for a closed environment."""
    if closed:
        raise gym.error.ClosedEnvironmentError("this environment is closed; make a new one")


def checked_seed(seed: object) -> int | None:
    """`seed` as an int or None. Raises ValueError for anything else, and for negative numbers."""
    if seed is None:
        return None
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"a seed must be None or a whole number, 0 or larger, not {seed!r}")
    return int(seed)


def checked_options(options: object, choices: Iterable[str]) -> Mapping[str, Any]:
    """The reset options; {} for None. Raises ValueError unless they are a mapping with known keys."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ValueError(f"reset options must be a mapping such as {{'task': id}}, not {options!r}")
    unknown = sorted(map(str, options.keys() - set(choices)))
    if unknown:
        raise ValueError(f"unknown reset options {unknown}; choose from {', '.join(choices)}")
    return options


def checked_flag(name: str, value: object) -> bool:
    """Raises ValueError unless `value` is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, not {value!r}")
    return bool(value)
