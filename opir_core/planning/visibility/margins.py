"""Whether targets are in view: exactly, at a moment; or for certain, throughout a second."""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import elevation_rad, grazing_height_m, nadir_angle_rad
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Sensor
from opir_core.planning.visibility.grid import Grid
from opir_core.planning.visibility.records import GRID_STEP_S, Blocked, Visibility

#: No target or satellite here moves off a straight line faster than this relative acceleration, m/s² (about 10 g).
_ACCELERATION_BOUND_M_S2 = 100.0

#: So between samples a position strays from the chord by less than this, m.
STRAY_M = _ACCELERATION_BOUND_M_S2 * GRID_STEP_S**2 / 8.0

#: Lines of sight that leave the target this far above its horizon are not asked where they graze the Earth.
_WELL_ABOVE_RAD = 0.05


def visible_now(sensor: Sensor, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> BoolArray:
    """Return whether targets (n, 3) are in a sensor's field of regard, high enough, and not behind the Earth."""
    margins = Margins.of(sensor, sensor_ecef_m, target_ecef_m)
    clear = (margins.horizon_rad > 0.0) | (margins.grazing_m > 0.0)
    seen: BoolArray = clear & (margins.inside_rad > 0.0) & (margins.above_rad > 0.0)
    return seen


@frozen(eq=False)
class Margins(Columns):
    """By how much lines of sight clear each condition; positive is good.

    A sensor above the target's horizon sees it; one below still does where the line of sight grazes above the
    ellipsoid.
    """

    horizon_rad: FloatArray
    grazing_m: FloatArray
    inside_rad: FloatArray
    above_rad: FloatArray

    @classmethod
    def of(cls, sensor: Sensor, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> "Margins":
        """Return the margins of lines of sight from a sensor's positions to targets (n, 3)."""
        horizon_rad = elevation_rad(target_ecef_m, sensor_ecef_m)
        inside_rad = sensor.field_of_regard_half_angle_rad - nadir_angle_rad(sensor_ecef_m, target_ecef_m)
        above_rad = horizon_rad - sensor.minimum_elevation_rad
        grazing_m = np.full(len(horizon_rad), np.inf)
        low = np.flatnonzero(~(horizon_rad > _WELL_ABOVE_RAD))
        grazing_m[low] = grazing_height_m(sensor_ecef_m[low], target_ecef_m[low])
        return cls(horizon_rad, grazing_m, inside_rad, above_rad)


def judged(grid: Grid, margins: Margins, range_m: FloatArray) -> tuple[NDArray[np.uint8], IntArray]:
    """Return the `Visibility` of each cell, by the point it starts at, and why pairs are blocked."""
    guard_rad = 2.0 * STRAY_M / range_m
    cells = grid.cells()
    horizon, hidden = _certain(margins.horizon_rad, guard_rad, cells)
    grazing, behind = _certain(margins.grazing_m, np.full(len(guard_rad), 2.0 * STRAY_M), cells)
    inside, outside = _certain(margins.inside_rad, guard_rad, cells)
    above, below = _certain(margins.above_rad, guard_rad, cells)
    impossible = np.zeros(len(cells), dtype=np.bool_)
    blocked = np.full(len(grid.points), Blocked.NOT, dtype=np.int64)
    for reason, never in (
        (Blocked.BEHIND_EARTH, hidden & behind),
        (Blocked.OUTSIDE_FIELD_OF_REGARD, outside),
        (Blocked.BELOW_MINIMUM_ELEVATION, below),
    ):
        impossible |= never
        newly = ~grid.any_of_pair(cells[~impossible]) & (blocked == Blocked.NOT)
        blocked = np.where(newly, reason, blocked)
    sight = np.zeros(len(grid.pair), dtype=np.uint8)
    sure = (horizon | grazing) & inside & above
    sight[cells] = np.where(impossible, Visibility.NEVER, np.where(sure, Visibility.ALWAYS, Visibility.PERHAPS))
    return sight, blocked


def _certain(margin: FloatArray, guard: FloatArray, cells: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return in which cells a margin is positive throughout, and in which negative throughout."""
    early, late = margin[cells], margin[cells + 1]
    stray = np.maximum(guard[cells], guard[cells + 1])
    always: BoolArray = np.minimum(early, late) > stray
    never: BoolArray = np.maximum(early, late) < -stray
    return always, never


def needs_look_test(grid: Grid, sight: NDArray[np.uint8], first_s: FloatArray, last_s: FloatArray) -> BoolArray:
    """Return which pairs have, between their first and last moment in view, a cell that is not seen throughout."""
    cells = grid.cells()
    time_s, pair = grid.time_s[cells], grid.pair[cells]
    between = (time_s + GRID_STEP_S > first_s[pair]) & (time_s < last_s[pair])
    return grid.any_of_pair(cells[between & (sight[cells] != Visibility.ALWAYS)])
