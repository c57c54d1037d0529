"""Type aliases of arrays, and of other types that recur."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
UInt8Array = NDArray[np.uint8]
UInt16Array = NDArray[np.uint16]
Int8Array = NDArray[np.int8]
Int16Array = NDArray[np.int16]
Int64Array = NDArray[np.int64]
UInt64Array = NDArray[np.uint64]
Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

AnyDict = dict[str, Any]
AnyMapping = Mapping[str, Any]
Strings = tuple[str, ...]
Rng = np.random.Generator

BOOLEANS = (bool, np.bool_)  # rejected as integers, although both (np.bool_ before NumPy 2.3) can be used as an index


def one_hot(values: NDArray[np.int64], count: int) -> UInt8Array:
    """(..., count) ones at the values, which have any shape, and zeros elsewhere."""
    return (values[..., None] == np.arange(count)).astype(np.uint8)
