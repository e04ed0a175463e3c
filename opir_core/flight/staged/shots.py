"""Shots of gravity turns: boosts with kicks and aim points, where they come down, and how far they
reach.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_core.flight.gravity_and_drag import height_and_climb
from opir_core.flight.landing import AimedLanding, aimed_landing, polar_rad
from opir_core.flight.rows import Rows
from opir_core.flight.staged.gravity_turn import Boosts, BoostState, Leg, LegKind, Turn, burnout
from opir_core.flight.staged.staging import Staging
from opir_core.geometry.vectors import FloatPair, components, length

if TYPE_CHECKING:
    from opir_core.flight.forces import Forces

#: Times of cut-off in a table.
_CUTS = 13


@frozen(eq=False, repr=False)
class StagedShots(Rows):
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

    def in_two_body_motion(self) -> "StagedShots":
        """Return the same shots with two-body motion after burnout."""
        return self if self.forces is None else evolve(self, forces=None)

    def burnout(self, azimuth_rad: FloatArray, cut_off_s: FloatArray) -> FloatPair:
        """Return burnout positions and velocities relative to the Earth, (n, 3), ECEF."""
        end = burnout(self.boosts, azimuth_rad, self.kick_rad, cut_off_s, self.fineness)
        return end.position_m.T, end.velocity_m_s.T

    def landing(self, azimuth_rad: FloatArray, cut_off_s: FloatArray) -> AimedLanding:
        """Return the impacts of flights."""
        return self.landing_from(*self.burnout(azimuth_rad, cut_off_s))

    def landing_from(
        self, position_ecef_m: FloatArray, velocity_ecef_m_s: FloatArray
    ) -> AimedLanding:
        """Return the impacts of flights from burnout states (n, 3)."""
        end = position_ecef_m, velocity_ecef_m_s
        return aimed_landing(self.boosts.site, self.aim_ecef_m, self.aim_height_m, end, self.forces)


@frozen(eq=False, repr=False)
class Reach(Rows):
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
        reaches = self.range_rad >= range_rad[:, None, None]
        reaches[:, :, 0] = False
        upper = np.maximum(reaches.argmax(axis=2), 1)
        row, kick = np.indices(upper.shape)
        low = self.range_rad[row, kick, upper - 1]
        high = self.range_rad[row, kick, upper]
        share = (range_rad[:, None] - low) / np.maximum(high - low, 1e-12)
        early_s = self.cut_off_s[row, upper - 1]
        late_s = self.cut_off_s[row, upper]
        return np.where(reaches.any(axis=2), early_s + share * (late_s - early_s), np.nan)

    def flat_kicks_rad(self, range_rad: FloatArray) -> FloatArray:
        """Return the largest kicks (n,) that reach ground angles (n,) with the earliest cut-off;
        nan where none is.
        """
        angle_rad = self.range_rad[:, :, 0]
        reaches = angle_rad >= range_rad[:, None]
        row_end = angle_rad.shape[1] - 1 - reaches[:, ::-1].argmax(axis=1)
        neighbour = np.minimum(row_end + 1, angle_rad.shape[1] - 1)
        row = np.arange(len(row_end))
        angle_step = angle_rad[row, row_end] - angle_rad[row, neighbour]
        share = (angle_rad[row, row_end] - range_rad) / np.where(
            neighbour > row_end, angle_step, 1.0
        )
        kick_step = self.kick_rad[row, neighbour] - self.kick_rad[row, row_end]
        kick_rad = self.kick_rad[row, row_end] + share * kick_step
        return np.where(reaches.any(axis=1) & (neighbour > row_end), kick_rad, np.nan)

    def extremes_rad(self) -> FloatPair:
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
    rows = np.repeat(np.arange(count), kicks)
    boosts = shots.boosts.take(rows)
    azimuth = azimuth_rad[rows]
    share = np.linspace(0.0, 1.0, _CUTS)
    cut_off_s = shots.earliest_s[:, None] + (shots.latest_s - shots.earliest_s)[:, None] * share
    turn = Turn(boosts, azimuth, kick_rad.ravel())
    ranges = [
        _range_rad(shots.take(rows), azimuth, end) for end in _burnouts(turn, cut_off_s[rows])
    ]
    table = np.stack(ranges, axis=1).reshape(count, kicks, _CUTS)
    # A larger kick than one into the ground is one into the ground, whatever a trial that has
    # passed through it does.
    table[np.logical_or.accumulate(np.isnan(table), axis=1)] = np.nan
    return Reach(kick_rad, cut_off_s, table)


def _burnouts(turn: Turn, cut_off_s: FloatArray) -> Iterator[BoostState]:
    """Yield the states at burnout of boosts (n,) for each of their times of cut-off (n, c)."""
    boosts = turn.boosts
    final_stage = len(boosts.stages.burn_time_s) - 1
    state = BoostState.at_rest(boosts)
    legs = list(boosts.legs(cut_off_s[:, 0]))[:-1]
    for cut in range(cut_off_s.shape[1]):
        cut_s = cut_off_s[:, cut]
        if cut:
            legs = [Leg(LegKind.PART, final_stage, cut_off_s[:, cut - 1], cut_s)]
        state = turn.flown(state, legs)
        tail = Leg(LegKind.TAIL_OFF, final_stage, cut_s, cut_s + boosts.tail_off_s)
        yield turn.flown(state, [tail])


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
