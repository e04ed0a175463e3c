"""Scan patterns: the time of the look at a direction within the scan period, vectorised over targets.

The phase of a target depends on its own row alone. Directions are in the local frame of the sensor: down to the Earth's
centre, north along the meridian, east across it.
"""

import math

import numpy as np
from attrs import define

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.protocols import ScanPattern


@define
class AlignedScan:
    """Looks at all targets are at whole periods of scene time (the convention of the paper)."""

    period_ns: int

    def phase_ns(self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float) -> IntArray:
        """Return offset 0 for targets (n, 3)."""
        return np.zeros(len(target_ecef_m), dtype=np.int64)


@define
class RandomScan:
    """Looks at all targets are at one offset, uniformly random in the period."""

    period_ns: int

    def phase_ns(self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float) -> IntArray:
        """Return for targets (n, 3) the offset at fraction `uniform`, in [0, 1), of the period."""
        start_ns = min(math.floor(uniform * self.period_ns), self.period_ns - 1)
        return np.full(len(target_ecef_m), start_ns, dtype=np.int64)


@define
class SpinSweep:
    """A spinning telescope: the sweep points north at whole periods of scene time and turns eastward about nadir."""

    period_ns: int

    def phase_ns(self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float) -> IntArray:
        """Return offsets (n,) proportional to the azimuth about nadir; 0 at nadir and where a position is not finite.

        `sensor_ecef_m` is (3,) or (n, 3), `target_ecef_m` (n, 3).
        """
        east, north, _ = _east_north_down(sensor_ecef_m, target_ecef_m)
        return _phase_at(np.arctan2(east, north) / (2.0 * np.pi), self.period_ns)


@define
class StepStareSweep:
    """A step-stare: the field of regard is a raster of stares of one length each, taken row by row in serpentine order.

    The raster is the square of `half_angle_rad` about nadir; its first cell is the north-west one. Every second row
    runs backward, so that each stare is next to the previous one.
    """

    period_ns: int
    half_angle_rad: float
    rows: int
    columns: int

    def phase_ns(self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float) -> IntArray:
        """Return offsets (n,) of the stares that contain the targets; those off the raster count to its edge.

        `sensor_ecef_m` is (3,) or (n, 3), `target_ecef_m` (n, 3). 0 where a position is not finite.
        """
        east, north, down = _east_north_down(sensor_ecef_m, target_ecef_m)
        row = self._cell(-np.arctan2(north, down), self.rows)
        column = self._cell(np.arctan2(east, down), self.columns)
        along = np.where(row % 2 == 0, column, self.columns - 1 - column)
        cell = row * self.columns + along
        return np.where(np.isfinite(east + north + down), cell * self.period_ns // (self.rows * self.columns), 0)

    def _cell(self, angle_rad: FloatArray, count: int) -> IntArray:
        """Return the number of the cell of an angle, of `count` equal ones across the raster."""
        fraction = (np.nan_to_num(angle_rad) / self.half_angle_rad + 1.0) / 2.0
        return np.clip(np.floor(fraction * count), 0, count - 1).astype(np.int64)


def scan_pattern(
    pattern: str, phase: str, *, period_ns: int, half_angle_rad: float, rows: int, columns: int
) -> ScanPattern:
    """Return the scan of a pattern (spin, step-stare or staring) and a phase (aligned, random or swept)."""
    if phase == "random":
        return RandomScan(period_ns)
    if phase == "swept" and pattern == "spin":
        return SpinSweep(period_ns)
    if phase == "swept" and pattern == "step-stare":
        return StepStareSweep(period_ns, half_angle_rad, rows, columns)
    return AlignedScan(period_ns)


def _phase_at(turn: FloatArray, period_ns: int) -> IntArray:
    """Return offsets in [0, period) at fractions of a turn, of any sign; 0 where these are nan."""
    known = np.nan_to_num(turn)
    phase = np.floor((known - np.floor(known)) * period_ns).astype(np.int64)
    # A negative rounding error becomes a whole turn.
    return np.where(phase >= period_ns, 0, phase)


def _east_north_down(sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the components (n,) of sensor to target; over a pole, east is +y.

    nan where a position is not finite or the sensor at the Earth's centre.
    """
    sensor = _finite_or_nan(np.broadcast_to(np.asarray(sensor_ecef_m, dtype=np.float64), np.shape(target_ecef_m)))
    dx, dy, dz = (_finite_or_nan(np.asarray(target_ecef_m, dtype=np.float64)) - sensor).T
    x, y, z = sensor.T
    across = np.hypot(x, y)
    radius = np.where((across == 0.0) & (z == 0.0), np.nan, np.hypot(across, z))
    cos_latitude, sin_latitude = across / radius, z / radius
    over_pole = across == 0.0
    safe = np.where(over_pole, 1.0, across)
    east_x, east_y = np.where(over_pole, 0.0, -y / safe), np.where(over_pole, 1.0, x / safe)
    outward = dx * east_y - dy * east_x
    east = dx * east_x + dy * east_y
    return east, dz * cos_latitude - outward * sin_latitude, -(outward * cos_latitude + dz * sin_latitude)


def _finite_or_nan(position: FloatArray) -> FloatArray:
    return np.where(np.isfinite(position), position, np.nan)
