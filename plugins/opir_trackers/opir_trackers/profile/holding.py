"""How far ellipsoids of states reach that hold what they say, where a state's distribution is a mixture.

Mean and covariance of what one sensor knows are its own, and yet most states lie nearer than those of a normal
distribution and a few far off. The squared distance of a normal distribution from another's middle is a sum of χ²
variables, which is told by its first three cumulants (Hall, Buckley and Eagleson; Buckley and Eagleson, Austral. J.
Statist. 30A, 1988, 150): exact where both are one, and to a hundredth of what is held where a mixture differs.
"""

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.records import TOLD_CONTAINMENTS
from opir_trackers.profile.flight import Moments

#: Squared distances at which is counted what they hold: of six dimensions, no more than a twentieth lies beyond 120.
_SQUARES = np.geomspace(0.5, 130.0, 64)

#: No direction of a correlation is known better than this.
_LEAST = 1e-12


def holding_sigmas(parts: Moments, weight: FloatArray, row: IntArray, told: Moments) -> FloatArray:
    """Return the radii (count, 3) of ellipsoids of told states that hold `TOLD_CONTAINMENTS` of their parts' mixture.

    They are in standard deviations of the told covariances (count, d, d); parts (n,) belong to the told ones of `row`
    (n,), with weights (n,). nan where there is one part, which is normally distributed, or one that is not known.
    """
    from scipy.special import gammainc

    count = len(told)
    found = np.full((count, len(TOLD_CONTAINMENTS)), np.nan)
    known = [
        np.isfinite(each.mean).all(axis=1) & np.isfinite(each.covariance).all(axis=(1, 2)) for each in (parts, told)
    ]
    unknown = np.bincount(row, ~known[0], count) > 0
    mixed = known[1] & ~unknown & (np.bincount(row, minlength=count) > 1)
    used = np.flatnonzero(mixed[row])
    if not len(used):
        return found
    one, two, three = _cumulants(parts.take(used), told.take(row[used]))
    freedom = two**3 / three**2
    scaled = (_SQUARES - one[:, None]) * np.sqrt(freedom / two)[:, None] + freedom[:, None]
    held = gammainc(0.5 * freedom[:, None], 0.5 * np.maximum(scaled, 0.0))
    total = np.zeros((count, len(_SQUARES)))
    np.add.at(total, row[used], weight[used, None] * held)
    share = np.bincount(row[used], weight[used], count)
    for mine in np.flatnonzero(mixed).tolist():
        found[mine] = np.interp(TOLD_CONTAINMENTS, total[mine] / share[mine], np.sqrt(_SQUARES))
    return found


def _cumulants(parts: Moments, told: Moments) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Σ λʲ (1 + j b²), j = 1, 2, 3, (n,) of parts' squared distances Σ λ (z + b)² from what is told."""
    sigma = np.sqrt(np.diagonal(told.covariance, axis1=1, axis2=2))
    scale = sigma[:, :, None] * sigma[:, None]
    value, axes = np.linalg.eigh(told.covariance / scale)
    white = axes / np.sqrt(np.maximum(value, _LEAST))[:, None]
    away = np.sum(white * ((parts.mean - told.mean) / sigma)[:, :, None], axis=1)
    spread = white.transpose(0, 2, 1) @ (parts.covariance / scale) @ white
    square = spread @ spread
    moved = np.sum(spread * away[:, None], axis=2)
    one = np.trace(spread, axis1=1, axis2=2) + np.sum(away * away, axis=1)
    two = np.trace(square, axis1=1, axis2=2) + 2.0 * np.sum(away * moved, axis=1)
    three = np.sum(square * spread, axis=(1, 2)) + 3.0 * np.sum(moved * moved, axis=1)
    return one, two, three
