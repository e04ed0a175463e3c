"""Vectors as rows x, y, z, (3, n): products written out, so that an element does not depend on its neighbours."""

import numpy as np

from opir_core.arrays import FloatArray


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return scalar products (n,)."""
    product: FloatArray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return vector products (3, n)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def length(a: FloatArray) -> FloatArray:
    """Return Euclidean lengths (n,)."""
    root: FloatArray = np.sqrt(dot(a, a))
    return root
