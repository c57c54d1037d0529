"""The arrays that a batch of environments reads its actions from and writes its results into.

They may lie anywhere: in this process, or in memory that processes share.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, NoReturn

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lilgym_mp.appearances import InvalidReason
from lilgym_mp.arrays import BoolArray, Int8Array, Int16Array, Int64Array, UInt8Array
from lilgym_mp.render import image_shape

INVALID_REASONS = tuple(InvalidReason)  # by number in `Buffers.invalid`
REASON_NUMBERS = {reason: number for number, reason in enumerate(INVALID_REASONS)}
NO_REASON = -1
ALIGNMENT = 64  # bytes: arrays start on cache lines of their own


class ArraySpec(NamedTuple):
    shape: tuple[int, ...]
    dtype: Any

    @property
    def size(self) -> int:
        """Bytes, rounded up to whole cache lines."""
        return -(-math.prod(self.shape) * np.dtype(self.dtype).itemsize // ALIGNMENT) * ALIGNMENT


@dataclass
class Buffers:
    """The arrays of N environments: their actions, and the results of the last step or reset."""

    action: Int64Array  # (N,)
    image: UInt8Array  # (N, height, width, 3)
    task: Int64Array  # (N,) number of the current task
    steps: Int64Array  # (N,) actions taken in the episode
    result: Int8Array  # (N,) index of the last action's `rules.StepResult`
    invalid: Int8Array  # (N,) number in INVALID_REASONS, or NO_REASON
    ended: BoolArray  # (N,) the last action ended the episode
    started: BoolArray  # (N,) an episode was started in the last call
    repeated: BoolArray  # (N,) the episode that ended was of a task that had been evaluated before
    last_image: UInt8Array  # (N, height, width, 3) of the episode that ended, where it was reset in the same step
    last_task: Int64Array  # (N,) likewise
    last_steps: Int64Array  # (N,) likewise
    last_items: Int16Array  # (N, 3, capacity, 5) likewise
    mask: BoolArray  # (N, actions) on demand
    goal: BoolArray  # (N,) on demand
    items: NDArray[np.int16]  # (N, 3, capacity, 5) on demand

    def part(self, first: int, stop: int) -> Buffers:
        """The arrays of environments first .. stop - 1, as views."""
        return Buffers(**{name: array[first:stop] for name, array in self.arrays()})

    def arrays(self) -> Iterator[tuple[str, Any]]:
        return ((field.name, getattr(self, field.name)) for field in fields(self))

    @classmethod
    def new(cls, forms: Mapping[str, ArraySpec]) -> Buffers:
        """Arrays of their own, zero."""
        arrays: dict[str, Any] = {name: np.zeros(form.shape, form.dtype) for name, form in forms.items()}
        return cls(**arrays)

    @classmethod
    def over(cls, memory: memoryview, forms: Mapping[str, ArraySpec]) -> Buffers:
        """Arrays one after another in `memory`, which has `buffers_size(forms)` bytes."""
        arrays: dict[str, Any] = {}
        offset = 0
        for name, (shape, dtype) in forms.items():
            arrays[name] = np.frombuffer(memory, dtype, math.prod(shape), offset).reshape(shape)
            offset += forms[name].size
        return cls(**arrays)


def refuse_copying(batch: object) -> NoReturn:
    """Raises TypeError for an object over buffers, as its `__reduce__`: a copy's views would be of other arrays."""
    name = type(batch).__name__
    raise TypeError(f"a {name} can be neither pickled nor copied, since its parts share arrays; make another one")


def buffer_specs(
    num_envs: int, image_size: str, actions: int, capacity: int, autoreset: AutoresetMode
) -> dict[str, ArraySpec]:
    """The form of every array of Buffers."""
    flags, numbers = ArraySpec((num_envs,), np.bool_), ArraySpec((num_envs,), np.int64)
    small = ArraySpec((num_envs,), np.int8)
    images = (num_envs, *image_shape(image_size))
    kept = num_envs if autoreset is AutoresetMode.SAME_STEP else 0
    return {
        "action": numbers,
        "image": ArraySpec(images, np.uint8),
        "task": numbers,
        "steps": numbers,
        "result": small,
        "invalid": small,
        "ended": flags,
        "started": flags,
        "repeated": flags,
        "last_image": ArraySpec((kept, *images[1:]), np.uint8),
        "last_task": numbers,
        "last_steps": numbers,
        "last_items": ArraySpec((kept, 3, capacity, 5), np.int16),
        "mask": ArraySpec((num_envs, actions), np.bool_),
        "goal": flags,
        "items": ArraySpec((num_envs, 3, capacity, 5), np.int16),
    }


def buffers_size(forms: Mapping[str, ArraySpec]) -> int:
    """Bytes of Buffers."""
    return sum(form.size for form in forms.values())
