"""Rays that may be no target's: within a track's gate, but not where the rest of its slice lies.

A ray is its track's, with the error that it states, or a stray one. Strays are evenly spread about the track as far as
a gate of that error alone reaches: how wide the track's own uncertainty makes its gate says nothing of how thick strays
lie where its rays do. A ray counts as far as it is the track's, and what is probable is asked again once the track is
where that puts it: expectation and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B 39(1),
1977). What the slice then tells is the observed information (Louis, J. Royal Statistical Society B 44(2), 1982, 226),
which is less than the weights say, for a ray that may be stray tells where the track is only if it is not.

Which share of a track's rays strays is told by the likelihood of all of them so far, over shares on a grid: a running
mean of what rays were taken for would keep what was believed before a share was known (Titterington, J. Royal
Statistical Society B 46(2), 1984, 257). Tracks none of whose rays is improbable are left alone.

Rays that several tracks may have, weighed by the whole of what is known of each track and not by one slice.

Two targets nearer to each other than a look's error are not told apart by giving each ray to one of them: each would
get the rays on its own side, and the two would be driven apart. So a contested ray counts for each track it may belong
to by how probable that is, and what is probable is asked again once the tracks are where that puts them: expectation
and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B 39(1), 1977; Streit and Luginbuhl,
"Probabilistic multi-hypothesis tracking", 1995), with one ray a track and scan. Every turn raises the likelihood of all
rays, summed over all their explanations.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import Sights, along, dot
from opir_core.interfaces.columns import Columns
from opir_trackers.assignment import marginals, ranks
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs

#: A ray that is less probably a track's than this, by its rivals for the ray alone, is none of its.
_LEAST_SHARE = 5e-3

#: A line of sight that is probably nobody's still tells this share of a ray.
LEAST_WEIGHT = 1e-6


@frozen(eq=False)
class AmbiguousMeasurements(Columns):
    """Rays that may be part of lines of sight, one row each: which line of sight, which ray and which scan it is of.

    `seen` (n, 2), rad, is where the ray is in the plane of the line of sight; `odds` (n,) the log likelihood that a ray
    on a track is the track's over that of a miss and a false alarm, by solid angle in units of its variance; `weight`
    (n,) how probably it is, as last asked; `end_s` (n,) when the slice of the ray ended.
    """

    sight: IntArray
    ray: IntArray
    scan: IntArray
    seen: FloatArray
    sigma_rad: FloatArray
    odds: FloatArray
    weight: FloatArray
    end_s: FloatArray

    @classmethod
    def empty(cls) -> "AmbiguousMeasurements":
        """Return the record of no rays."""
        whole, none = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(whole, whole, whole, np.empty((0, 2)), none, none, none, none)

    def weighed(self, track: IntArray, seen: FloatArray) -> "AmbiguousMeasurements":
        """Return the rays with how probably each is the track's, one ray a track and scan, and one track a ray.

        `track` (m,) are the tracks of the lines of sight, `seen` (m, 2) is where they are expected to be seen.
        """
        apart = self.seen - seen.take(self.sight, axis=0)
        log = self.odds - 0.5 * dot(apart, apart) / np.square(self.sigma_rad)
        ratio = np.exp(np.minimum(log, 300.0))
        likely = np.flatnonzero(ratio > _LEAST_SHARE * (1.0 + np.bincount(self.ray, ratio)[self.ray]))
        scan = ranks(track[self.sight[likely]] * (int(self.scan.max(initial=0)) + 1) + self.scan[likely])
        weight = np.zeros(len(self))
        weight[likely] = marginals(scan, self.ray[likely], ratio[likely])
        return evolve(self, weight=weight)

    def gathered(self, sights: Sights) -> tuple[Sights, IntArray]:
        """Return lines of sight with the means of the rays in them, each as sure as they are, and which those are."""
        sharp = np.maximum(self.weight, LEAST_WEIGHT) / np.square(self.sigma_rad)
        total = np.bincount(self.sight, sharp, len(sights))
        mine = np.flatnonzero(total)
        seen, whitener = sights.seen.copy(), sights.whitener.copy()
        for axis in (0, 1):
            seen[mine, axis] = np.bincount(self.sight, sharp * self.seen[:, axis], len(sights))[mine] / total[mine]
        whitener[mine] = np.sqrt(total[mine])[:, None, None] * np.eye(2)
        return evolve(sights, seen=seen, whitener=whitener), mine

    def without(self, gone: BoolArray, sight: IntArray) -> "AmbiguousMeasurements":
        """Return what is left once lines of sight (m,) are gone, others now being numbered `sight` (m,).

        A ray that was theirs with some probability is the less others'.
        """
        left = gone[self.sight]
        size = int(self.ray.max(initial=-1)) + 1
        theirs = np.bincount(self.ray[left], self.weight[left], size)
        odds = self.odds + np.log(np.maximum(1.0 - theirs[self.ray], LEAST_WEIGHT))
        return evolve(self, odds=odds, sight=sight[self.sight]).take(np.flatnonzero(~left))


def expected(path: PredictedMeasurements, sights: Sights) -> FloatArray:
    """Return where (n, 2) lines of sight would be, each in its own plane, if tracks were where they are taken to be."""
    local = along(sights.axes, path.positions(sights.track, sights.time_s) - sights.origin_m)
    seen: FloatArray = local[:, :2] / local[:, 2:]
    return seen


#: Shares of strays, evenly spaced in log odds: none, and from one in a hundred to nine in ten.
_STEP = 0.2
SHARES = np.append(0.0, 1.0 / (1.0 + np.exp(-np.arange(-4.6, 2.3, _STEP))))

#: Before any ray is seen, strays are believed to be this share, as if so many rays had said so.
_SHARE, _BELIEVED = 0.01, 3.0

#: A ray farther off than this, squared standard deviations, is one in a thousand; so large a share of strays is some.
_IMPROBABLE, _SOME = 13.8, 0.02

#: Rays none of which is improbable are not counted while fewer than this are strays: so many that begin later are seen.
FEW = 1e-3

_NONE = np.empty(0, dtype=np.int64)

#: Turns of expectation and maximisation; a slice tells at least this share of what its weights say.
_TURNS, _LEAST_TOLD = 4, 0.2


class Span(NamedTuple):
    """When a slice ends and how long it is, s, and the gate through which its rays were taken, standard deviations."""

    end_s: float
    long_s: float
    gate: float


def _believed() -> FloatArray:
    """Return the logarithms (shares,) of what is believed beforehand: the beta distribution that so many rays leave.

    Its density by log odds is (1 - q)^believed wherever q is no less than the first share; below lies the rest.
    """
    some = _SHARE * _BELIEVED * _STEP * (1.0 - SHARES[1:]) ** _BELIEVED
    return np.asarray(np.log(np.append(1.0 - some.sum(), some)))


_BEFORE, _CLEAN = _believed(), np.log1p(-SHARES)


class Outliers(NamedTuple):
    """What tracks' rays so far say of the share of strays among them: log likelihoods (n, shares), at most 0."""

    log: FloatArray

    @property
    def share(self) -> FloatArray:
        """Return the mean share (n,)."""
        chance = np.exp(self.log + _BEFORE)
        share: FloatArray = np.add.reduce(chance * SHARES, axis=1) / np.add.reduce(chance, axis=1)
        return share

    def take(self, rows: IntArray) -> "Outliers":
        """Return that of some tracks."""
        return Outliers(self.log[rows])

    def after(self, told: FloatArray) -> "Outliers":
        """Return that after more rays, which told so much (n, shares)."""
        log = self.log + told
        return Outliers(log - np.maximum.reduce(log, axis=1, keepdims=True))


class Weighed(NamedTuple):
    """Estimates after a slice, and what (n, shares) its rays tell of each track's share of strays."""

    bank: ModeEstimates
    strays: FloatArray


def doubtful(own: GatedPairs, share: FloatArray) -> IntArray:
    """Return the rows (k,) of tracks, with these shares (n,) of stray rays, that may have some among their own."""
    some = (own.distance > _IMPROBABLE) | (share.take(own.track) > _SOME)
    return np.unique(own.track[some]) if np.count_nonzero(some) else _NONE


def unsuspected(own: GatedPairs, stray: Outliers, gate: float) -> FloatArray:
    """Return what rays none of which is improbable tell of tracks' shares of strays, (n, shares).

    Each tells as much as it is probable that a stray one in its place would have been improbable.
    """
    within = _IMPROBABLE / gate**2 * np.exp(0.5 * own.log_volume) / np.square(own.sigma_rad)
    clean: FloatArray = np.bincount(own.track, np.maximum(1.0 - within, 0.0), stray.log.shape[0])[:, None] * _CLEAN
    return clean


def weighed(
    filter_: ImmFilter, before: ModeEstimates, after: ModeEstimates, span: Span, own: GatedPairs, stray: Outliers
) -> Weighed:
    """Return estimates after a slice with its rays weighed, where the pairs `own` led from `before` to `after`."""
    share = stray.share
    for turn in range(_TURNS + 1):
        weight, place, square = _weights(filter_.outlook(after, span.end_s), span, own, share)
        told = shares_told(square, span.gate, own.track, len(before))
        if turn < _TURNS:
            after = filter_.updated(before, span.end_s, _counted(own, own.seen, weight), span.long_s)
            share = stray.after(told).share
    most = np.bincount(own.track, weight, len(before))
    left = np.bincount(own.track, weight * (1.0 - 0.5 * (1.0 - weight) * square), len(before))
    part = np.maximum(left / np.maximum(most, LEAST_WEIGHT), _LEAST_TOLD)[own.track]
    # Where the path is, such rays pull it as far as they do with their weights, and are as much less sure.
    seen = place + (own.seen - place) / part[:, None]
    after = filter_.updated(before, span.end_s, _counted(own, seen, weight * part), span.long_s)
    return Weighed(after, told)


def shares_told(square: FloatArray, gate: float, track: IntArray, count: int) -> FloatArray:
    """Return what rays (m,), so far off, squared, tell of the shares of strays of `count` tracks, (count, shares).

    Rays beyond the gate are strays, and tell nothing of how many lie within it.
    """
    ratio = 2.0 / gate**2 * np.exp(0.5 * np.minimum(square, gate**2))
    ratio = np.where(square > gate**2, 1.0, ratio)
    log, told = np.log1p(SHARES * (ratio[:, None] - 1.0)), np.zeros((count, len(SHARES)))
    np.add.at(told, track, log)
    return told


def _weights(
    path: PredictedMeasurements, span: Span, own: GatedPairs, share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how probably rays (m,) are their tracks', where those are seen (m, 2), and how far off, squared (m,)."""
    sights = own.sights(own.seen, np.zeros((len(own), 2, 2)))
    place, sharp, stray = expected(path, sights), 1.0 / np.square(own.sigma_rad), share[own.track]
    square = np.sum(np.square(own.seen - place), axis=1) * sharp
    mine = (1.0 - stray) * np.exp(-0.5 * square) * sharp / (2.0 * np.pi)
    others = stray * sharp / (np.pi * span.gate**2)
    return np.maximum(mine / (mine + others), LEAST_WEIGHT), place, square


def _counted(own: GatedPairs, seen: FloatArray, weight: FloatArray) -> Sights:
    """Return pairs as lines of sight at places (m, 2) that count as much as weights (m,) say."""
    return own.sights(seen, (np.sqrt(weight) / own.sigma_rad)[:, None, None] * np.eye(2))
