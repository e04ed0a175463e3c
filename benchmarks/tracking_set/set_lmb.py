"""A labelled multi-Bernoulli filter on lines of sight, as a baseline of the tracking set.

Each label has a probability of existence and one normal distribution, to which the mixture over
associations is matched; the marginal probabilities of association are those of loopy belief
propagation (Reuter, Vo, Vo and Dietmayer, IEEE Trans. Signal Processing 62 (2014), 3246; Williams
and Lau, IEEE Trans. Aerospace and Electronic Systems 50 (2014), 2942). Labels are born of
detections that are no label's, near the ground on their line of sight, with the prior of
`opir_stonesoup`. Whether a label burns is a chain of two states, so that silence after burnout does
not end it. Motion is gravity and a nearly constant specific force, as of Stone Soup's filters here.
Nothing is tuned to the set.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_stonesoup.upkeep import ground_prior
from opir_trackers import FIRST_HEIGHT_M

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import BOOST, Motion, tangent_axes
from opir_core.flight import Forces
from opir_core.geometry import (
    ecef_to_eci,
    ecef_to_eci_state,
    eci_to_ecef_state,
    intersection_with_ellipsoid,
)
from opir_core.plugin import Detections, Tracker, TrackerContext, Tracks

SIZE = 9
NOISE = 2.0
#: Rates of ends, of burnouts and of ignitions after one, 1/s: once in ten minutes, and in a minute
#: (notional).
END_RATE = 1.0 / 600.0
BURNOUT_RATE = 1.0 / 60.0
RELIGHT_RATE = 1.0 / 60.0
#: Expected new launches, and least clutter, a look and steradian (notional).
BIRTHS = 1.0
LEAST_CLUTTER = 1.0
#: Labels with a smaller probability of existence are pruned, those with a greater one than
#: `REPORTED` reported.
PRUNED = 1e-5
REPORTED = 0.5
#: Squared Mahalanobis distance of the gate: 0.9999 of the detections of a label.
GATE = 18.4
SWEEPS = 40


class Labels(NamedTuple):
    """Labels (n,): numbers, probabilities of existence and of burning, and inertial states, (n, 9)
    and (n, 9, 9).
    """

    number: IntArray
    existence: FloatArray
    burning: FloatArray
    mean: FloatArray
    covariance: FloatArray

    def at(self, rows: IntArray) -> "Labels":
        """Return some labels."""
        return Labels(*(column[rows] for column in self))


class LmbTracker(Tracker):
    """The filter, stepped as a tracker of opir; `clutter_per_sr` is the density of clutter in a
    look.
    """

    def __init__(
        self, context: TrackerContext, detection_probability: float, clutter_per_sr: float
    ) -> None:
        self.cadence_s: float | None = 1.0
        self._motion = Motion(SIZE, NOISE, Forces(zonal=()))
        self._whole = evolve(self._motion, size=BOOST)
        self._chance = detection_probability
        self._clutter = max(clutter_per_sr, LEAST_CLUTTER)
        self._labels = Labels(
            np.empty(0, dtype=np.int64),
            np.empty(0),
            np.empty(0),
            np.empty((0, SIZE)),
            np.empty((0, SIZE, SIZE)),
        )
        self._now_s = 0.0
        self._next = 0

    def associate(self, detections: Detections) -> IntArray:
        """Return -1 for each detection: the filter keeps no hard associations."""
        return np.full(len(detections), -1, dtype=np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the labels that probably exist at a tick."""
        times = np.round(detections.time_s, 6)
        for time_s in np.unique(times).tolist():
            for sensor in np.unique(detections.sensor[times == time_s]).tolist():
                self._look(
                    time_s,
                    detections.take(
                        np.flatnonzero((times == time_s) & (detections.sensor == sensor))
                    ),
                )
        self._predict(tick_s)
        return self._report(tick_s)

    def _predict(self, time_s: float) -> None:
        """Predict all labels to a time."""
        span = time_s - self._now_s
        old = self._labels
        self._now_s = time_s
        if span <= 0.0 or not len(old.number):
            return
        step = np.full(len(old.number), span)
        wide = np.concatenate([old.mean, np.zeros((len(step), 3))], axis=1)
        matrix = self._motion.transition(old.mean, step)
        root = self._motion.noise_root(step)
        assert root is not None
        spread = matrix @ old.covariance @ matrix.transpose(0, 2, 1) + root @ root.transpose(
            0, 2, 1
        )
        out = np.exp(-BURNOUT_RATE * span)
        back = -np.expm1(-RELIGHT_RATE * span)
        self._labels = Labels(
            old.number,
            old.existence * np.exp(-END_RATE * span),
            old.burning * out + (1.0 - old.burning) * back,
            self._whole.propagated(wide, step)[:, :SIZE],
            spread,
        )

    def _look(self, time_s: float, seen: Detections) -> None:
        """Update all labels by one look of a sensor, and begin new ones."""
        self._predict(time_s)
        when = np.full(len(seen), time_s)
        direction = ecef_to_eci(seen.line_of_sight_ecef, when)
        origin = ecef_to_eci(seen.sensor_ecef_m, when)[0]
        sigma = float(seen.line_of_sight_sigma_rad[0])
        self._labels, taken = updated(
            self._labels, origin, direction, sigma, self._chance, self._clutter
        )
        self._labels = self._labels.at(np.flatnonzero(self._labels.existence > PRUNED))
        self._begin(
            time_s,
            seen,
            direction,
            origin,
            sigma,
            (1.0 - taken) * BIRTHS / (BIRTHS + self._clutter),
        )

    def _begin(
        self,
        time_s: float,
        seen: Detections,
        direction: FloatArray,
        origin: FloatArray,
        sigma: float,
        existence: FloatArray,
    ) -> None:
        """Add a label for each detection that is probably no label's and meets the Earth."""
        place = intersection_with_ellipsoid(
            seen.sensor_ecef_m, seen.line_of_sight_ecef, FIRST_HEIGHT_M
        )
        for row in np.flatnonzero((existence > PRUNED) & np.isfinite(place).all(axis=1)).tolist():
            mean, covariance = inertial(*ground_prior(place[row], SIZE), time_s)
            fresh = Labels(
                np.array([self._next]), np.ones(1), np.ones(1), mean[None], covariance[None]
            )
            # Certain to be it: its own detection, and no clutter.
            fresh, _ = updated(fresh, origin, direction[row : row + 1], sigma, 1.0, 0.0)
            fresh = fresh._replace(existence=existence[row : row + 1])
            self._labels = Labels(
                *(np.concatenate(pair) for pair in zip(self._labels, fresh, strict=True))
            )
            self._next += 1

    def _report(self, tick_s: float) -> Tracks:
        labels = self._labels.at(np.flatnonzero(self._labels.existence > REPORTED))
        count = len(labels.number)
        place, speed = eci_to_ecef_state(
            labels.mean[:, :3], labels.mean[:, 3:6], np.full(count, tick_s)
        )
        turn = earth_fixed(tick_s)
        order = np.argsort(labels.number)
        return Tracks(
            tick_s=np.full(count, tick_s),
            track=labels.number[order],
            state=np.concatenate([place, speed], axis=1)[order],
            state_covariance=(turn @ labels.covariance[:, :6, :6] @ turn.T)[order],
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
            impact=np.full((count, 3), np.nan),
            impact_covariance=np.full((count, 3, 3), np.nan),
            type_probability=np.full((count, 4), np.nan),
        )


def updated(
    labels: Labels,
    origin: FloatArray,
    direction: FloatArray,
    sigma: float,
    chance: float,
    clutter: float,
) -> tuple[Labels, FloatArray]:
    """Return labels (n,) after a look with directions (m, 3), and the probability (m,) that each is
    a label's.
    """
    line = labels.mean[:, :3] - origin
    range_m = np.sqrt(np.sum(line * line, axis=1))
    axes = tangent_axes(line / range_m[:, None])[:, :2]
    slope = np.zeros((len(line), 2, SIZE))
    slope[:, :, :3] = axes / range_m[:, None, None]
    spread = slope @ labels.covariance @ slope.transpose(0, 2, 1) + sigma**2 * np.eye(2)
    off = np.einsum("nkc,mc->nmk", axes, direction)
    inverse = np.linalg.inv(spread)
    distance = np.einsum("nmk,nkl,nml->nm", off, inverse, off)
    density = np.exp(-0.5 * distance) / (2.0 * np.pi * np.sqrt(np.linalg.det(spread)))[:, None]
    is_ahead = (line / range_m[:, None]) @ direction.T > 0.0
    seen = (
        (chance * labels.burning * labels.existence)[:, None]
        * density
        * ((distance < GATE) & is_ahead)
    )
    missed = 1.0 - chance * labels.burning * labels.existence
    marginal = association(seen / clutter if clutter else np.full_like(seen, 1e12), missed)
    silent = (
        (1.0 - marginal.sum(axis=1))
        * labels.existence
        * (1.0 - chance * labels.burning)
        / np.maximum(missed, 1e-12)
    )
    existence = marginal.sum(axis=1) + silent
    weight = marginal / np.maximum(existence, 1e-300)[:, None]
    hit = weight.sum(axis=1)
    still = labels.burning * (1.0 - chance) / np.maximum(1.0 - chance * labels.burning, 1e-12)
    gain = labels.covariance @ slope.transpose(0, 2, 1) @ inverse
    mean_off = np.einsum("nm,nmk->nk", weight, off)
    scatter = (
        np.einsum("nm,nmk,nml->nkl", weight, off, off) - mean_off[:, :, None] * mean_off[:, None, :]
    )
    shrunk = gain @ (hit[:, None, None] * spread - scatter) @ gain.transpose(0, 2, 1)
    covariance = labels.covariance - shrunk
    return (
        Labels(
            labels.number,
            np.minimum(existence, 1.0 - 1e-12),
            hit + (1.0 - hit) * still,
            labels.mean + np.einsum("nck,nk->nc", gain, mean_off),
            0.5 * (covariance + covariance.transpose(0, 2, 1)),
        ),
        np.minimum(marginal.sum(axis=0), 1.0),
    )


def association(seen: FloatArray, missed: FloatArray) -> FloatArray:
    """Return the marginal probabilities (n, m) that detections are labels', by loopy belief
    propagation.

    `seen` (n, m) are the weights of pairs over that of clutter, `missed` (n,) those of no
    detection.
    """
    ratio = seen / np.maximum(missed, 1e-12)[:, None]
    back = np.ones_like(ratio)
    # Sums over all others, not differences to the whole: weights differ by more than sixteen
    # digits.
    labels, detections = (1.0 - np.eye(size) for size in ratio.shape)
    for _ in range(SWEEPS):
        forth = ratio / (1.0 + (ratio * back) @ detections)
        back = 1.0 / (1.0 + labels @ forth)
    weighed = ratio * back
    return np.asarray(weighed / (1.0 + weighed.sum(axis=1, keepdims=True)))


def inertial(
    mean: FloatArray, covariance: FloatArray, time_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return an Earth-fixed mean (9, 1) and covariance (9, 9) as inertial ones, (9,) and (9, 9)."""
    flat = mean[:, 0]
    when = np.full(1, time_s)
    place, speed = ecef_to_eci_state(flat[None, :3], flat[None, 3:6], when)
    force = ecef_to_eci(flat[None, 6:9], when)
    turn = np.zeros((SIZE, SIZE))
    turn[:6, :6] = np.linalg.inv(earth_fixed(time_s))
    turn[6:, 6:] = turn[:3, :3]
    return np.concatenate([place[0], speed[0], force[0]]), turn @ covariance @ turn.T


def earth_fixed(time_s: float) -> FloatArray:
    """Return the matrix (6, 6) from inertial to Earth-fixed states."""
    unit = np.eye(6)
    place, speed = eci_to_ecef_state(unit[:, :3], unit[:, 3:], np.full(6, time_s))
    return np.concatenate([place, speed], axis=1).T
