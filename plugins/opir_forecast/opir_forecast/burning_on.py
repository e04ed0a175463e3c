"""Particles flown on through the burns that remain to them, and down to the ground."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from opir_estimation import law_parameters

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.interfaces import Columns
from opir_forecast.vehicles import STAGES

LAW = law_parameters("opir_forecast", "flight")

#: Steps of Runge and Kutta for each burn.
STEPS = 3

#: Starts, middles and ends of the steps as shares of a burn: short steps first, while a slow boost
#: turns fast.
_ENDS = (np.arange(STEPS + 1) / STEPS) ** 2
_NODES = np.interp(np.arange(2 * STEPS + 1), np.arange(0, 2 * STEPS + 1, 2), _ENDS)[:, None]


@frozen(eq=False, repr=False)
class Steering(Columns):
    """Angle by which the thrust of boosts (n,) leads the velocity downwards, by the time since the
    first ignition.

    It is vertical for `rise_s`, leads by up to `lead_rad` over the next `over_s` (pitch-over), and
    by `steer_rad` sin(`steer_rate` t + `steer_phase`) from then on.
    """

    rise_s: FloatArray
    over_s: FloatArray
    lead_rad: FloatArray
    steer_rad: FloatArray
    steer_rate: FloatArray
    steer_phase: FloatArray

    def leads(self, time_s: FloatArray) -> FloatArray:
        """Return the angles (..., n), rad, at times since ignition (..., n)."""
        progress = (time_s - self.rise_s) / self.over_s
        lead: FloatArray = self.steer_rad * np.sin(self.steer_rate * time_s + self.steer_phase)
        lead[progress <= 0.0] = 0.0
        # Most have pitched over.
        turns = ((progress > 0.0) & (progress < 1.0)).nonzero()
        lead[turns] += self.lead_rad[turns[-1]] * np.sin(np.pi * progress[turns]) ** 2
        return lead


def drawn_steering(count: int, data: Mapping[str, Any], seed: int) -> Steering:
    """Return `count` draws of the prior in data as in `vehicles.json`."""
    rng = np.random.default_rng(seed)

    def uniform(name: str) -> FloatArray:
        low, high = data[name]
        return low + (high - low) * rng.random(count)

    def log_uniform(name: str) -> FloatArray:
        low, high = data[name]
        return low * (high / low) ** rng.random(count)

    return Steering(
        rise_s=uniform("vertical_rise_s"),
        over_s=log_uniform("pitch_over_s"),
        lead_rad=np.radians(log_uniform("pitch_over_deg")),
        steer_rad=np.radians(rng.normal(size=count) * log_uniform("steer_sigma_deg")),
        steer_rate=2.0 * np.pi / log_uniform("steer_period_s"),
        steer_phase=rng.uniform(0.0, 2.0 * np.pi, count),
    )


@frozen(eq=False, repr=False)
class RemainingBurns(Columns):
    """Remaining burns of particles (p,), from the present time on.

    Ignitions `start_s`, burn times, first accelerations and growths c are (p, STAGES), burns of 0 s
    where there is none; an acceleration is A / (1 - c s) after s seconds. `since_s` (p,) is the
    time since the first ignition.
    """

    start_s: FloatArray
    burn_s: FloatArray
    acceleration_m_s2: FloatArray
    growth_per_s: FloatArray
    since_s: FloatArray

    @property
    def ideal_speed_m_s(self) -> FloatArray:
        """Return the speed (p,), m/s, that the thrust has yet to gain: A ln(1/(1 - c B)) / c."""
        growth = np.where(np.abs(self.growth_per_s) < 1e-6, 1e-6, self.growth_per_s)
        gained = -np.log(np.maximum(1.0 - growth * self.burn_s, LAW.least_mass)) / growth
        return np.sum(self.acceleration_m_s2 * gained, axis=1)

    def cut_off(self, share: FloatArray) -> "RemainingBurns":
        """Return the burns if the thrust ends for good after a share (p,) of the burn time that
        remains.
        """
        burnt = np.cumsum(self.burn_s, axis=1) - self.burn_s
        remaining = (share * self.burn_s.sum(axis=1))[:, None] - burnt
        return evolve(self, burn_s=np.clip(remaining, 0.0, self.burn_s))


def flown_on(
    state: FloatArray, burns: RemainingBurns, steering: Steering, tilt: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return inertial states (p, 6) at the end of the last burn, its time from now (p,), s, and
    least distances.

    These (p,), m, are from the Earth's centre, at the ends of steps.

    `tilt` (STAGES, STEPS, p, 2), rad, are angles of the thrust from its program, downwards and
    sidewards, in each step.
    """
    time_s = np.zeros(len(state))
    least_m = np.full(len(state), np.inf)
    # Components are rows here: numbers that are added lie side by side.
    state = np.ascontiguousarray(state[:, :6].T)
    for stage in range(STAGES):
        rows = np.flatnonzero(burns.burn_s[:, stage] > 0.0)
        if not len(rows):
            continue
        start_s = burns.start_s[rows, stage]
        burn_s = burns.burn_s[rows, stage]
        moving = state[:, rows]
        dark_s = start_s - time_s[rows]
        if np.count_nonzero(dark_s > 1e-9):
            moving = _step(moving, dark_s, (None, None, None))
        thrust = _Thrust(burns, steering.take(rows), rows, stage)
        for number, share in enumerate(np.diff(_ENDS).tolist()):
            pushes = thrust.pushes(number, tilt[stage, number, rows])
            moving = _step(moving, share * burn_s, pushes)
            least_m[rows] = np.minimum(least_m[rows], np.sqrt(_dot(moving[:3], moving[:3])))
        state[:, rows] = moving
        time_s[rows] = start_s + burn_s
    return np.ascontiguousarray(state.T), time_s, least_m


#: The thrust of particles (p,) at a time, m/s²: along the velocity, downwards from it and
#: sidewards; None in the dark.
_Push = tuple[FloatArray, FloatArray, FloatArray]


class _Thrust:
    """The thrust of some particles in one stage, at its nodes."""

    def __init__(
        self, burns: RemainingBurns, steering: Steering, rows: IntArray, stage: int
    ) -> None:
        since_s = _NODES * burns.burn_s[rows, stage]
        self._lead = steering.leads(burns.since_s[rows] + burns.start_s[rows, stage] + since_s)
        mass = np.maximum(1.0 - burns.growth_per_s[rows, stage] * since_s, LAW.least_mass)
        self._size = burns.acceleration_m_s2[rows, stage] / mass

    def pushes(self, step: int, tilt: FloatArray) -> Sequence[_Push]:
        """Return the thrust at start, middle and end of a step, with tilts (p, 2) from the
        program.
        """
        nodes = slice(2 * step, 2 * step + 3)
        down = np.tan(self._lead[nodes] + tilt[:, 0])
        side = np.tan(tilt[:, 1])
        along = self._size[nodes] / np.sqrt(1.0 + down * down + side * side)
        return list(zip(along, along * down, along * side, strict=True))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return scalar products (p,) of vectors (3, p)."""
    product: FloatArray = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product


#: Axes in cyclic order: the next and the previous axes of each are slices of them.
_CYCLE = np.array([0, 1, 2, 0, 1])


def _rates(state: FloatArray, push: _Push | None) -> FloatArray:
    """Return the rates (6, p) of states (6, p).

    v × (v × r) points down, away from the velocity, with the length |v| |v × r|.
    """
    place = state[:3]
    rates = np.empty_like(state)
    rates[:3] = state[3:]
    square = _dot(place, place)
    pull = -EARTH_MU_M3_S2 / (square * np.sqrt(square))
    if push is None:
        np.multiply(place, pull, out=rates[3:])
        return rates
    places = place.take(_CYCLE, axis=0)
    air = state[3:].take(_CYCLE, axis=0)
    air[::3] += EARTH_ROTATION_RAD_S * place[1]
    air[1::3] -= EARTH_ROTATION_RAD_S * place[0]
    velocity = air[:3]
    side = air[1:4] * places[2:] - air[2:] * places[1:4]
    climb = _dot(velocity, place)
    square = _dot(velocity, velocity) + 1e-6
    speed = np.sqrt(square)
    across = np.sqrt(_dot(side, side)) + 1e-3
    along, down, aside = push
    down = down / (speed * across)
    np.multiply(velocity, along / speed + down * climb, out=rates[3:])
    rates[3:] += place * (pull - down * square)
    rates[3:] += side * (aside / across)
    return rates


def _step(state: FloatArray, step_s: FloatArray, pushes: Sequence[_Push | None]) -> FloatArray:
    """Return states (6, p) after a step of the classical method of Runge and Kutta."""
    start, middle, end = pushes
    half_s = 0.5 * step_s
    start_rate = _rates(state, start)
    rate = _rates(state + half_s * start_rate, middle)
    middle_rate = _rates(state + half_s * rate, middle)
    end_rate = _rates(state + step_s * middle_rate, end)
    rate += middle_rate
    rate += rate
    rate += start_rate
    rate += end_rate
    rate *= step_s / 6.0
    rate += state
    return rate
