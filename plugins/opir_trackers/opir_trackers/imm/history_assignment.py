"""Assignment of each sensor's histories to tracks, over all data since the tracks began.

For each sensor in turn, tracks are their initial estimates updated by the other sensors; the likelihood of each history
of the sensor is computed given those. The likeliest one-to-one assignment is made, and the probabilities of the others
are computed: where they remain significant, the mixture is reported.

Ambiguous lines are weighted towards the current tracks. So a swap of two histories is not evaluated with the weights as
they are: both tracks are reweighted with and without the swap, and the likelihoods of the lines themselves, summed over
all hypotheses, are compared.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import dot, matvec, square_root
from opir_trackers.assignment import cheapest_assignment, distinct, marginals, ranks, unambiguous
from opir_trackers.configs import GATE_SIGMAS
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.imm.histories import Histories, rows_of, updated_with_likelihood, with_biases
from opir_trackers.imm.measurement_weights import AmbiguousMeasurements, predicted_directions
from opir_trackers.lines_of_sight import AngleMeasurements

#: Iterations of the reweighting.
_TURNS = 3

#: Least remaining weight of a line that other tracks claim.
_LEAST_LEFT = 1e-6


class _SwapTrials(NamedTuple):
    """Two tracks per trial, as sides 2 k and 2 k + 1 of trial k: initial estimates and measurements.

    `measurements` (m,) are those of sides, `lines` (r,) the ambiguous lines in them, and `second` (r,) is 1 for lines
    of odd sides, else 0. `meeting` (r,) numbers the distinct lines (u,) of a trial, `scan` (u,) their scans, and
    `trial` (v,) is the trial of each scan.
    """

    first: ModeEstimates
    measurements: AngleMeasurements
    lines: AmbiguousMeasurements
    second: FloatArray
    meeting: IntArray
    scan: IntArray
    trial: IntArray


def swap_log_likelihoods(
    filter_: ImmFilter,
    known: Histories,
    estimates: ModeEstimates,
    time_s: float,
    sensor: int,
    tracks: IntArray,
    after: ModeEstimates,
) -> tuple[FloatArray, ModeEstimates]:
    """Return the gain (log likelihood) of swaps of histories, and the estimates that they lead to.

    `tracks` (k, 2) swap their histories of a sensor; `after`, of 2 k rows, are their estimates at `time_s` with the
    current weights; `estimates` are those without a swap.
    """
    sides = tracks.ravel()
    row, side = rows_of(known.measurements.track, sides)
    other = np.where(known.sensor[row] == sensor, side ^ 1, side)
    first = evolve(known.first, weight=estimates.weight, detection_rate=estimates.detection_rate).take(sides)
    rivals = _swap_trials(
        known,
        ModeEstimates.concatenate([first, first]),
        np.concatenate([row, row]),
        np.concatenate([side, other + len(sides)]),
    )
    settled, evidence = _reweighted(filter_, rivals, ModeEstimates.concatenate([estimates.take(sides), after]), time_s)
    without, gained = evidence.reshape(2, -1)
    return gained - without, settled.take(slice(len(sides), None))


def _swap_trials(known: Histories, first: ModeEstimates, row: IntArray, side: IntArray) -> _SwapTrials:
    """Return the trials of sides (m,) with rows (m,) of the histories' measurements.

    A line that other tracks claim counts for the remainder.
    """
    contested = known.contested
    pick, where = rows_of(contested.measurement, row)
    lines, trial = contested.take(pick), side[where] // 2
    rows, scans = int(contested.line.max(initial=-1)) + 1, int(contested.scan.max(initial=-1)) + 1
    meeting = ranks(trial * rows + lines.line)
    claimed, held = np.bincount(contested.line, contested.weight, rows), np.bincount(meeting, lines.weight)
    left = np.clip(1.0 - claimed[lines.line] + held[meeting], _LEAST_LEFT, 1.0)
    scan_of = ranks(trial * scans + lines.scan)
    scan = np.empty(int(meeting.max(initial=-1)) + 1, dtype=np.int64)
    trial_of = np.empty(int(scan_of.max(initial=-1)) + 1, dtype=np.int64)
    scan[meeting], trial_of[scan_of] = scan_of, trial
    lines = evolve(lines, measurement=where, log_odds=lines.log_odds + np.log(left))
    second = (side[where] % 2).astype(np.float64)
    return _SwapTrials(first, known.measurements.take(row).with_track(side), lines, second, meeting, scan, trial_of)


def _reweighted(
    filter_: ImmFilter, rivals: _SwapTrials, estimates: ModeEstimates, time_s: float
) -> tuple[ModeEstimates, FloatArray]:
    """Return estimates of the sides after reweighting, and log likelihoods (trials,).

    In the Gaussian likelihood of the measurements, the part of the ambiguous ones is replaced by that of their lines.
    """
    measurements, gained = rivals.measurements, np.zeros(len(estimates))
    for _ in range(_TURNS):
        weight, _ = _swap_probabilities(
            rivals, predicted_directions(filter_.predicted_measurements(estimates, time_s), measurements)
        )
        measurements, mine = evolve(rivals.lines, weight=weight).gathered(measurements)
        gained, estimates = updated_with_likelihood(filter_, rivals.first, time_s, measurements)
    seen = predicted_directions(filter_.predicted_measurements(estimates, time_s), measurements)
    _, evidence = _swap_probabilities(rivals, seen)
    residual = matvec(measurements.whitener[mine], measurements.measured[mine] - seen[mine])
    counted = 0.5 * np.bincount(measurements.track[mine], dot(residual, residual), len(estimates))
    return estimates, evidence + (gained + counted).reshape(-1, 2).sum(axis=1)


def _swap_probabilities(rivals: _SwapTrials, seen: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the association probability (r,) of each line with its side, and the log likelihood (trials,).

    With likelihood ratios a and b of the lines of a scan to the two tracks, all hypotheses together weigh (1 + Σ a) (1
    + Σ b) - Σ a b.
    """
    lines = rivals.lines
    apart = lines.measured - seen.take(lines.measurement, axis=0)
    ratio = np.exp(lines.log_odds - 0.5 * dot(apart, apart) / np.square(lines.sigma_rad))
    size, scans = len(rivals.scan), len(rivals.trial)
    a = np.bincount(rivals.meeting, ratio * (1.0 - rivals.second), size)
    b = np.bincount(rivals.meeting, ratio * rivals.second, size)
    one, other, both = (np.bincount(rivals.scan, value, scans) for value in (a, b, a * b))
    total = (1.0 + one) * (1.0 + other) - both
    first = a * (1.0 + other[rivals.scan] - b) / total[rivals.scan]
    second = b * (1.0 + one[rivals.scan] - a) / total[rivals.scan]
    weight = np.where(rivals.second > 0.0, second[rivals.meeting], first[rivals.meeting])
    return weight, np.bincount(rivals.trial, np.log(total)).astype(np.float64)


#: A history's last measurement may also exceed the track's own squared distance by this: tracks may begin far off.
_FARTHER = 10.0

#: Search radius of histories, standard deviations.
_REACH = 6.3

#: Histories less likely than the track's likeliest by this (log) are left out.
_LEAST_LOG = -40.0

#: Swaps less likely by this (log) with the current weights are not evaluated.
_HOPELESS = 30.0

#: Number of histories in a reported mixture, and their least probability.
_MIXED, _LEAST_SHARE = 4, 1e-3

#: Below this probability of another assignment no mixture is reported.
_LEAST_DOUBT = 1e-2


class HistoryAssignment(NamedTuple):
    """Assigned histories, the estimates (n rows) that follow, and the reported estimates.

    The histories' `doubt` is the probability of another assignment, for the sensor where it is largest; `reported` are
    the estimates mixed over possible assignments.
    """

    histories: Histories
    estimates: ModeEstimates
    reported: ModeEstimates


class _Trials(NamedTuple):
    """Tracks (m,), the source of the history given to each, its log likelihood, and the estimates that follow."""

    track: IntArray
    source: IntArray
    gain: FloatArray
    estimates: ModeEstimates

    def of(self, rows: IntArray) -> "_Trials":
        return _Trials(self.track[rows], self.source[rows], self.gain[rows], self.estimates.take(rows))


def assigned_histories(
    filter_: ImmFilter,
    known: Histories,
    estimates: ModeEstimates,
    time_s: float,
    bias_sigma_rad: FloatArray,
    asked: BoolArray | None = None,
) -> HistoryAssignment:
    """Return the assignment of histories of tracks with estimates at `time_s` (n rows).

    `bias_sigma_rad` (sensors,) are the standard deviations of the sensors' biases; `asked` (n,) are the tracks with
    undecided histories, by default all.
    """
    reported, doubt = estimates, np.zeros(len(known))
    if len(known) < 2:
        return HistoryAssignment(evolve(known, doubt=doubt), estimates, estimates)
    asked = np.ones(len(known), dtype=bool) if asked is None else asked
    for sensor in distinct(known.sensor).tolist():
        trials = _trials(filter_, known, with_biases(known, bias_sigma_rad), estimates, time_s, sensor, asked)
        if not len(trials.track):
            continue
        trials = _after_swaps(filter_, known, trials, estimates, time_s, sensor)
        chosen = cheapest_assignment(trials.track, trials.source, _costs(trials.gain))
        beta = marginals(trials.track, trials.source, np.exp(_below_best(trials) + _FORCED_LOG))
        known, estimates, reported = _reassigned(known, estimates, reported, sensor, trials, chosen)
        open_ = np.zeros(len(known))
        open_[trials.track[chosen]] = 1.0 - beta[chosen]
        worse = np.flatnonzero(open_ > np.maximum(doubt, _LEAST_DOUBT))
        if len(worse):
            reported = reported.put(
                worse, _moment_matched(worse, trials, chosen, _normalised_by_track(trials.track, beta), estimates)
            )
        doubt = np.maximum(doubt, open_)
    return HistoryAssignment(evolve(known, doubt=doubt), estimates, reported)


#: Every track has a history: log weight of the likeliest relative to none.
_FORCED_LOG = 60.0


def _below_best(trials: _Trials) -> FloatArray:
    """Return log likelihoods (m,) relative to each track's likeliest; swaps may exceed the current ones."""
    best = np.full(int(trials.track.max()) + 1, -np.inf)
    np.maximum.at(best, trials.track, trials.gain)
    below: FloatArray = trials.gain - best[trials.track]
    return below


def _normalised_by_track(track: IntArray, beta: FloatArray) -> FloatArray:
    """Return the probabilities (m,) of trials, given that their track has a history.

    Tracks whose probabilities sum to 0 get equal ones.
    """
    total, count = np.bincount(track, beta)[track], np.bincount(track)[track]
    share: FloatArray = np.where(total > 0.0, beta, 1.0) / np.where(total > 0.0, total, count)
    return share


def _costs(gain: FloatArray) -> FloatArray:
    """Return costs with which as many pairs as possible are used."""
    cost: FloatArray = -(gain - gain.min(initial=0.0) + 1.0) - len(gain) * np.ptp(gain)
    return cost


def _trials(
    filter_: ImmFilter,
    known: Histories,
    measurements: AngleMeasurements,
    estimates: ModeEstimates,
    time_s: float,
    sensor: int,
    asked: BoolArray,
) -> _Trials:
    """Return the possible histories of a sensor, of tracks that share some with others."""
    mine = known.sensor == sensor
    count = len(known)
    seen = np.bincount(measurements.track[mine], minlength=count) > 0
    seen &= (np.bincount(measurements.track[~mine], minlength=count) > 0) & asked
    rows = np.flatnonzero(seen)
    first = evolve(known.first, weight=estimates.weight, detection_rate=estimates.detection_rate)
    others = measurements.take(np.flatnonzero(~mine & seen[measurements.track]))
    theirs = measurements.take(np.flatnonzero(mine & seen[measurements.track]))
    if len(rows) < 2:
        return _Trials(rows[:0], rows[:0], np.empty(0), estimates.take(rows[:0]))
    without = updated_with_likelihood(filter_, first, time_s, others)[1]
    track, source = _gated_histories(
        filter_.predicted_measurements(without, time_s), filter_.predicted_measurements(estimates, time_s), theirs, rows
    )
    row, which = rows_of(theirs.track, source)
    gain, after = updated_with_likelihood(filter_, without.take(track), time_s, theirs.take(row).with_track(which))
    best = np.full(count, -np.inf)
    np.maximum.at(best, track, gain)
    gain = gain - best[track]
    likely = np.flatnonzero((gain > _LEAST_LOG) | (track == source))
    return _with_rivals(_Trials(track, source, np.maximum(gain, _LEAST_LOG), after).of(likely))


def _after_swaps(
    filter_: ImmFilter, known: Histories, trials: _Trials, estimates: ModeEstimates, time_s: float, sensor: int
) -> _Trials:
    """Return the trials, with those in which two tracks swap ambiguous histories evaluated after reweighting."""
    go, back = _swap_pairs(trials, distinct(known.measurements.track[known.contested.measurement]))
    own = np.full(len(known), -1, dtype=np.int64)
    same = np.flatnonzero(trials.track == trials.source)
    own[trials.track[same]] = same
    mine, theirs = own[trials.track[go]], own[trials.track[back]]
    loss = trials.gain[mine] + trials.gain[theirs] - trials.gain[go] - trials.gain[back]
    some = np.flatnonzero(loss < _HOPELESS)
    if not len(some):
        return trials
    rows, theirs = np.stack([go, back], axis=1)[some], np.stack([mine, theirs], axis=1)[some]
    better, after = swap_log_likelihoods(
        filter_, known, estimates, time_s, sensor, trials.track[rows], trials.estimates.take(rows.ravel())
    )
    gain = trials.gain.copy()
    gain[rows] = trials.gain[theirs] + 0.5 * better[:, None]
    return _Trials(trials.track, trials.source, gain, trials.estimates.put(rows.ravel(), after))


def _swap_pairs(trials: _Trials, contested: IntArray) -> tuple[IntArray, IntArray]:
    """Return the trials in which one of two `contested` tracks has the other's history, and the reverse trials."""
    size = int(max(trials.track.max(), trials.source.max())) + 1
    key, back = trials.track * size + trials.source, trials.source * size + trials.track
    order = np.argsort(key)
    place = order[np.minimum(np.searchsorted(key[order], back), len(key) - 1)]
    both = (key[place] == back) & np.isin(trials.track, contested) & np.isin(trials.source, contested)
    go = np.flatnonzero(both & (trials.track < trials.source))
    return go, place[go]


def _with_rivals(trials: _Trials) -> _Trials:
    """Return the trials of tracks with several possible histories, or shared ones."""
    return trials.of(np.flatnonzero(~unambiguous(trials.track, trials.source)))


def _gated_histories(
    without: PredictedMeasurements, whole: PredictedMeasurements, theirs: AngleMeasurements, rows: IntArray
) -> tuple[IntArray, IntArray]:
    """Return tracks and sources of the histories within the gate, and every track with its own."""
    from scipy.spatial import cKDTree

    last = np.zeros(len(whole.root), dtype=np.int64)
    last[theirs.track] = np.arange(len(theirs))
    place = whole.derivative[rows, 0]
    # Another sensor's lines may have shifted a track, which is still seen in its own direction: search that far.
    reach = _REACH * (without.position_bound_m(0.0)[rows] + float(whole.position_bound_m(0.0)[rows].max()))
    neighbours = cKDTree(place).query_ball_point(without.derivative[rows, 0], reach, return_sorted=True)
    track = np.repeat(rows, [len(near) for near in neighbours])
    source = rows[np.concatenate([np.array(near, dtype=np.int64) for near in neighbours])]
    others = track != source
    track, source = np.concatenate([rows, track[others]]), np.concatenate([rows, source[others]])
    measurements = theirs.take(last[source])
    residual, slope = measurements.residuals(without.positions(track, measurements.time_s))
    side = slope @ without.position_roots(track, measurements.time_s)
    spread = side @ side.transpose(0, 2, 1) + np.eye(2)
    distance = np.sum(residual * np.linalg.solve(spread, residual[:, :, None])[:, :, 0], axis=1)
    own = np.zeros(len(last))
    own[rows] = distance[: len(rows)]
    inside = (distance < np.maximum(GATE_SIGMAS**2, own[track] + _FARTHER)) | (track == source)
    return track[inside], source[inside]


def _reassigned(
    known: Histories, estimates: ModeEstimates, reported: ModeEstimates, sensor: int, trials: _Trials, chosen: BoolArray
) -> tuple[Histories, ModeEstimates, ModeEstimates]:
    """Return histories, estimates and reported estimates after a sensor's histories are reassigned."""
    moved = np.flatnonzero(chosen & (trials.track != trials.source))
    if not len(moved):
        return known, estimates, reported
    place = np.arange(len(known))
    place[trials.source[moved]] = trials.track[moved]
    track = np.where(known.sensor == sensor, place[known.measurements.track], known.measurements.track)
    after = trials.estimates.take(moved)
    rows = trials.track[moved]
    return (
        evolve(known, measurements=known.measurements.with_track(track)),
        estimates.put(rows, after),
        reported.put(rows, after),
    )


def _moment_matched(
    rows: IntArray, trials: _Trials, chosen: BoolArray, beta: FloatArray, estimates: ModeEstimates
) -> ModeEstimates:
    """Return the estimates of tracks (rows) as mixtures over possible histories, by moment matching."""
    member = _mixture_member(trials, chosen)
    order = np.lexsort((-beta, trials.track))
    order = order[beta[order] > _LEAST_SHARE]
    start, stop = np.searchsorted(trials.track[order], rows), np.searchsorted(trials.track[order], rows, side="right")
    cluster = start[:, None] + np.arange(_MIXED)
    there = cluster < stop[:, None]
    pick = order[np.where(there, cluster, start[:, None])]
    share = np.where(there, beta[pick], 0.0)
    share /= share.sum(axis=1, keepdims=True)
    parts = [trials.estimates.take(member[pick[:, column]]) for column in range(_MIXED)]
    boost = square_root.moment_matched(share, tuple(p.boost_mean for p in parts), tuple(p.boost_root for p in parts))
    coast = square_root.moment_matched(share, tuple(p.coast_mean for p in parts), tuple(p.coast_root for p in parts))
    own = estimates.take(rows)
    return ModeEstimates(own.weight, *boost, *coast, own.detection_rate)


def _mixture_member(trials: _Trials, chosen: BoolArray) -> IntArray:
    """Return for each trial (m,) the one that represents it in a mixture: itself or its swap partner.

    A swap that leaves two tracks nearer to each other's positions than to their own only exchanges identities.
    Identities are irrelevant here, so each track is mixed with the estimate that lies near it (set JPDA: Svensson et
    al., IEEE Trans. Signal Processing 59(10), 2011).
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
    place = trials.estimates.likelier_position_m
    here, there = place[row[trials.track]], place[row[np.maximum(other, 0)]]
    stays = np.sum((place - here) ** 2 + (place[back] - there) ** 2, axis=1)
    swaps = np.sum((place - there) ** 2 + (place[back] - here) ** 2, axis=1)
    return np.where((key[back] == sought) & (other >= 0) & (swaps < stays), back, np.arange(len(key)))
