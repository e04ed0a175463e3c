"""When a target is visible to a sensor: margins of lines of sight, and what they say of the time
between two samples.

Along each pair's burn or flight the geometry is sampled on a grid of scene time. Between two
samples it deviates from the chord by at most acceleration · step² / 8, so most cells are certain:
visible throughout, or not at all. In the other cells the looks are tested one by one.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import dot, elevation_rad, grazing_height_m, nadir_angle_rad
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.sightlines import GRID_STEP_S, Blocked, Grid, Visibility, distance_m
from opir_core.planning.solar_exclusion import SolarExclusion

#: Upper bound of the relative acceleration of target and satellite, m/s² (about 10 g).
ACCELERATION_BOUND_M_S2 = 100.0

#: Largest distance of a position from the chord between two samples, m.
CHORD_ERROR_M = ACCELERATION_BOUND_M_S2 * GRID_STEP_S**2 / 8.0

#: Heights of lines of sight this far below the ground need not be exact: all between two samples is
#: hidden; of a single look only the sign counts.
_HIDDEN_M = -2.0 * CHORD_ERROR_M

#: More than the angle between the geodetic and the geocentric vertical (half the squared
#: eccentricity on the ground, 0.0034 rad), at this distance from the Earth's centre or beyond.
_VERTICAL_RAD = 0.005
_LEAST_RADIUS_M = 6e6

#: Lines of sight at least this far above the target's horizon need no grazing height.
_WELL_ABOVE_RAD = 0.05


def visible_now(sensor: Sensor, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> BoolArray:
    """Return whether targets (n, 3) are in the field of regard of a sensor at places (n, 3), it is
    above its minimum elevation over their horizons, and the Earth is not in the way. Sun and limb
    are the caller's to test.
    """
    least_rad = sensor.minimum_elevation_rad
    angle_rad = nadir_angle_rad(sensor_ecef_m, target_ecef_m)
    is_visible = angle_rad < sensor.field_of_regard_half_angle_rad
    rough_rad = _geocentric_elevation_rad(target_ecef_m, sensor_ecef_m)
    is_visible &= ~(rough_rad <= least_rad - _VERTICAL_RAD)
    # The exact elevation is sought where the rough one does not decide, and then a grazing height.
    rows = np.flatnonzero(is_visible & ~(rough_rad > max(least_rad, 0.0) + _VERTICAL_RAD))
    if len(rows):
        exact_rad = elevation_rad(target_ecef_m[rows], sensor_ecef_m[rows])
        is_visible[rows] = exact_rad > least_rad
        low = rows[(exact_rad > least_rad) & ~(exact_rad > 0.0)]
        if len(low):
            places_m = sensor_ecef_m[low], target_ecef_m[low]
            is_visible[low] = grazing_height_m(*places_m, exact_above_m=_HIDDEN_M) > 0.0
    return is_visible


def _geocentric_elevation_rad(target_ecef_m: FloatArray, sensor_ecef_m: FloatArray) -> FloatArray:
    """Return elevations (n,) of sensors above the plane across the targets' directions from the
    Earth's centre, rad; nan far below the ground.
    """
    way = sensor_ecef_m - target_ecef_m
    square = dot(target_ecef_m, target_ecef_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = dot(target_ecef_m, way) / np.sqrt(square * dot(way, way))
    return np.where(square > _LEAST_RADIUS_M**2, np.arcsin(np.clip(sine, -1.0, 1.0)), np.nan)


@frozen(eq=False, repr=False)
class Margins(Columns):
    """Margins of lines of sight for each condition; all positive means visible.

    A target is visible to a sensor above its horizon, and to one below if the line of sight passes
    above the ellipsoid.
    """

    horizon_rad: FloatArray
    grazing_m: FloatArray
    inside_rad: FloatArray
    above_rad: FloatArray

    @classmethod
    def of(
        cls,
        half_angle_rad: FloatArray | float,
        minimum_elevation_rad: FloatArray | float,
        sensor_ecef_m: FloatArray,
        target_ecef_m: FloatArray,
    ) -> "Margins":
        """Return the margins of lines of sight from sensor positions to targets (n, 3), with the
        half angles of the fields of regard and the minimum elevations (n,), or one for all."""
        horizon_rad = elevation_rad(target_ecef_m, sensor_ecef_m)
        inside_rad = half_angle_rad - nadir_angle_rad(sensor_ecef_m, target_ecef_m)
        above_rad = horizon_rad - minimum_elevation_rad
        grazing_m = np.full(len(horizon_rad), np.inf)
        low = np.flatnonzero(~(horizon_rad > _WELL_ABOVE_RAD))
        grazing_m[low] = grazing_height_m(
            sensor_ecef_m[low], target_ecef_m[low], exact_above_m=_HIDDEN_M
        )
        return cls(horizon_rad, grazing_m, inside_rad, above_rad)


@frozen(eq=False, repr=False)
class SunMargins(Columns):
    """Margins of lines of sight at the grid's points to the solar exclusion, rad, and how far they
    turn in a step.
    """

    clear_rad: FloatArray
    turn_rad: FloatArray

    @classmethod
    def of(
        cls,
        exclusion: SolarExclusion,
        pair: IntArray,
        sensor_ecef_m: FloatArray,
        target_ecef_m: FloatArray,
        time_s: FloatArray,
    ) -> "SunMargins":
        """Return the margins of lines of sight of pairs (n,), from sensor positions to targets (n,
        3) at scene times (n,)."""
        way = target_ecef_m - sensor_ecef_m
        unit = way / distance_m(sensor_ecef_m, target_ecef_m)[:, None]
        # An arc is at most pi/2 times its chord; the Sun turns about the Earth in ECEF.
        moved = np.where(pair[1:] == pair[:-1], distance_m(unit[1:], unit[:-1]), 0.0)
        turn_rad = np.append(0.5 * np.pi * moved, 0.0) + EARTH_ROTATION_RAD_S * GRID_STEP_S
        return cls(exclusion.margin_rad(sensor_ecef_m, target_ecef_m, time_s), turn_rad)


def cell_visibility(
    grid: Grid, margins: Margins, range_m: FloatArray, sun: SunMargins | None = None
) -> tuple[ByteArray, IntArray]:
    """Return the `Visibility` of each cell, by its first point, and why pairs are `Blocked`."""
    guard_rad = 2.0 * CHORD_ERROR_M / range_m
    cells = grid.cells()
    horizon, hidden = _certain(margins.horizon_rad, guard_rad, cells)
    grazing, behind = _certain(
        margins.grazing_m, np.full(len(guard_rad), 2.0 * CHORD_ERROR_M), cells
    )
    inside, outside = _certain(margins.inside_rad, guard_rad, cells)
    above, below = _certain(margins.above_rad, guard_rad, cells)
    nobody = np.zeros(len(cells), dtype=np.bool_)
    clear, blinded = (
        (~nobody, nobody)
        if sun is None
        else _certain(sun.clear_rad, guard_rad + sun.turn_rad, cells)
    )
    impossible = np.zeros(len(cells), dtype=np.bool_)
    blocked = np.full(len(grid.points), Blocked.NOT, dtype=np.int64)
    for reason, never in (
        (Blocked.BEHIND_EARTH, hidden & behind),
        (Blocked.OUTSIDE_FIELD_OF_REGARD, outside),
        (Blocked.BELOW_MINIMUM_ELEVATION, below),
        (Blocked.NEAR_THE_SUN, blinded),
    ):
        impossible |= never
        newly = ~grid.any_of_pair(cells[~impossible]) & (blocked == Blocked.NOT)
        blocked = np.where(newly, reason, blocked)
    sight = np.zeros(len(grid.pair), dtype=np.uint8)
    certain = (horizon | grazing) & inside & above & clear
    sight[cells] = np.where(
        impossible, Visibility.NEVER, np.where(certain, Visibility.ALWAYS, Visibility.UNCERTAIN)
    )
    return sight, blocked


def _certain(margin: FloatArray, guard: FloatArray, cells: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return in which cells a margin is positive throughout, and in which it is negative
    throughout.
    """
    start_margin = margin[cells]
    stop_margin = margin[cells + 1]
    bound = np.maximum(guard[cells], guard[cells + 1])
    always: BoolArray = np.minimum(start_margin, stop_margin) > bound
    never: BoolArray = np.maximum(start_margin, stop_margin) < -bound
    return always, never


#: Allowance at the ends of dark gaps, s: more than the error of interpolated light times.
_GAP_ALLOWANCE_S = 1e-6


def without_dark_gaps(
    sight: ByteArray, grid: Grid, emission_s: FloatArray, gaps_s: FloatArray
) -> ByteArray:
    """Return the visibility of cells for sensors that see burns only: never in dark gaps, uncertain
    at their ends.

    `emission_s` are the times at which the light seen at the grid's points leaves; `gaps_s` (n, k,
    2) are by pair.
    """
    if not gaps_s.shape[1]:
        return sight
    cells = grid.cells()
    early_s = emission_s[cells, None]
    late_s = emission_s[cells + 1, None]
    out_s, relit_s = gaps_s[grid.pair[cells]].transpose(2, 0, 1)
    meets = (late_s > out_s - _GAP_ALLOWANCE_S) & (early_s < relit_s + _GAP_ALLOWANCE_S)
    within = (early_s > out_s + _GAP_ALLOWANCE_S) & (late_s < relit_s - _GAP_ALLOWANCE_S)
    dark = within.any(axis=1)
    edge = meets.any(axis=1)
    result = sight.copy()
    result[cells[edge & (sight[cells] == Visibility.ALWAYS)]] = Visibility.UNCERTAIN
    result[cells[dark]] = Visibility.NEVER
    return result


def needs_look_test(
    grid: Grid, sight: ByteArray, first_s: FloatArray, last_s: FloatArray
) -> BoolArray:
    """Return which pairs have a cell without certain visibility between their first and last
    visible times.
    """
    cells = grid.cells()
    time_s = grid.time_s[cells]
    pair = grid.pair[cells]
    between = (time_s + GRID_STEP_S > first_s[pair]) & (time_s < last_s[pair])
    return grid.any_of_pair(cells[between & (sight[cells] != Visibility.ALWAYS)])
