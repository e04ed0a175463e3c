"""Bounds of the tracking set: what no tracker can beat in the mean, and what one reaches that does
not know the law.

The first is the posterior Cramér–Rao bound (van Trees) of the flight's parameters: it knows that
flights are those of `set_flights`, with which laws of their parameters, and which detection is
whose; light and dark are known to within the time between two detections, uniformly. The second,
with an unknown thrust whose rate is a random walk, is `opir_scoring.bound.free_bound`. Both have
the sensors' biases as unknowns.
"""

import sys
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np
from flight_bound import KnownValues, bound_of, central_slopes, parameter_bound
from opir_scoring import energy_scores
from opir_scoring.bound import DetectedLooks, free_bound, position_and_velocity
from set_cases import WIDE
from set_flights import burns, flown, prior_sigma
from set_sights import horizon_axes

#: Step of the flights whose differences are the slopes, s.
FLIGHT_STEP_S = 1.0


class Bounds(NamedTuple):
    """Bounds at the scored ticks (k,) of a launch: RMS errors of position, m, and velocity, m/s.

    `log_det` is the logarithm of the determinant of the first bound's covariance (6 by 6),
    `energy_m` the energy score of position that an estimate with this covariance expects.
    """

    tick_s: np.ndarray
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    log_det: np.ndarray
    energy_m: np.ndarray
    free_position_m: np.ndarray
    free_velocity_m_s: np.ndarray


def bounds_of(scene, truth, sights, number):
    """Return the bounds of a launch."""
    launch = scene.launches[number]
    tick_s = truth.tick_s[truth.is_scored[number]]
    rows = np.flatnonzero(sights.launch == number)
    if not len(tick_s):
        return Bounds(*[np.empty(0)] * 7)
    looks = _looks(scene, sights, rows)
    times = np.concatenate([looks.look_s, tick_s])
    prior = prior_sigma(launch.stages, launch.has_gaps)
    slope = _slopes(launch, prior, times)
    known = parameter_bound(
        tick_s, looks, slope[: len(rows), :3], prior, _edges(launch, prior, looks.look_s)
    )
    covariance = bound_of(known, slope[len(rows) :])
    free = position_and_velocity(free_bound(tick_s, looks))
    drawn = energy_scores(np.zeros((len(tick_s), 3)), 2.0 * covariance[:, :3, :3])
    return Bounds(
        tick_s,
        *position_and_velocity(covariance),
        np.linalg.slogdet(covariance)[1],
        # E|X - X'|/2 of X, X' ~ N(0, B): with the truth at the mean of N(0, 2 B) the score is (1 -
        # 1/√2) E|X - X'|.
        drawn / (2.0 - np.sqrt(2.0)),
        *free,
    )


def _slopes(launch, prior, time_s):
    """Return the slopes (n, 6, p) of ECEF states at times (n,) by the parameters."""
    end_s = float(time_s.max()) + 1.0

    def states(rows):
        return flown(rows, launch.stages, end_s, FLIGHT_STEP_S).states(time_s)

    return central_slopes(states, launch.row, _steps(prior))


def _steps(prior):
    """Return steps of differences: 10 m of the launch, 1 µrad, 1 ms, and small shares of laws."""
    return np.concatenate([[10.0 / 6.4e6] * 2, [1e-6, 1e-3], 1e-4 * prior[4:]])


def _edges(launch, prior, look_s):
    """Return the times at which a launch lights or goes dark as values that become known one
    detection later.
    """
    gap_s = (look_s[-1] - look_s[0]) / max(len(look_s) - 1, 1)

    def edges(rows):
        both = np.array([burns(row, launch.stages).ravel() for row in rows])
        # Between stages without a gap nothing goes dark.
        return both if launch.has_gaps else both[:, [0, -1]]

    slope = central_slopes(edges, launch.row, _steps(prior))
    time_s = edges(launch.row[None])[0] + gap_s
    return KnownValues(time_s, slope * np.sqrt(12.0) / gap_s)


def _looks(scene, sights, rows):
    """Return the looks that detected a launch, with the noise and the biases that they truly
    have.
    """
    wide = efficient_sigma(scene.case.wide_share)
    sigma = np.array([sensor.sigma_rad for sensor in scene.sensors])[sights.sensor[rows]] * wide
    place = sights.sensor_m[rows]
    bias = np.array([sensor.true_bias_sigma_rad for sensor in scene.sensors])
    turns = np.zeros((len(rows), 2 * len(bias) if bias.any() else 0, 3))
    for number, axes in enumerate(horizon_axes(place)):
        if bias.any():
            turns[np.arange(len(rows)), 2 * sights.sensor[rows] + number] = (
                axes * bias[sights.sensor[rows], None]
            )
    return DetectedLooks(sights.time_s[rows], sights.target_m[rows], place, sigma, turns)


def efficient_sigma(wide_share):
    """Return the standard deviation with the Fisher information of the mixture of both noises, 1
    for no wide one.

    Of a two-dimensional error with density p the information per axis is half the integral of |grad
    p|² / p.
    """
    radius = np.linspace(0.0, 12.0 * WIDE, 20_001)
    parts = ((1.0 - wide_share, 1.0), (wide_share, WIDE))
    density = sum(
        share / (2.0 * np.pi * s**2) * np.exp(-0.5 * (radius / s) ** 2) for share, s in parts
    )
    slope = sum(
        -radius / s**2 * share / (2.0 * np.pi * s**2) * np.exp(-0.5 * (radius / s) ** 2)
        for share, s in parts
    )
    inner = np.divide(slope**2, density, out=np.zeros_like(radius), where=density > 1e-300)
    return float(1.0 / np.sqrt(0.5 * np.trapezoid(inner * 2.0 * np.pi * radius, radius)))
