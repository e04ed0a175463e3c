"""A labelled multi-Bernoulli filter on lines of sight, as a baseline of the tracking set.

Each label has a probability of existence and one normal distribution, to which the mixture over
associations is matched; the marginal probabilities of association are those of loopy belief
propagation (Reuter, Vo, Vo and Dietmayer, IEEE Trans. Signal Processing 62 (2014), 3246; Williams
and Lau, IEEE Trans. Aerospace and Electronic Systems 50 (2014), 2942). Labels are born of
detections of no label, near the ground on their line of sight, with the prior of `opir_stonesoup`.
Whether a label burns is a chain of two states, so that silence after burnout does not end it.
Motion is gravity and a nearly constant specific force, as of Stone Soup's filters here. Nothing is
tuned to the set.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_estimation import BOOST, FIRST_HEIGHT_M, Motion, tangent_axes
from opir_stonesoup.upkeep import ground_prior

from opir_core.arrays import FloatArray, IntArray
from opir_core.flight import Forces
from opir_core.geometry import (
    ecef_to_eci,
    ecef_to_eci_state,
    eci_to_ecef_state,
    intersection_with_ellipsoid,
)
from opir_core.plugin import Tracker, Tracks

SIZE = 9
#: Rates of ends, of burnouts and of ignitions after one, 1/s: once in ten minutes, and in a minute
#: (notional).
END_RATE = 1.0 / 600.0
SWITCH_RATE = 1.0 / 60.0
#: Least clutter, and expected new launches, a look and steradian (notional).
DENSITY = 1.0
#: Labels with a smaller probability of existence are pruned.
PRUNED = 1e-5
#: Squared Mahalanobis distance of the gate: 0.9999 of the detections of a label.
GATE = 18.4


class Labels(NamedTuple):
    """Labels (n,): numbers, probabilities of existence and of burning, and inertial states, (n, 9)
    and (n, 9, 9).
    """

    number: IntArray
    existence: FloatArray
    burning: FloatArray
    mean: FloatArray
    covariance: FloatArray

    def take(self, rows):
        """Return some labels."""
        return Labels(*(column[rows] for column in self))


class Look(NamedTuple):
    """A look: inertial position of the sensor (3,), directions (m, 3), their noise, rad, P_d of
    burning targets and the density of clutter, 1/sr.
    """

    origin: FloatArray
    direction: FloatArray
    sigma: float
    chance: float
    clutter: float


class LmbTracker(Tracker):
    """The filter, stepped as a tracker of opir; `clutter_per_sr` is the density of clutter in a
    look.
    """

    def __init__(self, context, detection_probability, clutter_per_sr):
        self.cadence_s = 1.0
        self._motion = Motion(SIZE, 2.0, Forces(zonal=()))
        self._state_motion = evolve(self._motion, size=BOOST)
        self._chance = detection_probability
        self._clutter = max(clutter_per_sr, DENSITY)
        blank = np.empty(0)
        state = np.empty((0, SIZE))
        covariance = np.empty((0, SIZE, SIZE))
        self._labels = Labels(blank.astype(np.int64), blank, blank, state, covariance)
        self._time_s = 0.0
        self._births = 0

    def associate(self, detections):
        """Return -1 for each detection: the filter keeps no hard associations."""
        return np.full(len(detections), -1, dtype=np.int64)

    def step(self, tick_s, detections):
        """Return the labels that probably exist at a tick."""
        times = np.round(detections.time_s, 6)
        for time_s in np.unique(times).tolist():
            for sensor in np.unique(detections.sensor[times == time_s]).tolist():
                rows = np.flatnonzero((times == time_s) & (detections.sensor == sensor))
                self._update(time_s, detections.take(rows))
        self._predict(tick_s)
        return self._report(tick_s)

    def _predict(self, time_s):
        """Predict all labels to a time."""
        span_s = time_s - self._time_s
        labels = self._labels
        self._time_s = time_s
        if span_s <= 0.0 or not len(labels.number):
            return
        step_s = np.full(len(labels.number), span_s)
        padded = np.concatenate([labels.mean, np.zeros((len(step_s), 3))], axis=1)
        matrix = self._motion.transition(labels.mean, step_s)
        root = self._motion.noise_root(step_s)
        assert root is not None
        noise = root @ root.transpose(0, 2, 1)
        same = np.exp(-SWITCH_RATE * span_s)
        self._labels = labels._replace(
            existence=labels.existence * np.exp(-END_RATE * span_s),
            burning=labels.burning * same + (1.0 - labels.burning) * (1.0 - same),
            mean=self._state_motion.propagated(padded, step_s)[:, :SIZE],
            covariance=matrix @ labels.covariance @ matrix.transpose(0, 2, 1) + noise,
        )

    def _update(self, time_s, seen):
        """Update all labels by one look of a sensor, and begin new ones."""
        self._predict(time_s)
        times = np.full(len(seen), time_s)
        look = Look(
            ecef_to_eci(seen.sensor_ecef_m, times)[0],
            ecef_to_eci(seen.line_of_sight_ecef, times),
            float(seen.line_of_sight_sigma_rad[0]),
            self._chance,
            self._clutter,
        )
        labels, assigned = updated(self._labels, look)
        self._labels = labels.take(np.flatnonzero(labels.existence > PRUNED))
        self._begin(time_s, seen, look, (1.0 - assigned) * DENSITY / (DENSITY + self._clutter))

    def _begin(self, time_s, seen, look, existence):
        """Add a label for each detection that is probably of no label and meets the Earth."""
        place = intersection_with_ellipsoid(
            seen.sensor_ecef_m, seen.line_of_sight_ecef, FIRST_HEIGHT_M
        )
        for row in np.flatnonzero((existence > PRUNED) & np.isfinite(place).all(axis=1)).tolist():
            mean, covariance = inertial(*ground_prior(place[row], SIZE), time_s)
            one = np.ones(1)
            label = Labels(np.array([self._births]), one, one, mean[None], covariance[None])
            # Certain to be it: its own detection, and no clutter.
            direction = look.direction[row : row + 1]
            label, _ = updated(label, look._replace(direction=direction, chance=1.0, clutter=0.0))
            label = label._replace(existence=existence[row : row + 1])
            pairs = zip(self._labels, label, strict=True)
            self._labels = Labels(*(np.concatenate(pair) for pair in pairs))
            self._births += 1

    def _report(self, tick_s):
        labels = self._labels.take(np.flatnonzero(self._labels.existence > 0.5))
        labels = labels.take(np.argsort(labels.number))
        count = len(labels.number)
        time_s = np.full(count, tick_s)
        state = eci_to_ecef_state(labels.mean[:, :3], labels.mean[:, 3:6], time_s)
        turn = earth_fixed(tick_s)
        unknown = np.full((count, 3, 3), np.nan)
        return Tracks(
            tick_s=time_s,
            track=labels.number,
            state=np.concatenate(state, axis=1),
            state_covariance=turn @ labels.covariance[:, :6, :6] @ turn.T,
            launch=unknown[:, 0],
            launch_covariance=unknown,
            impact=unknown[:, 0],
            impact_covariance=unknown,
            type_probability=np.full((count, 4), np.nan),
        )


class Residuals(NamedTuple):
    """Detections (m,) across the predictions of labels (n,): residuals (n, m, 2), their spread and
    its inverse (n, 2, 2), covariance with the state (n, 9, 2), likelihoods (n, m), 0 outside of the
    gate.
    """

    residual: FloatArray
    spread: FloatArray
    inverse: FloatArray
    across: FloatArray
    density: FloatArray


def residuals(labels, look):
    """Return the residuals of a look."""
    line = labels.mean[:, :3] - look.origin
    range_m = np.sqrt(np.sum(line * line, axis=1))
    axis = line / range_m[:, None]
    axes = tangent_axes(axis)[:, :2]
    slope = np.zeros((len(line), 2, SIZE))
    slope[:, :, :3] = axes / range_m[:, None, None]
    across = labels.covariance @ slope.transpose(0, 2, 1)
    spread = slope @ across + look.sigma**2 * np.eye(2)
    residual = np.einsum("nkc,mc->nmk", axes, look.direction)
    inverse = np.linalg.inv(spread)
    distance = np.einsum("nmk,nkl,nml->nm", residual, inverse, residual)
    density = np.exp(-0.5 * distance) / (2.0 * np.pi * np.sqrt(np.linalg.det(spread)))[:, None]
    is_gated = (distance < GATE) & (axis @ look.direction.T > 0.0)
    return Residuals(residual, spread, inverse, across, density * is_gated)


def updated(labels, look):
    """Return labels (n,) after a look, and the probability (m,) that each detection is a label's."""
    seen = residuals(labels, look)
    detected = look.chance * labels.burning * labels.existence
    weight = detected[:, None] * seen.density
    missed = 1.0 - detected
    ratio = weight / look.clutter if look.clutter else np.full_like(weight, 1e12)
    marginal = association(ratio, missed)
    hits = marginal.sum(axis=1)
    dark = 1.0 - look.chance * labels.burning
    silent = (1.0 - hits) * labels.existence * dark / np.maximum(missed, 1e-12)
    existence = hits + silent
    share = marginal / np.maximum(existence, 1e-300)[:, None]
    hit = share.sum(axis=1)
    burning = labels.burning * (1.0 - look.chance) / np.maximum(dark, 1e-12)
    after = merged(labels, seen, share)._replace(
        existence=np.minimum(existence, 1.0 - 1e-12), burning=hit + (1.0 - hit) * burning
    )
    return after, np.minimum(marginal.sum(axis=0), 1.0)


def merged(labels, seen, share):
    """Return labels with states matched to the mixture over detections with shares (n, m)."""
    gain = seen.across @ seen.inverse
    mean = np.einsum("nm,nmk->nk", share, seen.residual)
    scatter = np.einsum("nm,nmk,nml->nkl", share, seen.residual, seen.residual)
    scatter -= mean[:, :, None] * mean[:, None, :]
    hit = share.sum(axis=1)
    shrunk = gain @ (hit[:, None, None] * seen.spread - scatter) @ gain.transpose(0, 2, 1)
    covariance = labels.covariance - shrunk
    return labels._replace(
        mean=labels.mean + np.einsum("nck,nk->nc", gain, mean),
        covariance=0.5 * (covariance + covariance.transpose(0, 2, 1)),
    )


def association(weight, missed):
    """Return the marginal probabilities (n, m) that detections are labels', by loopy belief
    propagation.

    `weight` (n, m) are the weights of pairs over that of clutter, `missed` (n,) those of no
    detection.
    """
    ratio = weight / np.maximum(missed, 1e-12)[:, None]
    back = np.ones_like(ratio)
    # Sums without the own term, not differences to the total: weights differ by more than sixteen
    # digits.
    labels, detections = (1.0 - np.eye(size) for size in ratio.shape)
    for _ in range(40):
        forth = ratio / (1.0 + (ratio * back) @ detections)
        back = 1.0 / (1.0 + labels @ forth)
    belief = ratio * back
    return np.asarray(belief / (1.0 + belief.sum(axis=1, keepdims=True)))


def inertial(mean, covariance, time_s):
    """Return an Earth-fixed mean (9, 1) and covariance (9, 9) as inertial ones, (9,) and (9, 9)."""
    row = mean.T
    time = np.full(1, time_s)
    place, velocity = ecef_to_eci_state(row[:, :3], row[:, 3:6], time)
    force = ecef_to_eci(row[:, 6:9], time)
    turn = np.zeros((SIZE, SIZE))
    turn[:6, :6] = np.linalg.inv(earth_fixed(time_s))
    turn[6:, 6:] = turn[:3, :3]
    return np.concatenate([place, velocity, force], axis=1)[0], turn @ covariance @ turn.T


def earth_fixed(time_s):
    """Return the matrix (6, 6) from inertial to Earth-fixed states."""
    unit = np.eye(6)
    state = eci_to_ecef_state(unit[:, :3], unit[:, 3:], np.full(6, time_s))
    return np.concatenate(state, axis=1).T
