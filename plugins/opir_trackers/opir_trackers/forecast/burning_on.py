"""Particles flown on through the burns that remain to them, and down to the ground."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.interfaces import Columns
from opir_trackers.forecast.vehicles import STAGES

#: Steps of Runge and Kutta for each burn, and the time constant of a tilt that no program has, s.
STEPS, TILT_S = 4, 30.0

#: Ends of the steps as shares of a burn: short ones first, while a slow boost turns fast.
_SHARES = (np.arange(STEPS + 1) / STEPS) ** 2

#: Least share of its mass at which a stage still accelerates more.
_LEAST_MASS = 0.05


@frozen(eq=False, repr=False)
class Steering(Columns):
    """By which angle the thrust of boosts (n,) leads the velocity downwards, by the time since the first ignition.

    It is vertical for `rise_s`, leads by up to `lead_rad` over the next `over_s` (pitch-over), and by `steer_rad`
    sin(`steer_rate` t + `steer_phase`) from then on.
    """

    rise_s: FloatArray
    over_s: FloatArray
    lead_rad: FloatArray
    steer_rad: FloatArray
    steer_rate: FloatArray
    steer_phase: FloatArray

    def leads(self, time_s: FloatArray) -> FloatArray:
        """Return the angles (n,), rad, at times since ignition (n,)."""
        part = (time_s - self.rise_s) / self.over_s
        lead: FloatArray = self.steer_rad * np.sin(self.steer_rate * time_s + self.steer_phase)
        lead[part <= 0.0] = 0.0
        # Most have pitched over.
        rows = np.flatnonzero((part > 0.0) & (part < 1.0))
        lead[rows] += self.lead_rad[rows] * np.sin(np.pi * part[rows]) ** 2
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
    """What remains of the boosts of particles (p,), from now on.

    Ignitions `start_s`, burn times, first accelerations and growths c are (p, STAGES), burns of 0 s where there is
    none; an acceleration is A / (1 - c s) after s seconds. `since_s` (p,) is the time since the first ignition.
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
        gained = -np.log(np.maximum(1.0 - growth * self.burn_s, _LEAST_MASS)) / growth
        total: FloatArray = np.sum(self.acceleration_m_s2 * gained, axis=1)
        return total

    def cut_off(self, share: FloatArray) -> "RemainingBurns":
        """Return the burns if the thrust ends for good after a share (p,) of the burn time that remains."""
        before = np.cumsum(self.burn_s, axis=1) - self.burn_s
        left = (share * self.burn_s.sum(axis=1))[:, None] - before
        return evolve(self, burn_s=np.clip(left, 0.0, self.burn_s))


def flown_on(
    state: FloatArray, burns: RemainingBurns, steering: Steering, tilt: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return inertial states (p, 6) at the end of the last burn, how long after now (p,), s, and least distances.

    These (p,), m, are from the Earth's centre, at the ends of steps.

    `tilt` (STAGES, STEPS, p, 2), rad, are angles of the thrust from its program, downwards and sidewards, in each step.
    """
    now, least = np.zeros(len(state)), np.full(len(state), np.inf)
    # Components are rows here: numbers that are added lie side by side.
    state = np.ascontiguousarray(state[:, :6].T)
    for stage in range(STAGES):
        length = burns.burn_s[:, stage]
        rows = np.flatnonzero(length > 0.0)
        if not len(rows):
            continue
        part = _Thrust(burns, steering.take(rows), rows, stage)
        here, when = state[:, rows], now[rows]
        dark = burns.start_s[rows, stage] - when
        if np.count_nonzero(dark > 1e-9):
            here = _step(here, when, dark, part, None)
        when = burns.start_s[rows, stage]
        for number in range(STEPS):
            start, end = _SHARES[number : number + 2]
            here = _step(
                here, when + start * length[rows], (end - start) * length[rows], part, tilt[stage, number, rows]
            )
            least[rows] = np.minimum(least[rows], np.sqrt(_dot(here[:3], here[:3])))
        state[:, rows] = here
        now[rows] = when + length[rows]
    return np.ascontiguousarray(state.T), now, least


class _Thrust:
    """The thrust of some particles in one stage."""

    def __init__(self, burns: RemainingBurns, steering: Steering, rows: IntArray, stage: int) -> None:
        self.size, self.growth = burns.acceleration_m_s2[rows, stage], burns.growth_per_s[rows, stage]
        self.start, self.since, self.steering = burns.start_s[rows, stage], burns.since_s[rows], steering

    def at(self, time_s: FloatArray, tilt: FloatArray, aside: FloatArray) -> "_Push":
        """Return what of the thrust no state changes; `aside` (p,) is the tangent of the tilt sidewards."""
        lead = np.tan(self.steering.leads(self.since + time_s) + tilt[:, 0])
        size = self.size / np.maximum(1.0 - self.growth * (time_s - self.start), _LEAST_MASS)
        return _Push(size, lead, aside, 1.0 + lead * lead + aside * aside)


@frozen(eq=False)
class _Push:
    """The size of the thrust (p,), and its tangents downwards and sidewards from the velocity."""

    size: FloatArray
    lead: FloatArray
    aside: FloatArray
    square: FloatArray

    def force(self, state: FloatArray) -> FloatArray:
        """Return the specific force (3, p)."""
        place, velocity = state[:3], state[3:].copy()
        velocity[0] += EARTH_ROTATION_RAD_S * place[1]
        velocity[1] -= EARTH_ROTATION_RAD_S * place[0]
        square = _dot(velocity, velocity) + 1e-6
        side = _cross(velocity, place)
        across = np.sqrt(_dot(side, side)) + 1e-3
        # v × (v × r) points down, away from the velocity, with the length |v| |v × r|.
        down = velocity * _dot(velocity, place) - place * square
        size = self.size / np.sqrt(square * self.square)
        speed = np.sqrt(square)
        force: FloatArray = (
            size * velocity + (size * self.lead / across) * down + (size * self.aside * speed / across) * side
        )
        return force


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return scalar products (p,) of vectors (3, p)."""
    (x, y, z), (u, v, w) = one, other
    product: FloatArray = x * u + z * w + y * v
    return product


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return cross products (3, p): `np.cross` takes three times as long."""
    (x, y, z), (u, v, w) = one, other
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u])


def _step(
    state: FloatArray, time_s: FloatArray, step_s: FloatArray, thrust: _Thrust, tilt: FloatArray | None
) -> FloatArray:
    """Return states (6, p) after a step of the classical method of Runge and Kutta; without a tilt, in the dark."""

    def rates(there: FloatArray, push: _Push | None) -> FloatArray:
        place = there[:3]
        square = np.sum(place * place, axis=0)
        pull = place * (-EARTH_MU_M3_S2 / (square * np.sqrt(square)))
        if push is not None:
            pull = pull + push.force(there)
        return np.concatenate([there[3:], pull])

    times = time_s, time_s + 0.5 * step_s, time_s + step_s
    pushes: Sequence[_Push | None] = (None, None, None)
    if tilt is not None:
        aside = np.tan(tilt[:, 1])
        pushes = [thrust.at(when, tilt, aside) for when in times]
    start, middle, end = pushes
    first = rates(state, start)
    second = rates(state + 0.5 * step_s * first, middle)
    third = rates(state + 0.5 * step_s * second, middle)
    fourth = rates(state + step_s * third, end)
    after: FloatArray = state + step_s / 6.0 * (first + 2.0 * (second + third) + fourth)
    return after
