"""Gauss-Legendre quadrature."""

from functools import cache

import numpy as np

from opir_core.arrays import FloatArray


@cache
def legendre(order: int) -> tuple[FloatArray, FloatArray]:
    """Return the nodes (order,) and weights of a quadrature over [-1, 1]."""
    return np.polynomial.legendre.leggauss(order)


@cache
def unit_legendre(order: int) -> tuple[FloatArray, FloatArray]:
    """Return the nodes (order,) and weights of a quadrature over [0, 1]."""
    nodes, weights = legendre(order)
    return 0.5 * (nodes + 1.0), 0.5 * weights
