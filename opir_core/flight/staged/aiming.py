"""Aiming of gravity turns: the azimuth, kick and cut-off of the last burn with which a flight
reaches its aim point.

The kick of the earliest cut-off, a loft of 0, is found in two-body free flight, from tables of how
far the stages reach. Azimuth and cut-off then follow by Newton's method under the scene's forces.
Lofted and depressed flights start from that one: see `opir_core.flight.staged.lofting`.
"""

from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.flight.landing import corrected, polar_rad
from opir_core.flight.staged.gravity_turn import fineness_needed
from opir_core.flight.staged.lofting import Launches, lofted
from opir_core.flight.staged.shots import Reach, StagedShots, reach
from opir_core.geometry.vectors import FloatPair, components, length

if TYPE_CHECKING:
    from opir_core.flight.forces import Forces

#: The tolerance of the miss, m.
TOLERANCE_M = 0.1


#: Kicks in a table.
_KICKS = 25

_ITERATIONS = 25

#: How much farther the best kick may fly than the best one in a table, as a factor: about 1.02.
_SLACK = 1.05


#: How much earlier a guess that does not come down is cut off, as a share of the last burn, and how
#: often.
_EARLIER = 0.01


@frozen(eq=False, repr=False)
class StagedSolution:
    """Solved launches (n,), and about how far over the ground, m, the stages fly with the best
    kick.

    `nearest_m` is with the earliest cut-off, `farthest_m` with the latest. Where launches are not
    solved, their unknowns are those of the nearest trial.
    """

    launches: Launches
    nearest_m: FloatArray
    farthest_m: FloatArray


def solved(
    shots: StagedShots, loft: FloatArray, apogee_m: FloatArray, forces: "Forces | None"
) -> StagedSolution:
    """Return the launches that reach the aim points, with a loft (n,) in [-1, 1] or, where not nan,
    an apogee, m.
    """
    count = len(loft)
    range_rad, bearing_rad = polar_rad(shots.boosts.site, shots.aim_ecef_m)
    # The smallest and the largest kick in a table, rad; the largest is a turn faster than any
    # staging can fly.
    grid = np.geomspace(0.002, 1.2, _KICKS)
    table = reach(shots, bearing_rad, np.broadcast_to(grid, (count, _KICKS)))
    nearest_rad, farthest_rad = table.extremes_rad()
    earliest = Launches.none(bearing_rad, shots.earliest_s)
    is_near = range_rad <= _SLACK * farthest_rad
    rows = np.flatnonzero(is_near & (range_rad * _SLACK >= nearest_rad))
    if rows.size:
        earliest.overwrite(
            rows, _earliest(shots.take(rows), table.take(rows), forces and forces.take(rows))
        )
    shots = evolve(shots, kick_rad=earliest.kick_rad, fineness=earliest.fineness, forces=forces)
    launches = earliest
    rows = np.flatnonzero(is_near)
    if rows.size:
        launched = lofted(
            shots.take(rows), table.take(rows), earliest.take(rows), loft[rows], apogee_m[rows]
        )
        launches.overwrite(rows, launched)
    radius_m = length(*components(shots.boosts.site.launch_m))
    return StagedSolution(launches, nearest_rad * radius_m, farthest_rad * radius_m)


def _earliest(shots: StagedShots, table: Reach, forces: "Forces | None") -> Launches:
    """Return the launches with the earliest cut-offs that reach the aim points, with the kicks of
    two-body motion.
    """
    range_rad, azimuth_rad = polar_rad(shots.boosts.site, shots.aim_ecef_m)
    kick_rad, cut_off_s = _least_energy(table, range_rad)
    shots = evolve(shots, kick_rad=kick_rad)
    shots = evolve(
        shots, fineness=fineness_needed(shots.boosts, azimuth_rad, kick_rad, shots.latest_s)
    )
    cut_off_s = _coming_down(shots, azimuth_rad, cut_off_s)
    # The miss, m, at which the azimuth is good enough for the finer table.
    azimuth_rad, cut_off_s = corrected(shots, azimuth_rad, cut_off_s, 1e3, _ITERATIONS)
    table = reach(shots, azimuth_rad, _finer(table, shots.kick_rad))
    kick_rad, cut_off_s = _least_energy(table, range_rad)
    shots = evolve(shots, kick_rad=kick_rad)
    shots = evolve(shots, fineness=fineness_needed(shots.boosts, azimuth_rad, kick_rad, cut_off_s))
    azimuth_rad, cut_off_s = _aimed(shots, azimuth_rad, _coming_down(shots, azimuth_rad, cut_off_s))
    if forces is not None:
        shots = evolve(shots, forces=forces)
        azimuth_rad, cut_off_s = corrected(shots, azimuth_rad, cut_off_s, TOLERANCE_M, _ITERATIONS)
    miss_m = shots.landing(azimuth_rad, cut_off_s).miss_m
    is_solved = (
        (miss_m <= TOLERANCE_M) & (cut_off_s >= shots.earliest_s) & (cut_off_s <= shots.latest_s)
    )
    apogees_m = np.full((len(kick_rad), 4), np.nan)
    return Launches(azimuth_rad, kick_rad, cut_off_s, shots.fineness, is_solved, apogees_m)


def _coming_down(shots: StagedShots, azimuth_rad: FloatArray, cut_off_s: FloatArray) -> FloatArray:
    """Return guesses of times of cut-off, earlier where flights would not come down: Newton's
    method needs impacts.
    """
    cut_off_s = np.clip(cut_off_s, shots.earliest_s, shots.latest_s)
    step_s = _EARLIER * shots.boosts.stages.burn_time_s[-1]
    rows = np.arange(len(cut_off_s))
    for _ in range(20):
        rows = rows[np.isnan(shots.take(rows).landing(azimuth_rad[rows], cut_off_s[rows]).miss_m)]
        if not rows.size:
            break
        cut_off_s[rows] = np.maximum(cut_off_s[rows] - step_s[rows], shots.earliest_s[rows])
    return cut_off_s


def _aimed(shots: StagedShots, azimuth_rad: FloatArray, guess_s: FloatArray) -> FloatPair:
    """Return the azimuths and times of cut-off that reach the aim points; trials that miss start
    again, earlier.

    Near orbital speed the range grows so fast with the cut-off that Newton's method needs a guess
    that falls short.
    """
    azimuth, cut_off_s = corrected(shots, azimuth_rad, guess_s, TOLERANCE_M, _ITERATIONS)
    miss_m = shots.landing(azimuth, cut_off_s).miss_m
    step_s = _EARLIER * shots.boosts.stages.burn_time_s[-1]
    # Guesses from which an aim point that is not reached is tried again, each earlier by
    # `_EARLIER`.
    for retreat in range(1, 5):
        rows = np.flatnonzero(~(miss_m <= TOLERANCE_M))
        if not rows.size:
            break
        missing = shots.take(rows)
        earlier_s = np.maximum(guess_s - retreat * step_s, shots.earliest_s)[rows]
        trial = corrected(missing, azimuth_rad[rows], earlier_s, TOLERANCE_M, _ITERATIONS)
        trial_m = missing.landing(*trial).miss_m
        nearer = trial_m < np.nan_to_num(miss_m[rows], nan=np.inf)
        azimuth[rows[nearer]], cut_off_s[rows[nearer]] = (column[nearer] for column in trial)
        miss_m[rows[nearer]] = trial_m[nearer]
    return azimuth, cut_off_s


def _least_energy(table: Reach, range_rad: FloatArray) -> FloatPair:
    """Return the kicks and times (n,) of the earliest cut-off; out of reach, those that come
    nearest.

    Between kicks the time is a parabola over the logarithm of the kick.
    """
    needed_s = table.needed_s(range_rad)
    row = np.arange(len(range_rad))
    best = np.where(np.isnan(needed_s), np.inf, needed_s).argmin(axis=1)
    middle = np.clip(best, 1, needed_s.shape[1] - 2)
    lower_s, middle_s, upper_s = (needed_s[row, middle + step] for step in (-1, 0, 1))
    shift, gain_s = _vertex(lower_s, middle_s, upper_s, middle == best)
    log_kick = np.log(table.kick_rad)
    spacing = log_kick[row, middle + 1] - log_kick[row, middle]
    kick_rad = np.exp(log_kick[row, best] + shift * spacing)
    time_s = needed_s[row, best] - gain_s
    farthest = np.nanargmax(np.nan_to_num(table.range_rad[:, :, -1], nan=-1.0), axis=1)
    is_near = np.isfinite(needed_s).any(axis=1)
    return np.where(is_near, kick_rad, table.kick_rad[row, farthest]), np.where(
        is_near, time_s, table.cut_off_s[:, -1]
    )


def _vertex(
    lower: FloatArray, middle: FloatArray, upper: FloatArray, is_inner: BoolArray
) -> FloatPair:
    """Return the steps from the middle to the vertices of parabolas through three values, and how
    much lower these are; 0 where the middle is not the least, or at an end.
    """
    bend = lower - 2.0 * middle + upper
    has_vertex = is_inner & np.isfinite(bend) & (bend > 0.0)
    shift = np.where(has_vertex, 0.5 * (lower - upper) / np.where(has_vertex, bend, 1.0), 0.0)
    return shift, np.where(has_vertex, 0.25 * (lower - upper) * shift, 0.0)


def _finer(table: Reach, kick_rad: FloatArray) -> FloatArray:
    """Return kicks (n, k) between the neighbours of those of least energy."""
    step = table.kick_rad[:, 1] / table.kick_rad[:, 0]
    low = kick_rad / step
    high = kick_rad * step
    return low[:, None] * (high / low)[:, None] ** np.linspace(0.0, 1.0, _KICKS)
