"""Triangulation of lines of sight, and their comparison for sensors in low orbits.

From geostationary height a launch stays in its direction for seconds, whatever the satellite's
motion. From a low orbit it moves by tenths of a degree per second. So lines of low sensors are
compared by where they meet the ground, seen from a fixed station at geostationary height above the
sensor.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry import ecef_to_geodetic, intersection_with_ellipsoid, local_axes
from opir_core.interfaces import Columns
from opir_estimation.lines_of_sight import LinesOfSight

#: Range of sensors at geostationary height, about, m.
FAR_M = 3.6e7

#: Sensors below this distance from the Earth's centre, m, move noticeably past a target.
_LOW_M = 3e7 + EARTH_EQUATORIAL_RADIUS_M

#: Mean height of a target at its first detection by a single sensor, and the lowest and highest of
#: a target, m.
FIRST_HEIGHT_M = 3e3
LOWEST_M = -20e3
HIGHEST_M = 500e3

#: Lower bound on the sine of a line's elevation: along the horizon a line rises by 5 km in 250 km.
GRAZING_SINE = 0.02


def are_low_orbits(origin_m: FloatArray) -> BoolArray:
    """Return which sensors at positions (n, 3) are in low orbits."""
    return np.add.reduce(origin_m * origin_m, axis=1) < _LOW_M**2


def points_near_ground(origin_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the points (n, 3) of lines at a target's first height or, where they pass above it, at
    their lowest.

    A biased line near the horizon may miss the Earth, as does one of a target that rises behind it.
    Lines above any target give nan.
    """
    point = intersection_with_ellipsoid(origin_m, direction, FIRST_HEIGHT_M)
    missed = np.flatnonzero(np.isnan(point[:, 0]))
    if len(missed):
        distance_m = np.maximum(-np.sum(origin_m[missed] * direction[missed], axis=1), 0.0)
        lowest = origin_m[missed] + distance_m[:, None] * direction[missed]
        lawful = ecef_to_geodetic(lowest).height_m < HIGHEST_M
        point[missed[lawful]] = lowest[lawful]
    return point


def geostationary_directions(
    lines: LinesOfSight, sensor_row: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return directions (n, 3) as from geostationary height, and their errors (n,), rad; `sensor_row`
    (n,) is the sensor.

    Lines of low sensors without a ground point keep their directions.
    """
    low = np.flatnonzero(are_low_orbits(lines.origin_ecef_m))
    if not len(low):
        return lines.direction_ecef, lines.sigma_rad
    point = points_near_ground(lines.origin_ecef_m[low], lines.direction_ecef[low])
    met = np.isfinite(point[:, 0])
    low = low[met]
    point = point[met]
    first_row = np.unique(sensor_row, return_index=True)[1]
    station = _stations(lines.origin_ecef_m[first_row][sensor_row[low]])
    direction = lines.direction_ecef.copy()
    sigma_rad = lines.sigma_rad.copy()
    direction[low] = _units(point - station)
    sigma_rad[low] *= _error_factors(lines.take(low), point)
    return direction, sigma_rad


def _error_factors(lines: LinesOfSight, point: FloatArray) -> FloatArray:
    """Return the factors (n,) of the errors of lines to points on the ground (n, 3), as from
    geostationary height.
    """
    sine = -np.sum(local_axes(point)[:, 2] * lines.direction_ecef, axis=1)
    return lines.ranges_m(point) / (FAR_M * np.maximum(sine, GRAZING_SINE))


def _units(vector: FloatArray) -> FloatArray:
    return vector / np.sqrt(np.sum(vector * vector, axis=1))[:, None]


def _stations(origin_m: FloatArray) -> FloatArray:
    """Return the positions (n, 3) at geostationary height above sensors (n, 3)."""
    height_m = FAR_M + EARTH_EQUATORIAL_RADIUS_M
    return height_m * origin_m / np.sqrt(np.sum(origin_m * origin_m, axis=1))[:, None]


def mean_directions(origin_m: FloatArray, direction: FloatArray, aim_m: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) of mean lines from the means of their origins, directions and
    ground points.

    For a low sensor it is from the mean origin to the mean ground point, where there is one.
    """
    along = np.where(
        (are_low_orbits(origin_m) & np.isfinite(aim_m[:, 0]))[:, None], aim_m - origin_m, direction
    )
    return _units(along)


def ranges_m(origin_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return approximate ranges (n,), m, of what lines show."""
    range_m = np.full(len(origin_m), FAR_M)
    low = np.flatnonzero(are_low_orbits(origin_m))
    if len(low):
        offset = points_near_ground(origin_m[low], direction[low]) - origin_m[low]
        distance_m = np.sqrt(np.sum(offset * offset, axis=1))
        range_m[low] = np.where(np.isfinite(distance_m), distance_m, FAR_M)
    return range_m


@frozen(eq=False, repr=False)
class Fixes(Columns):
    """Triangulated positions (n, 3), m, their information (n, 3, 3), 1/m², and least sums of
    squared residuals (n,).

    Positions of groups with parallel lines are nan.
    """

    position_m: FloatArray
    information: FloatArray
    misfit: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (n, 3, 3), m²: the Cramér–Rao bound at these positions."""
        return np.linalg.inv(self.information).astype(np.float64, copy=False)


def information(direction: FloatArray, range_m: FloatArray, sigma_rad: FloatArray) -> FloatArray:
    """Return the Fisher information of each line about a position, (I - u uᵀ) / (σ R)², (n, 3, 3),
    1/m².

    Each line has two independent angular errors of σ; the information of a triangulation is the
    sum.
    """
    outer = direction[:, :, None] * direction[:, None, :]
    projector = np.eye(3) - outer
    return projector / ((sigma_rad * range_m) ** 2)[:, None, None]


def triangulated(
    group: IntArray,
    count: int,
    origin_m: FloatArray,
    direction: FloatArray,
    sigma_rad: FloatArray,
    rounds: int = 3,
) -> Fixes:
    """Return the intersections of the lines (n, 3) of `count` groups: weighted least squares of the
    angles.

    The weights depend on the ranges, so the solution is iterated. Each group needs two lines that
    are not parallel.
    """
    range_m = np.full(len(group), 4e7)
    for _ in range(rounds):
        weight = information(direction, range_m, sigma_rad)
        total = np.zeros((count, 3, 3))
        np.add.at(total, group, weight)
        pull = np.zeros((count, 3))
        np.add.at(pull, group, np.sum(weight * origin_m[:, None, :], axis=2))
        point = _solved(total, pull)
        offset = point[group] - origin_m
        range_m = np.sqrt(np.sum(offset**2, axis=1))
    misfit = np.zeros(count)
    weighted = np.sum(weight * offset[:, None, :], axis=2)
    np.add.at(misfit, group, np.sum(offset * weighted, axis=1))
    return Fixes(point, total, misfit)


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, 3) of symmetric systems; nan where a matrix is singular to working
    precision.
    """
    # What was singular in one round has no range for the next, and is not finite.
    sound: BoolArray = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    sound[sound] = np.linalg.cond(matrix[sound]) < 1e13
    out = np.full_like(right, np.nan)
    out[sound] = np.linalg.solve(matrix[sound], right[sound][:, :, None])[:, :, 0]
    return out
