"""Gaussian estimates as square roots of information, and the orthogonal array algorithms that move and update them.

An estimate of dimension d is a mean and an upper triangular R with Rᵀ R = P⁻¹. Everything is a QR decomposition of a
stacked array (Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, chapters V and VI), so
covariances are symmetric and positive definite by construction and no normal equations are formed. All functions work
on stacks (n, ...), one estimate each.
"""

from functools import cache
from typing import Any

import numpy as np

from opir_core.records import BoolArray, FloatArray


def triangular(rows: FloatArray) -> FloatArray:
    """Return the upper triangular T (n, d, d) with Tᵀ T = AᵀA of arrays A (n, m, d), m at least d."""
    raw: Any = np.linalg.qr(rows, mode="raw")[0]
    side = raw.transpose(0, 2, 1)[:, : rows.shape[2]]
    upper: FloatArray = np.where(_above(side.shape[1], side.shape[2]), side, 0.0)
    return upper


@cache
def _above(rows: int, columns: int) -> BoolArray:
    """Return where the elements of an upper triangle are."""
    return ~np.tri(rows, columns, -1, dtype=np.bool_)


def spread(root: FloatArray) -> FloatArray:
    """Return S = R⁻¹ (n, d, d), so that the covariance is S Sᵀ.

    LU decomposition of an upper triangular matrix moves no row, so this is back substitution.
    """
    inverse: Any = np.linalg.inv(root)
    side: FloatArray = inverse
    return side


def covariance(root: FloatArray) -> FloatArray:
    """Return the covariance (n, d, d), exactly symmetric."""
    side = spread(root)
    product = side @ side.transpose(0, 2, 1)
    return 0.5 * (product + product.transpose(0, 2, 1))


def root_of_spread(side: FloatArray) -> FloatArray:
    """Return R (n, d, d) of estimates whose covariance is A Aᵀ, for A (n, d, m) with m at least d and of full rank."""
    upper = triangular(side.transpose(0, 2, 1))
    return triangular(spread(upper).transpose(0, 2, 1))


def moved(root: FloatArray, back: FloatArray, noise: FloatArray | None) -> FloatArray:
    """Return R after x → F x + L w, with `back` (n, d, d) = F⁻¹, `noise` (n, d, k) = L, w of unit variance, or None."""
    carried = root @ back
    if noise is None:
        return triangular(carried)
    count, size, width = noise.shape
    rows = np.zeros((count, width + size, width + size))
    rows[:, np.arange(width), np.arange(width)] = 1.0
    rows[:, width:, :width] = -(carried @ noise)
    rows[:, width:, width:] = carried
    return triangular(rows)[:, width:, width:]


def updated(root: FloatArray, owed: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return R after a linear measurement, the step (n, d) to the new mean and the least sum of squares (n,).

    `owed` (n, d) is R (prior mean - point of linearisation); `rows` (n, m, d + 1) are whitened rows [H | residual] at
    that point. The step is from the point of linearisation.
    """
    size = root.shape[1]
    stack = np.concatenate([np.concatenate([root, owed[:, :, None]], axis=2), rows], axis=1)
    factor = triangular(stack)
    upper = factor[:, :size, :size]
    step: Any = np.linalg.solve(upper, factor[:, :size, size:])
    left = factor[:, size, size] ** 2 if factor.shape[1] > size else np.zeros(len(root))
    return upper, step[:, :, 0], left


def log_determinant(root: FloatArray) -> FloatArray:
    """Return log |det R| (n,)."""
    total: FloatArray = np.log(np.abs(np.diagonal(root, axis1=1, axis2=2))).sum(axis=1)
    return total


def mixed(
    weight: FloatArray, mean: tuple[FloatArray, ...], root: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return mean (n, d) and R of mixtures of Gaussians with `weight` (n, k), by first and second moments."""
    center = sum((weight[:, [k]] * mean[k] for k in range(len(mean))), np.zeros_like(mean[0]))
    scale = np.sqrt(weight)
    sides = [spread(root[k]) * scale[:, k, None, None] for k in range(len(mean))]
    shifts = [((mean[k] - center) * scale[:, [k]])[:, :, None] for k in range(len(mean))]
    return center, root_of_spread(np.concatenate([*sides, *shifts], axis=2))
