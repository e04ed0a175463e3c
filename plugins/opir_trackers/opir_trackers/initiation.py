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

from typing import NamedTuple

import numpy as np
from attrs import Factory, evolve, field, frozen
from opir_estimation import (
    FAR_M,
    GRAZING_SINE,
    HIGHEST_M,
    LOWEST_M,
    LinesOfSight,
    are_low_orbits,
    cheapest_assignment,
    dot,
    geostationary_directions,
    group_maxima,
    group_minima,
    group_sums,
    mean_directions,
    points_near_ground,
    ranges_m,
    ranks,
    triangulated,
)

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.geometry import WGS84, ecef_to_geodetic
from opir_core.interfaces import Columns
from opir_trackers.configs import GATE_SIGMAS
from opir_trackers.pairing import Directions, SetModel, cheapest_pairing, normal_equations

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
    split = cluster.copy()
    for wide in _wide_clusters(cluster, lines.scan, direction, sigma_rad).tolist():
        rows = np.flatnonzero(cluster == wide)
        looks = _Looks(lines.time_s[rows], lines.scan[rows], direction[rows], sigma_rad[rows])
        split[rows] = split.max() + 1 + _parts_of(looks)
    number, renumbered = np.unique(split, return_inverse=True)
    return renumbered.astype(np.int64), np.asarray(number > cluster.max(initial=-1))


class _Looks(NamedTuple):
    """Looks (n,) of a wide cluster: time, scan, direction and its error."""

    time_s: FloatArray
    scan: IntArray
    direction: FloatArray
    sigma_rad: FloatArray

    def at(self, rows: IntArray) -> "_Looks":
        """Return some of the looks."""
        return _Looks(
            self.time_s[rows], self.scan[rows], self.direction[rows], self.sigma_rad[rows]
        )


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
    return np.unique(key[0, starts[is_wide]])


def _parts_of(looks: _Looks) -> IntArray:
    """Return the part (n,), from 0, of each line of a wide cluster."""
    count = len(looks.scan)
    parts = np.empty(count, dtype=np.int64)
    total = 0
    mean = np.zeros((count, 3))
    hits = np.zeros(count)
    seen_s = np.zeros(count)
    for scan in np.unique(looks.scan).tolist():
        rows = np.flatnonzero(looks.scan == scan)
        scan_looks = looks.at(rows)
        moved = SPEED_SIGMA_M_S * (scan_looks.time_s[0] - seen_s[:total]) / FAR_M
        drift = np.square(moved / scan_looks.sigma_rad.min())
        blur = np.sqrt(1.0 / hits[:total] + drift)
        same_scan = np.zeros(len(rows), dtype=np.int64)
        row, old = _assigned(scan_looks, mean[:total], blur, same_scan)
        owner = np.full(len(rows), -1)
        owner[row] = old
        new = np.flatnonzero(owner < 0)
        owner[new] = total + np.arange(len(new))
        total += len(new)
        hits[owner] += 1.0
        mean[owner] += (scan_looks.direction - mean[owner]) / hits[owner][:, None]
        seen_s[owner] = scan_looks.time_s
        parts[rows] = owner
    # A line before the first of its own part may have been assigned to a neighbour's.
    blur = np.sqrt(1.0 / hits[:total])
    row, number = _assigned(looks, mean[:total], blur, ranks(looks.scan - looks.scan.min()))
    parts[row] = number
    return parts


def _assigned(
    looks: _Looks, mean: FloatArray, blur: FloatArray, scan: IntArray
) -> tuple[IntArray, IntArray]:
    """Return lines and the parts assigned to them, at most one line per scan (n,), from 0, and
    part.

    `blur` (m,) are the errors of the parts' means (m, 3) in units of a line's error.
    """
    from scipy.spatial import cKDTree

    if not len(mean):
        nothing = np.empty(0, dtype=np.int64)
        return nothing, nothing
    reach = GATE_SIGMAS * looks.sigma_rad.max() * np.hypot(1.0, blur.max())
    tree = cKDTree(looks.direction)
    distances = tree.sparse_distance_matrix(cKDTree(mean), reach, output_type="ndarray")
    line = distances["i"].astype(np.int64)
    number = distances["j"].astype(np.int64)
    square = np.square(distances["v"] / looks.sigma_rad[line]) / (1.0 + np.square(blur[number]))
    cost = square - GATE_SIGMAS**2
    selected = np.flatnonzero(cheapest_assignment(line, scan[line] * len(mean) + number, cost))
    return line[selected], number[selected]


#: Height that shifts where a line meets the ground, m: more where it grazes it.
HIGHER_M = 5e3

#: Mean upward acceleration, m/s², by which the speed of a burning target gives its height.
#: Notional.
STEADY_M_S2 = 20.0


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

    def with_biases(self, sigma_rad: FloatArray) -> "Clusters":
        """Return the clusters with the sensors' biases (sensors,) in their errors."""
        return evolve(self, sigma_rad=np.hypot(self.sigma_rad, sigma_rad[self.sensor]))


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
        # No boost burns above 200 km.
        return np.minimum(np.square(self.speed_m_s) / (2.0 * STEADY_M_S2), 200e3)


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
        return ~crowded | (self.place[line] == place)


def track_candidates(
    lines: LinesOfSight, scans_needed: int, bias_sigma_rad: FloatArray
) -> Initiation:
    """Return the candidates of lines, all recent and unassigned, with at least `scans_needed` scans
    each.

    `bias_sigma_rad` (sensors,) is the standard deviation of each sensor's bias, which averaging
    over scans does not reduce.
    """
    clusters, cluster = clusters_of(lines)
    seen_twice = np.flatnonzero(clusters.scans >= 2)
    likely = clusters.take(seen_twice).with_biases(bias_sigma_rad)
    group, count = _candidate_groups(likely)
    candidates = _candidates(likely, group, count)
    ready = _ready(candidates, np.bincount(group, likely.scans, count), scans_needed)
    number = np.full(count, -1)
    number[ready] = np.arange(len(ready))
    place = np.full(len(clusters), -1)
    place[seen_twice] = number[group]
    owner = place[cluster]
    return Initiation(cluster, owner, _raised_by_speed(candidates.take(ready), lines, owner))


def _ready(candidates: TrackCandidates, scans: IntArray, scans_needed: int) -> IntArray:
    """Return the rows of candidates that have a place, and enough scans (n,)."""
    # Part of a wide cluster may be of a target that other sensors begin a track of in this slice.
    is_doubtful = candidates.is_of_parts & (candidates.sensors == 1)
    needed = np.where(is_doubtful, 2 * scans_needed, scans_needed)
    is_placed = np.isfinite(candidates.position_ecef_m).all(axis=1)
    return np.flatnonzero((scans >= needed) & is_placed)


def _candidates(clusters: Clusters, group: IntArray, count: int) -> TrackCandidates:
    """Return the candidates of groups of clusters (n,)."""
    scans = np.bincount(group, clusters.scans, count)
    sensors = np.bincount(group, minlength=count)
    time_s = np.bincount(group, clusters.time_s * clusters.scans, count) / np.maximum(scans, 1)
    position = _positions(clusters, group, count, sensors)
    is_part = np.bincount(group, clusters.is_part, count) > 0.0
    sine = np.ones(count)
    sine[group] = _sines(clusters.direction_ecef, position[group])
    return TrackCandidates(position, time_s, sensors, sine, is_part)


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
    track = owner[rows]
    speed = _speeds(begun, lines.take(rows), track)
    if not np.count_nonzero(speed):
        return begun
    faster = evolve(begun, speed_m_s=speed)
    # Along the line of sight, towards the sensor.
    newest = np.zeros(len(begun), dtype=np.int64)
    newest[track] = rows
    rise_m = faster.height_by_speed_m / np.maximum(begun.sine, GRAZING_SINE)
    position_m = begun.position_ecef_m - rise_m[:, None] * lines.direction_ecef[newest]
    return evolve(faster, position_ecef_m=position_m)


def _centred(group: IntArray, value: FloatArray, count: int) -> FloatArray:
    """Return values (m,) less the means of their groups."""
    total = np.maximum(np.bincount(group, minlength=count), 1)
    return value - (np.bincount(group, value, count) / total)[group]


def _speeds(begun: TrackCandidates, lines: LinesOfSight, track: IntArray) -> FloatArray:
    """Return lower bounds (n,) of the speeds of candidates across lines (m,) of theirs, `track`.

    These are estimates less three standard deviations: noise alone exceeds them in 1 % of
    candidates.
    """
    count = len(begun)
    since_s = _centred(track, lines.time_s, count)
    foot = points_near_ground(lines.origin_ecef_m, lines.direction_ecef)
    across = foot - begun.position_ecef_m[track]
    across -= dot(across, lines.direction_ecef)[:, None] * lines.direction_ecef
    blur_m = lines.sigma_rad * lines.ranges_m(foot)
    spread = np.maximum(np.bincount(track, since_s * since_s, count), 1e-9)
    rate = group_sums(track, since_s[:, None] * across, count)
    noise = np.sqrt(np.bincount(track, np.square(since_s * blur_m), count))
    return np.fmax(np.sqrt(dot(rate, rate)) - 3.0 * noise, 0.0) / spread


def _lines_of(candidate: BoolArray, owner: IntArray) -> IntArray:
    """Return the rows of lines whose candidate, by `owner` (m,), -1 for none, is one of some
    (n,).
    """
    return np.flatnonzero(np.append(candidate, False)[owner])


def _sensor_counts(lines: LinesOfSight, owner: IntArray, count: int) -> IntArray:
    """Return the numbers (count,) of sensors with lines of each candidate."""
    owned = np.flatnonzero(owner >= 0)
    pairs = np.unique(np.stack([owner[owned], lines.sensor[owned].astype(np.int64)]), axis=1)
    return np.bincount(pairs[0], minlength=count)


def placed_at_crossings(
    begun: TrackCandidates, lines: LinesOfSight, owner: IntArray
) -> TrackCandidates:
    """Return the candidates, those of a single sensor with lines of others in their gates where
    these lines cross.

    `owner` (m,) are the candidates of lines, by association.
    """
    sensors = _sensor_counts(lines, owner, len(begun))
    is_crossed = (begun.sensors == 1) & (sensors > 1)
    if not np.count_nonzero(is_crossed):
        return begun
    point = _crossings_m(is_crossed, lines, owner)
    height_m = ecef_to_geodetic(point).height_m
    possible = (height_m > LOWEST_M) & (height_m < HIGHEST_M)
    moved = np.flatnonzero(is_crossed)[possible]
    position = begun.position_ecef_m.copy()
    count = begun.sensors.copy()
    position[moved] = point[possible]
    count[moved] = sensors[moved]
    return evolve(begun, position_ecef_m=position, sensors=count)


def _crossings_m(is_crossed: BoolArray, lines: LinesOfSight, owner: IntArray) -> FloatArray:
    """Return where the lines of the candidates that `is_crossed` (n,) marks cross, (k, 3)."""
    rows = _lines_of(is_crossed, owner)
    crossing = lines.take(rows)
    group = (np.cumsum(is_crossed) - 1)[owner[rows]]
    return triangulated(
        group,
        int(is_crossed.sum()),
        crossing.origin_ecef_m,
        crossing.direction_ecef,
        crossing.sigma_rad,
    ).position_m


def clusters_of(lines: LinesOfSight) -> tuple[Clusters, IntArray]:
    """Return the clusters of lines, and the cluster (m,) of each.

    Clusters are connected groups of occupied direction bins per sensor, or parts of these.
    """
    sensor, sensor_row = np.unique(lines.sensor, return_inverse=True)
    count = len(sensor)
    oldest = group_minima(sensor_row, lines.time_s, count)
    span = group_maxima(sensor_row, lines.time_s, count) - oldest
    direction, sigma_rad = geostationary_directions(lines, sensor_row)
    widest = group_maxima(sensor_row, sigma_rad, count)
    # Targets move across the line of sight by up to 1 km/s, half of which may be within a cluster.
    width = _WIDE_SIGMAS * widest + 1000.0 * span / FAR_M
    cluster = _connected(sensor_row, direction, width)
    clusters = _means(lines, cluster)
    if clusters.scans.sum() == len(cluster):
        return clusters, cluster
    cluster, is_part = split_clusters(cluster, lines, direction, sigma_rad)
    if np.count_nonzero(is_part):
        clusters = evolve(_means(lines, cluster), is_part=is_part)
    return clusters, cluster


def _connected(sensor_row: IntArray, direction: FloatArray, width: FloatArray) -> IntArray:
    """Return the number of each row's group of touching bins."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # With wider bins three bin numbers fit in 64 bits.
    bin_width = np.maximum(width, 2.0**-17 + 2.0**-30)[sensor_row][:, None]
    bins = np.floor((direction + 1.0) / bin_width).astype(np.int64) + 1
    size = int(bins.max(initial=0)) + 2
    bin_key = ((sensor_row * size + bins[:, 0]) * size + bins[:, 1]) * size + bins[:, 2]
    key, row_key = np.unique(bin_key, return_inverse=True)
    neighbour_key = key + (_FORWARD @ np.array([size * size, size, 1]))[:, None]
    place = np.minimum(np.searchsorted(key, neighbour_key), len(key) - 1)
    is_present = key[place] == neighbour_key
    edges = is_present.nonzero()[1], place[is_present]
    graph = coo_array((np.ones(len(edges[0]), dtype=np.int8), edges), shape=(len(key), len(key)))
    label: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return label[row_key]


#: Half of the 26 neighbours of a bin.
_FORWARD = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)]
)


def _means(lines: LinesOfSight, cluster: IntArray) -> Clusters:
    count = int(cluster.max(initial=-1)) + 1
    total = np.maximum(np.bincount(cluster, minlength=count), 1)
    scan_of = np.unique(np.stack([cluster, lines.scan], axis=1), axis=0)[:, 0]
    sensor = np.zeros(count, dtype=np.int64)
    sensor[cluster] = lines.sensor
    variance = np.bincount(cluster, lines.sigma_rad**2, count)
    origin = group_sums(cluster, lines.origin_ecef_m, count) / total[:, None]
    return Clusters(
        sensor=sensor,
        time_s=np.bincount(cluster, lines.time_s, count) / total,
        origin_ecef_m=origin,
        direction_ecef=_mean_lines(lines, cluster, origin, total),
        sigma_rad=np.sqrt(variance) / total,
        scans=np.bincount(scan_of, minlength=count),
        is_part=np.zeros(count, dtype=bool),
    )


def _mean_lines(
    lines: LinesOfSight, cluster: IntArray, origin: FloatArray, total: IntArray
) -> FloatArray:
    """Return the directions (k, 3) of the mean lines of clusters of `total` (k,) lines with mean
    origins (k, 3).
    """
    count = len(total)
    direction = group_sums(cluster, lines.direction_ecef, count) / total[:, None]
    if np.count_nonzero(are_low_orbits(origin)):
        foot = points_near_ground(lines.origin_ecef_m, lines.direction_ecef)
        aim = group_sums(cluster, foot, count) / total[:, None]
        return mean_directions(origin, direction, aim)
    direction /= np.sqrt(np.sum(direction * direction, axis=1))[:, None]
    return direction


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
    a = WGS84.equatorial_radius_m
    up = position_m / np.array([a, a, WGS84.polar_radius_m]) ** 2
    return -np.sum(up * direction, axis=1) / np.sqrt(np.sum(up * up, axis=1))


def _sigma_with_motion(clusters: Clusters) -> FloatArray:
    """Return the errors of mean lines, including motion during a cluster."""
    return np.hypot(
        clusters.sigma_rad,
        100.0 / ranges_m(clusters.origin_ecef_m, clusters.direction_ecef),
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
        groups, place = np.unique(group[rows], return_inverse=True)
        crossing = clusters.take(rows)
        fix = triangulated(
            place,
            len(groups),
            crossing.origin_ecef_m,
            crossing.direction_ecef,
            _sigma_with_motion(crossing),
        )
        position[groups] = fix.position_m
    return position
