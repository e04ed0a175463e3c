"""How much likelier an exchange of two tracks' histories makes all their rays, once both have settled into it.

Contested rays lean towards where their tracks are. So an exchange is not judged by the lines of sight as they stand:
both tracks take their shares of the contested rays anew, with and without the exchange, and what is compared is the
likelihood of the rays themselves, summed over all ways in which the two may have them.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.lines_of_sight import Sights, along, dot
from opir_trackers.assignment import ranks
from opir_trackers.filter.switching import ImmFilter, ModeEstimates
from opir_trackers.stereo.ambiguous_measurements import AmbiguousMeasurements, expected
from opir_trackers.stereo.histories import Histories, rows_of, weighed

#: So often both tracks take their shares anew.
_TURNS = 3

#: Of a ray that others claim altogether this is left.
_LEAST_LEFT = 1e-6


class _Rivals(NamedTuple):
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
    rivals = _rivals(
        known,
        ModeEstimates.concatenate([first, first]),
        np.concatenate([row, row]),
        np.concatenate([side, other + len(sides)]),
    )
    settled, evidence = _settled(filter_, rivals, ModeEstimates.concatenate([bank.take(sides), after]), time_s)
    without, gained = evidence.reshape(2, -1)
    return gained - without, settled.take(slice(len(sides), None))


def _rivals(known: Histories, first: ModeEstimates, row: IntArray, side: IntArray) -> _Rivals:
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
    return _Rivals(first, known.sights.take(row).placed(side), rays, second, meeting, scan, trial_of)


def _settled(
    filter_: ImmFilter, rivals: _Rivals, bank: ModeEstimates, time_s: float
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


def _shares(rivals: _Rivals, seen: FloatArray) -> tuple[FloatArray, FloatArray]:
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
