"""Vectors as rows x, y, z, (3, n): products written out, so that an element does not depend on its neighbours."""

import numpy as np

from opir_core.flight.stumpff import Floats


def dot(a: Floats, b: Floats) -> Floats:
    """Return scalar products (n,)."""
    product: Floats = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def cross(a: Floats, b: Floats) -> Floats:
    """Return vector products (3, n)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def length(a: Floats) -> Floats:
    """Return Euclidean lengths (n,)."""
    root: Floats = np.sqrt(dot(a, a))
    return root
