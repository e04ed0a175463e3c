"""The array types of this house, by what they hold: one name for each, wherever numbers flow."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BoolArray",
    "ByteArray",
    "FloatArray",
    "IndexArray",
    "IntArray",
    "ObjectArray",
    "RowArray",
    "WordArray",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Row numbers as records keep them: sensors, targets, pairs.
IndexArray = NDArray[np.int32]
#: Row numbers as numpy returns them (`flatnonzero`, `argsort`).
RowArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
#: Words of random streams and identifiers.
WordArray = NDArray[np.uint64]
#: Codes and bit masks.
ByteArray = NDArray[np.uint8]

#: Objects, as `ImpactRegion`s of tracks.
ObjectArray = NDArray[np.object_]

#: The number type of each array type. numpy does not promise what its own aliases are made of at
#: run time.
NUMBER_TYPES: Mapping[Any, type[np.generic]] = {
    FloatArray: np.float64,
    IntArray: np.int64,
    IndexArray: np.int32,
    RowArray: np.intp,
    BoolArray: np.bool_,
    WordArray: np.uint64,
    ByteArray: np.uint8,
    ObjectArray: np.object_,
}
