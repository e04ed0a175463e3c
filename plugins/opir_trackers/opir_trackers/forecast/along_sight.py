"""What one sensor does not see: position, velocity and force along its line of sight, given the law
of boosts.

A boost begins on the ground, so the first line of sight says where. Since then each ascent of the
law (`ascents`), in the direction that fits best, leads to a place and a motion in the image plane;
those near to what is seen there say how far away the target is (`kernel_regression`).
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.forecast.ascents import (
    ABOVE_S,
    AHEAD_S,
    ANGLE,
    CLIMB,
    HEIGHT,
    LEVEL,
    LEVEL_FORCE,
    LIFT,
    BoostAscents,
)
from opir_trackers.forecast.kernel_regression import ENOUGH, hidden_moments
from opir_trackers.forecast.planar_boost import RADIUS_M
from opir_trackers.lines_of_sight import SPIN
from opir_trackers.triangulation import GRAZING_SINE

#: Directions over the ground in which an ascent is tried before the best are refined, and steps of
#: that.
_DIRECTIONS = 24
_REFINEMENTS = 3

#: Most ascents that are compared exactly.
_MOST = 400

#: Width of the narrowest kernel: a share of the speed in the image plane, of the force, m/s², and
#: of the velocity at the first detection, m/s. Wider ones are multiples of it. Positions have that
#: of the velocity times half of the time.
_SHARE = 0.06
_FORCE_M_S2 = 3.0
_FIRST_M_S = 6.0
_SLOWEST_M_S = 100.0

#: The kernel of the first choice.
_CHOICE = 2.0


class Sighting(NamedTuple):
    """What one sensor sees of a target, in ECEF, m and m/s.

    `first_sensor_m` and `first_m` (3,) are the sensor at the first detection, `since_s` ago, and a
    point on its line of sight then; `first_sigma_m` is the error of the line's height there,
    `ground_radius_m` the distance of the ground there from the Earth's centre. `sensor_m` and
    `sensor_m_s` are the sensor now. `state` (9,) is position, velocity relative to the Earth and
    specific force by the filter, of which what is along the line of sight is not used. `axes` and
    `first_axes` (2, 3) are those of the image plane now and then, `first_m_s` (2,) the velocity
    along the latter then. `noise` (8, 8) is the covariance of the state along the former, and of
    `first_m_s`.
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
    """Return what ascents say along the line of sight; None if too few are like it.

    `ignition_s` (k, n) are k equally probable times from the ignition of each ascent to the first
    detection.
    """
    paths = [_Paths.of(sighting, ascents, each) for each in ignition_s]
    if sum(len(each.log_weight) for each in paths) < ENOUGH:
        return None
    path = _Paths(*(np.concatenate(columns, axis=-1) for columns in zip(*paths, strict=True)))
    scale = _scale(sighting)
    log, which, azimuth = _minima(*path.linear(sighting, _CHOICE * scale), path.log_weight)
    best = np.argsort(-log)[:_MOST]
    which = which[best]
    azimuth = azimuth[best]
    seen, hidden = path.compared(sighting, which, azimuth)
    moments = hidden_moments(seen, hidden, scale, sighting.noise, path.log_weight[which])
    if moments is None:
        return None
    found = AlongSight(*moments)
    found.covariance[0, 0] += _ground_variance(sighting)
    return found


def _ground_variance(sighting: Sighting) -> float:
    """Return the variance, m², of where the first line of sight meets the ground, along it."""
    line = sighting.first_m - sighting.first_sensor_m
    sine = -float(line @ sighting.first_m) / float(
        np.linalg.norm(line) * np.linalg.norm(sighting.first_m)
    )
    return (sighting.first_sigma_m / max(sine, GRAZING_SINE)) ** 2


def _scale(sighting: Sighting) -> FloatArray:
    """Return the widths (8,) of the narrowest kernel."""
    speed = sighting.axes @ sighting.state[3:6]
    wide = np.full(2, _SHARE * max(float(np.linalg.norm(speed)), _SLOWEST_M_S))
    return np.concatenate(
        [0.5 * sighting.since_s * wide, wide, np.full(2, _FORCE_M_S2), np.full(2, _FIRST_M_S)]
    )


class _Paths(NamedTuple):
    """Ascents (n,) that begin on a line of sight: first places and axes up, east and north (3, n),
    and rows (8, n).

    `moved` (5, n) are cosine and sine of the angle over the ground since the first detection, the
    distance from the Earth's centre, and the integrals of distances ahead and above since then, for
    the Coriolis force.
    """

    start_m: FloatArray
    up: FloatArray
    east: FloatArray
    north: FloatArray
    first: FloatArray
    now: FloatArray
    moved: FloatArray
    log_weight: FloatArray

    @classmethod
    def of(cls, sighting: Sighting, ascents: BoostAscents, ignition_s: FloatArray) -> "_Paths":
        """Return the ascents that burn at the first detection, on its line of sight, and now."""
        since = sighting.since_s
        before = ascents.at(ignition_s)
        after = ascents.at(ignition_s + since)
        rows = np.flatnonzero(before.burns & after.burns)
        first = before.rows[:, rows]
        now = after.rows[:, rows]
        sensor = sighting.first_sensor_m
        ground = sighting.ground_radius_m
        towards = sighting.first_m - sensor
        towards = towards / np.linalg.norm(towards)
        near = float(sensor @ towards)
        radius = ground + first[HEIGHT]
        far = -near - np.sqrt(
            np.maximum(near * near - float(sensor @ sensor) + radius * radius, 0.0)
        )
        start = sensor[:, None] + towards[:, None] * far
        up = start / np.sqrt(np.sum(start * start, axis=0))
        east = np.stack([-up[1], up[0], np.zeros(len(rows))]) / np.maximum(
            np.hypot(up[0], up[1]), 1e-9
        )
        angle = now[ANGLE] - first[ANGLE]
        ahead = now[AHEAD_S] - first[AHEAD_S] - RADIUS_M * first[ANGLE] * since
        above = now[ABOVE_S] - first[ABOVE_S] - first[HEIGHT] * since
        moved = np.array([np.cos(angle), np.sin(angle), ground + now[HEIGHT], ahead, above])
        north = np.cross(up, east, axis=0)
        return cls(start, up, east, north, first, now, moved, ascents.log_weight[rows])

    def states(self, which: IntArray, azimuth: FloatArray) -> FloatArray:
        """Return places, velocities, forces and first velocities (4, m, 3) of ascents (m,) towards
        azimuths (m,).
        """
        above = self.up[:, which]
        ahead = np.sin(azimuth) * self.east[:, which] + np.cos(azimuth) * self.north[:, which]
        cosine, sine, radius, ahead_s, above_s = self.moved[:, which]
        up = cosine * above + sine * ahead
        level = cosine * ahead - sine * above
        first = self.first[:, which]
        now = self.now[:, which]
        place = radius * up
        velocity = now[LEVEL] * level + now[CLIMB] * up
        velocity -= 2.0 * SPIN @ (place - self.start_m[:, which])
        place = place - 2.0 * SPIN @ (ahead_s * ahead + above_s * above)
        force = now[LEVEL_FORCE] * level + now[LIFT] * up
        return np.stack(
            [place, velocity, force, first[LEVEL] * ahead + first[CLIMB] * above]
        ).transpose(0, 2, 1)

    def compared(
        self, sighting: Sighting, which: IntArray, azimuth: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return by how much ascents (m,) differ from what is seen (m, 8), and what is hidden (m,
        3).

        Positions and motions are seen as angles, at the range of the state.
        """
        place, velocity, force, first = self.states(which, azimuth)
        line = sighting.state[:3] - sighting.sensor_m
        range_m = float(np.linalg.norm(line))
        line = line / range_m
        apart = place - sighting.sensor_m
        fast = velocity - sighting.sensor_m_s
        nearer = (range_m / (apart @ line))[:, None]
        axes = sighting.axes.T
        off = apart @ axes * nearer
        turned = fast @ axes * nearer - off * (fast @ line)[:, None] / range_m * nearer
        seen = [
            off,
            turned - (sighting.state[3:6] - sighting.sensor_m_s) @ axes,
            force @ axes * nearer - sighting.state[6:] @ axes,
            first @ sighting.first_axes.T - sighting.first_m_s,
        ]
        hidden = [place @ line, velocity @ line, force @ line]
        return np.concatenate(seen, axis=1), np.stack(hidden, axis=1)

    def linear(self, sighting: Sighting, width: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return A (8, n) and M (8, 2, n): far from the sensor, ascents differ from what is seen by
        A + M (cos, sin).

        The angle is the azimuth; the rows are in units of a kernel's widths (8,) and the noise.
        """
        cosine, sine, radius, ahead_s, above_s = self.moved
        first = self.first
        now = self.now
        ways = np.stack([self.north, self.east, self.up], axis=1)
        seen = np.tensordot(sighting.axes, ways, axes=1)
        turn = np.tensordot(-2.0 * sighting.axes @ SPIN, ways, axes=1)
        early = np.tensordot(sighting.first_axes, ways, axes=1)
        above = seen[:, 2]
        level = seen[:, :2]
        state = sighting.axes @ sighting.state.reshape(3, 3).T
        shift = [
            radius * cosine * above + above_s * turn[:, 2] - state[:, :1],
            (now[CLIMB] * cosine - now[LEVEL] * sine) * above - state[:, 1:2],
            (now[LIFT] * cosine - now[LEVEL_FORCE] * sine) * above - state[:, 2:],
            first[CLIMB] * early[:, 2] - sighting.first_m_s[:, None],
        ]
        slope = [
            radius * sine * level + ahead_s * turn[:, :2],
            (now[LEVEL] * cosine + now[CLIMB] * sine) * level,
            (now[LEVEL_FORCE] * cosine + now[LIFT] * sine) * level,
            first[LEVEL] * early[:, :2],
        ]
        size = 1.0 / np.sqrt(width * width + np.diag(sighting.noise))
        return np.concatenate(shift) * size[:, None], np.concatenate(slope) * size[:, None, None]


def _minima(
    shift: FloatArray, slope: FloatArray, log_weight: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return log weights, numbers and azimuths of the minima of |A + M (cos, sin)|², A (8, n), M
    (8, 2, n).
    """
    constant = np.sum(shift * shift, axis=0)
    north = slope[:, 0]
    east = slope[:, 1]
    pull = 2.0 * np.sum(north * shift, axis=0), 2.0 * np.sum(east * shift, axis=0)
    square = (
        np.sum(north * north, axis=0),
        2.0 * np.sum(north * east, axis=0),
        np.sum(east * east, axis=0),
    )
    terms = np.stack([*pull, *square])
    azimuth = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    cost = _powers(azimuth).T @ terms
    least = (cost <= np.roll(cost, 1, axis=0)) & (cost < np.roll(cost, -1, axis=0))
    place, which = least.nonzero()
    angle = azimuth[place]
    mine = terms[:, which]
    bend = np.ones_like(angle)
    for _ in range(_REFINEMENTS):
        c = np.cos(angle)
        s = np.sin(angle)
        tilt = mine[4] - mine[2]
        turn = c * c - s * s
        first = -mine[0] * s + mine[1] * c + 2.0 * tilt * c * s + mine[3] * turn
        bend = np.maximum(
            -mine[0] * c - mine[1] * s + 2.0 * tilt * turn - 4.0 * mine[3] * c * s, 1.0
        )
        angle = angle - np.clip(first / bend, -0.3, 0.3)
    total = constant[which] + np.sum(mine * _powers(angle), axis=0)
    # All azimuths are equally probable: the integral over one is that of a normal density about the
    # minimum.
    return log_weight[which] - 0.5 * total - 0.5 * np.log(bend), which, angle


def _powers(angle: FloatArray) -> FloatArray:
    """Return cos, sin, cos², cos sin and sin² (5, m) of angles (m,)."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.stack([c, s, c * c, c * s, s * s])
