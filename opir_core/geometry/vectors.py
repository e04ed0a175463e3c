"""Vectors as three columns: everything here is element by element, so a result never depends on its neighbours.

`numpy.linalg.norm`, `@` and `einsum` sum in an order that depends on memory layout and batch size; written-out components do not.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def components(vectors: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return x, y and z of an (..., 3) array, each of shape (...), as views where the array is float64."""
    array = np.asarray(vectors, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"expected vectors with a last axis of 3 (x, y, z), got shape {array.shape}")
    return array[..., 0], array[..., 1], array[..., 2]


def vector(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Floats:
    """Return the (..., 3) array of three broadcast components."""
    out = np.empty((*np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), 3))
    out[..., 0] = x
    out[..., 1] = y
    out[..., 2] = z
    return out


def length(x: Floats, y: Floats, z: Floats) -> Floats:
    """Return the Euclidean length of vectors given by their components (below 1e150, or the squares overflow)."""
    root: Floats = np.sqrt(x * x + y * y + z * z)
    return root
