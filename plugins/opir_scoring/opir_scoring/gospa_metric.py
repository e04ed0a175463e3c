"""The GOSPA distance between a set of estimates and a set of true states.

Functions of arrays. The assignment is optimal (scipy.optimize.linear_sum_assignment).
"""

import numpy as np
from attrs import frozen
from scipy.optimize import linear_sum_assignment

from opir_core.arrays import FloatArray, IntArray


@frozen(eq=False)
class Gospa:
    """A GOSPA distance and its parts: `distance`**p = `localisation` + `missed` + `false`, all of
    them p-th powers.

    `assigned` (k, 2) are the pairs (estimate, truth) closer than the cut-off, by estimate; every
    other truth is missed, every other estimate false.
    """

    distance: float
    localisation: float
    missed: float
    false: float
    missed_count: int
    false_count: int
    assigned: IntArray


def gospa(
    estimate: FloatArray,
    truth: FloatArray,
    *,
    cutoff: float,
    order: float = 2.0,
    alpha: float = 2.0,
) -> Gospa:
    """Return the generalised optimal sub-pattern assignment distance between points (m, d) and (n,
    d).

    With `alpha` 2 the distance splits into that of assigned pairs and `cutoff`**p / 2 for each
    missed truth and each false estimate (Rahmathullah, Garcia-Fernandez and Svensson, "Generalized
    optimal sub-pattern assignment metric", Fusion 2017, proposition 1). With another alpha in (0,
    2] the surplus of the larger set costs `cutoff`**p / alpha each (their definition 1) and pairs
    cut off are a missed truth and a false estimate, at half of `cutoff`**p each. Two empty sets are
    at distance 0.
    """
    _require_valid(cutoff, order, alpha)
    power, pairs = _assigned(estimate, truth, cutoff, order)
    is_near = power < cutoff**order
    localisation = float(power[is_near].sum())
    cut = int(np.count_nonzero(~is_near))
    spare_estimates = len(estimate) - len(power)
    spare_truths = len(truth) - len(power)
    missed = cutoff**order * (cut / 2.0 + spare_truths / alpha)
    false = cutoff**order * (cut / 2.0 + spare_estimates / alpha)
    return Gospa(
        distance=float((localisation + missed + false) ** (1.0 / order)),
        localisation=localisation,
        missed=missed,
        false=false,
        missed_count=cut + spare_truths,
        false_count=cut + spare_estimates,
        assigned=pairs[is_near],
    )


def _require_valid(cutoff: float, order: float, alpha: float) -> None:
    if not 0.0 < cutoff < np.inf:
        raise ValueError(f"the cut-off must be positive and finite, got {cutoff!r}")
    if not 1.0 <= order < np.inf:
        raise ValueError(f"the order must be finite and at least 1, got {order!r}")
    if not 0.0 < alpha <= 2.0:
        raise ValueError(f"alpha must be in (0, 2], got {alpha!r}")


def _assigned(
    estimate: FloatArray, truth: FloatArray, cutoff: float, order: float
) -> tuple[FloatArray, IntArray]:
    """Return the p-th powers of the cut-off distances of the best assignment, and its pairs, by
    estimate.
    """
    if not len(estimate) or not len(truth):
        return np.empty(0), np.empty((0, 2), dtype=np.int64)
    offset = np.asarray(estimate)[:, None, :] - np.asarray(truth)[None, :, :]
    distance = np.sqrt(np.sum(offset**2, axis=2))
    power = np.minimum(distance, cutoff) ** order
    rows, columns = linear_sum_assignment(power)
    return power[rows, columns], np.stack([rows, columns], axis=1).astype(np.int64)
