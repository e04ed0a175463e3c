"""Which history of a sensor belongs to which track: one assignment over all that was seen since the tracks began.

For each sensor in turn, tracks are what they began with and what the other sensors saw; each history of the sensor that
a track may have is weighed by its likelihood given that. The likeliest one-to-one assignment is made, clusters of any
size at once, and how probable the others are is told: what is undecided stays open, and is told as undecided.

How much likelier an exchange of two tracks' histories makes all their rays, once both have settled into it.

Contested rays lean towards where their tracks are. So an exchange is not judged by the lines of sight as they stand:
both tracks take their shares of the contested rays anew, with and without the exchange, and what is compared is the
likelihood of the rays themselves, summed over all ways in which the two may have them.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import square_root
from opir_core.estimation.lines_of_sight import Sights, along, dot
from opir_trackers.assignment import different, lone, marginals, nearest, ranks
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.stereo.histories import Histories, rows_of, weighed, with_biases
from opir_trackers.stereo.measurement_weights import AmbiguousMeasurements, expected

#: So often both tracks take their shares anew.
_TURNS = 3

#: Of a ray that others claim altogether this is left.
_LEAST_LEFT = 1e-6


class _SwapTrials(NamedTuple):
    """Two tracks a trial, as sides 2 k and 2 k + 1 of trial k: what was known of them first, and what they have seen.

    `sights` (m,) are lines of sight of sides, `rays` (r,) the contested rays in them, and `second` (r,) is 1 for
    rays of odd sides, 0 for others. `meeting` (r,) numbers the different rays (u,) of a trial, `scan` (u,) their scans,
    and `trial` (v,) says which trial a scan is of.
    """

    first: ModeEstimates
    sights: Sights
    rays: AmbiguousMeasurements
    second: FloatArray
    meeting: IntArray
    scan: IntArray
    trial: IntArray


def settled_exchanges(
    filter_: ImmFilter,
    known: Histories,
    bank: ModeEstimates,
    time_s: float,
    sensor: int,
    tracks: IntArray,
    after: ModeEstimates,
) -> tuple[FloatArray, ModeEstimates]:
    """Return how much likelier (log) exchanges of histories make the rays, and the estimates they settle into.

    `tracks` (k, 2) exchange their histories of a sensor, and a bank of 2 k rows says where that would put them at
    `time_s` as the lines of sight stand; `bank` are all estimates without an exchange.
    """
    sides = tracks.ravel()
    row, side = rows_of(known.sights.track, sides)
    other = np.where(known.sensor[row] == sensor, side ^ 1, side)
    first = evolve(known.first, weight=bank.weight, pace=bank.pace).take(sides)
    rivals = _swap_trials(
        known,
        ModeEstimates.concatenate([first, first]),
        np.concatenate([row, row]),
        np.concatenate([side, other + len(sides)]),
    )
    settled, evidence = _reweighted(filter_, rivals, ModeEstimates.concatenate([bank.take(sides), after]), time_s)
    without, gained = evidence.reshape(2, -1)
    return gained - without, settled.take(slice(len(sides), None))


def _swap_trials(known: Histories, first: ModeEstimates, row: IntArray, side: IntArray) -> _SwapTrials:
    """Return the trials of sides (m,) that have rows (m,) of the histories' lines of sight.

    A ray that other tracks claim counts for as much as they leave.
    """
    contested = known.contested
    pick, where = rows_of(contested.sight, row)
    rays, trial = contested.take(pick), side[where] // 2
    rows, scans = int(contested.ray.max(initial=-1)) + 1, int(contested.scan.max(initial=-1)) + 1
    meeting = ranks(trial * rows + rays.ray)
    claimed, held = np.bincount(contested.ray, contested.weight, rows), np.bincount(meeting, rays.weight)
    left = np.clip(1.0 - claimed[rays.ray] + held[meeting], _LEAST_LEFT, 1.0)
    scan_of = ranks(trial * scans + rays.scan)
    scan = np.empty(int(meeting.max(initial=-1)) + 1, dtype=np.int64)
    trial_of = np.empty(int(scan_of.max(initial=-1)) + 1, dtype=np.int64)
    scan[meeting], trial_of[scan_of] = scan_of, trial
    rays = evolve(rays, sight=where, odds=rays.odds + np.log(left))
    second = (side[where] % 2).astype(np.float64)
    return _SwapTrials(first, known.sights.take(row).placed(side), rays, second, meeting, scan, trial_of)


def _reweighted(
    filter_: ImmFilter, rivals: _SwapTrials, bank: ModeEstimates, time_s: float
) -> tuple[ModeEstimates, FloatArray]:
    """Return estimates of the sides after their shares are taken anew, from a bank on, and log likelihoods (trials,).

    Of the Gaussian likelihood of the lines of sight, what the contested ones say is replaced by what their rays do.
    """
    sights, gained = rivals.sights, np.zeros(len(bank))
    for _ in range(_TURNS):
        weight, _ = _shares(rivals, expected(filter_.outlook(bank, time_s), sights))
        sights, mine = evolve(rivals.rays, weight=weight).gathered(sights)
        gained, bank = weighed(filter_, rivals.first, time_s, sights)
    seen = expected(filter_.outlook(bank, time_s), sights)
    _, evidence = _shares(rivals, seen)
    residual = along(sights.whitener[mine], sights.seen[mine] - seen[mine])
    counted = 0.5 * np.bincount(sights.track[mine], dot(residual, residual), len(bank))
    return bank, evidence + (gained + counted).reshape(-1, 2).sum(axis=1)


def _shares(rivals: _SwapTrials, seen: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how probably (r,) each ray is its side's, and the log likelihood (trials,) of all rays.

    With likelihood ratios a and b of the rays of a scan to the two tracks, the ways in which they may have them weigh
    (1 + Σ a) (1 + Σ b) - Σ a b together.
    """
    rays = rivals.rays
    apart = rays.seen - seen.take(rays.sight, axis=0)
    ratio = np.exp(rays.odds - 0.5 * dot(apart, apart) / np.square(rays.sigma_rad))
    size, scans = len(rivals.scan), len(rivals.trial)
    a = np.bincount(rivals.meeting, ratio * (1.0 - rivals.second), size)
    b = np.bincount(rivals.meeting, ratio * rivals.second, size)
    one, other, both = (np.bincount(rivals.scan, value, scans) for value in (a, b, a * b))
    total = (1.0 + one) * (1.0 + other) - both
    first = a * (1.0 + other[rivals.scan] - b) / total[rivals.scan]
    second = b * (1.0 + one[rivals.scan] - a) / total[rivals.scan]
    weight = np.where(rivals.second > 0.0, second[rivals.meeting], first[rivals.meeting])
    return weight, np.bincount(rivals.trial, np.log(total)).astype(np.float64)


#: A track may have a history whose last line of sight is this near to where the other sensors see it, in deviations.
_GATE = 4.5

#: Nor need it be nearer than the track's own, squared, and this: a track that began far off is far from all of them.
_FARTHER = 10.0

#: They are sought as far off as this many deviations.
_REACH = 6.3

#: Histories this much less likely (log) than the track's likeliest are left out.
_LEAST_LOG = -40.0

#: An exchange this much less likely (log) as the lines of sight stand is not tried out.
_HOPELESS = 30.0

#: Of what a track may have, so many are mixed in what is told of it, and none less probable than this.
_MIXED, _LEAST_SHARE = 4, 1e-3

#: What is less doubtful than this is told as it is.
_LEAST_DOUBT = 1e-2


class Decision(NamedTuple):
    """Histories as assigned, estimates (a bank of n rows) that follow, and what to tell.

    The histories' `doubt` is the probability that a track has another history than it was given, of the sensor where
    that is largest; `told` are the estimates with all a track may have mixed in.
    """

    histories: Histories
    bank: ModeEstimates
    told: ModeEstimates


class _Trials(NamedTuple):
    """Tracks (m,), whose history each is given on trial, how likely (log) that is, and the estimates it leads to."""

    track: IntArray
    source: IntArray
    gain: FloatArray
    bank: ModeEstimates

    def of(self, rows: IntArray) -> "_Trials":
        return _Trials(self.track[rows], self.source[rows], self.gain[rows], self.bank.take(rows))


def decided(
    filter_: ImmFilter,
    known: Histories,
    bank: ModeEstimates,
    time_s: float,
    bias_sigma_rad: FloatArray,
    asked: BoolArray | None = None,
) -> Decision:
    """Return what follows from histories of tracks whose estimates at `time_s` are a bank (n rows).

    `bias_sigma_rad` (sensors,) are standard deviations of the sensors' biases; `asked` (n,) are the tracks whose
    histories are not settled, by default all.
    """
    told, doubt = bank, np.zeros(len(known))
    if len(known) < 2:
        return Decision(evolve(known, doubt=doubt), bank, bank)
    asked = np.ones(len(known), dtype=bool) if asked is None else asked
    for sensor in different(known.sensor).tolist():
        trials = _trials(filter_, known, with_biases(known, bias_sigma_rad), bank, time_s, sensor, asked)
        if not len(trials.track):
            continue
        trials = _after_swaps(filter_, known, trials, bank, time_s, sensor)
        chosen = nearest(trials.track, trials.source, _costs(trials.gain))
        beta = marginals(trials.track, trials.source, np.exp(_below_best(trials) + _SURELY))
        known, bank, told = _exchanged(known, bank, told, sensor, trials, chosen)
        open_ = np.zeros(len(known))
        open_[trials.track[chosen]] = 1.0 - beta[chosen]
        worse = np.flatnonzero(open_ > np.maximum(doubt, _LEAST_DOUBT))
        if len(worse):
            told = told.put(worse, _mixed(worse, trials, chosen, _of_some(trials.track, beta), bank))
        doubt = np.maximum(doubt, open_)
    return Decision(evolve(known, doubt=doubt), bank, told)


#: Every track has some history: e to this times as likely as none, when that is its likeliest.
_SURELY = 60.0


def _below_best(trials: _Trials) -> FloatArray:
    """Return how likely (log) trials are (m,), each track's likeliest at 0: exchanges may settle far above that."""
    best = np.full(int(trials.track.max()) + 1, -np.inf)
    np.maximum.at(best, trials.track, trials.gain)
    below: FloatArray = trials.gain - best[trials.track]
    return below


def _of_some(track: IntArray, beta: FloatArray) -> FloatArray:
    """Return the probabilities (m,) of trials, given that their track has some history.

    Where every explanation that gives all tracks one is less probable yet than one without, some are left with next to
    nothing: of that too they have their shares, and equal ones of nothing.
    """
    total, count = np.bincount(track, beta)[track], np.bincount(track)[track]
    share: FloatArray = np.where(total > 0.0, beta, 1.0) / np.where(total > 0.0, total, count)
    return share


def _costs(gain: FloatArray) -> FloatArray:
    """Return what pairs cost, so that first of all as many as possible are used."""
    cost: FloatArray = -(gain - gain.min(initial=0.0) + 1.0) - len(gain) * np.ptp(gain)
    return cost


def _trials(
    filter_: ImmFilter,
    known: Histories,
    sights: Sights,
    bank: ModeEstimates,
    time_s: float,
    sensor: int,
    asked: BoolArray,
) -> _Trials:
    """Return the histories of a sensor that tracks may have, of tracks that share some with others."""
    mine = known.sensor == sensor
    count = len(known)
    seen = np.bincount(sights.track[mine], minlength=count) > 0
    seen &= (np.bincount(sights.track[~mine], minlength=count) > 0) & asked
    rows = np.flatnonzero(seen)
    first = evolve(known.first, weight=bank.weight, pace=bank.pace)
    others = sights.take(np.flatnonzero(~mine & seen[sights.track]))
    theirs = sights.take(np.flatnonzero(mine & seen[sights.track]))
    if len(rows) < 2:
        return _Trials(rows[:0], rows[:0], np.empty(0), bank.take(rows[:0]))
    without = weighed(filter_, first, time_s, others)[1]
    track, source = _near(filter_.outlook(without, time_s), filter_.outlook(bank, time_s), theirs, rows)
    row, which = rows_of(theirs.track, source)
    gain, after = weighed(filter_, without.take(track), time_s, theirs.take(row).placed(which))
    best = np.full(count, -np.inf)
    np.maximum.at(best, track, gain)
    gain = gain - best[track]
    likely = np.flatnonzero((gain > _LEAST_LOG) | (track == source))
    return _with_rivals(_Trials(track, source, np.maximum(gain, _LEAST_LOG), after).of(likely))


def _after_swaps(
    filter_: ImmFilter, known: Histories, trials: _Trials, bank: ModeEstimates, time_s: float, sensor: int
) -> _Trials:
    """Return the trials with those in which two tracks exchange contested histories judged by what both settle into."""
    go, back = _exchanges(trials, different(known.sights.track[known.contested.sight]))
    own = np.full(len(known), -1, dtype=np.int64)
    same = np.flatnonzero(trials.track == trials.source)
    own[trials.track[same]] = same
    mine, theirs = own[trials.track[go]], own[trials.track[back]]
    loss = trials.gain[mine] + trials.gain[theirs] - trials.gain[go] - trials.gain[back]
    some = np.flatnonzero(loss < _HOPELESS)
    if not len(some):
        return trials
    rows, theirs = np.stack([go, back], axis=1)[some], np.stack([mine, theirs], axis=1)[some]
    better, after = settled_exchanges(
        filter_, known, bank, time_s, sensor, trials.track[rows], trials.bank.take(rows.ravel())
    )
    gain = trials.gain.copy()
    gain[rows] = trials.gain[theirs] + 0.5 * better[:, None]
    return _Trials(trials.track, trials.source, gain, trials.bank.put(rows.ravel(), after))


def _exchanges(trials: _Trials, contested: IntArray) -> tuple[IntArray, IntArray]:
    """Return the trials in which one of two `contested` tracks has the other's history, and those of the other way."""
    size = int(max(trials.track.max(), trials.source.max())) + 1
    key, back = trials.track * size + trials.source, trials.source * size + trials.track
    order = np.argsort(key)
    place = order[np.minimum(np.searchsorted(key[order], back), len(key) - 1)]
    both = (key[place] == back) & np.isin(trials.track, contested) & np.isin(trials.source, contested)
    go = np.flatnonzero(both & (trials.track < trials.source))
    return go, place[go]


def _with_rivals(trials: _Trials) -> _Trials:
    """Return the trials of tracks that have more than one history to choose from, or share theirs."""
    return trials.of(np.flatnonzero(~lone(trials.track, trials.source)))


def _near(
    without: PredictedMeasurements, whole: PredictedMeasurements, theirs: Sights, rows: IntArray
) -> tuple[IntArray, IntArray]:
    """Return tracks and sources of the histories that pass the gate, and every track with its own."""
    from scipy.spatial import cKDTree

    last = np.zeros(len(whole.side), dtype=np.int64)
    last[theirs.track] = np.arange(len(theirs))
    place = whole.derivative[rows, 0]
    # A track that another sensor's rays put elsewhere is still seen in its own direction: look as far as it may be off.
    reach = _REACH * (without.reach_m(0.0)[rows] + float(whole.reach_m(0.0)[rows].max()))
    found = cKDTree(place).query_ball_point(without.derivative[rows, 0], reach, return_sorted=True)
    track = np.repeat(rows, [len(near) for near in found])
    source = rows[np.concatenate([np.array(near, dtype=np.int64) for near in found])]
    others = track != source
    track, source = np.concatenate([rows, track[others]]), np.concatenate([rows, source[others]])
    sights = theirs.take(last[source])
    residual, slope = sights.residuals(without.positions(track, sights.time_s))
    side = slope @ without.position_sides(track, sights.time_s)
    spread = side @ side.transpose(0, 2, 1) + np.eye(2)
    distance = np.sum(residual * np.linalg.solve(spread, residual[:, :, None])[:, :, 0], axis=1)
    own = np.zeros(len(last))
    own[rows] = distance[: len(rows)]
    inside = (distance < np.maximum(_GATE**2, own[track] + _FARTHER)) | (track == source)
    return track[inside], source[inside]


def _exchanged(
    known: Histories, bank: ModeEstimates, told: ModeEstimates, sensor: int, trials: _Trials, chosen: BoolArray
) -> tuple[Histories, ModeEstimates, ModeEstimates]:
    """Return histories, estimates and what is told once a sensor's histories are where they were assigned."""
    moved = np.flatnonzero(chosen & (trials.track != trials.source))
    if not len(moved):
        return known, bank, told
    place = np.arange(len(known))
    place[trials.source[moved]] = trials.track[moved]
    track = np.where(known.sensor == sensor, place[known.sights.track], known.sights.track)
    after = trials.bank.take(moved)
    rows = trials.track[moved]
    return evolve(known, sights=known.sights.placed(track)), bank.put(rows, after), told.put(rows, after)


def _mixed(rows: IntArray, trials: _Trials, chosen: BoolArray, beta: FloatArray, bank: ModeEstimates) -> ModeEstimates:
    """Return the estimates of tracks (rows) mixed over the histories they may have, by first and second moments."""
    stands = _nearer(trials, chosen)
    order = np.lexsort((-beta, trials.track))
    order = order[beta[order] > _LEAST_SHARE]
    start, stop = np.searchsorted(trials.track[order], rows), np.searchsorted(trials.track[order], rows, side="right")
    spot = start[:, None] + np.arange(_MIXED)
    there = spot < stop[:, None]
    pick = order[np.where(there, spot, start[:, None])]
    share = np.where(there, beta[pick], 0.0)
    share /= share.sum(axis=1, keepdims=True)
    parts = [trials.bank.take(stands[pick[:, column]]) for column in range(_MIXED)]
    boost = square_root.mixed(share, tuple(p.boost_mean for p in parts), tuple(p.boost_root for p in parts))
    coast = square_root.mixed(share, tuple(p.coast_mean for p in parts), tuple(p.coast_root for p in parts))
    own = bank.take(rows)
    return ModeEstimates(own.weight, *boost, *coast, own.pace)


def _nearer(trials: _Trials, chosen: BoolArray) -> IntArray:
    """Return for each trial (m,) the one that stands for it in a mixture: itself, or that of whom it exchanges with.

    An exchange that leaves two tracks nearer to each other's places than to their own changes who is who and little
    else. Whom the numbers belong to is not what is asked: so each mixes with what comes to lie near it (the set JPDA of
    Svensson et al., IEEE Trans. Signal Processing 59(10), 2011).
    """
    size = int(max(trials.track.max(), trials.source.max())) + 1
    has, holder, row = (np.full(size, -1, dtype=np.int64) for _ in range(3))
    used = np.flatnonzero(chosen)
    has[trials.track[used]], holder[trials.source[used]] = trials.source[used], trials.track[used]
    row[trials.track[used]] = used
    key = trials.track * size + trials.source
    order = np.argsort(key)
    other = holder[trials.source]
    sought = other * size + has[trials.track]
    back = order[np.minimum(np.searchsorted(key[order], sought), len(key) - 1)]
    place = trials.bank.likelier_position_m
    here, there = place[row[trials.track]], place[row[np.maximum(other, 0)]]
    stays = np.sum((place - here) ** 2 + (place[back] - there) ** 2, axis=1)
    swaps = np.sum((place - there) ** 2 + (place[back] - here) ** 2, axis=1)
    return np.where((key[back] == sought) & (other >= 0) & (swaps < stays), back, np.arange(len(key)))
