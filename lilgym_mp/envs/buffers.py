"""The arrays from which a batch reads actions and into which it writes results, in private or shared memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, NoReturn

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.scene import BOX_COUNT, Item
from lilgym_mp.scene.appearances import InvalidReason
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Int8Array, Int16Array, Int64Array, UInt8Array
from lilgym_mp.scene.render import image_shape

INVALID_REASONS = tuple(InvalidReason)  # in the order of the indices in `Buffers.invalid`
REASON_INDICES = {reason: index for index, reason in enumerate(INVALID_REASONS)}
NO_REASON = -1
ALIGNMENT = 64  # bytes: each array starts on its own cache line


class ArraySpec(NamedTuple):
    """Shape and type of an array in shared memory."""

    shape: tuple[int, ...]
    dtype: Any

    @property
    def size(self) -> int:
        """Bytes, rounded up to whole cache lines."""
        return -(-math.prod(self.shape) * np.dtype(self.dtype).itemsize // ALIGNMENT) * ALIGNMENT


# Metadata of the fields of Buffers: the types of their elements
INT64 = {"dtype": np.int64}
INT16 = {"dtype": np.int16}
INT8 = {"dtype": np.int8}
UINT8 = {"dtype": np.uint8}
BOOL = {"dtype": np.bool_}


@dataclass
class Buffers:
    """The arrays of N environments: their actions, and the results of the last step or reset."""

    action: Int64Array = field(metadata=INT64)  # (N,)
    image: UInt8Array = field(metadata=UINT8)  # (N, height, width, 3)
    task: Int64Array = field(metadata=INT64)  # (N,) index of the current task
    steps: Int64Array = field(metadata=INT64)  # (N,) actions taken in the episode
    result: Int8Array = field(metadata=INT8)  # (N,) index of the last action's `rules.StepResult`
    invalid: Int8Array = field(metadata=INT8)  # (N,) index in INVALID_REASONS, or NO_REASON
    ended: BoolArray = field(metadata=BOOL)  # (N,) the last action ended the episode
    started: BoolArray = field(metadata=BOOL)  # (N,) the last call started an episode
    repeated: BoolArray = field(metadata=BOOL)  # (N,) in evaluation: the ended episode's task had been evaluated before
    evaluated: Int64Array = field(metadata=INT64)  # (N,) in evaluation: tasks completed
    last_image: UInt8Array = field(metadata=UINT8)  # (N, height, width, 3) of the episode that ended (SAME_STEP)
    last_task: Int64Array = field(metadata=INT64)  # (N,) likewise
    last_steps: Int64Array = field(metadata=INT64)  # (N,) likewise
    last_items: Int16Array = field(metadata=INT16)  # (N, 3, capacity, 5) likewise
    mask: BoolArray = field(metadata=BOOL)  # (N, actions) on demand
    goal: BoolArray = field(metadata=BOOL)  # (N,) on demand
    items: Int16Array = field(metadata=INT16)  # (N, 3, capacity, 5) on demand

    def slice(self, first: int, stop: int) -> Buffers:
        """Views of the arrays of environments first .. stop - 1."""
        return Buffers(**{name: array[first:stop] for name, array in self.arrays()})

    def arrays(self) -> Iterator[tuple[str, Any]]:
        """Pairs of a field's name and its array, in the order of the fields."""
        return ((each.name, getattr(self, each.name)) for each in fields(self))

    @classmethod
    def new(cls, array_specs: Mapping[str, ArraySpec]) -> Buffers:
        """New arrays of zeros."""
        arrays: AnyDict = {name: np.zeros(spec.shape, spec.dtype) for name, spec in array_specs.items()}
        return cls(**arrays)


def refuse_copying(batch: object) -> NoReturn:
    """Raises TypeError: the `__reduce__` of objects with views of buffers, which a copy would not share."""
    name = type(batch).__name__
    raise TypeError(f"a {name} cannot be pickled or copied, because it shares arrays; make a new one")


def buffer_specs(
    num_envs: int, image_size: str, actions: int, capacity: int, autoreset: AutoresetMode
) -> dict[str, ArraySpec]:
    """Shape and dtype of every array of Buffers; those that keep the last episode are empty unless SAME_STEP."""
    kept = num_envs if autoreset is AutoresetMode.SAME_STEP else 0
    rows = {"image": image_shape(image_size), "mask": (actions,), "items": (BOX_COUNT, capacity, len(Item._fields))}
    return {
        each.name: ArraySpec(
            (kept if each.name.startswith("last_") else num_envs, *rows.get(each.name.removeprefix("last_"), ())),
            each.metadata["dtype"],
        )
        for each in fields(Buffers)
    }


def arrays_in(memory: memoryview, array_specs: Mapping[str, ArraySpec]) -> AnyDict:
    """Arrays one after another in `memory`, which has as many bytes as they take together."""
    arrays: AnyDict = {}
    offset = 0
    for name, spec in array_specs.items():
        arrays[name] = np.frombuffer(memory, spec.dtype, math.prod(spec.shape), offset).reshape(spec.shape)
        offset += spec.size
    return arrays
