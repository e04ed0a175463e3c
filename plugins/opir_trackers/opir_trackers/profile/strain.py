"""What is known of all tracks' boosts at a time, and how it fades where a target does not fly as the family does.

A family of smooth boosts does not hold every target: stages, other pitch programmes. Where new looks lie farther from
where they are expected than their errors say, time after time, what older looks say counts less, by as much as it
takes: the family then fits the recent past, and the covariance grows. Targets of the family keep their whole past.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.profile import fit
from opir_trackers.profile import hypotheses as hypotheses_of
from opir_trackers.profile.family import Priors
from opir_trackers.profile.fit import Hypotheses
from opir_trackers.profile.rows import Rows
from opir_trackers.profile.seen import LEAN_VARIANCE, TrackHistory

#: What a new innovation weighs in the running mean.
_FRESH = 0.15

#: A drift so improbable, χ² for each component of it beyond their number, is believed.
_BELIEVED = 25.0

#: A tick with such a drift weakens the past to this share.
_SHARE = 0.6

#: What strange targets are off by stays from tick to tick to this share.
KEPT = 0.95

#: A target turns strange at a tick with this chance: a stage, a turn.
TURNS = 4e-3

#: Innovations are believed to be as large as expected, as if so many had said so.
_SMOOTH = 40.0

#: A track's first ticks say nothing of it, and its odds never exceed this.
_UNTRIED, _MOST = 5, 14.0

#: A single look farther off than this, standard deviations, strays no more than this.
_STRAYS = 4.0


@frozen(eq=False)
class OffModelFilters:
    """Hypotheses, sorted by track and class, normal points, what was seen, and how many ticks each track has."""

    hypotheses: Hypotheses
    rows: Rows
    seen: TrackHistory
    ticks: IntArray

    @classmethod
    def empty(cls, sensors: int) -> "OffModelFilters":
        """Return the bank of no tracks."""
        whole = np.empty(0, dtype=np.int64)
        return cls(fit.blank(0, sensors), Rows.empty(), TrackHistory.nothing(whole, sensors), whole)

    def joined(self, other: "OffModelFilters") -> "OffModelFilters":
        """Return the bank with the tracks of another, none of which it has."""
        hypotheses = Hypotheses.concatenate([self.hypotheses, other.hypotheses])
        seen = TrackHistory.concatenate([self.seen, other.seen])
        order = np.argsort(seen.track, kind="stable")
        return OffModelFilters(
            hypotheses.take(np.argsort(hypotheses.track, kind="stable")),
            Rows.concatenate([self.rows, other.rows]),
            seen.take(order),
            np.concatenate([self.ticks, other.ticks])[order],
        )

    def without_fits(self, track: IntArray) -> "OffModelFilters":
        """Return the bank without the hypotheses and rows of tracks, of which it remains known what was seen."""
        if not len(track):
            return self
        return evolve(
            self,
            hypotheses=self.hypotheses.take(~np.isin(self.hypotheses.track, track)),
            rows=self.rows.take(~np.isin(self.rows.track, track)),
        )

    def without(self, track: IntArray) -> "OffModelFilters":
        """Return the bank without tracks."""
        if not len(track):
            return self
        kept = ~np.isin(self.seen.track, track)
        return evolve(self.without_fits(track), seen=self.seen.take(kept), ticks=self.ticks[kept])


def strained(bank: OffModelFilters, fresh: Rows, priors: Priors, bias_sigma_rad: FloatArray) -> OffModelFilters:
    """Return the bank, before fresh rows (m,) are taken in, with the past weakened of tracks that fly otherwise."""
    likely = hypotheses_of.likeliest(bank.hypotheses.take(bank.hypotheses.rows > 0.0))
    mine = np.isin(fresh.track, likely.track)
    fresh = fresh.take(mine)
    if not len(fresh):
        return bank
    owner = np.searchsorted(likely.track, fresh.track)
    innovation = _innovations(likely, fresh, owner, priors, bias_sigma_rad)
    seen = _drifted(bank.seen, fresh, innovation)
    tried = bank.ticks[np.searchsorted(seen.track, fresh.track)] > _UNTRIED
    seen = judged(seen, fresh.take(tried), innovation[tried])
    beyond = seen.drifted() > _BELIEVED
    bank = evolve(bank, seen=seen)
    return _faded(bank, np.where(beyond, _SHARE, 1.0)) if beyond.any() else bank


def _drifted(seen: TrackHistory, rows: Rows, innovation: FloatArray) -> TrackHistory:
    """Return what is seen with the running means of innovations (m, 2) gone on, row by row."""
    drift, wander = seen.drift.copy(), seen.wander.copy()
    place = np.searchsorted(seen.track, rows.track)
    order = np.lexsort((rows.time_s, rows.sensor, place))
    key = place[order] * drift.shape[1] + rows.sensor[order]
    turn = np.arange(len(key)) - np.searchsorted(key, key)
    for number in range(int(turn.max(initial=-1)) + 1):
        one = order[turn == number]
        at = place[one], rows.sensor[one]
        drift[at] = (1.0 - _FRESH) * drift[at] + _FRESH * innovation[one]
        wander[at] = (1.0 - _FRESH) ** 2 * wander[at] + _FRESH**2
    return evolve(seen, drift=drift, wander=wander)


def judged(seen: TrackHistory, rows: Rows, innovation: FloatArray) -> TrackHistory:
    """Return what is seen with the odds told by innovations (m, 2) that targets do not fly as the family does.

    Those of the family's targets are white, and as large as they differ by from one to the next. Those of others are
    off by what stays for a while: a first-order process, followed by Kalman's filter, whose likelihood is held against
    that of no such thing. The chance that a target turns strange at a tick lets the odds rise from any depth soon
    (Shiryaev, Theory of Probability and its Applications 8, 1963, 22).
    """
    lean, doubt, odds = seen.lean.copy(), seen.doubt.copy(), seen.strange.copy()
    newest, rough, jumps = seen.newest.copy(), seen.rough.copy(), seen.jumps.copy()
    place = np.searchsorted(seen.track, rows.track)
    order = np.lexsort((rows.time_s, rows.sensor, place))
    key = place[order] * lean.shape[1] + rows.sensor[order]
    turn = np.arange(len(key)) - np.searchsorted(key, key)
    scale = np.sqrt(np.maximum((rough + _SMOOTH) / (jumps + _SMOOTH), 1.0))
    now = np.unique(place)
    odds[now] = np.logaddexp(odds[now], np.log(TURNS))
    for number in range(int(turn.max(initial=-1)) + 1):
        one = order[turn == number]
        at = place[one], rows.sensor[one]
        expected = KEPT * lean[at]
        variance = KEPT**2 * doubt[at] + (1.0 - KEPT**2) * LEAN_VARIANCE
        jump = 0.5 * np.square(innovation[one] - newest[at])
        np.add.at(rough, place[one], np.nansum(jump, axis=1))
        np.add.at(jumps, place[one], np.isfinite(jump).sum(axis=1))
        newest[at] = innovation[one]
        white = innovation[one] / scale[place[one], None]
        total, off = 1.0 + variance, white - expected
        square = np.square(white) - np.square(off) / total[:, None]
        np.add.at(odds, place[one], 0.5 * square.sum(axis=1) - np.log(total))
        lean[at] = expected + (variance / total)[:, None] * off
        doubt[at] = variance / total
    odds = np.minimum(odds, _MOST)
    return evolve(seen, lean=lean, doubt=doubt, strange=odds, newest=newest, rough=rough, jumps=jumps)


def _innovations(
    likely: Hypotheses, rows: Rows, owner: IntArray, priors: Priors, bias_sigma_rad: FloatArray
) -> FloatArray:
    """Return by how many standard deviations (m, 2) rows differ from what is expected, whitened.

    What is known of the sensors' biases is expected.
    """
    expected, slope = fit.linearised(fit.family_of(likely, priors), rows, owner)
    expected = expected + _biases(likely, bias_sigma_rad)[owner, rows.sensor]
    spread = likely.spread[owner]
    through = np.sum(spread[:, None] * slope[:, :, None], axis=3)
    total = np.sum(through[:, :, None] * slope[:, None], axis=3)
    total[:, [0, 1], [0, 1]] += np.square(rows.sigma_rad)[:, None]
    first = np.sqrt(total[:, 0, 0])
    lean = total[:, 0, 1] / first
    second = np.sqrt(np.maximum(total[:, 1, 1] - lean * lean, np.square(rows.sigma_rad)))
    x = expected[:, 0] / first
    white = np.stack([x, (expected[:, 1] - lean * x) / second], axis=1)
    return np.asarray(np.clip(np.nan_to_num(white), -_STRAYS, _STRAYS))


def _biases(likely: Hypotheses, bias_sigma_rad: FloatArray) -> FloatArray:
    """Return the biases (n, sensors, 2), rad, that the rows of hypotheses tell, given the path."""
    variance = np.square(bias_sigma_rad)
    left = likely.pulled - np.sum(likely.pull * likely.parameters[:, None, :, None], axis=2)
    told: FloatArray = (variance / (1.0 + variance * likely.weight))[:, :, None] * left
    return told


def _faded(bank: OffModelFilters, share: FloatArray) -> OffModelFilters:
    """Return the bank with what tracks' rows say weakened to shares (tracks,)."""
    by_row = share[np.searchsorted(bank.seen.track, bank.rows.track)]
    by_hypothesis = share[np.searchsorted(bank.seen.track, bank.hypotheses.track)]
    return evolve(
        bank,
        hypotheses=bank.hypotheses.faded(by_hypothesis),
        rows=evolve(bank.rows, sigma_rad=bank.rows.sigma_rad / np.sqrt(by_row)),
    )
