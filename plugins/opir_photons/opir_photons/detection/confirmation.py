"""False alarms that a sensor confirms over scans: M detections within N scans, near enough to be of
one source.

Noise crosses a threshold in each cell and scan with probability P_fa, independently. A false alarm
is confirmed if at least M - 1 of the N - 1 scans before it have one within the confirmation gate:
the distance that the fastest source may have moved since, and one cell for the error of both
directions. j scans before, the gate has the radius r_j = 1 + v j T / (IFOV · R) cells, so that the
scan has a false alarm in it with probability 1 - exp(-P_fa π r_j²). The number of such scans has a
Poisson binomial distribution (Y. H. Wang, Statistica Sinica 3, 1993, 295).

Clutter may be correlated from scan to scan: the cell of a false alarm then crosses again with the
conditional probability of a bivariate normal distribution, P(y > T, y' > T) / P_fa, in place of
P_fa.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from opir_core.arrays import FloatArray
from opir_photons.columns import floats
from opir_photons.radiometry.quadrature import legendre


def gate_radius_cells(
    scans_before: ArrayLike, scan_period_s: float, ifov_rad: float, range_m: float, speed_m_s: float
) -> FloatArray:
    """Return the radii of confirmation gates, in resolution cells, the given numbers of scans
    before a detection.
    """
    moved_m = speed_m_s * scan_period_s * floats(scans_before)
    return 1.0 + moved_m / (ifov_rad * range_m)


def repeated_crossing_probability(
    false_alarm_probability: float, correlation: ArrayLike
) -> FloatArray:
    """Return the probabilities that noise which crosses a threshold in one scan crosses it in
    another.

    `correlation` (…) is that of the noise in both scans, from -1 to 1; 0 gives P_fa itself, 1 gives
    1. The joint probability is P_fa² + 1/(2π) ∫ exp(-T² / (1 + sin θ)) dθ from 0 to arcsin ρ, with
    T = Q⁻¹(P_fa): W. F. Sheppard, Phil. Trans. R. Soc. A 192 (1899) 101.
    """
    # To within 1e-12 up to a correlation of 0.9, 1e-5 up to 0.9999.
    nodes, weights = legendre(64)
    end = np.arcsin(np.clip(floats(correlation), -1.0, 1.0))[..., None]
    sine = np.sin(0.5 * end * (1.0 + nodes))
    squared_threshold = float(ndtri(false_alarm_probability)) ** 2
    with np.errstate(all="ignore"):
        density = np.exp(-squared_threshold / (1.0 + sine))
    joint = (density * weights).sum(axis=-1) * end[..., 0] / (4.0 * np.pi)
    is_possible = false_alarm_probability > 0.0
    excess = joint / false_alarm_probability if is_possible else np.zeros_like(joint)
    return np.asarray(np.clip(false_alarm_probability + excess, 0.0, 1.0))


def false_confirmation_probability(
    false_alarm_probability: float,
    needed: int,
    radius_cells: ArrayLike,
    correlation: ArrayLike = 0.0,
) -> float:
    """Return the probability that false alarms in earlier scans confirm one.

    `false_alarm_probability` is P_fa per cell and scan, `needed` is M, `radius_cells` (N - 1,) are
    the radii of the gates of the scans before, `correlation` (N - 1,) the correlations of a cell's
    noise with its own in those scans; other cells are independent of it. 1 for M = 1.
    """
    gate = np.pi * np.square(floats(radius_cells))
    correlations = np.broadcast_to(correlation, gate.shape)
    excess = (
        repeated_crossing_probability(false_alarm_probability, correlations)
        - false_alarm_probability
    )
    hit = -np.expm1(-false_alarm_probability * gate)
    # Of the cells in a gate one crosses again with another probability.
    hit += excess / max(1.0 - false_alarm_probability, 1e-300) * (1.0 - hit)
    return _poisson_binomial_tail(np.clip(hit, 0.0, 1.0), max(needed - 1, 0))


def _poisson_binomial_tail(chance: FloatArray, needed: int) -> float:
    """Return the probability of at least `needed` of independent events with probabilities (n,)."""
    counts = np.zeros(len(chance) + 1)
    counts[0] = 1.0
    for hit in chance.tolist():
        counts[1:] = counts[1:] * (1.0 - hit) + counts[:-1] * hit
        counts[0] *= 1.0 - hit
    return min(float(counts[needed:].sum()), 1.0)
