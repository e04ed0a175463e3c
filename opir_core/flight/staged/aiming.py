"""Aiming of gravity turns: the azimuth, kick and cut-off of the last burn with which a flight
reaches its aim point.

A kick steeper or flatter than that of minimum energy needs a later cut-off of the last burn. `loft`
chooses among the kicks that reach the aim point: 0 is the kick of the earliest cut-off; 1 the
smallest (lofted) and -1 the largest (depressed) with which it is reached before the last `RESERVE`
of the last burn; between them the kick is linear. These kicks are found in two-body free flight.
Azimuth and cut-off then follow by Newton's method under the scene's forces.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.gravity_and_drag import height_and_climb
from opir_core.flight.landing import AimedLanding, aimed_landing, corrected, polar_rad
from opir_core.flight.staged.gravity_turn import (
    Boosts,
    BoostState,
    Leg,
    LegKind,
    Turn,
    burnout,
    fineness_needed,
)
from opir_core.flight.staged.staging import Staging
from opir_core.geometry.vectors import components, length

if TYPE_CHECKING:
    from opir_core.flight.forces import Forces

#: The tolerance of the miss, m.
TOLERANCE_M = 0.1

#: The share of the last burn that lofted and depressed flights keep in reserve.
RESERVE = 0.02

#: The smallest and the largest kick, rad; from vertical flight to a turn faster than any staging
#: can fly.
_KICKS_RAD = (0.002, 1.2)

#: Kicks in a table, and times of cut-off.
_KICKS = 25
_CUTS = 13

_ITERATIONS = 25

#: The miss, m, at which the azimuth is good enough for the table of lofts.
_ROUGH_M = 1e3

#: How much earlier a guess that does not come down is cut off, as a share of the last burn, and how
#: often.
_EARLIER = 0.01
_RETREATS = 20

#: Guesses from which an aim point that is not reached is tried again, each earlier by `_EARLIER`.
_RESTARTS = 4


@frozen(eq=False, repr=False)
class StagedShots:
    """Boosts (n,) with their kicks, earliest and latest times of cut-off and aim points; `forces`
    None is two-body.
    """

    boosts: Boosts
    kick_rad: FloatArray
    fineness: FloatArray
    earliest_s: FloatArray
    latest_s: FloatArray
    aim_ecef_m: FloatArray
    aim_height_m: FloatArray
    forces: "Forces | None" = None

    @classmethod
    def of(
        cls,
        boosts: Boosts,
        stagings: Sequence[Staging],
        aim_ecef_m: FloatArray,
        aim_height_m: FloatArray,
    ) -> "StagedShots":
        """Return shots without a kick yet, in two-body free flight."""
        earliest, latest = (
            np.array([getattr(staging, name) for staging in stagings])
            for name in ("earliest_cut_off_s", "latest_cut_off_s")
        )
        nothing = np.zeros(len(stagings))
        return cls(
            boosts, nothing, np.ones(len(stagings)), earliest, latest, aim_ecef_m, aim_height_m
        )

    def take(self, rows: RowArray) -> "StagedShots":
        """Return some of the shots."""
        columns = (
            self.kick_rad,
            self.fineness,
            self.earliest_s,
            self.latest_s,
            self.aim_ecef_m,
            self.aim_height_m,
        )
        forces = None if self.forces is None else self.forces.take(rows)
        kick, fineness, earliest, latest, aim_m, height_m = (column[rows] for column in columns)
        return StagedShots(
            self.boosts.take(rows), kick, fineness, earliest, latest, aim_m, height_m, forces
        )

    def in_two_body_motion(self) -> "StagedShots":
        """Return the same shots with two-body motion after burnout."""
        return self if self.forces is None else evolve(self, forces=None)

    def burnout(
        self, azimuth_rad: FloatArray, cut_off_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return burnout positions and velocities relative to the Earth, (n, 3), ECEF."""
        end = burnout(self.boosts, azimuth_rad, self.kick_rad, cut_off_s, self.fineness)
        return end.position_m.T, end.velocity_m_s.T

    def landing(self, azimuth_rad: FloatArray, cut_off_s: FloatArray) -> AimedLanding:
        """Return the impacts of flights."""
        end = self.burnout(azimuth_rad, cut_off_s)
        return aimed_landing(self.boosts.site, self.aim_ecef_m, self.aim_height_m, end, self.forces)


@frozen(eq=False, repr=False)
class Reach:
    """Ground angles that shots reach, by time of cut-off and kick.

    `kick_rad` (n, k) increases along its rows; `cut_off_s` (n, c); `range_rad` (n, k, c), nan for
    flights that descend at cut-off, and pi for those that pass the antipode or do not come down.
    """

    kick_rad: FloatArray
    cut_off_s: FloatArray
    range_rad: FloatArray

    def needed_s(self, range_rad: FloatArray) -> FloatArray:
        """Return the earliest cut-offs (n, k) that reach ground angles (n,); nan where none does.

        Where the earliest of all already reaches farther, the answer is extrapolated from it.
        """
        far = self.range_rad >= range_rad[:, None, None]
        far[:, :, 0] = False
        late = np.maximum(far.argmax(axis=2), 1)
        row, kick = np.indices(late.shape)
        low = self.range_rad[row, kick, late - 1]
        high = self.range_rad[row, kick, late]
        share = (range_rad[:, None] - low) / np.maximum(high - low, 1e-12)
        early_s = self.cut_off_s[row, late - 1]
        late_s = self.cut_off_s[row, late]
        return np.where(far.any(axis=2), early_s + share * (late_s - early_s), np.nan)

    def extremes_rad(self) -> tuple[FloatArray, FloatArray]:
        """Return the ranges (n,) of the flights of least energy for the earliest and for the latest
        cut-off.
        """
        nearest, farthest = (
            np.nanmax(self.range_rad[:, :, cut], axis=1, initial=0.0) for cut in (0, -1)
        )
        return nearest, farthest


def reach(shots: StagedShots, azimuth_rad: FloatArray, kick_rad: FloatArray) -> Reach:
    """Return how far shots reach with kicks (n, k), in two-body free flight."""
    count, kicks = kick_rad.shape
    every = np.repeat(np.arange(count), kicks)
    boosts = shots.boosts.take(every)
    azimuth = azimuth_rad[every]
    share = np.linspace(0.0, 1.0, _CUTS)
    cut_off_s = shots.earliest_s[:, None] + (shots.latest_s - shots.earliest_s)[:, None] * share
    turn = Turn(boosts, azimuth, kick_rad.ravel())
    state = turn.flown(BoostState.at_rest(boosts), _but_last(boosts, cut_off_s[every, 0]))
    range_rad = np.empty((count * kicks, _CUTS))
    last = len(boosts.stages.burn_time_s) - 1
    earlier_s = cut_off_s[every, 0]
    for cut in range(_CUTS):
        cut_s = cut_off_s[every, cut]
        if cut:
            state = turn.flown(state, [Leg(LegKind.PART, last, earlier_s, cut_s)])
        end = turn.flown(state, [Leg(LegKind.TAIL_OFF, last, cut_s, cut_s + boosts.tail_off_s)])
        range_rad[:, cut] = _range_rad(shots.take(every), azimuth, end)
        earlier_s = cut_s
    table = range_rad.reshape(count, kicks, _CUTS)
    # A larger kick than one into the ground is one into the ground, whatever a trial that has
    # passed through it does.
    table[np.logical_or.accumulate(np.isnan(table), axis=1)] = np.nan
    return Reach(kick_rad, cut_off_s, table)


def _but_last(boosts: Boosts, cut_off_s: FloatArray) -> list[Leg]:
    """Return the legs up to a time of cut-off, without the tail-off."""
    return list(boosts.legs(cut_off_s))[:-1]


def _range_rad(shots: StagedShots, azimuth_rad: FloatArray, end: BoostState) -> FloatArray:
    """Return the ground angles of flights with launch azimuths (n,); pi where they pass the
    antipode or stay aloft.

    nan where they descend, or are below the aim point, at burnout.
    """
    position = end.position_m.T
    velocity = end.velocity_m_s.T
    with np.errstate(all="ignore"):
        inverse_radius = 1.0 / length(*components(position))
        height, climb = height_and_climb(end.position_m, end.velocity_m_s, inverse_radius)
        landing = aimed_landing(
            shots.boosts.site, shots.aim_ecef_m, shots.aim_height_m, (position, velocity), None
        )
        angle, bearing = polar_rad(shots.boosts.site, landing.impact_ecef_m)
        # Beyond the antipode the shorter way to the impact leads backwards, as it does for short
        # steep flights.
        is_beyond = (angle > 0.5 * np.pi) & (np.cos(bearing - azimuth_rad) < 0.0)
        angle = np.where(is_beyond, np.pi, angle)
    is_aloft = (climb > 0.0) & (height > shots.aim_height_m)
    return np.where(is_aloft, np.where(np.isnan(angle), np.pi, angle), np.nan)


@frozen(eq=False, repr=False)
class StagedSolution:
    """Solved launches (n,): unknowns, fineness and misses; reachable distances over the ground, m.

    Where `is_solved` is False the unknowns are those of the nearest trial.
    """

    azimuth_rad: FloatArray
    kick_rad: FloatArray
    cut_off_s: FloatArray
    fineness: FloatArray
    miss_m: FloatArray
    nearest_m: FloatArray
    farthest_m: FloatArray
    is_solved: BoolArray


def solved(shots: StagedShots, loft: FloatArray, forces: "Forces | None") -> StagedSolution:
    """Return the launches that reach the aim points, with a loft (n,) in [-1, 1] each."""
    count = len(loft)
    range_rad, azimuth_rad = polar_rad(shots.boosts.site, shots.aim_ecef_m)
    grid = np.geomspace(*_KICKS_RAD, _KICKS)
    table = reach(shots, azimuth_rad, np.broadcast_to(grid, (count, _KICKS)))
    nearest_rad, farthest_rad = table.extremes_rad()
    kick_rad, cut_off_s = _least_energy(table, range_rad)
    shots = evolve(shots, kick_rad=kick_rad)
    shots = evolve(
        shots, fineness=fineness_needed(shots.boosts, azimuth_rad, kick_rad, shots.latest_s)
    )
    cut_off_s = _coming_down(shots, azimuth_rad, cut_off_s)
    azimuth_rad, cut_off_s = corrected(shots, azimuth_rad, cut_off_s, _ROUGH_M, _ITERATIONS)
    table = reach(shots, azimuth_rad, _finer(table, range_rad, shots, loft))
    kick_rad, cut_off_s = _lofted(table, range_rad, shots, loft)
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
    radius_m = length(*components(shots.boosts.site.launch_m))
    reaches_m = nearest_rad * radius_m, farthest_rad * radius_m
    return StagedSolution(
        azimuth_rad, kick_rad, cut_off_s, shots.fineness, miss_m, *reaches_m, is_solved
    )


def _coming_down(shots: StagedShots, azimuth_rad: FloatArray, cut_off_s: FloatArray) -> FloatArray:
    """Return guesses of times of cut-off, earlier where flights would not come down: Newton's
    method needs impacts.
    """
    cut_off_s = np.clip(cut_off_s, shots.earliest_s, shots.latest_s)
    step_s = _EARLIER * shots.boosts.stages.burn_time_s[-1]
    rows = np.arange(len(cut_off_s))
    for _ in range(_RETREATS):
        rows = rows[np.isnan(shots.take(rows).landing(azimuth_rad[rows], cut_off_s[rows]).miss_m)]
        if not rows.size:
            break
        cut_off_s[rows] = np.maximum(cut_off_s[rows] - step_s[rows], shots.earliest_s[rows])
    return cut_off_s


def _aimed(
    shots: StagedShots, azimuth_rad: FloatArray, guess_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the azimuths and times of cut-off that reach the aim points; trials that miss start
    again, earlier.

    Near orbital speed the range grows so fast with the cut-off that Newton's method needs a guess
    that falls short.
    """
    azimuth, cut_off_s = corrected(shots, azimuth_rad, guess_s, TOLERANCE_M, _ITERATIONS)
    miss_m = shots.landing(azimuth, cut_off_s).miss_m
    step_s = _EARLIER * shots.boosts.stages.burn_time_s[-1]
    for retreat in range(1, _RESTARTS + 1):
        rows = np.flatnonzero(~(miss_m <= TOLERANCE_M))
        if not rows.size:
            break
        part = shots.take(rows)
        earlier_s = np.maximum(guess_s - retreat * step_s, shots.earliest_s)[rows]
        trial = corrected(part, azimuth_rad[rows], earlier_s, TOLERANCE_M, _ITERATIONS)
        trial_m = part.landing(*trial).miss_m
        nearer = trial_m < np.nan_to_num(miss_m[rows], nan=np.inf)
        azimuth[rows[nearer]], cut_off_s[rows[nearer]] = (column[nearer] for column in trial)
        miss_m[rows[nearer]] = trial_m[nearer]
    return azimuth, cut_off_s


def _least_energy(table: Reach, range_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the kicks and times (n,) of the earliest cut-off; out of reach, those that come
    nearest.

    Between kicks the time is a parabola over the logarithm of the kick.
    """
    needed_s = table.needed_s(range_rad)
    row = np.arange(len(range_rad))
    best = np.where(np.isnan(needed_s), np.inf, needed_s).argmin(axis=1)
    middle = np.clip(best, 1, needed_s.shape[1] - 2)
    before_s, here_s, after_s = (needed_s[row, middle + step] for step in (-1, 0, 1))
    bend = before_s - 2.0 * here_s + after_s
    inside = (middle == best) & np.isfinite(bend) & (bend > 0.0)
    shift = np.where(inside, 0.5 * (before_s - after_s) / np.where(inside, bend, 1.0), 0.0)
    log_kick = np.log(table.kick_rad)
    spacing = log_kick[row, middle + 1] - log_kick[row, middle]
    kick_rad = np.exp(log_kick[row, best] + shift * spacing)
    time_s = needed_s[row, best] - np.where(inside, 0.25 * (before_s - after_s) * shift, 0.0)
    farthest = np.nanargmax(np.nan_to_num(table.range_rad[:, :, -1], nan=-1.0), axis=1)
    is_near = np.isfinite(needed_s).any(axis=1)
    return np.where(is_near, kick_rad, table.kick_rad[row, farthest]), np.where(
        is_near, time_s, table.cut_off_s[:, -1]
    )


def _allowed(
    table: Reach, range_rad: FloatArray, shots: StagedShots
) -> tuple[RowArray, RowArray, BoolArray]:
    """Return the first and last of the kicks about that of least energy that keep the reserve, and
    where there are.
    """
    needed_s = table.needed_s(range_rad)
    limit_s = shots.latest_s - RESERVE * shots.boosts.stages.burn_time_s[-1]
    fits = needed_s <= limit_s[:, None]
    best = np.where(np.isnan(needed_s), np.inf, needed_s).argmin(axis=1)
    kick = np.arange(fits.shape[1])
    below = ~fits & (kick <= best[:, None])
    above = ~fits & (kick >= best[:, None])
    first = np.where(below.any(axis=1), fits.shape[1] - below[:, ::-1].argmax(axis=1), 0)
    last = np.where(above.any(axis=1), above.argmax(axis=1) - 1, fits.shape[1] - 1)
    return first, last, first <= last


def _finer(table: Reach, range_rad: FloatArray, shots: StagedShots, loft: FloatArray) -> FloatArray:
    """Return kicks (n, k) between the neighbours of that of least energy, or with loft of all that
    are allowed.
    """
    first, last, exists = _allowed(table, range_rad, shots)
    row = np.arange(len(loft))
    step = table.kick_rad[:, 1] / table.kick_rad[:, 0]
    wide = exists & (loft != 0.0)
    low = np.where(wide, table.kick_rad[row, np.minimum(first, _KICKS - 1)], shots.kick_rad) / step
    high = np.where(wide, table.kick_rad[row, np.maximum(last, 0)], shots.kick_rad) * step
    return low[:, None] * (high / low)[:, None] ** np.linspace(0.0, 1.0, _KICKS)


def _lofted(
    table: Reach, range_rad: FloatArray, shots: StagedShots, loft: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the kicks (n,) of the lofts, and about when the last burn is cut off, s since
    ignition.
    """
    kick_rad, cut_off_s = _least_energy(table, range_rad)
    first, last, exists = _allowed(table, range_rad, shots)
    row = np.arange(len(loft))
    limit = np.where(loft > 0.0, np.minimum(first, _KICKS - 1), np.maximum(last, 0))
    towards = np.where(exists, table.kick_rad[row, limit], kick_rad)
    wanted = kick_rad + np.abs(loft) * (towards - kick_rad)
    needed_s = table.needed_s(range_rad)
    after = np.clip((table.kick_rad < wanted[:, None]).sum(axis=1), 1, _KICKS - 1)
    low = table.kick_rad[row, after - 1]
    high = table.kick_rad[row, after]
    share = (wanted - low) / (high - low)
    between_s = needed_s[row, after - 1] + share * (needed_s[row, after] - needed_s[row, after - 1])
    return wanted, np.where((loft != 0.0) & np.isfinite(between_s), between_s, cut_off_s)
