"""Wide spots: rays of launches side by side, nearer to one another than spots are, parted launch by launch.

A sensor's scan sees a target at most once. So a spot is wide where a scan has rays in it that lie farther apart than
the errors of two looks in one direction, and holds several targets that can be told apart. Its rays are parted as
tracks take theirs: scan by scan, one-to-one, to the nearest parts so far; what lies off them all begins another.

Parts of many targets meet those of their neighbours as well. Which meetings are the likelier is then asked of the
whole likelihood: sharp rays that meet say more than blurred ones, and launches begin on the ground.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, dot
from opir_core.geometry import ecef_to_geodetic
from opir_trackers.assignment import nearest, ranks
from opir_trackers.low_orbit_ranges import FAR_M, FIRST_HEIGHT_M
from opir_trackers.triangulation import Fixes

#: Two looks in one direction lie farther apart than so many standard deviations of one by a chance of 10⁻⁴.
_WIDE_SIGMAS = 6.0

#: A ray is of a part if it is no farther from its mean than so many standard deviations: the default gate of tracks.
_GATE = 4.5

#: One standard deviation of the speed of targets first seen by several sensors, as in tracks' priors, m/s.
_SPEED_M_S = 300.0

#: A meeting may be so much below the ground, m, beside its own error.
_DEEP_M = 500.0


def parted(
    spot: IntArray, rays: LinesOfSight, direction: FloatArray, sigma_rad: FloatArray
) -> tuple[IntArray, BoolArray]:
    """Return the spots (n,) of rays, from 0, once wide ones are parted, and which spots (m,) are such parts.

    `direction` (n, 3), unit vectors, and `sigma_rad` (n,) are those that the spots were formed by.
    """
    wide = _wide(spot, rays.scan, direction, sigma_rad)
    parts = spot.copy()
    for one in wide.tolist():
        rows = np.flatnonzero(spot == one)
        part = _parts(rays.time_s[rows], rays.scan[rows], direction[rows], sigma_rad[rows])
        parts[rows] = parts.max() + 1 + part
    number, which = np.unique(parts, return_inverse=True)
    return which.astype(np.int64), np.asarray(number > spot.max(initial=-1))


def _wide(spot: IntArray, scan: IntArray, direction: FloatArray, sigma_rad: FloatArray) -> IntArray:
    """Return the spots of which some scan saw several targets that can be told apart."""
    order = np.lexsort((scan, spot))
    key = np.stack([spot, scan])[:, order]
    first = np.append(0, 1 + np.flatnonzero(np.any(key[:, 1:] != key[:, :-1], axis=0)))
    across = np.maximum.reduceat(direction[order], first) - np.minimum.reduceat(direction[order], first)
    far = dot(across, across) > np.square(_WIDE_SIGMAS * sigma_rad[order[first]])
    wide: IntArray = np.unique(key[0, first[far]])
    return wide


def _parts(time_s: FloatArray, scan: IntArray, direction: FloatArray, sigma_rad: FloatArray) -> IntArray:
    """Return the part (n,), from 0, of each ray of a wide spot."""
    part, total = np.empty(len(scan), dtype=np.int64), 0
    mean, looks, seen_s = np.zeros((len(scan), 3)), np.zeros(len(scan)), np.zeros(len(scan))
    for one in np.unique(scan).tolist():
        rows = np.flatnonzero(scan == one)
        moved = _SPEED_M_S * (time_s[rows[0]] - seen_s[:total]) / FAR_M
        blur = np.sqrt(1.0 / looks[:total] + np.square(moved / sigma_rad[rows].min()))
        row, old = _assigned(direction[rows], sigma_rad[rows], mean[:total], blur, np.zeros(len(rows), dtype=np.int64))
        mine = np.full(len(rows), -1)
        mine[row] = old
        new = np.flatnonzero(mine < 0)
        mine[new] = total + np.arange(len(new))
        total += len(new)
        looks[mine] += 1.0
        mean[mine] += (direction[rows] - mean[mine]) / looks[mine][:, None]
        part[rows], seen_s[mine] = mine, time_s[rows]
    # A ray that came before the first of its own part may have gone to a neighbour's.
    row, new = _assigned(direction, sigma_rad, mean[:total], np.sqrt(1.0 / looks[:total]), ranks(scan - scan.min()))
    part[row] = new
    return part


def _assigned(
    direction: FloatArray, sigma_rad: FloatArray, mean: FloatArray, blur: FloatArray, scan: IntArray
) -> tuple[IntArray, IntArray]:
    """Return rays and the parts they go to, one ray of a scan (n,), from 0, each.

    `blur` (m,) are the errors of the parts' means (m, 3) in those of a ray.
    """
    from scipy.spatial import cKDTree

    if not len(mean):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    reach = _GATE * sigma_rad.max() * np.hypot(1.0, blur.max())
    near = cKDTree(direction).sparse_distance_matrix(cKDTree(mean), reach, output_type="ndarray")
    ray, part = near["i"].astype(np.int64), near["j"].astype(np.int64)
    distance = np.square(near["v"] / sigma_rad[ray]) / (1.0 + np.square(blur[part]))
    used = np.flatnonzero(nearest(ray, scan[ray] * len(mean) + part, distance - _GATE * _GATE))
    return ray[used], part[used]


def unlikelihood(fix: Fixes, spread_m: FloatArray) -> FloatArray:
    """Return twice the negative log likelihood (n,), but for a constant, that rays of one target meet at these points.

    `spread_m` (n,) is how far apart the rays may pass there, by their errors. Beforehand a height
    h above the ground is as likely as 1 / (3 km + h): from 3 km on every octave of heights is as likely as another.
    """
    height_m = ecef_to_geodetic(fix.position_m).height_m
    up = fix.position_m / np.sqrt(dot(fix.position_m, fix.position_m))[:, None]
    sigma_m = np.sqrt(np.einsum("ni,nij,nj->n", up, fix.covariance, up))
    high = 2.0 * np.log1p(np.maximum(height_m, 0.0) / FIRST_HEIGHT_M)
    deep = np.minimum(height_m, 0.0) / np.hypot(sigma_m, _DEEP_M)
    cost: FloatArray = fix.misfit + 2.0 * np.log(spread_m) + high + deep * deep
    return cost
