"""Visibility of points from a sensor: the engine's conditions as products of columns.

Field of regard, minimum elevation and occlusion by the Earth are inequalities between scalar
products of the sensor's position and the points, which cost a few nanoseconds a point. A point
within rounding of a limit is decided by `opir_core.planning.visible_now`, so that every cell has
the engine's answer.
"""

import math

import numpy as np
from attrs import frozen

from opir_core import Plan
from opir_core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from opir_core.geometry import WGS84, angle_between_rad, is_sunlit, nadir_angle_rad, sun_ecef_m
from opir_core.planning import visible_now
from opir_core.plugin import Sensor
from opir_coverage.grid import SeenPoints

_AXES_M = np.array([WGS84.equatorial_radius_m, WGS84.equatorial_radius_m, WGS84.polar_radius_m])
#: Margins below which the engine's own test decides: of angles, rad, and of distances in radii of
#: the Earth. Rounding of the products is below 1e-13 of a distance.
_CLOSE = 1e-9


def seen(sensor: Sensor, sensor_m: FloatArray, points: SeenPoints) -> BoolArray:
    """Return which points (n,) a sensor at an ECEF position (3,), m, sees; the Sun is left out."""
    along_m2 = points.position_m @ sensor_m
    rows = np.flatnonzero(along_m2 > _least_along_m2(sensor_m, points))
    margin = _margins(sensor, sensor_m, points, rows, along_m2[rows])
    result = np.zeros(len(points), dtype=np.bool_)
    result[rows] = margin > 0.0
    close = rows[np.abs(margin) < _CLOSE]
    if len(close):
        place = np.broadcast_to(sensor_m, (len(close), 3))
        result[close] = visible_now(sensor, place, points.position_m[close])
    return result


def _least_along_m2(sensor_m: FloatArray, points: SeenPoints) -> float:
    """Return the scalar product of positions below which the Earth's inner sphere occludes."""
    inner_m = WGS84.polar_radius_m
    sensor_radius_m = math.sqrt(float(sensor_m @ sensor_m))
    if sensor_radius_m <= inner_m:
        return -math.inf
    low_m, high_m = (math.sqrt(limit_m2) for limit_m2 in points.squared_limits_m2)
    angle_rad = math.acos(inner_m / sensor_radius_m) + math.acos(min(inner_m / high_m, 1.0))
    cosine = math.cos(angle_rad + _CLOSE)
    return sensor_radius_m * (low_m if cosine > 0.0 else high_m) * cosine


def _margins(
    sensor: Sensor, sensor_m: FloatArray, points: SeenPoints, rows: IntArray, along_m2: FloatArray
) -> FloatArray:
    """Return the least margins of the conditions at points, over distances or Earth radii."""
    radius_m2 = float(sensor_m @ sensor_m)
    distance_m = np.sqrt(points.squared_m2[rows] + radius_m2 - 2.0 * along_m2)
    sine = (points.up[rows] @ sensor_m - points.along_up_m[rows]) / distance_m
    margin = _clear(sine.copy(), sensor_m, points, rows)
    half_rad = sensor.field_of_regard_half_angle_rad
    if half_rad < math.pi:
        inside = (radius_m2 - along_m2) / (math.sqrt(radius_m2) * distance_m) - math.cos(half_rad)
        np.minimum(margin, inside, out=margin)
    if sensor.minimum_elevation_rad > -0.5 * math.pi:
        np.minimum(margin, sine - math.sin(sensor.minimum_elevation_rad), out=margin)
    return margin


def _clear(
    sine: FloatArray, sensor_m: FloatArray, points: SeenPoints, rows: IntArray
) -> FloatArray:
    """Return the clearance of lines of sight: sine of elevation, or the gap if it is larger."""
    low = np.flatnonzero((sine < _CLOSE) & (points.scaled_squared[rows] > 1.0))
    if not len(low):
        return sine
    place = sensor_m / _AXES_M
    point_squared = points.scaled_squared[rows[low]]
    along = points.scaled[rows[low]] @ place
    fall = point_squared - along
    # The share of the segment, from the point, at which it is closest to the centre.
    squared = point_squared + float(place @ place) - 2.0 * along
    share = np.clip(fall / squared, 0.0, 1.0)
    sine[low] = np.maximum(sine[low], point_squared - share * (2.0 * fall - share * squared) - 1.0)
    return sine


@frozen(eq=False)
class Fleet:
    """Sensors over scene times (T,), s: `position_m` (sensors, T, 3), `sun_m` (T, 3) in ECEF.

    `is_blinded` (sensors, T) is where the Sun is so near to a sensor's field of regard that its
    exclusion matters.
    """

    sensors: tuple[Sensor, ...]
    time_s: FloatArray
    position_m: FloatArray
    sun_m: FloatArray
    is_blinded: BoolArray

    @classmethod
    def of(cls, plan: Plan, time_s: FloatArray) -> "Fleet":
        """Return the sensors of a plan at scene times (T,), s, also after the scene's end."""
        sensors = plan.sensors
        position = np.stack([sensor.orbit.position_ecef_m(time_s) for sensor in sensors])
        sun = sun_ecef_m(time_s, plan.scene.epoch_us)
        blinded = np.zeros((len(sensors), len(time_s)), dtype=np.bool_)
        for number, sensor in enumerate(sensors):
            if sensor.solar_exclusion_rad > 0.0:
                reach_rad = sensor.field_of_regard_half_angle_rad + sensor.solar_exclusion_rad
                is_near = nadir_angle_rad(position[number], sun) < reach_rad + _CLOSE
                blinded[number] = is_near & is_sunlit(position[number], sun)
        return cls(sensors, time_s, position, sun, blinded)

    @property
    def is_still(self) -> bool:
        """Whether visibility is the same at all times: sensors at rest in ECEF, none blinded."""
        return not self.is_blinded.any() and all(
            sensor.orbit.is_stationary for sensor in self.sensors
        )

    def seen(self, number: int, step: int, points: SeenPoints) -> BoolArray:
        """Return which points (n,) a sensor sees at a time, with the Sun's exclusion."""
        sensor = self.sensors[number]
        place = self.position_m[number, step]
        result = seen(sensor, place, points)
        if self.is_blinded[number, step]:
            rows = np.flatnonzero(result)
            off_rad = angle_between_rad(points.position_m[rows] - place, self.sun_m[step] - place)
            result[rows] = off_rad > sensor.solar_exclusion_rad
        return result


@frozen(eq=False)
class SightMap:
    """Visibility of `cells` points as bits (T, sensors, ceil(cells / 8)); one time if constant."""

    bits: ByteArray
    cells: int
    steps: int

    @classmethod
    def of(cls, fleet: Fleet, points: SeenPoints) -> "SightMap":
        """Return the visibility of points from each sensor of a fleet at each of its times."""
        steps = 1 if fleet.is_still else len(fleet.time_s)
        rows = [
            np.stack(
                [
                    np.packbits(fleet.seen(number, step, points))
                    for number in range(len(fleet.sensors))
                ]
            )
            for step in range(steps)
        ]
        return cls(np.stack(rows), len(points), len(fleet.time_s))

    def at(self, step: int) -> BoolArray:
        """Return whether each sensor sees each point (sensors, cells) at a time."""
        row = self.bits[min(step, len(self.bits) - 1)]
        return np.unpackbits(row, axis=1, count=self.cells).view(np.bool_)

    def in_view(self) -> ByteArray:
        """Return the numbers (T, cells) of sensors that see each point."""
        counts = [self.at(step).sum(axis=0, dtype=np.uint8) for step in range(len(self.bits))]
        return np.broadcast_to(np.stack(counts), (self.steps, self.cells))

    def seeing(self, step: int) -> IntArray:
        """Return the sensors (most in view, cells) that see each point, in order, then -1."""
        is_seen = self.at(step)
        count = np.zeros(self.cells, dtype=np.int64)
        table = np.full((int(is_seen.sum(axis=0).max(initial=0)), self.cells), -1)
        for number, row in enumerate(is_seen):
            cells = np.flatnonzero(row)
            table[count[cells], cells] = number
            count[cells] += 1
        return table


def day_s(steps: int, length_s: float = 86_400.0) -> FloatArray:
    """Return scene times (steps,), s: the middles of equal parts of a day from the epoch."""
    return np.asarray((np.arange(steps) + 0.5) * (length_s / steps))
