"""Gaussian estimates in square-root information form, with orthogonal time updates.

An estimate of dimension d is a mean and an upper triangular R with Rᵀ R = P⁻¹. Each update is a QR
decomposition of a stacked array (Bierman, "Factorization Methods for Discrete Sequential
Estimation", 1977, chapters V and VI): covariances stay symmetric and positive definite, and no
normal equations are formed. All functions work on stacks (n,
...), one estimate each.
"""

from functools import cache
from typing import Any, Literal

import numpy as np

from opir_core.arrays import FloatArray

__all__ = ["covariance", "gram", "inverse_root", "time_update", "triangular"]


def triangular(rows: FloatArray) -> FloatArray:
    """Return the upper triangular T (n, d, d) with Tᵀ T = AᵀA of arrays A (n, m, d), m ≥ d."""
    count, _, size = rows.shape
    if count == 1:
        factor = _lapack().dgeqrf(rows[0], lwork=size)[0][:size]
        return (factor * _above(size, size, "F"))[None]
    raw: Any = np.linalg.qr(rows, mode="raw")[0]
    side = raw.mT[:, : rows.shape[2]]
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
    if root.shape[0] == 1:
        lone, singular = _lapack().dtrtri(root[0])
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
        return lone[None]
    inverse: Any = np.linalg.inv(root)
    return inverse


def solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, d) of equations with matrices (n, d, d) and right sides (n, d)."""
    if right.shape[0] == 1:
        *_, lone, singular = _lapack().dgesv(matrix[0], right[0])
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
        return lone[None]
    solutions: Any = np.linalg.solve(matrix, right[:, :, None])
    return solutions[:, :, 0]


def covariance(root: FloatArray) -> FloatArray:
    """Return the covariance (n, d, d), exactly symmetric."""
    return gram(inverse_root(root))


def gram(side: FloatArray) -> FloatArray:
    """Return the products A Aᵀ (n, d, d) of arrays A (n, d, m), exactly symmetric."""
    product = side @ side.mT
    return 0.5 * (product + product.mT)


def time_update(root: FloatArray, back: FloatArray, noise: FloatArray | None) -> FloatArray:
    """Return R after x → F x + L w, with `back` (n, d, d) = F⁻¹, `noise` (n, d, k) = L or None, w
    of unit variance.
    """
    carried = root @ back
    if noise is None:
        return triangular(carried)
    count, size, width = noise.shape
    rows = np.zeros((count, size + width, width + size))
    # The sign of the noise is of no account. Large rows come first: below small ones they cost
    # these their digits.
    np.matmul(carried, noise, out=rows[:, :size, :width])
    rows[:, :size, width:] = carried
    rows.reshape(count, -1)[:, size * (width + size) :: width + size + 1] = 1.0
    return triangular(rows)[:, width:, width:]
