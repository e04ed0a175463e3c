"""New tracks from rays that belong to no track: M of N scans in one direction, or in one place seen from several.

Rays of a sensor that lie within a few standard deviations of each other form a spot. Spots of different sensors whose
mean rays meet at a height a target can have form a place. A place begins a track once its rays come from M different
scans of the last N. Before the first update a track knows only its prior, which is stated in `track_priors.py` and in
docs/explanation/association.md: where one sensor alone sees a spot, the prior says that launches begin near the ground.

Wide spots: rays of launches side by side, nearer to one another than spots are, parted launch by launch.

A sensor's scan sees a target at most once. So a spot is wide where a scan has rays in it that lie farther apart than
the errors of two looks in one direction, and holds several targets that can be told apart. Its rays are parted as
tracks take theirs: scan by scan, one-to-one, to the nearest parts so far; what lies off them all begins another.

Parts of many targets meet those of their neighbours as well. Which meetings are the likelier is then asked of the
whole likelihood: sharp rays that meet say more than blurred ones, and launches begin on the ground.
"""

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, dot
from opir_core.geometry import ecef_to_geodetic
from opir_core.geometry.ellipsoid import WGS84
from opir_core.interfaces.columns import Columns
from opir_trackers.assignment import nearest, ranks
from opir_trackers.triangulation import (
    FAR_M,
    FIRST_HEIGHT_M,
    GRAZING,
    HIGHEST_M,
    Fixes,
    are_low,
    from_afar,
    mean_directions,
    meeting_points,
    near_ground,
    ranges_m,
)

#: Two looks in one direction lie farther apart than so many standard deviations of one by a chance of 10⁻⁴.
_WIDE_SIGMAS = 6.0

#: A ray is of a part if it is no farther from its mean than so many standard deviations: the default gate of tracks.
_GATE = 4.5

#: One standard deviation of the speed of targets first seen by several sensors, as in tracks' priors, m/s.
_SPEED_SIGMA_M_S = 300.0

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
        moved = _SPEED_SIGMA_M_S * (time_s[rows[0]] - seen_s[:total]) / FAR_M
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


#: Half the speed across the line of sight that a spot allows for over the scans it spans, m/s.
_CLUSTER_SPEED_M_S = 1000.0

#: A spot's bins are this many standard deviations wide, and no narrower than three numbers of them fit in 64 bits.
_WIDTH_SIGMAS, _NARROWEST_RAD = 6.0, 2.0**-17 + 2.0**-30

#: Two mean rays meet if the sum of their squared residuals, on one degree of freedom, is below this (99.99 %).
_MEET = 15.1

#: The lowest height at which rays may meet, m.
_LOWEST_M = -20e3

#: Spots of two sensors are held against each other if their rays meet the ground this near to each other, m: farther
#: apart where they graze it, as far as so much of height, m, and standard deviations of a mean ray shift the points.
_NEAR_M = 60e3
HIGHER_M, _SHIFT_SIGMAS = 5e3, 3.0

#: The squares of the Earth's semi-axes, m².
_AXES_M2 = np.array([WGS84.equatorial_radius_m, WGS84.equatorial_radius_m, WGS84.polar_radius_m]) ** 2


@frozen(eq=False)
class Clusters(Columns):
    """Directions of one sensor from which unclaimed rays come: the mean ray, its error, and from how many scans.

    `is_part` (n,) says which are parts of a wide spot.
    """

    sensor: IntArray
    time_s: FloatArray
    origin_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: FloatArray
    scans: IntArray
    is_part: BoolArray


@frozen(eq=False)
class TrackInitiator(Columns):
    """Places where tracks begin: position (n, 3) in ECEF, m, when, and how many sensors see it.

    `sine` (n,) is that of the angle at which the ray of a sensor alone meets the ground; `is_of_parts` (n,) says which
    places are of parts of wide spots.
    """

    position_ecef_m: FloatArray
    time_s: FloatArray
    sensors: IntArray
    sine: FloatArray = field(default=Factory(lambda self: np.ones(len(self.sensors)), takes_self=True))
    is_of_parts: BoolArray = field(default=Factory(lambda self: np.zeros(len(self.sensors), bool), takes_self=True))


@frozen(eq=False)
class Shown:
    """What rays (m,) show: the spot that each is in, the place that its spot is of, -1 for none, and the places."""

    spot: IntArray
    place: IntArray
    begun: TrackInitiator

    def owned(self, place: IntArray, ray: IntArray, sensor: IndexArray) -> BoolArray:
        """Return which pairs (n,) of a place and a ray in its gate, which `sensor` saw, may be a track's first.

        So little is known of a place that its gate may hold neighbours: where a scan missed the target, one of their
        rays would pull the track kilometres off. So where any sensor has several spots there, none has but its own.
        """
        spots = np.unique(np.stack([place, sensor, self.spot[ray]]), axis=1)[:2]
        looks, several = np.unique(spots, axis=1, return_counts=True)
        crowded = np.isin(place, looks[0, several > 1])
        own: BoolArray = ~crowded | (self.place[ray] == place)
        return own


def beginnings(rays: LinesOfSight, scans_needed: int, bias_sigma_rad: FloatArray) -> Shown:
    """Return the places that rays (all recent and unclaimed) show, with at least `scans_needed` scans each.

    `bias_sigma_rad` (sensors,) is the standard deviation of each sensor's bias, which no averaging over scans lessens.
    """
    spots, spot = spots_of(rays)
    used = np.flatnonzero(spots.scans >= 2)
    likely = spots.take(used)
    likely = evolve(likely, sigma_rad=np.hypot(likely.sigma_rad, bias_sigma_rad[likely.sensor]))
    group, count = _places_of(likely)
    scans = np.bincount(group, likely.scans, count)
    sensors = np.bincount(group, minlength=count)
    time_s = np.bincount(group, likely.time_s * likely.scans, count) / np.maximum(scans, 1)
    position = _positions(likely, group, count, sensors)
    ready = np.flatnonzero((scans >= scans_needed) & np.isfinite(position).all(axis=1))
    sine = np.ones(count)
    if np.count_nonzero(sensors[ready] == 1):
        sine[group] = _sines(likely.direction_ecef, position[group])
    place, number = np.full(len(spots), -1), np.full(count, -1)
    number[ready] = np.arange(len(ready))
    place[used] = number[group]
    begun = TrackInitiator(position, time_s, sensors, sine, np.bincount(group, likely.is_part, count) > 0.0)
    return Shown(spot, place[spot], begun.take(ready))


def spots_of(rays: LinesOfSight) -> tuple[Clusters, IntArray]:
    """Return the spots of rays, and which (m,) each is in.

    They are connected groups of occupied bins of directions, sensor by sensor, or parts of such.
    """
    sensor, which = np.unique(rays.sensor, return_inverse=True)
    span = np.zeros(len(sensor))
    newest = np.full(len(sensor), -np.inf)
    np.maximum.at(newest, which, rays.time_s)
    np.maximum.at(span, which, newest[which] - rays.time_s)
    direction, sigma_rad = from_afar(rays, which)
    widest = np.zeros(len(sensor))
    np.maximum.at(widest, which, sigma_rad)
    width = _WIDTH_SIGMAS * widest + _CLUSTER_SPEED_M_S * span / FAR_M
    spot = _connected(which, direction, width)
    spots = _means(rays, spot)
    if spots.scans.sum() == len(spot):
        return spots, spot
    spot, parts = parted(spot, rays, direction, sigma_rad)
    return (evolve(_means(rays, spot), is_part=parts) if np.count_nonzero(parts) else spots), spot


def _connected(which: IntArray, direction: FloatArray, width: FloatArray) -> IntArray:
    """Return a number for each row's group of touching bins."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    bins = np.floor((direction + 1.0) / np.maximum(width, _NARROWEST_RAD)[which][:, None]).astype(np.int64) + 1
    size = int(bins.max(initial=0)) + 2
    key, of_row = np.unique(((which * size + bins[:, 0]) * size + bins[:, 1]) * size + bins[:, 2], return_inverse=True)
    sought = key + (_FORWARD @ np.array([size * size, size, 1]))[:, None]
    place = np.minimum(np.searchsorted(key, sought), len(key) - 1)
    here = key[place] == sought
    edges = here.nonzero()[1], place[here]
    graph = coo_array((np.ones(len(edges[0]), dtype=np.int8), edges), shape=(len(key), len(key)))
    label: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return label[of_row]


#: Half of the 26 neighbours of a bin.
_FORWARD = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])


def _means(rays: LinesOfSight, spot: IntArray) -> Clusters:
    count = int(spot.max(initial=-1)) + 1
    total = np.maximum(np.bincount(spot, minlength=count), 1)
    scan_of = np.unique(np.stack([spot, rays.scan], axis=1), axis=0)[:, 0]
    sensor = np.zeros(count, dtype=np.int64)
    sensor[spot] = rays.sensor
    origin = _mean_vectors(spot, rays.origin_ecef_m, total)
    direction = _mean_vectors(spot, rays.direction_ecef, total)
    if np.count_nonzero(are_low(origin)):
        aim = _mean_vectors(spot, near_ground(rays.origin_ecef_m, rays.direction_ecef), total)
        direction = mean_directions(origin, direction, aim)
    else:
        direction /= np.sqrt(np.sum(direction * direction, axis=1))[:, None]
    return Clusters(
        sensor=sensor,
        time_s=np.bincount(spot, rays.time_s, count) / total,
        origin_ecef_m=origin,
        direction_ecef=direction,
        sigma_rad=np.sqrt(np.bincount(spot, rays.sigma_rad**2, count)) / total,
        scans=np.bincount(scan_of, minlength=count),
        is_part=np.zeros(count, dtype=bool),
    )


def _mean_vectors(group: IntArray, vectors: FloatArray, total: IntArray) -> FloatArray:
    return np.stack([np.bincount(group, vectors[:, axis], len(total)) / total for axis in range(3)], axis=1)


def _places_of(spots: Clusters) -> tuple[IntArray, int]:
    """Return a group number for each spot, with no sensor twice in a group: the best meetings are joined first."""
    leader = list(range(len(spots)))
    members = {number: [number] for number in leader}
    sensor = spots.sensor.tolist()
    for first, second in _meetings(spots):
        one, other = leader[first], leader[second]
        if one == other or {sensor[k] for k in members[one]} & {sensor[k] for k in members[other]}:
            continue
        members[one] += members.pop(other)
        for spot in members[one]:
            leader[spot] = one
    _, group = np.unique(np.array(leader, dtype=np.int64), return_inverse=True)
    return group.astype(np.int64), len(members)


def _meetings(spots: Clusters) -> list[tuple[int, int]]:
    """Return pairs of spots of different sensors whose mean rays meet at a height a target can have, the best first."""
    from scipy.spatial import cKDTree

    ground = near_ground(spots.origin_ecef_m, spots.direction_ecef)
    known = np.flatnonzero(np.isfinite(ground[:, 0]))
    if len(known) < 2:
        return []
    reach = _ground_reach_m(spots, ground)
    farthest = max(_NEAR_M, 2.0 * reach[known].max())
    near = cKDTree(ground[known]).query_pairs(farthest, output_type="ndarray")
    pairs = known[near[np.lexsort((near[:, 1], near[:, 0]))]]
    first, second = pairs.T
    apart = np.sqrt(np.sum((ground[first] - ground[second]) ** 2, axis=1))
    likely = (apart <= np.maximum(_NEAR_M, reach[first] + reach[second])) & (
        spots.sensor[first] != spots.sensor[second]
    )
    pairs = pairs[likely]
    if not len(pairs):
        return []
    group, spot = np.repeat(np.arange(len(pairs)), 2), pairs.ravel()
    fix = meeting_points(
        group, len(pairs), spots.origin_ecef_m[spot], spots.direction_ecef[spot], _blurred(spots)[spot]
    )
    height = ecef_to_geodetic(fix.position_m).height_m
    lawful = np.flatnonzero((fix.misfit < _MEET) & (height > _LOWEST_M) & (height < HIGHEST_M))
    cost = fix.misfit[lawful]
    if np.count_nonzero(spots.is_part):
        spread = _blurred(spots) * ranges_m(spots.origin_ecef_m, spots.direction_ecef)
        cost = unlikelihood(fix.take(lawful), np.hypot(*spread[pairs[lawful].T]))
    order = lawful[np.argsort(cost, kind="stable")]
    return [(int(first), int(second)) for first, second in pairs[order]]


def _ground_reach_m(spots: Clusters, ground: FloatArray) -> FloatArray:
    """Return how far (n,) from where mean rays meet the ground at points (n, 3) those of other sensors may, m."""
    apart = ground - spots.origin_ecef_m
    shift: FloatArray = HIGHER_M + _SHIFT_SIGMAS * spots.sigma_rad * np.sqrt(np.sum(apart * apart, axis=1))
    return shift / np.maximum(_sines(spots.direction_ecef, ground), GRAZING)


def _sines(direction: FloatArray, position_m: FloatArray) -> FloatArray:
    """Return the sines (n,) of the angles at which rays meet the ground below positions (n, 3)."""
    up = position_m / _AXES_M2
    sine: FloatArray = -np.sum(up * direction, axis=1) / np.sqrt(np.sum(up * up, axis=1))
    return sine


def _blurred(spots: Clusters) -> FloatArray:
    """Return the errors of mean rays with what motion during a spot may add."""
    return np.hypot(spots.sigma_rad, 0.1 * _CLUSTER_SPEED_M_S / ranges_m(spots.origin_ecef_m, spots.direction_ecef))


def _positions(spots: Clusters, group: IntArray, count: int, sensors: IntArray) -> FloatArray:
    """Return where places are: where the rays of several sensors meet, or near the ground on a single ray."""
    position = np.full((count, 3), np.nan)
    single = sensors[group] == 1
    position[group[single]] = near_ground(spots.origin_ecef_m[single], spots.direction_ecef[single])
    several = np.flatnonzero(~single)
    if len(several):
        used, place = np.unique(group[several], return_inverse=True)
        part = spots.take(several)
        fix = meeting_points(place, len(used), part.origin_ecef_m, part.direction_ecef, _blurred(part))
        position[used] = fix.position_m
    return position
