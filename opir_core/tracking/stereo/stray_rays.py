"""Rays that may be no target's: within a track's gate, but not where the rest of its slice lies.

A ray is its track's, with the error that it states, or a stray one, evenly spread over the gate through which it was
taken. It counts as far as it is the track's, and what is probable is asked again once the track is where that puts it:
expectation and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B 39(1), 1977). What the slice
then tells is the observed information (Louis, J. Royal Statistical Society B 44(2), 1982, 226), which is less than the
weights say, for a ray that may be stray tells where the track is only if it is not.

A track's share of stray rays is that of all its rays so far. Tracks none of whose rays is improbable are left alone.
"""

from typing import NamedTuple

import numpy as np

from opir_core.records import FloatArray, IntArray
from opir_core.tracking.filter.switching import Bank, SwitchingFilter
from opir_core.tracking.gating import Pairs
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import Sights
from opir_core.tracking.stereo.contested import LEAST_WEIGHT, expected

#: Before any ray is seen, strays are believed to be this share, as if so many rays had said so.
_SHARE, _BELIEVED = 0.01, 3.0

#: A ray farther off than this, squared standard deviations, is one in a thousand; so large a share of strays is some.
_IMPROBABLE, _SOME = 13.8, 0.02

_NONE = np.empty(0, dtype=np.int64)

#: Turns of expectation and maximisation; a slice tells at least this share of what its weights say.
_TURNS, _LEAST_TOLD = 4, 0.2


class Span(NamedTuple):
    """When a slice ends and how long it is, s, and the gate through which its rays were taken, standard deviations."""

    end_s: float
    long_s: float
    gate: float


class Strays(NamedTuple):
    """Which share (n,) of tracks' rays is stray, and how many rays (n,) said so."""

    share: FloatArray
    rays: FloatArray

    @classmethod
    def of(cls, strays: FloatArray, hits: IntArray) -> "Strays":
        """Return that of tracks that had so many stray rays (n,) among so many (n,)."""
        rays: FloatArray = hits + np.float64(_BELIEVED)
        return cls((strays + _SHARE * _BELIEVED) / rays, rays)

    def take(self, rows: IntArray) -> "Strays":
        """Return that of some tracks."""
        return Strays(self.share[rows], self.rays[rows])

    def after(self, strays: FloatArray, hits: IntArray) -> FloatArray:
        """Return the share (n,) after so many more stray rays among so many."""
        share: FloatArray = (self.share * self.rays + strays) / (self.rays + hits)
        return share


class Weighed(NamedTuple):
    """Estimates after a slice, and how many (n,) of its rays are none of each track's."""

    bank: Bank
    strays: FloatArray


def doubtful(own: Pairs, share: FloatArray) -> IntArray:
    """Return the rows (k,) of tracks, with these shares (n,) of stray rays, that may have some among their own."""
    some = (own.distance > _IMPROBABLE) | (share.take(own.track) > _SOME)
    return np.unique(own.track[some]) if np.count_nonzero(some) else _NONE


def weighed(filter_: SwitchingFilter, before: Bank, after: Bank, span: Span, own: Pairs, stray: Strays) -> Weighed:
    """Return estimates after a slice with its rays weighed, where the pairs `own` led from `before` to `after`."""
    share, hits = stray.share, np.bincount(own.track, minlength=len(before)).astype(np.int64)
    for turn in range(_TURNS + 1):
        weight, place, square = _weights(filter_.outlook(after, span.end_s), span, own, share)
        strays: FloatArray = np.bincount(own.track, 1.0 - weight, len(before)).astype(np.float64)
        if turn < _TURNS:
            after = filter_.updated(before, span.end_s, _counted(own, own.seen, weight), span.long_s)
            share = stray.after(strays, hits)
    most = np.bincount(own.track, weight, len(before))
    told = np.bincount(own.track, weight * (1.0 - 0.5 * (1.0 - weight) * square), len(before))
    part = np.maximum(told / np.maximum(most, LEAST_WEIGHT), _LEAST_TOLD)[own.track]
    # Where the path is, such rays pull it as far as they do with their weights, and are as much less sure.
    seen = place + (own.seen - place) / part[:, None]
    after = filter_.updated(before, span.end_s, _counted(own, seen, weight * part), span.long_s)
    return Weighed(after, strays)


def _weights(path: Outlook, span: Span, own: Pairs, share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how probably rays (m,) are their tracks', where those are seen (m, 2), and how far off, squared (m,)."""
    sights = own.sights(own.seen, np.zeros((len(own), 2, 2)))
    place, sharp, stray = expected(path, sights), 1.0 / np.square(own.sigma_rad), share[own.track]
    square = np.sum(np.square(own.seen - place), axis=1) * sharp
    mine = (1.0 - stray) * np.exp(-0.5 * square) * sharp / (2.0 * np.pi)
    others = stray * np.exp(-0.5 * own.log_volume) / (np.pi * span.gate**2)
    return np.maximum(mine / (mine + others), LEAST_WEIGHT), place, square


def _counted(own: Pairs, seen: FloatArray, weight: FloatArray) -> Sights:
    """Return pairs as lines of sight at places (m, 2) that count as much as weights (m,) say."""
    return own.sights(seen, (np.sqrt(weight) / own.sigma_rad)[:, None, None] * np.eye(2))
