"""Measurement updates, mixtures and evidence of Gaussian estimates in the form of
`opir_estimation.square_root`.

All functions work on stacks (n, ...), one estimate each.
"""

from math import log, prod
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_estimation.square_root import inverse_root, triangular


class Gaussian(NamedTuple):
    """Estimates (n,): means (n, d) and information roots (n, d, d)."""

    mean: FloatArray
    root: FloatArray


def information_root(side: FloatArray) -> FloatArray:
    """Return R (n, d, d) for the covariance A Aᵀ, with A (n, d, m), m ≥ d, of full rank."""
    upper = triangular(side.mT)
    return triangular(inverse_root(upper).mT)


def measurement_update(
    root: FloatArray, owed: FloatArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return R after a linear measurement, the step (n, d) to the new mean and the least sum of
    squares (n,).

    `owed` (n, d) is R (prior mean - linearisation point); `rows` (n, m, d + 1) are whitened rows [H
    | residual] at that point. The step starts at the linearisation point.
    """
    count, size = owed.shape
    stack = np.empty((count, size + rows.shape[1], size + 1))
    stack[:, :size, :size] = root
    stack[:, :size, size] = owed
    stack[:, size:] = rows
    return least_squares(stack)


def least_squares(stack: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return R (n, d, d), solutions (n, d) and least sums of squares (n,) of stacked rows (n, m, d
    + 1) [A | b].
    """
    size = stack.shape[2] - 1
    factor = triangular(stack)
    upper = factor[:, :size, :size]
    right = factor[:, :size, size:]
    squares = factor[:, size, size] ** 2 if factor.shape[1] > size else np.zeros(len(stack))
    return upper, _solved(upper, right)[:, :, 0], squares


def _solved(upper: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, d, k) of upper triangular systems."""
    if upper.shape[0] == 1:
        # Here, because plugins import the contracts of parts without solving anything.
        from scipy.linalg import lapack

        lone, singular = lapack.dtrtrs(upper[0], right[0])
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
        return lone[None]
    raw: Any = np.linalg.solve(upper, right)
    return raw


def log_determinant_ratio(root: FloatArray, reference: FloatArray) -> FloatArray:
    """Return log |det R / det R'| (n,) of two sets of roots."""
    if root.shape[0] == 1:
        determinant = prod(root[0].diagonal().tolist())
        return np.array([log(abs(determinant / prod(reference[0].diagonal().tolist())))])
    ratio = root.diagonal(axis1=1, axis2=2) / reference.diagonal(axis1=1, axis2=2)
    return np.log(np.abs(np.multiply.reduce(ratio, axis=1)))


def moment_matched(weight: FloatArray, mean: Any, root: Any) -> Gaussian:
    """Return the moments (n,) of Gaussian mixtures with weights (n, k), means (k of (n, d)) and
    information roots.
    """
    means = np.array(mean)
    components, count, size = means.shape
    scale = np.sqrt(weight).T[:, :, None]
    center = np.add.reduce(weight.T[:, :, None] * means)
    shifts = (means - center) * scale
    wide = np.empty((count, size, components * (size + 1)))
    wide[:, :, components * size :] = shifts.transpose(1, 2, 0)
    for number in range(components):
        side = wide[:, :, number * size : (number + 1) * size]
        np.multiply(inverse_root(root[number]), scale[number, :, :, None], out=side)
    return Gaussian(center, information_root(wide))
