"""Whether a target flies as the family does: the fit held against a filter that knows no family.

Where the family holds, the fit is the better of two estimates from the same looks, and their difference has the
difference of their covariances (Hausman, "Specification tests in econometrics", Econometrica 46, 1978, 1251). Where it
does not, the fit strays from the filter by more than that. The filter needs two sensors to be any judge.
"""

import numpy as np

from opir_core.records import BoolArray, Tracks

#: χ² of six degrees of freedom beyond which a fit strays; one in a thousand.
_GIVEN_UP = 22.5

#: The least share of the filter's variance that the difference has: its covariance is not exact either.
_LEAST_SHARE = 0.25


def strays(fitted: Tracks, filtered: Tracks) -> BoolArray:
    """Return which (n,) of the fitted tracks stray from the filtered ones of the same rows; False where unknown."""
    known = np.isfinite(filtered.state).all(axis=1) & np.isfinite(fitted.state).all(axis=1)
    known &= np.isfinite(filtered.state_covariance).all(axis=(1, 2))
    away = np.zeros(len(fitted), dtype=np.bool_)
    rows = np.flatnonzero(known)
    if not len(rows):
        return away
    filtered, fitted = filtered.take(rows), fitted.take(rows)
    scale = np.sqrt(np.diagonal(filtered.state_covariance, axis1=1, axis2=2))
    outer = scale[:, :, None] * scale[:, None, :]
    side = np.linalg.cholesky(filtered.state_covariance / outer + 1e-12 * np.eye(6))
    apart = np.linalg.solve(side, ((fitted.state - filtered.state) / scale)[:, :, None])
    half = np.linalg.solve(side, fitted.state_covariance / outer)
    share, axes = np.linalg.eigh(np.linalg.solve(side, half.transpose(0, 2, 1)))
    along = np.sum(axes * apart, axis=1)
    square = np.sum(along * along / np.maximum(1.0 - share, _LEAST_SHARE), axis=1)
    away[rows] = square > _GIVEN_UP
    return away
