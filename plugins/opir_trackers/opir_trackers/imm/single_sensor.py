"""Tracks of one sensor: what it does not see is replaced, every few seconds, by what the law of
boosts says of it.
"""

from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import (
    COAST,
    SPIN,
    ImmFilter,
    air_velocity,
    are_low_orbits,
    dot,
    earth_rotated,
    square_root,
)
from opir_forecast import (
    BEFORE_S,
    EDGES_S,
    AlongSight,
    BoostAscents,
    Outcomes,
    Sighting,
    along_sight,
    ascents_of,
)

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.imm.state import TrackTable
from opir_trackers.onset.motion_statistics import LAUNCH
from opir_trackers.sensors import Biases


@frozen
class SingleSensorLaw:
    """When tracks of one sensor are compared with ascents."""

    #: A track is compared at its first detection after each interval of this length, s, since the
    #: first one: the state along the line of sight changes little in it, and a comparison takes
    #: milliseconds.
    every_s: float = 5.0

    #: Sine of the least elevation of the sensor, 10°: there a height that is off moves the place by
    #: six times as much.
    least_sine: float = 0.17

    #: A free burn more probable than this is no ascent of the law.
    free: float = 0.5


LAW = SingleSensorLaw()


class _Along(NamedTuple):
    """Axes (m, 3), and moments (m, 3) and (m, 3, 3) of position, velocity and force along them."""

    axis: FloatArray
    mean: FloatArray
    covariance: FloatArray


class _Motion(NamedTuple):
    """Inertial position, velocity and force (9,) of a target at a time, and a root (9, k) of their
    covariance.
    """

    time_s: float
    mean: FloatArray
    side: FloatArray


class _View(NamedTuple):
    """What a sensor sees of a track, its inertial line of sight (3,), and the sensor's number."""

    sighting: Sighting
    axis: FloatArray
    sensor: int


@frozen(eq=False)
class SingleSensor:
    """The law of boosts for tracks that one sensor alone sees, from sites of the height `site_m`,
    root mean square; `unreported` (sensors, edges) is that of `log_unreported`.
    """

    outcomes: Outcomes
    filter: ImmFilter
    biases: Biases
    unreported: FloatArray
    site_m: float

    def with_ascents(
        self, table: TrackTable, seen_before_s: FloatArray, time_s: float
    ) -> TrackTable:
        """Return the tracks (n,) at a time, those of one sensor as ascents say along its line of
        sight.

        `seen_before_s` (n,) are the times of the last detections before the slice.
        """
        rows = self._due(table, seen_before_s).nonzero()[0]
        rows = rows[self._are_far(table, rows, time_s)] if rows.size else rows
        motions = [self._burn(table, row, time_s) for row in rows.tolist()]
        compared, along = self._along(table, rows, motions)
        if not compared.size:
            return table
        estimates = table.estimates
        return table.with_estimates(self.filter.replaced_along(estimates, compared, *along))

    def with_burnouts(self, table: TrackTable, burned: BoolArray, time_s: float) -> TrackTable:
        """Return the tracks (n,) at a time, those of one sensor that have `burned` (n,) until the
        slice as ascents say whose burns end at their last detections.

        A burn that ends is another piece of evidence: heavy stages of high acceleration are short.
        """
        has_ended = burned & (table.estimates.weight[:, 0] <= 0.5)
        if True not in has_ended:
            return table
        rows = (has_ended & self._are_launches(table)).nonzero()[0]
        rows = rows[self._are_far(table, rows, time_s)] if rows.size else rows
        motions = [self._burnout(table, row, time_s) for row in rows.tolist()]
        compared, along = self._along(table, rows, motions, has_ended=True)
        if not compared.size:
            return table
        since_s = time_s - table.seen_s[compared]
        coasts = along.axis, along.mean[:, :2], along.covariance[:, :2, :2]
        estimates = table.estimates
        return table.with_estimates(
            self.filter.coasts_replaced_along(estimates, compared, since_s, *coasts)
        )

    def _along(
        self,
        table: TrackTable,
        rows: IntArray,
        motions: list[_Motion],
        has_ended: bool = False,
    ) -> tuple[IntArray, _Along]:
        """Return the rows (m,), of some, with motions that ascents are like, and what these say
        along their lines.
        """
        found = self._matches(table, rows, motions, has_ended)
        compared = np.array([row for row, _, _ in found], dtype=np.int64)
        axis = np.array([axis for _, axis, _ in found]).reshape(-1, 3)
        mean = np.array([along.mean for _, _, along in found]).reshape(-1, 3)
        covariance = np.array([along.covariance for _, _, along in found]).reshape(-1, 3, 3)
        # Ascents move relative to the Earth, and the part of its rotation along the line is the
        # same at all distances.
        mean[:, 1] += dot(axis, table.estimates.boost_mean[compared, :3] @ SPIN.T)
        return compared, _Along(axis, mean, covariance)

    def _matches(
        self, table: TrackTable, rows: IntArray, motions: list[_Motion], has_ended: bool
    ) -> list[tuple[int, FloatArray, AlongSight]]:
        """Return the rows that ascents are like, their axes, and the moments along these."""
        found = list[tuple[int, FloatArray, AlongSight]]()
        # A track is compared with thousands of ascents.
        for row, motion in zip(rows.tolist(), motions, strict=True):
            view = self._view(table, row, motion)
            sighting = view.sighting._replace(has_ended=has_ended)
            along = along_sight(self.ascents, sighting, self._ignitions_s(view.sensor))
            if along is not None:
                found.append((row, view.axis, along))
        return found

    @cached_property
    def ascents(self) -> BoostAscents:
        """Return the ascents of the law; they are drawn for the first track that needs them."""
        return ascents_of(self.outcomes)

    def _burn(self, table: TrackTable, row: int, time_s: float) -> _Motion:
        """Return the motion of a burning track at present."""
        estimates = table.estimates
        side = square_root.inverse_root(estimates.boost_root[row : row + 1])[0, : COAST + 3]
        return _Motion(time_s, estimates.boost_mean[row, : COAST + 3], side)

    def _burnout(self, table: TrackTable, row: int, time_s: float) -> _Motion:
        """Return the motion of a track whose burn has ended, at its last detection: back along its
        free flight, with its last force.
        """
        estimates = table.estimates
        seen_s = float(table.seen_s[row])
        coast = self.filter.coasts_before(estimates, np.array([row]), np.array([time_s - seen_s]))
        burn = self._burn(table, row, time_s)
        mean = np.concatenate([coast.mean[0], burn.mean[COAST:]])
        side = np.zeros((COAST + 3, COAST + burn.side.shape[1]))
        side[:COAST, :COAST] = square_root.inverse_root(coast.root)[0]
        side[COAST:, COAST:] = burn.side[COAST:]
        return _Motion(seen_s, mean, side)

    def _due(self, table: TrackTable, seen_before_s: FloatArray) -> BoolArray:
        """Return which tracks (n,) are compared: those of one sensor that burn and were detected in
        the slice.
        """
        is_launch = self._are_launches(table)
        if True not in is_launch:
            return is_launch
        interval = (np.stack([table.seen_s, seen_before_s]) - table.first_s) // LAW.every_s
        return (interval[0] > interval[1]) & is_launch & (table.estimates.weight[:, 0] > 0.5)

    def _are_launches(self, table: TrackTable) -> BoolArray:
        """Return which tracks (n,) of one sensor are launches, and follow the law.

        Ascents are compared with the first motion: statistics that have begun anew do not have it.
        """
        is_single = table.seen.sum(axis=1) == 1
        if True not in is_single:
            return is_single
        motion = table.motion
        is_launch = motion.probability[:, LAUNCH] > 0.5
        follows_law = table.estimates.burn_share[:, 2] < LAW.free
        return is_single & is_launch & follows_law & (motion.epoch_s <= table.first_s)

    def _are_far(self, table: TrackTable, rows: IntArray, time_s: float) -> BoolArray:
        """Return which tracks (m,) a sensor sees that is neither low nor near their horizon.

        One that moves past a target sees how far away it is. Near the horizon the first line of
        sight does not say where the launch was.
        """
        when = np.full(1, time_s)
        origin = np.concatenate(
            [sensor.orbit.position_ecef_m(when) for sensor in self.biases.sensors]
        )
        number = np.argmax(table.seen[rows], axis=1)
        place = table.motion.reference_m[rows]
        line = origin[number] - place
        sine = dot(line, place) / np.sqrt(dot(line, line) * dot(place, place))
        return ~are_low_orbits(origin)[number] & (sine > LAW.least_sine)

    def _view(self, table: TrackTable, row: int, target: _Motion) -> _View:
        """Return what the sensor of a track sees of a motion."""
        motion = table.motion
        sensor = int(np.argmax(table.seen[row]))
        first_s = float(table.first_s[row])
        time_s = target.time_s
        times_s = np.array([first_s, time_s - 0.5, time_s, time_s + 0.5])
        places = self.biases.sensors[sensor].orbit.position_ecef_m(times_s)
        mean = target.mean
        back = np.full(3, -time_s)
        vectors = [mean[:3], air_velocity(mean[None])[0], mean[COAST : COAST + 3]]
        state = earth_rotated(np.stack(vectors), back)
        axes = _image_axes(state[0] - places[2], state[0])
        inertial_axes = earth_rotated(axes, -back)
        reference = motion.reference_m[row]
        first_axes = _image_axes(reference - places[0], reference)[:2]
        ground, first, spread = motion.part(np.array([row])).first_motion(first_axes)
        sighting = Sighting(
            first_sensor_m=places[0],
            first_m=ground + first[:2] @ first_axes,
            first_sigma_m=float(np.hypot(np.sqrt(spread[1, 1]), self.site_m)),
            ground_radius_m=float(np.linalg.norm(ground)),
            since_s=time_s - first_s,
            sensor_m=places[2],
            sensor_m_s=places[3] - places[1],
            state=state.ravel(),
            axes=axes[:2],
            first_axes=first_axes,
            first_m_s=first[2:],
            noise=_noise(target.side, inertial_axes[:2], spread),
        )
        return _View(sighting, inertial_axes[2], sensor)

    def _ignitions_s(self, sensor: int) -> FloatArray:
        """Return times (2, n), s, from the ignition of each ascent to its first detection: at once,
        or out of cloud.
        """
        wait, hidden = _uniform(len(self.ascents.log_weight))
        reported = 1.0 - np.exp(self.unreported[sensor])
        wait_s = np.interp(wait * reported[-1], reported, EDGES_S)
        return np.stack([wait_s, wait_s + BEFORE_S * hidden])


def _noise(side: FloatArray, axes: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the covariance (8, 8) of a motion in the image plane, of a root (9, k), and of the
    first motion, which has the covariance `spread` (4, 4).
    """
    image = _image_rows(axes) @ side
    noise = np.zeros((8, 8))
    noise[:6, :6] = image @ image.T
    noise[:2, :2] += spread[:2, :2]
    noise[6:, 6:] = spread[2:, 2:]
    return noise


def _image_axes(line: FloatArray, beside: FloatArray) -> FloatArray:
    """Return unit vectors (3, 3): two across a line of sight (3,), the first also across another
    vector; then along.
    """
    along = line / np.linalg.norm(line)
    across = np.cross(along, beside)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(across, along), along])


def _image_rows(axes: FloatArray) -> FloatArray:
    """Return the rows (6, 9) that take position, velocity and force to the image plane, velocities
    over the ground.
    """
    rows = np.zeros((6, 9))
    rows[:2, :3] = rows[2:4, 3:6] = rows[4:, 6:] = axes
    rows[2:4, :3] = -axes @ SPIN
    return rows


@lru_cache(maxsize=2)
def _uniform(count: int) -> FloatArray:
    """Return uniform numbers (2, n), the same for all tracks and ticks."""
    return np.random.default_rng(12).random((2, count))
