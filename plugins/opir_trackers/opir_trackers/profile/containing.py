"""How far ellipses of predicted impacts reach that hold what they say, where these are not normally distributed.

While a burn goes on its end is open, and the impact lies along an arc, far more densely at some places than at others;
hypotheses of class and heading that compete have such an arc each. Mean and covariance say where that is and how wide,
not how much of it an ellipse about the mean holds: that is counted here, over points that stand for the mixture.
"""

import math

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.records import TRACK_CONTAINMENTS
from opir_trackers.profile.end import DEVIATES
from opir_trackers.profile.flight import Moments, off_ground, on_ground

#: Points that stand for a hypothesis: ends of the burn, and so many at each; and the generators of their lattice
#: (Korobov's kind), of all those with which straight and turned, central and distant normal distributions lie in
#: ellipses most nearly as they do: to 0.6 % (root mean square), and 1.9 % at most.
_ENDS, _BESIDE, _GENERATORS = 64, 4, (227, 67)

#: Between nodes logarithms of how likely ends are go no farther than this: polynomials may.
_LARGEST = 20.0

#: No impact is known better than this, m².
_LEAST_M2 = 1e-12


@frozen(eq=False)
class ContainingArcs(Columns):
    """The impacts of n hypotheses as their burns may end; those with ends that are not open (`is_open`) are one place.

    `place` (n, k, 3) are impacts at k ends of the burn, `nodes` (n, k), latitude and longitude, rad, and time, nan of
    those that do not come down. What is left then is normally distributed in two deviates: `sides` (n, k, 2, 2) are
    what these move the impact by, east and north in rows, m, and `bend` (n, k, 2) what the first one's square does.
    `quantiles` (n, deviates) are those of the end; `log` (n, k) are logarithms of how much likelier impacts are there
    than the end is.
    """

    place: FloatArray
    sides: FloatArray
    bend: FloatArray
    nodes: FloatArray
    quantiles: FloatArray
    log: FloatArray
    is_open: BoolArray

    @classmethod
    def of(
        cls,
        place: FloatArray,
        sides: FloatArray,
        bend: FloatArray,
        nodes: FloatArray,
        quantiles: FloatArray,
        log: FloatArray,
    ) -> "ContainingArcs":
        """Return the arcs of hypotheses whose burns' ends are open."""
        return cls(place, sides, bend, nodes, quantiles, log, np.ones(len(nodes), dtype=np.bool_))

    @classmethod
    def still(cls, impacts: Moments, nodes: FloatArray, quantiles: FloatArray) -> "ContainingArcs":
        """Return the arcs of impacts (n, 3) of covariances (n, 3, 3) that do not depend on the end."""
        again, count = nodes.shape[1], len(nodes)
        place, spread = (np.repeat(each[:, None], again, axis=1) for each in (impacts.mean, impacts.covariance))
        straight = np.zeros((count, again, 2))
        alike = np.zeros((count, again))
        return cls(place, factors(spread), straight, nodes, quantiles, alike, np.zeros(count, dtype=np.bool_))


def containing_sigmas(arcs: ContainingArcs, weight: FloatArray, row: IntArray, told: Moments) -> FloatArray:
    """Return the radii (count, 3) of ellipses of told impacts that hold `TRACK_CONTAINMENTS` of what they stand for.

    They are in standard deviations of the told covariances (count, 3, 3). Hypotheses (n,) of one `row` of what is told
    make a mixture of these weights. nan where no impact is told, and where it has a normal distribution: one
    hypothesis, whose burn's end is not open.
    """
    count = len(told)
    found = np.full((count, len(TRACK_CONTAINMENTS)), np.nan)
    is_told = np.isfinite(told.mean).all(axis=1) & np.isfinite(told.covariance).all(axis=(1, 2))
    is_known = np.isfinite(arcs.place[:, :, 0]).any(axis=1)
    parts, opens = (np.bincount(row[mine], minlength=count) for mine in (is_known, is_known & arcs.is_open))
    rows = np.flatnonzero((is_told & ((parts > 1) | (opens > 0)))[row] & is_known)
    if not len(rows):
        return found
    rows = rows[np.argsort(row[rows], kind="stable")]
    square, share = _squares(arcs.take(rows), told.take(row[rows]))
    share = share * weight[rows, None]
    number, first, sizes = np.unique(row[rows], return_index=True, return_counts=True)
    # Tracks of as many hypotheses at a time: what comes of one does not depend on the others.
    for size in np.unique(sizes).tolist():
        mine = sizes == size
        chosen = first[mine, None] + np.arange(size)
        points = (each[chosen].reshape(len(chosen), -1) for each in (square, share))
        found[number[mine]] = np.sqrt(_quantiles(*points))
    return found


def _squares(arcs: ContainingArcs, told: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the squared distances (n, points) of points from what is told, in its covariances, and their shares."""
    likelier, arc = _whitened(arcs, told)
    # Between two deviates an arc is straight.
    spot = arc[:, _BEFORE] + _PART[:, None, None] * (arc[:, _BEFORE + 1] - arc[:, _BEFORE])
    square = np.zeros((len(arc), _ENDS, _BESIDE))
    for axis in (0, 1):
        middle, first, second, bend = (spot[:, :, axis, part, None] for part in range(4))
        square += np.square(middle + (first + bend * _LEFT[..., 0]) * _LEFT[..., 0] + second * _LEFT[..., 1])
    share = np.where(_PART < 0.5, likelier[:, _BEFORE], likelier[:, _BEFORE + 1])
    return square.reshape(len(arc), -1), np.repeat(share, _BESIDE, axis=1)


def _whitened(arcs: ContainingArcs, told: Moments) -> tuple[FloatArray, FloatArray]:
    """Return how much likelier ends at `DEVIATES` are (n, d), 0 of what does not come down, and where (n, d, 2, 4).

    That is in the standard deviations told. The last axis is the place on the arc, and by what the two sides and the
    bend move it.
    """
    about = told.mean[:, None]
    place = on_ground(arcs.place, about)[..., :2]
    known = np.asarray(np.isfinite(place).all(axis=2))
    # What is east at an impact lies in another direction seen from afar.
    moved = [_seen(arcs.place, away, about) - place for away in (arcs.sides[..., 0], arcs.sides[..., 1], arcs.bend)]
    spots = np.where(known[..., None, None], np.stack([place, *moved], axis=3), 0.0)
    white = _inverse(factors(told.covariance[:, None]))
    spots = white[..., :1] * spots[..., :1, :] + white[..., 1:] * spots[..., 1:, :]
    weights = _lagrange(arcs.nodes, known, arcs.quantiles)
    arc = np.sum(weights[..., None, None] * spots[:, None], axis=2)
    nearest = np.abs(arcs.quantiles[:, :, None] - arcs.nodes[:, None]).argmin(axis=2)
    log = np.clip(np.sum(weights * np.where(known, arcs.log, 0.0)[:, None], axis=2), -_LARGEST, _LARGEST)
    return np.where(np.take_along_axis(known, nearest, axis=1), np.exp(log), 0.0), arc


def _seen(place: FloatArray, away: FloatArray, about: FloatArray) -> FloatArray:
    """Return where points lie (n, k, 2), seen from others, that are metres (n, k, 2) east and north of places."""
    at_once = np.concatenate([away, np.zeros((*away.shape[:2], 1))], axis=2)
    return on_ground(off_ground(at_once, place), about)[..., :2]


def _lagrange(nodes: FloatArray, known: BoolArray, wanted: FloatArray) -> FloatArray:
    """Return the weights (n, d, k) of values at known nodes (n, k) in Lagrange's polynomials at places (n, d).

    Gauss's nodes are where polynomials through them do not swing.
    """
    apart = nodes[:, :, None] - nodes[:, None]
    use = known[:, None] & ~np.eye(nodes.shape[1], dtype=np.bool_)
    ratio = (wanted[:, :, None, None] - nodes[:, None, None]) / np.where(use, apart, 1.0)[:, None]
    found: FloatArray = np.prod(np.where(use[:, None], ratio, 1.0), axis=3) * known[:, None]
    return found


def factors(covariance: FloatArray) -> FloatArray:
    """Return the lower triangular factors (n, k, 2, 2) of the first two rows of covariances (n, k, 3, 3)."""
    found = np.zeros((*covariance.shape[:2], 2, 2))
    first = np.sqrt(np.maximum(covariance[..., 0, 0], _LEAST_M2))
    both = covariance[..., 0, 1] / first
    found[..., 0, 0], found[..., 1, 0] = first, both
    found[..., 1, 1] = np.sqrt(np.maximum(covariance[..., 1, 1] - both * both, _LEAST_M2))
    return found


def _inverse(factor: FloatArray) -> FloatArray:
    """Return the inverses (n, k, 2, 2) of lower triangular factors."""
    found = np.zeros_like(factor)
    found[..., 0, 0], found[..., 1, 1] = 1.0 / factor[..., 0, 0], 1.0 / factor[..., 1, 1]
    found[..., 1, 0] = -factor[..., 1, 0] * found[..., 0, 0] * found[..., 1, 1]
    return found


def _quantiles(value: FloatArray, share: FloatArray) -> FloatArray:
    """Return the quantiles (n, 3) of values (n, m) below which `TRACK_CONTAINMENTS` of their shares (n, m) are."""
    order = np.argsort(value, axis=1)
    value, share = (np.take_along_axis(each, order, axis=1) for each in (value, share))
    upto = np.cumsum(share, axis=1)
    # A point stands in the middle of its share.
    below = (upto - 0.5 * share) / upto[:, -1:]
    found = np.empty((len(value), len(TRACK_CONTAINMENTS)))
    row, last = np.arange(len(value)), value.shape[1] - 1
    for column, containment in enumerate(TRACK_CONTAINMENTS):
        after = np.clip(np.count_nonzero(below < containment, axis=1), 1, last)
        low, high = below[row, after - 1], below[row, after]
        part = np.clip((containment - low) / np.maximum(high - low, 1e-300), 0.0, 1.0)
        found[:, column] = value[row, after - 1] + part * (value[row, after] - value[row, after - 1])
    return found


def _lattice() -> tuple[IntArray, FloatArray, FloatArray]:
    """Return points: between which deviates ends are and how far on, (ends,), and deviates (ends, beside, 2) beside.

    Each of their three coordinates is evenly spread in share; the latter two are taken through Box and Muller.
    """
    count = _ENDS * _BESIDE
    fine = np.linspace(DEVIATES[0], DEVIATES[-1], 1201)
    shares = [0.5 * math.erfc(-each / math.sqrt(2.0)) for each in fine.tolist()]
    ends = np.interp((np.arange(_ENDS) + 0.5) / _ENDS, shares, fine)
    place = (ends - DEVIATES[0]) / (DEVIATES[1] - DEVIATES[0])
    before = place.astype(np.int64)
    length, angle = ((np.arange(count) * step % count + 0.5) / count for step in _GENERATORS)
    turned = np.stack([np.cos(2.0 * np.pi * angle), np.sin(2.0 * np.pi * angle)], axis=1)
    beside = np.sqrt(-2.0 * np.log(length))[:, None] * turned
    return before, place - before, beside.reshape(_ENDS, _BESIDE, 2)


_BEFORE, _PART, _LEFT = _lattice()
