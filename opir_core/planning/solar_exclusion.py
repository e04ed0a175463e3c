"""Looks that a sensor cannot make because the Sun is too close to its line of sight.

Planning finds the times at which the Sun comes that close to anything in a sensor's field of regard
during the scene. There are usually none; otherwise looks are tested one by one at these times
alone.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import nadir_angle_rad
from opir_core.geometry.sun import is_sunlit, sun_ecef_m
from opir_core.geometry.vectors import angle_between_rad
from opir_core.interfaces.sensors import Sensor

#: By how much the times enclose an outage on both sides, s, and the error of its ends.
_ALLOWANCE_S = 1.0
_TOLERANCE_S = 0.1

#: Time that is searched at once, s: a year at once would take 200 MiB.
_SPAN_S = 30 * 86_400.0

#: More than the Sun moves in a second as seen from a point at rest in ECEF.
_SUN_RATE_RAD_S = 1.01 * EARTH_ROTATION_RAD_S


@frozen(eq=False, repr=False)
class SolarExclusion:
    """The exclusion angle of a sensor, rad, and the scene times (n,) between which it matters."""

    angle_rad: float
    epoch_us: int
    start_s: FloatArray
    stop_s: FloatArray

    @classmethod
    def of(cls, sensor: Sensor, epoch_us: int, end_s: float) -> "SolarExclusion | None":
        """Return the solar exclusion of a sensor from scene time 0 to an end, or None if it
        prevents no look.
        """
        from opir_core.orbits.sun_events import outage_times_s  # of sensors that may meet the Sun

        edges_s = np.append(np.arange(-_ALLOWANCE_S, end_s, _SPAN_S), end_s + _ALLOWANCE_S).tolist()
        pieces = [
            outage_times_s(sensor, epoch_us, *span, tolerance_s=_TOLERANCE_S)
            for span in pairwise(edges_s)
        ]
        start_s, stop_s = np.concatenate(pieces).T
        if not len(start_s):
            return None
        return cls(
            sensor.solar_exclusion_rad, epoch_us, start_s - _ALLOWANCE_S, stop_s + _ALLOWANCE_S
        )

    def margin_rad(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, time_s: FloatArray
    ) -> FloatArray:
        """Return by how much lines of sight (n, 3) clear the Sun at scene times (n,); inf where it
        is out of view.
        """
        later = np.searchsorted(self.start_s, time_s, side="right") - 1
        rows = np.flatnonzero((later >= 0) & (time_s <= self.stop_s[np.maximum(later, 0)]))
        sensor_m = sensor_ecef_m[rows]
        sun_m = sun_ecef_m(time_s[rows], self.epoch_us)
        angle = angle_between_rad(target_ecef_m[rows] - sensor_m, sun_m - sensor_m)
        margin = np.full(len(time_s), np.inf)
        margin[rows] = np.where(is_sunlit(sensor_m, sun_m), angle - self.angle_rad, np.inf)
        return margin

    def is_clear(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, time_s: FloatArray
    ) -> BoolArray:
        """Return which lines of sight (n, 3) the Sun leaves free at scene times (n,)."""
        return self.margin_rad(sensor_ecef_m, target_ecef_m, time_s) > 0.0


def solar_exclusions(
    sensors: Sequence[Sensor], epoch_us: int, end_s: float
) -> tuple[SolarExclusion | None, ...]:
    """Return the solar exclusion of each sensor in a scene, or None where it prevents no look."""
    is_free = _surely_free(sensors, epoch_us, end_s).tolist()
    rows = zip(sensors, is_free, strict=True)
    return tuple(
        None if free else SolarExclusion.of(sensor, epoch_us, end_s) for sensor, free in rows
    )


def _surely_free(sensors: Sequence[Sensor], epoch_us: int, end_s: float) -> BoolArray:
    """Return which sensors surely lose no look to the Sun: those without an exclusion angle, and
    those at rest in ECEF from whose fields the Sun is farther in the middle of a scene than it
    moves in half of it."""
    free = np.array([sensor.solar_exclusion_rad <= 0.0 for sensor in sensors], dtype=np.bool_)
    rows = [row for row in np.flatnonzero(~free).tolist() if sensors[row].orbit.is_stationary]
    if not rows:
        return free
    middle_s = np.array([0.5 * end_s])
    row_sensors = [sensors[row] for row in rows]
    position_m = np.concatenate([sensor.orbit.position_ecef_m(middle_s) for sensor in row_sensors])
    sun_m = np.repeat(sun_ecef_m(middle_s, epoch_us), len(rows), axis=0)
    reach_rad = np.array(
        [
            sensor.field_of_regard_half_angle_rad + sensor.solar_exclusion_rad
            for sensor in row_sensors
        ]
    )
    moved_rad = _SUN_RATE_RAD_S * (0.5 * end_s + _ALLOWANCE_S)
    free[rows] = nadir_angle_rad(position_m, sun_m) > reach_rad + moved_rad
    return free
