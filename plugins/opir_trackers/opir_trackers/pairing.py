"""Pairing of clusters of lines across sensors, by geometry alone.

Directions of one target meet; those of two targets pass one another. The cost of a set of clusters,
one a sensor, is the sum over its instants of the least squares of the triangulation: for two
sensors the misfit of their epipolar planes. The cheapest one-to-one assignment is exact for two
sensors. For more it is NP-hard: each sensor in turn is assigned to the sets of the others until
nothing changes (multidimensional assignment by relaxation to two dimensions: Poore, Computational
Optimization and Applications 3, 1994), from the present pairing and from none.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import FIRST_HEIGHT_M, cheapest_assignment, ranks

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import WGS84
from opir_core.interfaces import Columns


@frozen
class PairingLaw:
    """Gains and thresholds of pairings, log likelihoods where no unit is given."""

    #: Least gain of a set over its parts alone: a stage that ignites moves focal-plane tracks by
    #: more than their errors for a second or two, and wrong partners lose more within a few slices.
    least_gain: float = -20.0

    #: That of sets that begin tracks: a squared misfit of one degree of freedom above 15.1 has a
    #: probability of 10⁻⁴.
    least_first_gain: float = -7.5

    #: Tolerance below the ground of a first crossing, m, in addition to its own error.
    deep_m: float = 500.0

    #: What a degree of freedom has for one target over different ones, at each of the stretch's
    #: instants: those of different targets are larger by chance three times in four or so, and long
    #: correlated.
    reward: float = 1.0

    #: That of one of a first crossing: mean lines are known to some 350 m, in a crowd of 10 km.
    first_reward: float = 3.0

    #: What a set loses that is of one target only since some instant: in a salvo focal-plane tracks
    #: change targets every 20 s or so.
    swapped: float = 3.0

    #: How many last instants count whatever was before.
    recent: int = 3

    #: What a present pairing has over another, by what came before the stretch.
    present: float = 3.0

    #: Assignments are repeated while they gain more than this.
    tolerance: float = 1e-3

    #: Sets and focal-plane tracks are compared at these instants first, from the last.
    coarse: tuple[int, ...] = (-1, -3, -6)

    #: If they add more to the least squares there, in the mean, they are no pair: two degrees of
    #: freedom exceed it with a probability of 10⁻⁴ at one.
    hopeless: float = 18.0

    #: Lowest and highest distance of a target from the Earth's centre, m.
    lowest_m: float = 6.33e6
    highest_m: float = 7.2e6

    #: Crossings beyond these distances by fewer standard deviations than this may be targets.
    sure_sigmas: float = 5.0

    #: Lines that cross to within no better than this, m, are parallel: nothing says that they are
    #: of one target.
    vague_m: float = 300e3

    #: With this number of sensors, crossings of wrong sets are rare: sets that fit are right. With
    #: more, the assignment starts from the present pairing.
    certain: int = 3

    #: Rounds of assignment of each sensor to the sets of the others.
    rounds: int = 6

    #: Weight of the point of reference, 1/m²: parallel lines meet as far off as 10 000 km.
    least_weight: float = 1e-14

    #: A set of three sensors is sure where it has lost less than this share of its reward: where
    #: the mean least squares of a degree of freedom are below 1.5.
    fitting: float = 0.25


LAW = PairingLaw()


@frozen(eq=False, repr=False)
class Directions(Columns):
    """Kept directions of focal-plane tracks: track number and sensor, slice, unit vectors in ECEF
    and their errors.
    """

    number: IntArray
    sensor: IntArray
    time_s: FloatArray
    origin_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def empty(cls) -> "Directions":
        """Return no directions."""
        numbers = np.empty(0, dtype=np.int64)
        none = np.empty(0)
        vectors = np.empty((0, 3))
        return cls(numbers, numbers, none, vectors, vectors, none)


def normal_equations(
    directions: Directions, row: IntArray, count: int, range_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (count, instants, 12) of the intersections of directions, and a
    point of reference.

    `row` (m,) is the focal-plane track of each direction, `range_m` (m,) its range. Columns: matrix
    (6), side (3), least squares without the point, and numbers of focal-plane tracks and of lines.
    Those of a set are sums.
    """
    instants, instant = np.unique(directions.time_s, return_inverse=True)
    unit = directions.direction_ecef
    centre = np.zeros(3)
    if len(row):
        centre = (directions.origin_ecef_m + range_m[:, None] * unit).mean(axis=0)
    from_centre = directions.origin_ecef_m - centre
    across = from_centre - unit * np.sum(unit * from_centre, axis=1)[:, None]
    weight = 1.0 / np.square(directions.sigma_rad * range_m)
    outer = -unit[:, _FIRST] * unit[:, _SECOND] + (_FIRST == _SECOND)
    square = np.sum(across * across, axis=1)
    columns = [weight[:, None] * outer, weight[:, None] * across, weight * square]
    table = np.zeros((count, len(instants), 12))
    table[row, instant] = np.column_stack([*columns, np.zeros(len(row)), np.ones(len(row))])
    table[..., 10] = 1.0
    return table, centre


#: Rows and columns of the elements of a symmetric matrix (6).
_FIRST = np.array([0, 0, 0, 1, 1, 2])
_SECOND = np.array([0, 1, 2, 1, 2, 2])


class LineCrossings(NamedTuple):
    """Crossings of lines: points (3 of ...), their covariances (6 of ...), m², and the least
    squares (...).

    The least squares of a single line are 0: as a difference they would be rounding errors, of some
    100 where lines have errors of metres.
    """

    point: tuple[FloatArray, ...]
    covariance: tuple[FloatArray, ...]
    misfit: FloatArray

    def last(self) -> "LineCrossings":
        """Return those of the last instant."""
        point = tuple(values[..., -1] for values in self.point)
        covariance = tuple(values[..., -1] for values in self.covariance)
        return LineCrossings(point, covariance, self.misfit[..., -1])


def fixes(table: FloatArray) -> LineCrossings:
    """Return the crossings of sums of normal equations (..., 12)."""
    x, y, z, square = (table[..., column] for column in range(6, 10))
    a, b, c, d, e, f = _inverse(*(table[..., column] for column in range(6)))
    point = a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z
    misfit = square - point[0] * x - point[1] * y - point[2] * z
    misfit = np.where(table[..., 11] > 1.5, misfit, 0.0)
    return LineCrossings(point, (a, b, c, d, e, f), misfit)


def _inverse(
    xx: FloatArray, xy: FloatArray, xz: FloatArray, yy: FloatArray, yz: FloatArray, zz: FloatArray
) -> list[FloatArray]:
    """Return the six elements of the inverses of symmetric matrices, of which parallel lines leave
    a direction open.
    """
    xx = xx + LAW.least_weight
    yy = yy + LAW.least_weight
    zz = zz + LAW.least_weight
    minor_xx = yy * zz - yz * yz
    minor_xy = xz * yz - xy * zz
    minor_xz = xy * yz - xz * yy
    share = 1.0 / (xx * minor_xx + xy * minor_xy + xz * minor_xz)
    minors = minor_xx, minor_xy, minor_xz, xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    return [minor * share for minor in minors]


def _gains(table: FloatArray, misfit: FloatArray, reward: float) -> FloatArray:
    """Return the log likelihoods (...) of sets, by sums of normal equations (..., instants, 12).

    The least squares of an instant with k lines have 2 k - 3 degrees of freedom, each of which has
    a `reward` over different targets. Where a cluster was not there yet, a set has the reward as if
    its lines fitted.
    """
    return reward * _degrees(table[..., 10]).sum(axis=-1) - _losses(table, misfit, reward).min(
        axis=-1
    )


def are_open(table: FloatArray, group: IntArray) -> BoolArray:
    """Return which rows are of sets (n,), from 0, that the pairing may change: of two sensors, or
    that fit badly.

    Lines of three sensors do not cross at all instants by chance.
    """
    sums = set_sums(table, group)
    full_reward = LAW.reward * _degrees(sums[..., 11]).sum(axis=-1)
    is_sure = (sums[:, 0, 10] >= LAW.certain) & (
        _losses(sums, fixes(sums).misfit, LAW.reward)[:, 0] < LAW.fitting * full_reward
    )
    return ~is_sure[group]


def _is_settled(table: FloatArray, group: IntArray) -> bool:
    """Return whether all sets but one are sure, so that nothing can be exchanged."""
    return len(np.unique(group[are_open(table, group)])) < 2


def _losses(table: FloatArray, misfit: FloatArray, reward: float) -> FloatArray:
    """Return what sets lose (..., instants) to perfect ones if they are of one target since each
    instant.
    """
    degrees = _degrees(table[..., 11])
    excess = np.where(degrees > 0.0, 0.5 * (misfit - degrees), 0.0)
    misfits = np.cumsum(excess[..., ::-1], axis=-1)[..., ::-1]
    earlier_reward = np.cumsum(reward * degrees, axis=-1) - reward * degrees
    return (misfits + earlier_reward + LAW.swapped * (earlier_reward > 0.0))[
        ..., : max(table.shape[-2] - LAW.recent, 1)
    ]


def _degrees(lines: FloatArray) -> FloatArray:
    """Return the degrees of freedom of the least squares of crossings of lines."""
    return np.maximum(2.0 * lines - 3.0, 0.0)


class SetModel(NamedTuple):
    """What sets of focal-plane tracks are likely: `centre` (3,) is the point of reference of normal
    equations, ECEF, m.

    `present` (n,) are the sets of the rows as they are: what came before the stretch speaks for
    them. No target is below the ground. Of sets that `begin` tracks the height h at the first look
    counts: its prior density is proportional to 1 / (3 km + h), so that above 3 km each octave is
    equally probable.
    """

    centre: FloatArray
    begin: bool = False
    present: IntArray | None = None

    def total(self, table: FloatArray, group: IntArray) -> float:
        """Return the log likelihood of sets (n,), from 0, of the rows of normal equations."""
        unchanged = (
            0
            if self.present is None
            else len(group) - np.unique(np.stack([group, self.present]), axis=1).shape[1]
        )
        return float(self.gains(set_sums(table, group)).sum()) + LAW.present * unchanged

    @property
    def least_gain(self) -> float:
        """Return the least gain (log likelihood) of a set over its parts alone."""
        return LAW.least_first_gain if self.begin else LAW.least_gain

    def gains(self, table: FloatArray) -> FloatArray:
        """Return `gains` of sums of normal equations (..., instants, 12), with the prior of the
        last height.
        """
        crossings = fixes(table)
        newest = table[..., -1, :]
        height_m, sigma_m = self._heights(crossings.last())
        cost = 0.5 * np.square(np.minimum(height_m, 0.0) / np.hypot(sigma_m, LAW.deep_m))
        if self.begin:
            cost += np.log1p(np.maximum(height_m, 0.0) / FIRST_HEIGHT_M)
        gain = _gains(table, crossings.misfit, LAW.first_reward if self.begin else LAW.reward)
        return gain - np.where(newest[..., 11] > 1.5, cost, 0.0)

    def _heights(self, crossings: LineCrossings) -> tuple[FloatArray, FloatArray]:
        """Return heights (...) of crossings above the ellipsoid, m, to within 50 m, and their
        standard deviations.
        """
        position = self._positions(crossings)
        radius = _length(position)
        x, y, z = (component / radius for component in position)
        ground = WGS84.equatorial_radius_m * (1.0 - WGS84.flattening * np.square(z))
        xx, xy, xz, yy, yz, zz = crossings.covariance
        variance = (
            xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
        )
        return radius - ground, np.sqrt(variance)

    def _positions(self, crossings: LineCrossings) -> list[FloatArray]:
        """Return positions (3 of ...) from the Earth's centre, m."""
        centre = self.centre.tolist()
        return [point + shift for point, shift in zip(crossings.point, centre, strict=True)]

    def _may_be_at_lawful_height(self, crossings: LineCrossings) -> BoolArray:
        radius = _length(self._positions(crossings))
        xx, _, _, yy, _, zz = crossings.covariance
        blur_m = LAW.sure_sigmas * np.sqrt(xx + yy + zz)
        is_within = (radius > LAW.lowest_m - blur_m) & (radius < LAW.highest_m + blur_m)
        return is_within & (blur_m < LAW.sure_sigmas * LAW.vague_m)

    def may_share_target(self, sums: FloatArray, added: FloatArray) -> BoolArray:
        """Return which sums (..., instants, 12), and added ones, may be of one target at a lawful
        height, where both have lines.
        """
        crossings = fixes(sums + added)
        met = (sums[..., 11] > 0.5) & (added[..., 11] > 0.5)
        lawful = ~met | self._may_be_at_lawful_height(crossings)
        misfit = np.where(met, crossings.misfit - fixes(sums).misfit, 0.0).sum(axis=-1)
        misfit = misfit / np.maximum(met.sum(axis=-1), 1)
        return lawful.all(axis=-1) & (misfit < LAW.hopeless)


def _length(position: Sequence[FloatArray]) -> FloatArray:
    x, y, z = position
    return np.sqrt(x * x + y * y + z * z)


class Candidates(NamedTuple):
    """Possible pairs (m,) of a set and a focal-plane track of one sensor, and the log likelihood of
    the addition.
    """

    set: IntArray
    row: IntArray
    gain: FloatArray


def candidates(table: FloatArray, sums: FloatArray, rows: IntArray, model: SetModel) -> Candidates:
    """Return the possible additions of focal-plane tracks `rows` to sets with `sums` (sets,
    instants, 12).

    They are sought at the last instant, then at some.
    """
    added = table[rows]
    sets, row = np.nonzero(model.may_share_target(sums[:, None, -1:], added[None, :, -1:]))
    instants = list(LAW.coarse) if table.shape[1] >= -LAW.coarse[-1] else slice(None)
    coarse = (sums[sets][:, instants], added[row][:, instants])
    likely = ((coarse[0][..., 11] > 0.5) & (coarse[1][..., 11] > 0.5)).any(axis=-1)
    if table.shape[1] > 1:
        likely &= model.may_share_target(*coarse)
    sets = sets[likely]
    row = row[likely]
    gain = model.gains(sums[sets] + added[row]) - model.gains(sums)[sets] - model.gains(added)[row]
    return Candidates(sets, rows[row], gain)


def cheapest_pairing(table: FloatArray, sensor: IntArray, model: SetModel) -> IntArray:
    """Return the set (n,), from 0, of each focal-plane track: at most one of each sensor, of the
    least total cost.
    """
    if model.present is not None and np.ptp(sensor) >= LAW.certain:
        return _relaxed(table, sensor, model.present, model)[0]
    group, total = _relaxed(table, sensor, _in_sequence(table, sensor, model), model)
    if model.present is None and _is_settled(table, group):
        return group
    start = model.present
    if start is None:
        start = _in_sequence(table, sensor.max() - sensor, model)
    alternative, alternative_total = _relaxed(table, sensor, start, model)
    return alternative if alternative_total > total else group


def _in_sequence(table: FloatArray, sensor: IntArray, model: SetModel) -> IntArray:
    """Return sets made sensor by sensor: the rows of each are assigned to the sets of those
    before.
    """
    group = np.arange(len(sensor))
    for number in np.unique(sensor)[1:].tolist():
        rows = np.flatnonzero(sensor <= number)
        subset = model if model.present is None else model._replace(present=model.present[rows])
        group[rows] = _reassigned(table[rows], sensor[rows], ranks(group[rows]), [number], subset)
        # The others stay alone.
        group[sensor > number] = len(sensor) + np.flatnonzero(sensor > number)
    return ranks(group)


def _relaxed(
    table: FloatArray, sensor: IntArray, group: IntArray, model: SetModel
) -> tuple[IntArray, float]:
    """Return sets and their log likelihood after each sensor in turn is assigned until nothing
    changes.

    Where one sensor at a time gains nothing, of four or more sensors pairs are assigned together.
    """
    sensors = np.unique(sensor).tolist()
    single_moves = [[number] for number in sensors]
    pairs = [list(pair) for pair in pairwise(sensors)]
    if len(sensors) == 2:
        group = _reassigned(table, sensor, group, single_moves[1], model)
        return group, model.total(table, group)
    total = model.total(table, group)
    moves = single_moves
    for _ in range(LAW.rounds):
        previous_total = total
        for move in moves:
            group = _reassigned(table, sensor, group, move, model)
        total = model.total(table, group)
        if total > previous_total + LAW.tolerance:
            moves = single_moves
        elif moves is pairs or len(sensors) == 3 or _is_settled(table, group):
            break
        else:
            moves = pairs
    return group, total


def set_sums(table: FloatArray, group: IntArray) -> FloatArray:
    """Return the sums (sets, instants, 12) of the normal equations of each set."""
    sums = np.zeros((int(group.max(initial=-1)) + 1, *table.shape[1:]))
    np.add.at(sums, group, table)
    return sums


def _reassigned(
    table: FloatArray, sensor: IntArray, group: IntArray, moved_sensors: list[int], model: SetModel
) -> IntArray:
    """Return the sets after the pieces of sets of some sensors are assigned to the pieces of the
    others.
    """
    is_moved = np.isin(sensor, moved_sensors)
    rows = np.flatnonzero(is_moved)
    fixed = np.flatnonzero(~is_moved)
    number, fixed_piece = np.unique(group[fixed], return_inverse=True)
    pieces, piece = np.unique(group[rows], return_inverse=True)
    sums = set_sums(table[fixed], fixed_piece)
    pairs = candidates(set_sums(table[rows], piece), sums, np.arange(len(pieces)), model)
    gain = pairs.gain
    if model.present is not None:
        present = _piece_sets(model.present[fixed], fixed_piece)[pairs.set]
        stays = present == _piece_sets(model.present[rows], piece)[pairs.row]
        gain = gain + LAW.present * stays
    assigned = np.flatnonzero(cheapest_assignment(pairs.set, pairs.row, model.least_gain - gain))
    # Pieces that fit no set make sets of their own.
    new_group = int(group.max(initial=0)) + 1 + np.arange(len(pieces))
    new_group[pairs.row[assigned]] = number[pairs.set[assigned]]
    regrouped = group.copy()
    regrouped[rows] = new_group[piece]
    return ranks(regrouped)


def _piece_sets(present: IntArray, piece: IntArray) -> IntArray:
    """Return the present set of each piece: that of its first row (n,)."""
    sets = np.empty(int(piece.max(initial=-1)) + 1, dtype=np.int64)
    sets[piece[::-1]] = present[::-1]
    return sets
