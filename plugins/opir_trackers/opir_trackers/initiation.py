"""Track initiation from unassigned lines of sight: M of N scans, in one direction or triangulated.

Lines of a sensor within a few standard deviations of each other form a cluster. Clusters of
different sensors whose mean lines intersect at a height possible for a target form a candidate. A
candidate starts a track once its lines come from M different scans of the last N. Before its first
update a track has only its prior, given in `track_priors.py` and docs/explanation/association.md: a
candidate of a single sensor is near the ground, unless its speed across the line of sight or its
crossing with a line of another sensor places it higher.

Neighbouring launches may lie closer than the size of a cluster. A scan sees a target at most once,
so a cluster that has lines of one scan farther apart than the noise allows holds several targets.
Its lines are split scan by scan, one-to-one, to the nearest part; a line off all parts begins a new
one. Parts of several sensors intersect in many combinations: these are ranked by their likelihood,
in which accurate lines count more and launches begin near the ground.
"""

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation import dot
from opir_core.geometry import WGS84, ecef_to_geodetic
from opir_core.interfaces import Columns
from opir_trackers.assignment import cheapest_assignment, group_sums, ranks
from opir_trackers.configs import GATE_SIGMAS
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.pairing import Directions, SetModel, cheapest_pairing, normal_equations
from opir_trackers.triangulation import (
    FAR_M,
    GRAZING_SINE,
    HIGHEST_M,
    LOWEST_M,
    are_low_orbits,
    geostationary_directions,
    mean_directions,
    points_near_ground,
    ranges_m,
    triangulated,
)

#: Two lines in one direction differ by more than this many standard deviations with a probability
#: of 10⁻⁴; clusters are searched in bins of this width.
_WIDE_SIGMAS = 6.0

#: Standard deviation of the speed of targets first seen by several sensors, as in the track priors,
#: m/s.
SPEED_SIGMA_M_S = 300.0


def split_clusters(
    cluster: IntArray, lines: LinesOfSight, direction: FloatArray, sigma_rad: FloatArray
) -> tuple[IntArray, BoolArray]:
    """Return the clusters (n,) of lines, from 0, with wide ones split, and which clusters (m,) are
    parts.

    `direction` (n, 3), unit vectors, and `sigma_rad` (n,) are those that the clusters were formed
    by.
    """
    wide = _wide_clusters(cluster, lines.scan, direction, sigma_rad)
    split = cluster.copy()
    for one in wide.tolist():
        rows = np.flatnonzero(cluster == one)
        new_part = _parts_of(lines.time_s[rows], lines.scan[rows], direction[rows], sigma_rad[rows])
        split[rows] = split.max() + 1 + new_part
    number, renumbered = np.unique(split, return_inverse=True)
    return renumbered.astype(np.int64), np.asarray(number > cluster.max(initial=-1))


def _wide_clusters(
    cluster: IntArray, scan: IntArray, direction: FloatArray, sigma_rad: FloatArray
) -> IntArray:
    """Return the clusters in which some scan has lines of several resolved targets."""
    order = np.lexsort((scan, cluster))
    key = np.stack([cluster, scan])[:, order]
    starts = np.append(0, 1 + np.flatnonzero(np.any(key[:, 1:] != key[:, :-1], axis=0)))
    across = np.maximum.reduceat(direction[order], starts) - np.minimum.reduceat(
        direction[order], starts
    )
    is_wide = dot(across, across) > np.square(_WIDE_SIGMAS * sigma_rad[order[starts]])
    wide: IntArray = np.unique(key[0, starts[is_wide]])
    return wide


def _parts_of(
    time_s: FloatArray, scan: IntArray, direction: FloatArray, sigma_rad: FloatArray
) -> IntArray:
    """Return the part (n,), from 0, of each line of a wide cluster."""
    part = np.empty(len(scan), dtype=np.int64)
    total = 0
    mean = np.zeros((len(scan), 3))
    looks = np.zeros(len(scan))
    seen_s = np.zeros(len(scan))
    for scan_number in np.unique(scan).tolist():
        rows = np.flatnonzero(scan == scan_number)
        moved = SPEED_SIGMA_M_S * (time_s[rows[0]] - seen_s[:total]) / FAR_M
        blur = np.sqrt(1.0 / looks[:total] + np.square(moved / sigma_rad[rows].min()))
        row, old = _assigned(
            direction[rows],
            sigma_rad[rows],
            mean[:total],
            blur,
            np.zeros(len(rows), dtype=np.int64),
        )
        owner = np.full(len(rows), -1)
        owner[row] = old
        new = np.flatnonzero(owner < 0)
        owner[new] = total + np.arange(len(new))
        total += len(new)
        looks[owner] += 1.0
        mean[owner] += (direction[rows] - mean[owner]) / looks[owner][:, None]
        part[rows] = owner
        seen_s[owner] = time_s[rows]
    # A line before the first of its own part may have been assigned to a neighbour's.
    row, new = _assigned(
        direction, sigma_rad, mean[:total], np.sqrt(1.0 / looks[:total]), ranks(scan - scan.min())
    )
    part[row] = new
    return part


def _assigned(
    direction: FloatArray, sigma_rad: FloatArray, mean: FloatArray, blur: FloatArray, scan: IntArray
) -> tuple[IntArray, IntArray]:
    """Return lines and the parts assigned to them, at most one line per scan (n,), from 0, and
    part.

    `blur` (m,) are the errors of the parts' means (m, 3) in units of a line's error.
    """
    from scipy.spatial import cKDTree

    if not len(mean):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    reach = GATE_SIGMAS * sigma_rad.max() * np.hypot(1.0, blur.max())
    distances = cKDTree(direction).sparse_distance_matrix(
        cKDTree(mean), reach, output_type="ndarray"
    )
    line = distances["i"].astype(np.int64)
    part = distances["j"].astype(np.int64)
    distance = np.square(distances["v"] / sigma_rad[line]) / (1.0 + np.square(blur[part]))
    rows_used = np.flatnonzero(
        cheapest_assignment(line, scan[line] * len(mean) + part, distance - GATE_SIGMAS**2)
    )
    return line[rows_used], part[rows_used]


#: Half the speed across the line of sight that a cluster allows for over its scans, m/s.
_CLUSTER_SPEED_M_S = 1000.0

#: Least bin width of clusters, for which three bin numbers fit in 64 bits.
_NARROWEST_RAD = 2.0**-17 + 2.0**-30

#: Height that shifts where a line meets the ground, m: more where it grazes it.
HIGHER_M = 5e3

#: The speed of a candidate across the line of sight is its estimate less this many standard
#: deviations: a speed that noise alone exceeds in 1 % of candidates.
_SPEED_SIGMAS = 3.0

#: Mean upward acceleration, m/s², by which the speed of a burning target gives its height, and the
#: greatest height, m. Notional.
STEADY_M_S2 = 20.0
_HIGHEST_BURN_M = 200e3

#: Squared semi-axes of the Earth, m².
_AXES_M2 = (
    np.array([WGS84.equatorial_radius_m, WGS84.equatorial_radius_m, WGS84.polar_radius_m]) ** 2
)


@frozen(eq=False, repr=False)
class Clusters(Columns):
    """Clusters of unassigned lines of one sensor: mean line, its standard deviation, and number of
    scans.

    `is_part` (n,) marks parts of wide clusters.
    """

    sensor: IntArray
    time_s: FloatArray
    origin_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: FloatArray
    scans: IntArray
    is_part: BoolArray


@frozen(eq=False, repr=False)
class TrackCandidates(Columns):
    """Candidates for new tracks: position (n, 3) in ECEF, m, time, and number of sensors.

    `sine` (n,) is that of the angle at which the line of a single sensor meets the ground,
    `speed_m_s` (n,) a lower bound of the speed across it, 0 if unknown; `is_of_parts` (n,) marks
    candidates from parts of wide clusters.
    """

    position_ecef_m: FloatArray
    time_s: FloatArray
    sensors: IntArray
    sine: FloatArray = field(
        default=Factory(lambda self: np.ones(len(self.sensors)), takes_self=True)
    )
    is_of_parts: BoolArray = field(
        default=Factory(lambda self: np.zeros(len(self.sensors), bool), takes_self=True)
    )
    speed_m_s: FloatArray = field(
        default=Factory(lambda self: np.zeros(len(self.sensors)), takes_self=True)
    )

    @property
    def height_by_speed_m(self) -> FloatArray:
        """The heights (n,), m, at which a boost of `STEADY_M_S2` from the ground reaches
        `speed_m_s`.
        """
        return np.asarray(
            np.minimum(np.square(self.speed_m_s) / (2.0 * STEADY_M_S2), _HIGHEST_BURN_M)
        )


@frozen(eq=False)
class Initiation:
    """The cluster of each line (m,), the candidate of its cluster, -1 for none, and the
    candidates.
    """

    cluster: IntArray
    place: IntArray
    begun: TrackCandidates

    def owned(self, place: IntArray, line: IntArray, sensor: IndexArray) -> BoolArray:
        """Return which pairs (n,) of a candidate and a line in its gate, by `sensor`, may initiate
        the track.

        A candidate's gate is wide and may hold neighbours: where a scan missed the target, a
        neighbour's line would shift the track by kilometres. So where any sensor has several
        clusters in the gate, only the candidate's own lines count.
        """
        clusters = np.unique(np.stack([place, sensor, self.cluster[line]]), axis=1)[:2]
        looks, counts = np.unique(clusters, axis=1, return_counts=True)
        crowded = np.isin(place, looks[0, counts > 1])
        is_owned: BoolArray = ~crowded | (self.place[line] == place)
        return is_owned


def track_candidates(
    lines: LinesOfSight, scans_needed: int, bias_sigma_rad: FloatArray
) -> Initiation:
    """Return the candidates of lines, all recent and unassigned, with at least `scans_needed` scans
    each.

    `bias_sigma_rad` (sensors,) is the standard deviation of each sensor's bias, which averaging
    over scans does not reduce.
    """
    clusters, cluster = clusters_of(lines)
    rows_used = np.flatnonzero(clusters.scans >= 2)
    likely = clusters.take(rows_used)
    likely = evolve(likely, sigma_rad=np.hypot(likely.sigma_rad, bias_sigma_rad[likely.sensor]))
    group, count = _candidate_groups(likely)
    scans = np.bincount(group, likely.scans, count)
    sensors = np.bincount(group, minlength=count)
    time_s = np.bincount(group, likely.time_s * likely.scans, count) / np.maximum(scans, 1)
    position = _positions(likely, group, count, sensors)
    is_part = np.bincount(group, likely.is_part, count) > 0.0
    # Part of a wide cluster may be of a target that other sensors begin a track of in this slice.
    needed = np.where(is_part & (sensors == 1), 2 * scans_needed, scans_needed)
    ready = np.flatnonzero((scans >= needed) & np.isfinite(position).all(axis=1))
    sine = np.ones(count)
    if np.count_nonzero(sensors[ready] == 1):
        sine[group] = _sines(likely.direction_ecef, position[group])
    place = np.full(len(clusters), -1)
    number = np.full(count, -1)
    number[ready] = np.arange(len(ready))
    place[rows_used] = number[group]
    begun = TrackCandidates(position, time_s, sensors, sine, is_part).take(ready)
    return Initiation(cluster, place[cluster], _raised_by_speed(begun, lines, place[cluster]))


def _raised_by_speed(
    begun: TrackCandidates, lines: LinesOfSight, owner: IntArray
) -> TrackCandidates:
    """Return candidates with the speeds of those of a single distant sensor, at the heights that
    these give.

    `owner` (m,) are the candidates of lines. The speed is the rate of the points where lines meet
    the ground, across the line of sight; seen from a low orbit, a target above the ground would
    have the speed of the sensor.
    """
    rows = _lines_of(begun.sensors == 1, owner)
    rows = rows[~are_low_orbits(lines.origin_ecef_m[rows])]
    if not len(rows):
        return begun
    candidate_lines = lines.take(rows)
    of = owner[rows]
    count = len(begun)
    total = np.maximum(np.bincount(of, minlength=count), 1)
    since_s = candidate_lines.time_s - (np.bincount(of, candidate_lines.time_s, count) / total)[of]
    foot = points_near_ground(candidate_lines.origin_ecef_m, candidate_lines.direction_ecef)
    across = foot - begun.position_ecef_m[of]
    across -= dot(across, candidate_lines.direction_ecef)[:, None] * candidate_lines.direction_ecef
    blur_m = candidate_lines.sigma_rad * np.sqrt(
        np.sum((foot - candidate_lines.origin_ecef_m) ** 2, axis=1)
    )
    spread = np.maximum(np.bincount(of, since_s * since_s, count), 1e-9)
    rate = group_sums(of, since_s[:, None] * across, count)
    noise = np.sqrt(np.bincount(of, np.square(since_s * blur_m), count))
    speed = np.fmax(np.sqrt(dot(rate, rate)) - _SPEED_SIGMAS * noise, 0.0) / spread
    if not np.count_nonzero(speed):
        return begun
    faster = evolve(begun, speed_m_s=speed)
    # Along the line of sight, towards the sensor.
    newest = np.zeros(count, dtype=np.int64)
    newest[of] = rows
    rise_m = faster.height_by_speed_m / np.maximum(begun.sine, GRAZING_SINE)
    return evolve(
        faster,
        position_ecef_m=begun.position_ecef_m - rise_m[:, None] * lines.direction_ecef[newest],
    )


def _lines_of(candidate: BoolArray, owner: IntArray) -> IntArray:
    """Return the rows of lines whose candidate, by `owner` (m,), -1 for none, is one of some
    (n,).
    """
    return np.flatnonzero(np.append(candidate, False)[owner])


def placed_at_crossings(
    begun: TrackCandidates, lines: LinesOfSight, owner: IntArray
) -> TrackCandidates:
    """Return the candidates, those of a single sensor with lines of others in their gates where
    these lines cross.

    `owner` (m,) are the candidates of lines, by association.
    """
    owned = np.flatnonzero(owner >= 0)
    candidate_of = np.unique(
        np.stack([owner[owned], lines.sensor[owned].astype(np.int64)]), axis=1
    )[0]
    sensors = np.bincount(candidate_of, minlength=len(begun))
    is_crossed = (begun.sensors == 1) & (sensors > 1)
    if not np.count_nonzero(is_crossed):
        return begun
    rows = _lines_of(is_crossed, owner)
    rows_used = lines.take(rows)
    number = np.cumsum(is_crossed) - 1
    of = number[owner[rows]]
    point = triangulated(
        of,
        int(is_crossed.sum()),
        rows_used.origin_ecef_m,
        rows_used.direction_ecef,
        rows_used.sigma_rad,
    ).position_m
    height_m = ecef_to_geodetic(point).height_m
    possible = (height_m > LOWEST_M) & (height_m < HIGHEST_M)
    moved = np.flatnonzero(is_crossed)[possible]
    position = begun.position_ecef_m.copy()
    count = begun.sensors.copy()
    position[moved] = point[possible]
    count[moved] = sensors[moved]
    return evolve(begun, position_ecef_m=position, sensors=count)


def clusters_of(lines: LinesOfSight) -> tuple[Clusters, IntArray]:
    """Return the clusters of lines, and the cluster (m,) of each.

    Clusters are connected groups of occupied direction bins per sensor, or parts of these.
    """
    sensor, sensor_row = np.unique(lines.sensor, return_inverse=True)
    span = np.zeros(len(sensor))
    newest = np.full(len(sensor), -np.inf)
    np.maximum.at(newest, sensor_row, lines.time_s)
    np.maximum.at(span, sensor_row, newest[sensor_row] - lines.time_s)
    direction, sigma_rad = geostationary_directions(lines, sensor_row)
    widest = np.zeros(len(sensor))
    np.maximum.at(widest, sensor_row, sigma_rad)
    width = _WIDE_SIGMAS * widest + _CLUSTER_SPEED_M_S * span / FAR_M
    cluster = _connected(sensor_row, direction, width)
    clusters = _means(lines, cluster)
    if clusters.scans.sum() == len(cluster):
        return clusters, cluster
    cluster, is_part = split_clusters(cluster, lines, direction, sigma_rad)
    return (
        evolve(_means(lines, cluster), is_part=is_part) if np.count_nonzero(is_part) else clusters
    ), cluster


def _connected(sensor_row: IntArray, direction: FloatArray, width: FloatArray) -> IntArray:
    """Return the number of each row's group of touching bins."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    bins = (
        np.floor((direction + 1.0) / np.maximum(width, _NARROWEST_RAD)[sensor_row][:, None]).astype(
            np.int64
        )
        + 1
    )
    size = int(bins.max(initial=0)) + 2
    key, of_row = np.unique(
        ((sensor_row * size + bins[:, 0]) * size + bins[:, 1]) * size + bins[:, 2],
        return_inverse=True,
    )
    neighbour_key = key + (_FORWARD @ np.array([size * size, size, 1]))[:, None]
    place = np.minimum(np.searchsorted(key, neighbour_key), len(key) - 1)
    is_present = key[place] == neighbour_key
    edges = is_present.nonzero()[1], place[is_present]
    graph = coo_array((np.ones(len(edges[0]), dtype=np.int8), edges), shape=(len(key), len(key)))
    label: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return label[of_row]


#: Half of the 26 neighbours of a bin.
_FORWARD = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)]
)


def _means(lines: LinesOfSight, cluster: IntArray) -> Clusters:
    count = int(cluster.max(initial=-1)) + 1
    total = np.maximum(np.bincount(cluster, minlength=count), 1)[:, None]
    scan_of = np.unique(np.stack([cluster, lines.scan], axis=1), axis=0)[:, 0]
    sensor = np.zeros(count, dtype=np.int64)
    sensor[cluster] = lines.sensor
    origin = group_sums(cluster, lines.origin_ecef_m, count) / total
    direction = group_sums(cluster, lines.direction_ecef, count) / total
    if np.count_nonzero(are_low_orbits(origin)):
        aim = (
            group_sums(
                cluster, points_near_ground(lines.origin_ecef_m, lines.direction_ecef), count
            )
            / total
        )
        direction = mean_directions(origin, direction, aim)
    else:
        direction /= np.sqrt(np.sum(direction * direction, axis=1))[:, None]
    return Clusters(
        sensor=sensor,
        time_s=np.bincount(cluster, lines.time_s, count) / total[:, 0],
        origin_ecef_m=origin,
        direction_ecef=direction,
        sigma_rad=np.sqrt(np.bincount(cluster, lines.sigma_rad**2, count)) / total[:, 0],
        scans=np.bincount(scan_of, minlength=count),
        is_part=np.zeros(count, dtype=bool),
    )


def _candidate_groups(clusters: Clusters) -> tuple[IntArray, int]:
    """Return a group number for each cluster, each sensor at most once per group, and the number of
    groups.

    The groups are the cheapest assignment across the sensors of mean lines.
    """
    numbers = np.arange(len(clusters))
    if not len(numbers) or np.ptp(clusters.sensor) == 0:
        return numbers, len(numbers)
    range_m = ranges_m(clusters.origin_ecef_m, clusters.direction_ecef)
    lines = Directions(
        numbers,
        clusters.sensor,
        np.zeros(len(numbers)),
        clusters.origin_ecef_m,
        clusters.direction_ecef,
        _sigma_with_motion(clusters),
    )
    table, centre = normal_equations(lines, numbers, len(numbers), range_m)
    group = cheapest_pairing(table, clusters.sensor, SetModel(centre, begin=True))
    return group, int(group.max()) + 1


def _sines(direction: FloatArray, position_m: FloatArray) -> FloatArray:
    """Return the sines (n,) of the angles at which lines meet the ground below positions (n, 3)."""
    up = position_m / _AXES_M2
    sine: FloatArray = -np.sum(up * direction, axis=1) / np.sqrt(np.sum(up * up, axis=1))
    return sine


def _sigma_with_motion(clusters: Clusters) -> FloatArray:
    """Return the errors of mean lines, including motion during a cluster."""
    return np.hypot(
        clusters.sigma_rad,
        0.1 * _CLUSTER_SPEED_M_S / ranges_m(clusters.origin_ecef_m, clusters.direction_ecef),
    )


def _positions(clusters: Clusters, group: IntArray, count: int, sensors: IntArray) -> FloatArray:
    """Return the positions of candidates: triangulated, or near the ground on a single line."""
    position = np.full((count, 3), np.nan)
    single = sensors[group] == 1
    position[group[single]] = points_near_ground(
        clusters.origin_ecef_m[single], clusters.direction_ecef[single]
    )
    rows = np.flatnonzero(~single)
    if len(rows):
        rows_used, place = np.unique(group[rows], return_inverse=True)
        clusters_ = clusters.take(rows)
        fix = triangulated(
            place,
            len(rows_used),
            clusters_.origin_ecef_m,
            clusters_.direction_ecef,
            _sigma_with_motion(clusters_),
        )
        position[rows_used] = fix.position_m
    return position
