"""Position, velocity and force along a single sensor's line of sight, given the law of boosts.

A boost begins on the ground, so the first line of sight leads there. Since then each ascent of the
law (`ascents`), in the direction that fits best, leads to a place and a motion in the image plane;
those near to the measured ones say how far away the target is (`kernel_regression`).
"""

from typing import NamedTuple

import numpy as np
from opir_estimation import GRAZING_SINE, SPIN

from opir_core.arrays import FloatArray, IntArray
from opir_forecast.ascents import AscentRows, BoostAscents
from opir_forecast.kernel_regression import LAW, hidden_moments
from opir_forecast.planar_boost import RADIUS_M


class Sighting(NamedTuple):
    """Measurements of a target by one sensor, in ECEF, m and m/s.

    `first_sensor_m` and `first_m` (3,) are the sensor at the first detection, `since_s` ago, and a
    point on its line of sight at that time; `first_sigma_m` is the error of the line's height
    there, `ground_radius_m` the distance of the ground there from the Earth's centre. `sensor_m`
    and `sensor_m_s` are the sensor at present. `state` (9,) is position, velocity relative to the
    Earth and specific force by the filter, whose components along the line of sight are not used.
    `axes` and `first_axes` (2, 3) are those of the image plane at present and at the first
    detection, `first_m_s` (2,) the velocity along the latter at that time. `noise` (8, 8) is the
    covariance of the state along the former, and of `first_m_s`. `has_ended` says whether the burn
    ends at present, or goes on.
    """

    first_sensor_m: FloatArray
    first_m: FloatArray
    first_sigma_m: float
    ground_radius_m: float
    since_s: float
    sensor_m: FloatArray
    sensor_m_s: FloatArray
    state: FloatArray
    axes: FloatArray
    first_axes: FloatArray
    first_m_s: FloatArray
    noise: FloatArray
    has_ended: bool = False


class AlongSight(NamedTuple):
    """Mean (3,) and covariance (3, 3) of position, velocity and force along the line of sight;
    effective samples.
    """

    mean: FloatArray
    covariance: FloatArray
    samples: float


def along_sight(
    ascents: BoostAscents, sighting: Sighting, ignition_s: FloatArray
) -> AlongSight | None:
    """Return the moments along the line of sight by ascents; None if too few are alike.

    `ignition_s` (k, n) are k equally probable times from the ignition of each ascent to the first
    detection.
    """
    paths = _burning_paths(sighting, ascents, ignition_s)
    if len(paths.log_weight) < LAW.enough:
        return None
    scale = _scale(sighting)
    log, path, azimuth = _minima(*paths.linear(sighting, LAW.choice * scale), paths.log_weight)
    best = np.argsort(-log)[: LAW.compared]
    path = path[best]
    differences, hidden = paths.compared(sighting, path, azimuth[best])
    log_prior = paths.log_weight[path]
    # One sensor has nothing but the law to go by.
    moments = hidden_moments(differences, hidden, scale, sighting.noise, log_prior, law_errs=True)
    if moments is None:
        return None
    result = AlongSight(*moments)
    result.covariance[0, 0] += _ground_variance(sighting)
    return result


def _ground_variance(sighting: Sighting) -> float:
    """Return the variance, m², of where the first line of sight meets the ground, along it."""
    line = sighting.first_m - sighting.first_sensor_m
    length = np.linalg.norm(line) * np.linalg.norm(sighting.first_m)
    sine = -float(line @ sighting.first_m) / float(length)
    return (sighting.first_sigma_m / max(sine, GRAZING_SINE)) ** 2


def _scale(sighting: Sighting) -> FloatArray:
    """Return the widths (8,) of the narrowest kernel."""
    speed = float(np.linalg.norm(sighting.axes @ sighting.state[3:6]))
    width_m_s = LAW.speed_share * max(speed, LAW.slowest_m_s)
    position_m = 0.5 * sighting.since_s * width_m_s
    return np.repeat([position_m, width_m_s, LAW.force_m_s2, LAW.first_velocity_m_s], 2)


class _Paths(NamedTuple):
    """Ascents (n,) that begin on a line of sight: first places and axes up, east and north (3, n).

    `first` (2, n) are level and vertical velocities at the first detection, `motion` (3, 2, n)
    level and vertical components of present positions from the Earth's centre, velocities and
    forces. `moved` (4, n) are cosine and sine of the angle over the ground since the first
    detection, and the integrals of distances and heights gained since then, for the Coriolis force.
    """

    start_m: FloatArray
    up: FloatArray
    east: FloatArray
    north: FloatArray
    first: FloatArray
    motion: FloatArray
    moved: FloatArray
    log_weight: FloatArray

    def states(self, path: IntArray, azimuth: FloatArray) -> FloatArray:
        """Return places, velocities, forces and first velocities (4, m, 3) of ascents (m,) towards
        azimuths (m,).
        """
        zenith = self.up[:, path]
        course = np.sin(azimuth) * self.east[:, path] + np.cos(azimuth) * self.north[:, path]
        cosine, sine, distance_s, height_s = self.moved[:, path]
        up = cosine * zenith + sine * course
        level = cosine * course - sine * zenith
        motion = self.motion[:, :, None, path]
        place, velocity, force = motion[:, 0] * level + motion[:, 1] * up
        velocity -= 2.0 * SPIN @ (place - self.start_m[:, path])
        place = place - 2.0 * SPIN @ (distance_s * course + height_s * zenith)
        first_velocity = self.first[0, path] * course + self.first[1, path] * zenith
        return np.stack([place, velocity, force, first_velocity]).mT

    def compared(
        self, sighting: Sighting, path: IntArray, azimuth: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the differences (m, 8) of ascents (m,) from the measurements, and their hidden
        components (m, 3).

        Positions and motions are seen as angles, at the range of the state.
        """
        place, velocity, force, first_velocity = self.states(path, azimuth)
        line = sighting.state[:3] - sighting.sensor_m
        range_m = float(np.linalg.norm(line))
        line = line / range_m
        axes = sighting.axes.T
        relative = place - sighting.sensor_m
        drift = velocity - sighting.sensor_m_s
        scale = (range_m / (relative @ line))[:, None]
        offset = relative @ axes * scale
        turn = drift @ axes * scale - offset * (drift @ line)[:, None] / range_m * scale
        _, speed, push = sighting.state.reshape(3, 3)
        differences = [
            offset,
            turn - (speed - sighting.sensor_m_s) @ axes,
            force @ axes * scale - push @ axes,
            first_velocity @ sighting.first_axes.T - sighting.first_m_s,
        ]
        hidden = [vector @ line for vector in (place, velocity, force)]
        return np.concatenate(differences, axis=1), np.stack(hidden, axis=1)

    def linear(self, sighting: Sighting, width: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return A (8, n) and M (8, 2, n): far from the sensor, ascents differ from the
        measurements by A + M (cos, sin).

        The angle is the azimuth; the rows are in units of a kernel's widths (8,) and the noise.
        """
        cosine, sine, distance_s, height_s = self.moved
        image, turn, first_image = (
            np.tensordot(axes, np.stack([self.north, self.east, self.up], axis=1), axes=1)
            for axes in (sighting.axes, -2.0 * sighting.axes @ SPIN, sighting.first_axes)
        )
        level, climb = self.motion.swapaxes(0, 1)
        first_level, first_climb = self.first
        shift = (climb * cosine - level * sine)[:, None] * image[:, 2]
        shift[0] += height_s * turn[:, 2]
        shift -= (sighting.state.reshape(3, 3) @ sighting.axes.T)[:, :, None]
        slope = (level * cosine + climb * sine)[:, None, None] * image[:, :2]
        slope[0] += distance_s * turn[:, :2]
        first_shift = first_climb * first_image[:, 2] - sighting.first_m_s[:, None]
        size = 1.0 / np.sqrt(width * width + np.diag(sighting.noise))
        shift = np.concatenate([*shift, first_shift]) * size[:, None]
        slope = np.concatenate([*slope, first_level * first_image[:, :2]])
        return shift, slope * size[:, None, None]


def _burning_rows(
    ascents: BoostAscents, ignition_s: FloatArray, sighting: Sighting
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows at the first detection and at present (8, n), and the log weights (n,), of
    ascents that burn at both.

    Where a boost leads is no part of the weights: the forecast weighs ends, and no prior counts
    twice.
    """
    since_s = sighting.since_s
    burning = []
    for times_s in ignition_s:
        start, burns_at_start = ascents.at(times_s)
        end, burns = ascents.at(times_s + since_s)
        ascent = np.flatnonzero(burns_at_start & burns)
        log_weight = ascents.log_share[ascent]
        if sighting.has_ended:
            log_weight = log_weight + ascents.endings.log_rates(ascent, times_s[ascent] + since_s)
        burning.append((start[:, ascent], end[:, ascent], log_weight))
    start, end, log_weight = (
        np.concatenate(columns, axis=-1) for columns in zip(*burning, strict=True)
    )
    return start, end, log_weight


def _burning_paths(sighting: Sighting, ascents: BoostAscents, ignition_s: FloatArray) -> _Paths:
    """Return the ascents that burn at the first detection, on its line of sight, and at present."""
    since_s = sighting.since_s
    start, end, log_weight = _burning_rows(ascents, ignition_s, sighting)
    initial = AscentRows(*start)
    present = AscentRows(*end)
    place, up, east = _starts(sighting, initial.height)
    radius = sighting.ground_radius_m + present.height
    motion = [
        [np.zeros_like(radius), radius],
        [present.level, present.climb],
        [present.level_force, present.lift],
    ]
    return _Paths(
        place,
        up,
        east,
        np.cross(up, east, axis=0),
        np.array([initial.level, initial.climb]),
        np.array(motion),
        _moved(initial, present, since_s),
        log_weight,
    )


def _moved(initial: AscentRows, present: AscentRows, since_s: float) -> FloatArray:
    """Return cosine and sine of the angle over the ground since the first detection, and the
    integrals of distances and heights gained since then (4, n).
    """
    angle = present.angle - initial.angle
    distance_s = present.distance_s - initial.distance_s - RADIUS_M * initial.angle * since_s
    height_s = present.height_s - initial.height_s - initial.height * since_s
    return np.array([np.cos(angle), np.sin(angle), distance_s, height_s])


def _starts(sighting: Sighting, height_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places (3, n) on the first line of sight at heights (n,), and axes up and east."""
    sensor = sighting.first_sensor_m
    line = sighting.first_m - sensor
    line = line / np.linalg.norm(line)
    nadir = float(sensor @ line)
    radius = sighting.ground_radius_m + height_m
    chord = np.maximum(nadir * nadir - float(sensor @ sensor) + radius * radius, 0.0)
    start = sensor[:, None] + line[:, None] * (-nadir - np.sqrt(chord))
    return start, *_up_and_east(start)


def _up_and_east(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors up and east (3, n) at places (3, n)."""
    up = place / np.sqrt(np.sum(place * place, axis=0))
    horizontal = np.maximum(np.hypot(up[0], up[1]), 1e-9)
    return up, np.stack([-up[1], up[0], np.zeros(len(horizontal))]) / horizontal


def _minima(
    shift: FloatArray, slope: FloatArray, log_weight: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return log weights, numbers and azimuths of the minima of |A + M (cos, sin)|², A (8, n), M
    (8, 2, n).
    """
    terms = _terms(shift, slope)
    azimuth = 2.0 * np.pi * np.arange(LAW.directions) / LAW.directions
    cost = _powers(azimuth).T @ terms
    is_minimum = (cost <= np.roll(cost, 1, axis=0)) & (cost < np.roll(cost, -1, axis=0))
    direction, path = is_minimum.nonzero()
    terms = terms[:, path]
    angle, curvature = _refined(terms, azimuth[direction])
    total = np.sum(shift * shift, axis=0)[path] + np.sum(terms * _powers(angle), axis=0)
    # All azimuths are equally probable: the integral over one is that of a normal density about the
    # minimum.
    return log_weight[path] - 0.5 * total - 0.5 * np.log(curvature), path, angle


def _terms(shift: FloatArray, slope: FloatArray) -> FloatArray:
    """Return the factors (5, n) of `_powers` in |A + M (cos, sin)|²."""
    north, east = slope.swapaxes(0, 1)
    products = north * shift, east * shift, north * north, north * east, east * east
    terms = np.stack([np.sum(product, axis=0) for product in products])
    terms[[0, 1, 3]] *= 2.0
    return terms


def _refined(terms: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return minima (m,) of forms with terms (5, m), near angles (m,), and their curvatures, by
    Newton's method.
    """
    curvature = np.ones_like(angle)
    for _ in range(LAW.refinements):
        c, s, *_ = _powers(angle)
        tilt = terms[4] - terms[2]
        turn = c * c - s * s
        gradient = -terms[0] * s + terms[1] * c + 2.0 * tilt * c * s + terms[3] * turn
        curvature = np.maximum(
            -terms[0] * c - terms[1] * s + 2.0 * tilt * turn - 4.0 * terms[3] * c * s, 1.0
        )
        step = np.clip(gradient / curvature, -LAW.most_turn_rad, LAW.most_turn_rad)
        angle = angle - step
    return angle, curvature


def _powers(angle: FloatArray) -> FloatArray:
    """Return cos, sin, cos², cos sin and sin² (5, m) of angles (m,)."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.stack([c, s, c * c, c * s, s * s])
