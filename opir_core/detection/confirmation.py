"""False alarms that a sensor confirms over scans: M detections within N scans, near enough to be of one source.

Noise crosses a threshold in each cell and scan with probability P_fa, independently. A false alarm is confirmed if at
least M - 1 of the N - 1 scans before it have one within the confirmation gate: the distance that the fastest source may
have moved since, and one cell for the error of both directions. j scans before, the gate has the radius
r_j = 1 + v j T / (IFOV · R) cells, so that the scan has a false alarm in it with probability 1 - exp(-P_fa π r_j²).
The number of such scans has a Poisson binomial distribution (Y. H. Wang, Statistica Sinica 3, 1993, 295).
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray


def gate_radius_cells(
    scans_before: ArrayLike, scan_period_s: float, ifov_rad: float, range_m: float, speed_m_s: float
) -> FloatArray:
    """Return the radii of confirmation gates, in resolution cells, the given numbers of scans before a detection."""
    moved_m = speed_m_s * scan_period_s * np.asarray(scans_before, dtype=np.float64)
    radius: FloatArray = 1.0 + moved_m / (ifov_rad * range_m)
    return radius


def false_confirmation_probability(false_alarm_probability: float, needed: int, radius_cells: ArrayLike) -> float:
    """Return the probability that a false alarm is confirmed by those of the scans before it.

    `false_alarm_probability` is P_fa per cell and scan, `needed` is M, `radius_cells` (N - 1,) are the radii of the
    gates of the scans before. 1 for M = 1.
    """
    gate = np.pi * np.square(np.asarray(radius_cells, dtype=np.float64))
    hit = -np.expm1(-false_alarm_probability * gate)
    counts = np.zeros(len(hit) + 1)
    counts[0] = 1.0
    for chance in hit.tolist():
        counts[1:] = counts[1:] * (1.0 - chance) + counts[:-1] * chance
        counts[0] *= 1.0 - chance
    return min(float(counts[max(needed - 1, 0) :].sum()), 1.0)
