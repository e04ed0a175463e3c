"""Where rays from several places meet, and how surely.

Directions of unclaimed rays as they would be seen from far away: low sensors move past what they look at.

From geostationary height a launch stays in its direction for seconds, whatever the satellite does. A sensor in a low
orbit sees it turn by its own motion, by tenths of a degree a second. So rays of low sensors are compared by where they
meet the ground, seen from a station above the sensor that stands still, at geostationary height.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.geometry.occlusion import intersection_with_ellipsoid
from opir_core.interfaces.columns import Columns

#: How far sensors at geostationary height are from what they look at, about, m.
FAR_M = 3.6e7

#: Sensors lower than this move past what they look at, m from the Earth's centre.
_LOW_M = 3e7 + EARTH_EQUATORIAL_RADIUS_M

#: The mean height of a target when one sensor alone first sees it, and the highest at which rays may meet, m.
FIRST_HEIGHT_M, HIGHEST_M = 3e3, 500e3

#: No ray counts as lower than at this sine of an angle: along the horizon a line rises by 5 km in 250 km.
GRAZING = 0.02


def are_low(origin_m: FloatArray) -> BoolArray:
    """Return which sensors at points (n, 3) are low."""
    return np.asarray(np.add.reduce(origin_m * origin_m, axis=1) < _LOW_M**2)


def near_ground(origin_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return where (n, 3) rays are at the first height of a target, or, where they pass above it, at their lowest.

    A biased ray of a target near the horizon may miss the Earth, and one of a target that rises from behind it does.
    Rays that pass higher than any target meet nothing: nan.
    """
    point = intersection_with_ellipsoid(origin_m, direction, FIRST_HEIGHT_M)
    missed = np.flatnonzero(np.isnan(point[:, 0]))
    if len(missed):
        ahead = np.maximum(-np.sum(origin_m[missed] * direction[missed], axis=1), 0.0)
        lowest = origin_m[missed] + ahead[:, None] * direction[missed]
        lawful = ecef_to_geodetic(lowest).height_m < HIGHEST_M
        point[missed[lawful]] = lowest[lawful]
    return point


def from_afar(rays: LinesOfSight, which: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return directions (n, 3) that stand still as launches do, and their errors (n,), rad; `which` (n,) is the sensor.

    Rays of low sensors that meet nothing keep their directions.
    """
    low = np.flatnonzero(are_low(rays.origin_ecef_m))
    if not len(low):
        return rays.direction_ecef, rays.sigma_rad
    origin = rays.origin_ecef_m[low]
    point = near_ground(origin, rays.direction_ecef[low])
    met = np.isfinite(point[:, 0])
    low, origin, point = low[met], origin[met], point[met]
    above = rays.origin_ecef_m[np.unique(which, return_index=True)[1]][which[low]]
    height_m = FAR_M + EARTH_EQUATORIAL_RADIUS_M
    off = point - height_m * above / np.sqrt(np.sum(above * above, axis=1))[:, None]
    direction, sigma_rad = rays.direction_ecef.copy(), rays.sigma_rad.copy()
    direction[low] = off / np.sqrt(np.sum(off * off, axis=1))[:, None]
    range_m = np.sqrt(np.sum((point - origin) ** 2, axis=1))
    sine = -np.sum(local_axes(point)[:, 2] * rays.direction_ecef[low], axis=1)
    sigma_rad[low] *= range_m / (FAR_M * np.maximum(sine, GRAZING))
    return direction, sigma_rad


def mean_directions(origin_m: FloatArray, direction: FloatArray, aim_m: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) of mean rays, from the means of their origins, directions and aims on the ground.

    A low sensor's is that from the mean origin to the mean aim, where there is one.
    """
    along = np.where((are_low(origin_m) & np.isfinite(aim_m[:, 0]))[:, None], aim_m - origin_m, direction)
    unit: FloatArray = along / np.sqrt(np.sum(along * along, axis=1))[:, None]
    return unit


def ranges_m(origin_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return about how far (n,) sensors are from what they see, m."""
    range_m = np.full(len(origin_m), FAR_M)
    low = np.flatnonzero(are_low(origin_m))
    if len(low):
        apart = near_ground(origin_m[low], direction[low]) - origin_m[low]
        found = np.sqrt(np.sum(apart * apart, axis=1))
        range_m[low] = np.where(np.isfinite(found), found, FAR_M)
    return range_m


@frozen(eq=False)
class Fixes(Columns):
    """Positions (n, 3), m, the information (n, 3, 3) behind them, 1/m², and the least sum of squared residuals (n,).

    Positions of groups whose rays are parallel to working precision are nan.
    """

    position_m: FloatArray
    information: FloatArray
    misfit: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (n, 3, 3), m²: the Cramér-Rao bound at these positions."""
        return np.linalg.inv(self.information).astype(np.float64, copy=False)


def information(direction: FloatArray, range_m: FloatArray, sigma_rad: FloatArray) -> FloatArray:
    """Return what each ray tells of a position, (I - u uᵀ) / (σ R)², (n, 3, 3), 1/m².

    Two independent angular errors of σ each per ray: the Fisher information of a triangulation is their sum.
    """
    outer = direction[:, :, None] * direction[:, None, :]
    projector = np.eye(3) - outer
    return projector / ((sigma_rad * range_m) ** 2)[:, None, None]


def meeting_points(
    group: IntArray, count: int, origin_m: FloatArray, direction: FloatArray, sigma_rad: FloatArray, rounds: int = 3
) -> Fixes:
    """Return where the rays (n, 3) of each of `count` groups meet: weighted least squares of the angles across them.

    The weights hold the ranges, which hold the point: a few rounds settle them. Every group needs two rays that are not
    parallel.
    """
    range_m = np.full(len(group), 4e7)
    for _ in range(rounds):
        weight = information(direction, range_m, sigma_rad)
        total, pull = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(total, group, weight)
        np.add.at(pull, group, np.sum(weight * origin_m[:, None, :], axis=2))
        point = _solved(total, pull)
        range_m = np.sqrt(np.sum((point[group] - origin_m) ** 2, axis=1))
    apart = point[group] - origin_m
    misfit = np.zeros(count)
    np.add.at(misfit, group, np.sum(apart * np.sum(weight * apart[:, None, :], axis=2), axis=1))
    return Fixes(point, total, misfit)


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, 3) of symmetric systems; nan where a matrix is singular to working precision."""
    # What was singular in one round has no range for the next, and is not finite.
    sound: BoolArray = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    sound[sound] = np.linalg.cond(matrix[sound]) < 1e13
    out = np.full_like(right, np.nan)
    out[sound] = np.linalg.solve(matrix[sound], right[sound][:, :, None])[:, :, 0]
    return out
