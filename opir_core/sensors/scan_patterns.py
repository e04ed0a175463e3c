"""Scan patterns: the time of the look at a direction within the scan period, vectorised over
targets.

The phase of a target depends on its own row alone. Directions are in the local frame of the sensor:
down to the Earth's centre, north along the meridian, east across it.
"""

import math

import numpy as np
from attrs import define

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry.vectors import floats
from opir_core.interfaces.sensors import ScanPattern


@define
class AlignedScan:
    """Looks at all targets are at whole periods of scene time (the convention of the paper)."""

    period_ns: int

    def phase_ns(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float
    ) -> IntArray:
        """Return offset 0 for targets (n, 3)."""
        return np.zeros(len(target_ecef_m), dtype=np.int64)


@define
class SpinSweep:
    """A spinning telescope: the sweep points north at a random start of the period and turns
    eastward about nadir.
    """

    period_ns: int

    def phase_ns(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float
    ) -> IntArray:
        """Return offsets (n,) proportional to the azimuth about nadir after the start, which is
        `uniform` periods.

        `sensor_ecef_m` is (3,) or (n, 3), `target_ecef_m` (n, 3). The start at nadir and where a
        position is not finite.
        """
        east, north, _ = _east_north_down(sensor_ecef_m, target_ecef_m)
        return _phase_at(np.arctan2(east, north) / (2.0 * np.pi), uniform, self.period_ns)

    def is_stuck_on(
        self,
        sensor_ecef_m: FloatArray,
        target_ecef_m: FloatArray,
        turn: float,
        width_rad: float,
    ) -> BoolArray:
        """Return which targets (n, 3) a sweep sees that stays at a turn: those in a strip as wide as
        `width_rad` from nadir to the edge.
        """
        east, north, down = _east_north_down(sensor_ecef_m, target_ecef_m)
        azimuth_rad = 2.0 * np.pi * turn
        along = east * np.sin(azimuth_rad) + north * np.cos(azimuth_rad)
        across = east * np.cos(azimuth_rad) - north * np.sin(azimuth_rad)
        range_m = np.sqrt(along * along + across * across + down * down)
        seen: BoolArray = (along >= 0.0) & (np.abs(across) <= range_m * np.sin(0.5 * width_rad))
        return seen


@define
class StepStareSweep:
    """A step-stare: the field of regard is a raster of stares of one length each, taken row by row
    in serpentine order.

    The raster is the square of `half_angle_rad` about nadir; its first cell is the north-west one.
    Every second row runs backward, so that each stare is next to the previous one. In each stare
    the array is read out line by line, from north to south. With `is_staring` the cells are arrays
    side by side, which are all read at once.
    """

    period_ns: int
    half_angle_rad: float
    rows: int
    columns: int
    is_staring: bool = False

    def phase_ns(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float
    ) -> IntArray:
        """Return offsets (n,) at which the lines of targets are read, after a start at `uniform`
        periods.

        `sensor_ecef_m` is (3,) or (n, 3), `target_ecef_m` (n, 3). Targets off the raster count to
        its edge. The start where a position is not finite.
        """
        stare, line = self._stare_and_line(sensor_ecef_m, target_ecef_m)
        turn = line if self.is_staring else (stare + line) / (self.rows * self.columns)
        return _phase_at(turn, uniform, self.period_ns)

    @property
    def stare_half_angle_rad(self) -> float:
        """Half of a stare's width."""
        return self.half_angle_rad / max(self.rows, self.columns)

    def is_stuck_on(
        self,
        sensor_ecef_m: FloatArray,
        target_ecef_m: FloatArray,
        turn: float,
        width_rad: float,
    ) -> BoolArray:
        """Return which targets (n, 3) a raster sees that stays at a turn: those in the stare in
        which it was; `width_rad` plays no part.
        """
        stare, _ = self._stare_and_line(sensor_ecef_m, target_ecef_m)
        stuck: BoolArray = stare == math.floor(turn * self.rows * self.columns)
        return stuck

    def _stare_and_line(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the numbers (n,) of the stares of targets in the order of the scan, and the share
        of the stare that is read before their lines; nan where a position is not finite.
        """
        east, north, down = _east_north_down(sensor_ecef_m, target_ecef_m)
        place = self._place(-np.arctan2(north, down), self.rows)
        row = np.floor(place)
        column = np.floor(self._place(np.arctan2(east, down), self.columns))
        along = np.where(row % 2 == 0, column, self.columns - 1 - column)
        stare = np.where(np.isfinite(east + north + down), row * self.columns + along, np.nan)
        return stare, np.where(np.isnan(stare), np.nan, place - row)

    def _place(self, angle_rad: FloatArray, count: int) -> FloatArray:
        """Return the place of an angle across the raster in cells, in [0, count)."""
        fraction = (np.nan_to_num(angle_rad) / self.half_angle_rad + 1.0) / 2.0
        return np.clip(fraction * count, 0.0, count * (1.0 - 1e-12))


def scan_pattern(
    pattern: str, phase: str, *, period_ns: int, half_angle_rad: float, rows: int, columns: int
) -> ScanPattern:
    """Return the scan of a pattern (spin, step-stare or staring) and a phase (aligned, or random:
    as swept).
    """
    if phase == "aligned":
        return AlignedScan(period_ns)
    if pattern == "spin":
        return SpinSweep(period_ns)
    return StepStareSweep(period_ns, half_angle_rad, rows, columns, pattern == "staring")


def _phase_at(turn: FloatArray, start: float, period_ns: int) -> IntArray:
    """Return offsets in [0, period) at fractions of a turn, of any sign, after a start; the start
    where these are nan.

    Turn and start are rounded down to ns one by one, so that another start moves all offsets alike.
    """
    turns = np.nan_to_num(turn)
    place = np.floor((turns - np.floor(turns)) * period_ns).astype(np.int64)
    return (place + math.floor(start * period_ns)) % period_ns


def _east_north_down(
    sensor_ecef_m: FloatArray, target_ecef_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the components (n,) of sensor to target; over a pole, east is +y.

    nan where a position is not finite or the sensor at the Earth's centre.
    """
    sensor = _finite_or_nan(np.broadcast_to(floats(sensor_ecef_m), np.shape(target_ecef_m)))
    dx, dy, dz = (_finite_or_nan(floats(target_ecef_m)) - sensor).T
    x, y, z = sensor.T
    across = np.hypot(x, y)
    radius = np.where((across == 0.0) & (z == 0.0), np.nan, np.hypot(across, z))
    cos_latitude = across / radius
    sin_latitude = z / radius
    over_pole = across == 0.0
    safe = np.where(over_pole, 1.0, across)
    east_x = np.where(over_pole, 0.0, -y / safe)
    east_y = np.where(over_pole, 1.0, x / safe)
    outward = dx * east_y - dy * east_x
    east = dx * east_x + dy * east_y
    return (
        east,
        dz * cos_latitude - outward * sin_latitude,
        -(outward * cos_latitude + dz * sin_latitude),
    )


def _finite_or_nan(position: FloatArray) -> FloatArray:
    return np.where(np.isfinite(position), position, np.nan)
