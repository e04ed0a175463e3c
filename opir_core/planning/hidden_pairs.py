"""Pairs of a sensor and a target that the Earth surely hides all the time, found on a coarse grid.

Let K be a sphere about the Earth's centre. The targets whose line of sight from a fixed sensor
meets K are the shadow of K, which is convex, as K is: {sensor + m (k - sensor), k in K, m >= 1}. By
symmetry the sensors from which a fixed target is in the shadow are convex too. So if both ends of a
step of the target are in the shadow from both ends of a step of the sensor, all points of both
chords are. The paths are at most acceleration · step² / 8 from their chords, and so is the line of
sight: within that distance of K.

K lies so deep under the ellipsoid that every line of sight then is deep underground, and starts
below the target's horizon: the ellipsoid is below the tangent plane at the target's foot, so a
point of the line at depth d is at least d below it, and the target at most its own depth below it.
These are the two conditions of `Blocked.BEHIND_EARTH`, with more than their guards.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.occlusion import closest_to_centre_m, normal
from opir_core.geometry.vectors import components
from opir_core.planning.sightlines import distance_m
from opir_core.planning.visibility import ACCELERATION_BOUND_M_S2

#: Longest step of the coarse grid, s: at twice the step K lies four times as deep, and hides fewer
#: pairs.
COARSE_STEP_S = 16.0

#: Largest distance of a position from the chord of a coarse step, m.
_CHORD_ERROR_M = ACCELERATION_BOUND_M_S2 * COARSE_STEP_S**2 / 8.0

#: By how much the coarse grid encloses the observed time at both ends, s: more than a step of the
#: fine grid, which whole seconds of the arrival of light begin and end.
_ENCLOSED_S = 1.5

#: Depth below the target's horizon plane that remains, m. The guards of the fine grid need 25 m
#: times the ratio of two successive distances, which this allows to be 40.
_SPARE_M = 1000.0

#: The least radius of curvature of the ellipsoid, m, at the equator along the meridian.
_LEAST_CURVATURE_M = WGS84.polar_radius_m**2 / WGS84.equatorial_radius_m


@frozen(eq=False, repr=False)
class CoarseGrid:
    """Times of emission (m,) of all pairs end to end, in equal steps, and the pair of each."""

    pair: IntArray
    time_s: FloatArray
    first: IntArray

    @classmethod
    def over(cls, start_s: FloatArray, stop_s: FloatArray) -> "CoarseGrid":
        """Return the grid that encloses start to stop (n,) of each of n pairs."""
        start_s = start_s - _ENCLOSED_S
        stop_s = stop_s + _ENCLOSED_S
        steps = np.ceil((stop_s - start_s) / COARSE_STEP_S).astype(np.int64)
        points = steps + 1
        first_point = np.cumsum(points) - points
        pair = np.repeat(np.arange(len(points)), points)
        share = (np.arange(len(pair)) - first_point[pair]) / steps[pair]
        return cls(pair, start_s[pair] + (stop_s - start_s)[pair] * share, first_point)

    def cells(self) -> IntArray:
        """Return the points at which a step starts: all but the last of each pair."""
        return np.flatnonzero(self.pair[1:] == self.pair[:-1])


def surely_hidden(
    grid: CoarseGrid, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, is_moving: BoolArray
) -> BoolArray:
    """Return which pairs (n,) the Earth surely hides all the time, of sensors that move in ECEF or
    do not (n,).

    Positions (m, 3) are those of the target at the grid's times, and of the sensor when the light
    arrives.
    """
    radius_m = _shadow_radius_m(grid, target_ecef_m)
    hidden = _all_of_pair(
        grid, closest_to_centre_m(sensor_ecef_m, target_ecef_m) <= radius_m[grid.pair]
    )
    cells = grid.cells()
    cells = cells[(hidden & is_moving)[grid.pair[cells]]]
    for near_cell, far_cell in ((cells, cells + 1), (cells + 1, cells)):
        is_hidden = (
            closest_to_centre_m(sensor_ecef_m[near_cell], target_ecef_m[far_cell])
            > radius_m[grid.pair[cells]]
        )
        hidden[grid.pair[cells[is_hidden]]] = False
    return hidden


def _all_of_pair(grid: CoarseGrid, is_so: BoolArray) -> BoolArray:
    """Return which pairs (n,) have something at all their points (m,)."""
    return np.bincount(grid.pair[~is_so], minlength=len(grid.first)) == 0


def _shadow_radius_m(grid: CoarseGrid, target_ecef_m: FloatArray) -> FloatArray:
    """Return the radius (n,) of K for each pair, from the positions (m, 3) of its target.

    Between two points a target is lower than the lower of them by at most the distance from the
    chord and the chord's sagitta over the ground.
    """
    cells = grid.cells()
    sagitta_m = np.zeros(len(grid.pair))
    sagitta_m[cells] = distance_m(target_ecef_m[cells + 1], target_ecef_m[cells]) ** 2 / (
        8.0 * _LEAST_CURVATURE_M
    )
    sagitta_m[cells + 1] = np.maximum(sagitta_m[cells + 1], sagitta_m[cells])
    lowest_m = normal(*components(target_ecef_m)).height - sagitta_m
    underground_m = np.maximum(-np.minimum.reduceat(lowest_m, grid.first), 0.0)
    return WGS84.polar_radius_m - (2.0 * _CHORD_ERROR_M + underground_m + _SPARE_M)
