"""Particles flown on through the burns that remain to them, and down to the ground."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_trackers.forecast.prior_boosts import STAGES, BoostPrograms

#: Steps of Runge and Kutta for each burn, and the time constant of a tilt that no program has, s.
STEPS, TILT_S = 5, 30.0

#: Ends of the steps as shares of a burn: short ones first, while a slow boost turns fast.
_SHARES = (np.arange(STEPS + 1) / STEPS) ** 2

#: Least share of its mass at which a stage still accelerates more.
_LEAST_MASS = 0.05


@frozen(eq=False)
class RemainingBurns:
    """What remains of the boosts of particles (p,): `wait_s` to the next ignition and the burns (p, STAGES).

    `programs` have the angles by which the thrust leads the velocity, by the time since ignition, `since_s` (p,) now.
    `scale` (p,) is the ratio of a particle's acceleration to that of its boost, for the burn that goes on.
    """

    start_s: FloatArray
    burn_s: FloatArray
    acceleration_m_s2: FloatArray
    growth_per_s: FloatArray
    programs: BoostPrograms
    since_s: FloatArray


def remaining(programs: BoostPrograms, since_s: FloatArray, scale: FloatArray) -> RemainingBurns:
    """Return what remains of programs (p,) after times since ignition (p,)."""
    starts = programs.starts_s - since_s[:, None]
    done = np.clip(-starts, 0.0, programs.burn_s)
    left = programs.burn_s - done
    shrink = 1.0 - programs.growth_per_s * done
    on = (done > 0.0) & (left > 0.0)
    size = programs.acceleration_m_s2 / shrink * np.where(on, scale[:, None], 1.0)
    return RemainingBurns(np.maximum(starts, 0.0), left, size, programs.growth_per_s / shrink, programs, since_s)


def flown_on(state: FloatArray, burns: RemainingBurns, tilt: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return inertial states (p, 6) at the end of the last burn, and how long after now (p,), s.

    `tilt` (STAGES, STEPS, p, 2), rad, are angles of the thrust from its program, downwards and sidewards, in each step.
    """
    now = np.zeros(len(state))
    # Components are rows here: numbers that are added lie side by side.
    state = np.ascontiguousarray(state[:, :6].T)
    for stage in range(STAGES):
        length = burns.burn_s[:, stage]
        rows = np.flatnonzero(length > 0.0)
        if not len(rows):
            continue
        part = _Thrust(burns, rows, stage)
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
        state[:, rows] = here
        now = now.copy()
        now[rows] = when + length[rows]
    return np.ascontiguousarray(state.T), now


class _Thrust:
    """The thrust of some particles in one stage."""

    def __init__(self, burns: RemainingBurns, rows: IntArray, stage: int) -> None:
        self.size, self.growth = burns.acceleration_m_s2[rows, stage], burns.growth_per_s[rows, stage]
        self.start, self.since, self.programs = (
            burns.start_s[rows, stage],
            burns.since_s[rows],
            burns.programs.take(rows),
        )

    def at(self, time_s: FloatArray, tilt: FloatArray, aside: FloatArray) -> "_Push":
        """Return what of the thrust no state changes; `aside` (p,) is the tangent of the tilt sidewards."""
        lead = np.tan(self.programs.leads(self.since + time_s) + tilt[:, 0])
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
