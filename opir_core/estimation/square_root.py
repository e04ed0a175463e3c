"""Gaussian estimates in square-root information form, with orthogonal time and measurement updates.

An estimate of dimension d is a mean and an upper triangular R with Rᵀ R = P⁻¹. Each update is a QR decomposition of a
stacked array (Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapters V and VI):
covariances stay symmetric and positive definite, and no normal equations are formed. All functions work on stacks (n,
...), one estimate each.
"""

from functools import cache
from math import log, prod
from typing import Any, Literal

import numpy as np

from opir_core.arrays import FloatArray

__all__ = [
    "covariance",
    "gram",
    "information_root",
    "inverse_root",
    "least_squares",
    "log_determinant_ratio",
    "measurement_update",
    "moment_matched",
    "time_update",
    "triangular",
]


def triangular(rows: FloatArray) -> FloatArray:
    """Return the upper triangular T (n, d, d) with Tᵀ T = AᵀA of arrays A (n, m, d), m ≥ d."""
    count, _, size = rows.shape
    if count == 1:
        factor = _lapack().dgeqrf(rows[0], lwork=size)[0][:size]
        return (factor * _above(size, size, "F"))[None]
    raw: Any = np.linalg.qr(rows, mode="raw")[0]
    side = raw.transpose(0, 2, 1)[:, : rows.shape[2]]
    return side * _above(side.shape[1], side.shape[2])


@cache
def _lapack() -> Any:
    """Return LAPACK itself: for a single estimate numpy's overhead exceeds the arithmetic."""
    from scipy.linalg import lapack

    return lapack


@cache
def _above(rows: int, columns: int, order: Literal["C", "F"] = "C") -> FloatArray:
    """Return the mask of an upper triangle, 1 inside and 0 outside; LAPACK's order is F."""
    return np.array(1.0 - np.tri(rows, columns, -1), order=order)


def inverse_root(root: FloatArray) -> FloatArray:
    """Return S = R⁻¹ (n, d, d); the covariance is S Sᵀ.

    LU decomposition of an upper triangular matrix does not pivot, so this is back substitution.
    """
    if len(root) == 1:
        lone, singular = _lapack().dtrtri(root[0])
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
        return lone[None]
    inverse: Any = np.linalg.inv(root)
    return inverse


def covariance(root: FloatArray) -> FloatArray:
    """Return the covariance (n, d, d), exactly symmetric."""
    return gram(inverse_root(root))


def gram(side: FloatArray) -> FloatArray:
    """Return the products A Aᵀ (n, d, d) of arrays A (n, d, m), exactly symmetric."""
    product = side @ side.transpose(0, 2, 1)
    return 0.5 * (product + product.transpose(0, 2, 1))


def information_root(side: FloatArray) -> FloatArray:
    """Return R (n, d, d) for the covariance A Aᵀ, with A (n, d, m), m ≥ d, of full rank."""
    upper = triangular(side.transpose(0, 2, 1))
    return triangular(inverse_root(upper).transpose(0, 2, 1))


def time_update(root: FloatArray, back: FloatArray, noise: FloatArray | None) -> FloatArray:
    """Return R after x → F x + L w, with `back` (n, d, d) = F⁻¹, `noise` (n, d, k) = L or None, w of unit variance."""
    carried = root @ back
    if noise is None:
        return triangular(carried)
    count, size, width = noise.shape
    rows = np.zeros((count, width + size, width + size))
    rows.reshape(count, -1)[:, : width * (width + size) : width + size + 1] = 1.0
    # The sign of the noise is of no account.
    np.matmul(carried, noise, out=rows[:, width:, :width])
    rows[:, width:, width:] = carried
    return triangular(rows)[:, width:, width:]


def measurement_update(
    root: FloatArray, owed: FloatArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return R after a linear measurement, the step (n, d) to the new mean and the least sum of squares (n,).

    `owed` (n, d) is R (prior mean - linearisation point); `rows` (n, m, d + 1) are whitened rows [H | residual] at that
    point. The step starts at the linearisation point.
    """
    count, size = owed.shape
    stack = np.empty((count, size + rows.shape[1], size + 1))
    stack[:, :size, :size], stack[:, :size, size], stack[:, size:] = root, owed, rows
    return least_squares(stack)


def least_squares(stack: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return R (n, d, d), solutions (n, d) and least sums of squares (n,) of stacked rows (n, m, d + 1) [A | b]."""
    size = stack.shape[2] - 1
    factor = triangular(stack)
    upper, right = factor[:, :size, :size], factor[:, :size, size:]
    left = factor[:, size, size] ** 2 if factor.shape[1] > size else np.zeros(len(stack))
    return upper, _solved(upper, right)[:, :, 0], left


def _solved(upper: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, d, k) of upper triangular systems."""
    if len(upper) == 1:
        lone, singular = _lapack().dtrtrs(upper[0], right[0])
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
        return lone[None]
    raw: Any = np.linalg.solve(upper, right)
    return raw


def log_determinant_ratio(root: FloatArray, other: FloatArray) -> FloatArray:
    """Return log |det R / det R'| (n,) of two sets of roots."""
    if len(root) == 1:
        own, others = prod(root[0].diagonal().tolist()), prod(other[0].diagonal().tolist())
        return np.array([log(abs(own / others))])
    ratio = root.diagonal(axis1=1, axis2=2) / other.diagonal(axis1=1, axis2=2)
    return np.log(np.abs(np.multiply.reduce(ratio, axis=1)))


def moment_matched(
    weight: FloatArray, mean: tuple[FloatArray, ...], root: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return mean (n, d) and R of Gaussian mixtures with weights `weight` (n, k), by moment matching."""
    center = sum((weight[:, [k]] * mean[k] for k in range(len(mean))), np.zeros_like(mean[0]))
    scale = np.sqrt(weight)
    sides = [inverse_root(root[k]) * scale[:, k, None, None] for k in range(len(mean))]
    shifts = [((mean[k] - center) * scale[:, [k]])[:, :, None] for k in range(len(mean))]
    return center, information_root(np.concatenate([*sides, *shifts], axis=2))
