"""Gravity turns of many boosts at once: numerical integration in ECEF with thrust, gravity and
drag.

Flight begins at rest on the rotating Earth. The thrust points to the geodetic zenith of the launch
point during the vertical rise; in the pitch-over it leads the velocity by kick · sin²(pi u), u from
0 to 1, towards the launch azimuth; after that it follows the velocity relative to the air (Curtis,
Orbital Mechanics for Engineering Students, section 11.4). In ECEF r'' = g(r) + Omega² (x, y, 0) + 2
Omega (vy, -vx, 0) + thrust - rho |v| v / (2 beta).

Every leg of a flight (rise, pitch-over, burn, tail-off, gap) has the same number of DOP853 steps in
all boosts, so that the arithmetic is element by element and a result has the same bits in any
company. Where the summed error estimates exceed the tolerance, a boost takes twice, four times ...
as many.
"""

from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.atmosphere_density import LOWEST_HEIGHT_M, density_kg_m3
from opir_core.flight.boost import LaunchSite
from opir_core.flight.dense_output import StepRecorder
from opir_core.flight.dop853 import NODES, StepStart, stepped_in_columns
from opir_core.flight.forces import ExponentialAtmosphere, ZonalField
from opir_core.flight.gravity_and_drag import Gravity, height_m
from opir_core.flight.rows import Rows, TrailingRows
from opir_core.flight.staged.staging import StageColumns, Staging
from opir_core.flight.universal_anomaly import dot, length

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel


#: The tolerance of the summed error estimates of velocity, m/s: at most 0.2 m at an impact.
TOLERANCE_M_S = 2e-5


class LegKind(IntEnum):
    """What the thrust does in a leg; a part is one of a burn."""

    RISE = 0
    PITCH_OVER = 1
    BURN = 2
    TAIL_OFF = 3
    GAP = 4
    PART = 5


#: Steps per leg before any doubling.
_STEPS = {
    LegKind.RISE: 2,
    LegKind.PITCH_OVER: 10,
    LegKind.BURN: 6,
    LegKind.TAIL_OFF: 1,
    LegKind.GAP: 1,
    LegKind.PART: 1,
}


@frozen(eq=False, repr=False)
class Leg:
    """A stretch of n boosts in which the thrust is smooth: times since ignition (n,), s."""

    kind: LegKind
    stage: int
    start_s: FloatArray
    stop_s: FloatArray


@frozen(eq=False, repr=False)
class Boosts(Rows):
    """Boosts of n launches with one number of stages: sites, stages as columns, and times and
    coefficients (n,).

    `zonal` and `air` are common to all.
    """

    site: LaunchSite
    stages: StageColumns
    zonal: tuple[str, ...]
    air: ExponentialAtmosphere | str
    vertical_rise_s: FloatArray
    pitch_over_s: FloatArray
    tail_off_s: FloatArray
    ballistic_coefficient_kg_m2: FloatArray

    @classmethod
    def of(cls, site: LaunchSite, stagings: Sequence[Staging], forces: "ForceModel") -> "Boosts":
        """Return the boosts of launches; gravity is that of the scene's forces, and so is the air
        if they have drag.
        """
        zonal: tuple[str, ...] = ()
        # The air of boosts in scenes without drag (Curtis, Orbital Mechanics for Engineering
        # Students, appendix D.40).
        air: ExponentialAtmosphere | str = ExponentialAtmosphere(
            density_kg_m3=1.225, scale_height_m=7500.0
        )
        if not isinstance(forces, str):
            zonal = forces.zonal
            air = air if forces.drag is None else forces.drag.atmosphere
        names = ("vertical_rise_s", "pitch_over_s", "tail_off_s", "ballistic_coefficient_kg_m2")
        columns = (
            np.array([getattr(staging, name) for staging in stagings], dtype=np.float64)
            for name in names
        )
        return cls(site, StageColumns.of(stagings), zonal, air, *columns)

    def __len__(self) -> int:
        return len(self.tail_off_s)

    def legs(self, cut_off_s: FloatArray) -> Iterator[Leg]:
        """Yield the legs of boosts whose last burn is cut off (n,) s after ignition, up to the
        tail-off of that.
        """
        turn_s = self.vertical_rise_s + self.pitch_over_s
        zero = np.zeros(len(self))
        yield Leg(LegKind.RISE, 0, zero, self.vertical_rise_s)
        yield Leg(LegKind.PITCH_OVER, 0, self.vertical_rise_s, turn_s)
        final_stage = len(self.stages.burn_time_s) - 1
        for number, (ignition_s, burn_s) in enumerate(
            zip(self.stages.ignition_s, self.stages.burn_time_s, strict=True)
        ):
            start_s = turn_s if number == 0 else ignition_s
            stop_s = ignition_s + burn_s
            cut_s = cut_off_s if number == final_stage else stop_s - self.tail_off_s
            yield Leg(LegKind.BURN, number, start_s, cut_s)
            yield Leg(LegKind.TAIL_OFF, number, cut_s, cut_s + self.tail_off_s)
            if number < final_stage:
                yield Leg(LegKind.GAP, number, stop_s, self.stages.ignition_s[number + 1])


@frozen(eq=False, repr=False)
class BoostState(TrailingRows):
    """Positions and velocities relative to the Earth (3, n), ECEF, and the summed error estimates
    of velocity (n,).
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    error_m_s: FloatArray

    @classmethod
    def at_rest(cls, boosts: Boosts) -> "BoostState":
        """Return the states at ignition."""
        position = boosts.site.launch_m.T.copy()
        return cls(position, np.zeros_like(position), np.zeros(len(boosts)))


class RightSide:
    """The acceleration of boosts within a leg, at the times of a step's stages one after the
    other.
    """

    needs_velocity = True

    def __init__(self, boosts: Boosts, leg: Leg, heading: FloatArray, kick_rad: FloatArray) -> None:
        self._boosts = boosts
        self._leg = leg
        self._heading = heading
        self._kick_rad = kick_rad
        self._gravity = Gravity(ZonalField(), boosts.zonal)
        self._half_inverse_beta = 0.5 / boosts.ballistic_coefficient_kg_m2
        self._up = boosts.site.axes[:, 2].T
        self._times: Iterator[FloatArray] = iter(())

    def begin(self, time_s: FloatArray, step_s: FloatArray) -> None:
        """Set the times of the next calls: the nodes of a step and of its dense output."""
        self._times = (time_s + node * step_s for node in NODES[1:])

    def at(self, time_s: FloatArray, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return accelerations (3, n), m/s², at times since ignition (n,), s."""
        self._times = iter((time_s,))
        return self(position, velocity)

    def __call__(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return accelerations (3, n), m/s²."""
        acceleration, inverse_radius = self._gravity.with_inverse_radius(position)
        density = _density(height_m(position, inverse_radius), self._boosts.air)
        speed = length(velocity)
        acceleration -= (density * speed * self._half_inverse_beta) * velocity
        acceleration[0] += EARTH_ROTATION_RAD_S * (
            EARTH_ROTATION_RAD_S * position[0] + 2.0 * velocity[1]
        )
        acceleration[1] += EARTH_ROTATION_RAD_S * (
            EARTH_ROTATION_RAD_S * position[1] - 2.0 * velocity[0]
        )
        time_s = next(self._times)
        if self._leg.kind != LegKind.GAP:
            acceleration += self._thrust(time_s) * self._direction(time_s, velocity, speed)
        return acceleration

    def _thrust(self, time_s: FloatArray) -> FloatArray:
        stages = self._boosts.stages
        leg = self._leg
        if leg.kind != LegKind.TAIL_OFF:
            return stages.acceleration_m_s2(leg.stage, time_s)
        share = (leg.stop_s - time_s) / np.maximum(leg.stop_s - leg.start_s, 1e-9)
        return stages.acceleration_m_s2(leg.stage, leg.start_s) * share

    def _direction(self, time_s: FloatArray, velocity: FloatArray, speed: FloatArray) -> FloatArray:
        if self._leg.kind == LegKind.RISE:
            return self._up
        along = velocity / speed
        if self._leg.kind != LegKind.PITCH_OVER:
            return along
        share = (time_s - self._leg.start_s) / (self._leg.stop_s - self._leg.start_s)
        lead = self._kick_rad * np.sin(np.pi * share) ** 2
        sideways = self._heading - dot(self._heading, along) * along
        sideways /= length(sideways)
        return np.cos(lead) * along + np.sin(lead) * sideways


def _density(height_m: FloatArray, air: ExponentialAtmosphere | str) -> FloatArray:
    """Return densities (n,), kg/m³; nan below the models' lowest height."""
    if not isinstance(air, ExponentialAtmosphere):
        return density_kg_m3(height_m, air)
    density = air.density_kg_m3 * np.exp((air.base_height_m - height_m) / air.scale_height_m)
    return np.where(height_m >= LOWEST_HEIGHT_M, density, np.nan)


@frozen(eq=False, repr=False)
class Turn:
    """Integrates boosts with launch azimuths, clockwise from true north, and kicks (n,), rad."""

    boosts: Boosts
    azimuth_rad: FloatArray
    kick_rad: FloatArray
    fineness: int = 1
    recorder: StepRecorder | None = None
    #: The numbers of the boosts for the recorder.
    arcs: RowArray | None = None

    def flown(self, state: BoostState, legs: Iterator[Leg] | Sequence[Leg]) -> BoostState:
        """Return the states at the end of the legs; flights into the ground become nan."""
        heading = self.boosts.site.plane(self.azimuth_rad).heading.T
        with np.errstate(all="ignore"):
            for leg in legs:
                state = self._leg(state, leg, heading, _STEPS[leg.kind] * self.fineness)
        return state

    def _leg(self, state: BoostState, leg: Leg, heading: FloatArray, steps: int) -> BoostState:
        right_side = RightSide(self.boosts, leg, heading, self.kick_rad)
        position = state.position_m
        velocity = state.velocity_m_s
        error = state.error_m_s
        h = (leg.stop_s - leg.start_s) / steps
        acceleration = right_side.at(leg.start_s, position, velocity)
        for number in range(steps):
            time_s = leg.start_s + number * h
            start = StepStart(position, velocity, acceleration)
            right_side.begin(time_s, h)
            step = stepped_in_columns(right_side, start, h)
            if self.recorder is not None and self.arcs is not None:
                self.recorder(self.arcs, time_s, h, start, step, h > 0.0, right_side)
            position = step.position
            velocity = step.velocity
            acceleration = step.acceleration
            error = error + step.velocity_error
        return BoostState(position, velocity, error)


def burnout(
    boosts: Boosts,
    azimuth_rad: FloatArray,
    kick_rad: FloatArray,
    cut_off_s: FloatArray,
    fineness: FloatArray,
    recorder: StepRecorder | None = None,
    arcs: RowArray | None = None,
) -> BoostState:
    """Return the states at burnout of boosts (n,), each integrated with its own `fineness`, a
    factor of its steps.

    A recorder gets the steps, in ECEF and by time since ignition, as those of arcs of these numbers
    (n,).
    """
    end = BoostState.at_rest(boosts)
    for factor in np.unique(fineness).tolist():
        rows = np.flatnonzero(fineness == factor)
        group = boosts.take(rows)
        numbers = None if arcs is None else arcs[rows]
        turn = Turn(group, azimuth_rad[rows], kick_rad[rows], int(factor), recorder, numbers)
        end.overwrite(rows, turn.flown(BoostState.at_rest(group), group.legs(cut_off_s[rows])))
    return end


def fineness_needed(
    boosts: Boosts, azimuth_rad: FloatArray, kick_rad: FloatArray, cut_off_s: FloatArray
) -> FloatArray:
    """Return the factors (n,) of the numbers of steps with which the summed error estimates meet
    the tolerance.
    """
    fineness = np.ones(len(boosts))
    rows = np.arange(len(boosts))
    # Doublings of the number of steps after which a boost counts as not converged.
    for _ in range(5):
        columns = azimuth_rad[rows], kick_rad[rows], cut_off_s[rows], fineness[rows]
        rows = rows[burnout(boosts.take(rows), *columns).error_m_s > TOLERANCE_M_S]
        if not rows.size:
            break
        fineness[rows] *= 2.0
    return fineness
