"""The array types of this house, by what they hold: one name for each, wherever numbers flow."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoolArray", "FloatArray", "IndexArray", "IntArray", "ObjectArray", "RowArray", "WordArray"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Row numbers as records keep them: sensors, targets, pairs.
IndexArray = NDArray[np.int32]
#: Row numbers as numpy returns them (`flatnonzero`, `argsort`).
RowArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
#: Words of random streams and identifiers.
WordArray = NDArray[np.uint64]

#: Objects, as `ImpactRegion`s of tracks.
ObjectArray = NDArray[np.object_]
