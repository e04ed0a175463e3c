"""Parameters of the flights of `foreign_flights`, and many flights with slightly other ones, flown
at once.

What an estimator could know that knows their law: the gravity turn with its stages, pitch-over,
launch and azimuth, and the ranges from which these are drawn. `benchmarks/flight_bound.py` makes a
bound of it.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from foreign_flights import MU, PITCH_OVER_S, SPIN, Boost, directions, ecef

from opir_core.flight.forces import Forces
from opir_core.flight.propagation import impact

#: Standard deviations of the law of flights: of uniform laws, or so wide that a look says more.
BURN_S = {1: (45.0, 110.0), 2: (40.0, 85.0), 3: (40.0, 70.0)}
PLACE_RAD = 0.2
IGNITION_S = 1e3
LONGEST_STEP_S = 0.5
FREE_S = 40.0


class Paths(NamedTuple):
    """Flights (f,) since the scene's start: times (f, k), ECEF positions and velocities (f, k, 3),
    burnouts (f,).
    """

    time_s: np.ndarray
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    burnout_s: np.ndarray

    def states(self, time_s: np.ndarray) -> np.ndarray:
        """Return the states (f, n, 6) at times (n,), by cubic Hermite interpolation."""
        return np.array([self._states_of(row, time_s) for row in range(len(self.time_s))])

    def _states_of(self, row: int, time_s: np.ndarray) -> np.ndarray:
        times = self.time_s[row]
        place = self.position_m[row]
        speed = self.velocity_m_s[row]
        at = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, len(times) - 2)
        step = np.maximum(times[at + 1] - times[at], 1e-9)[:, None]
        share = (time_s[:, None] - times[at, None]) / step
        gap = place[at + 1] - place[at]
        left = speed[at] * step - gap
        right = gap - speed[at + 1] * step
        bend = (1.0 - share) * left + share * right
        found = place[at] + share * gap + share * (1.0 - share) * bend
        rate = gap + (1.0 - 2.0 * share) * bend + share * (1.0 - share) * (right - left)
        return np.concatenate([found, rate / step], axis=1)

    def impacts(self) -> np.ndarray:
        """Return the ECEF positions (f, 3) of the impacts, in free flight after the last
        burnout.
        """
        states = np.array(
            [
                self._states_of(row, self.burnout_s[row : row + 1])[0]
                for row in range(len(self.time_s))
            ]
        )
        velocity = states[:, 3:] + np.cross([0.0, 0.0, SPIN], states[:, :3])
        flight, fell = impact(states[:, :3], velocity, forces=Forces(zonal=()))
        angle = SPIN * flight
        x, y, z = fell.T
        return np.stack(
            [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z],
            axis=1,
        )


class Law(NamedTuple):
    """The thrust of flights (f,) in a leg: the stage's start, burn, acceleration and growth, and
    the pitch-over.
    """

    start_s: np.ndarray
    burn_s: np.ndarray
    acceleration_m_s2: np.ndarray
    growth: np.ndarray
    rise_s: np.ndarray
    kick: np.ndarray
    up: np.ndarray
    ahead: np.ndarray
    is_rising: bool


def parameters(boost: Boost, ignition_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters (p,) of a boost and their prior standard deviations.

    Launch latitude and longitude, azimuth, ignition, rise, kick; burns, first accelerations,
    growths, and gaps if any.
    """
    stages = len(boost.burn_s)
    gaps = boost.gap_s[:-1] if boost.gap_s.any() else np.empty(0)
    values = [*boost.launch, boost.azimuth, ignition_s, boost.rise_s, boost.kick]
    widths = [
        *[PLACE_RAD * np.sqrt(12.0)] * 2,
        2.0 * np.pi,
        IGNITION_S * np.sqrt(12.0),
        6.0,
        np.radians(20.0),
    ]
    accelerations = [14.0] + [18.0] * (stages - 1)
    low, high = BURN_S[stages]
    widths += [high - low] * stages + accelerations + [2.7] * stages + [10.0] * len(gaps)
    found = np.concatenate([values, boost.burn_s, boost.acceleration_m_s2, boost.growth, gaps])
    return found, np.array(widths) / np.sqrt(12.0)


def flown(rows: np.ndarray, stages: int) -> Paths:
    """Return flights with parameters (f, p), by the classical method of Runge and Kutta."""
    place = [(float(row[0]), float(row[1])) for row in rows]
    sides = [directions(there, float(row[2])) for there, row in zip(place, rows, strict=True)]
    up = np.array([side[0] for side in sides])
    ahead = np.array([side[1] for side in sides])
    ignition = rows[:, 3]
    rise = rows[:, 4]
    kick = rows[:, 5]
    burn, first, growth = np.split(rows[:, 6 : 6 + 3 * stages], 3, axis=1)
    gap = (
        rows[:, 6 + 3 * stages :]
        if rows.shape[1] > 6 + 3 * stages
        else np.zeros((len(rows), stages - 1))
    )
    state = np.concatenate(
        [np.array([ecef(*there) for there in place]), np.zeros((len(rows), 3))], axis=1
    )
    times = [np.zeros(len(rows))]
    states = [state]
    start = np.zeros(len(rows))
    for stage in range(stages):
        end = start + burn[:, stage]
        edges = [start, rise, rise + PITCH_OVER_S, end] if not stage else [start, end]
        for one, two in pairwise(edges):
            is_rising = one is edges[0] and not stage
            law = Law(
                start,
                burn[:, stage],
                first[:, stage],
                growth[:, stage],
                rise,
                kick,
                up,
                ahead,
                is_rising,
            )
            _leg(times, states, one, two, law)
        start = end + (gap[:, stage] if stage < stages - 1 else FREE_S)
        if stage == stages - 1:
            burnout = end
        if np.any(start > end):
            _leg(times, states, end, start, None)
    every = np.array(states).transpose(1, 0, 2)
    return Paths(
        np.array(times).T + ignition[:, None], every[:, :, :3], every[:, :, 3:], burnout + ignition
    )


def _leg(
    times: list[np.ndarray],
    states: list[np.ndarray],
    one: np.ndarray,
    two: np.ndarray,
    law: Law | None,
) -> None:
    """Append the steps of a leg from times (f,) to others; its two ends are steps of their own."""
    count = int(np.ceil(np.max(two - one) / LONGEST_STEP_S))
    step = ((two - one) / count)[:, None]
    state = states[-1]
    for number in range(count):
        now = one + step[:, 0] * number
        half = now + 0.5 * step[:, 0]
        k1 = rates(now, state, law)
        k2 = rates(half, state + 0.5 * step * k1, law)
        k3 = rates(half, state + 0.5 * step * k2, law)
        k4 = rates(now + step[:, 0], state + step * k3, law)
        state = state + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        times.append(now + step[:, 0])
        states.append(state)


def rates(time_s: np.ndarray, state: np.ndarray, law: Law | None) -> np.ndarray:
    """Return the rates (f, 6) of states (f, 6), as `Boost.rates` does for one."""
    place = state[:, :3]
    speed = state[:, 3:]
    x, y, _ = place.T
    u, v, _ = speed.T
    turning = np.stack(
        [2.0 * SPIN * v + SPIN**2 * x, SPIN**2 * y - 2.0 * SPIN * u, np.zeros(len(state))], axis=1
    )
    pull = turning - MU * place / np.sum(place * place, axis=1, keepdims=True) ** 1.5
    if law is not None:
        share = (time_s - law.start_s) / law.burn_s
        size = law.acceleration_m_s2 / (1.0 - (1.0 - 1.0 / law.growth) * np.minimum(share, 1.0))
        unit = (
            law.up
            if law.is_rising
            else speed / np.sqrt(np.sum(speed * speed, axis=1, keepdims=True))
        )
        over = np.clip((time_s - law.rise_s) / PITCH_OVER_S, 0.0, 1.0)
        lead = 0.0 if law.is_rising else (law.kick * np.sin(np.pi * over) ** 2)[:, None]
        unit = np.cos(lead) * unit + np.sin(lead) * law.ahead
        pull = pull + (size / np.sqrt(np.sum(unit * unit, axis=1)))[:, None] * unit
    return np.concatenate([speed, pull], axis=1)


def edges(rows: np.ndarray, stages: int) -> np.ndarray:
    """Return the edges (f, k) between light and dark: ignition, ends of burns before a gap,
    ignitions after one.
    """
    burn = rows[:, 6 : 6 + stages]
    gap = rows[:, 6 + 3 * stages :]
    found = [rows[:, 3]]
    now = rows[:, 3]
    for stage in range(stages):
        now = now + burn[:, stage]
        if stage == stages - 1:
            found.append(now)
        elif gap.shape[1]:
            found += [now, now + gap[:, stage]]
            now = now + gap[:, stage]
    return np.stack(found, axis=1)
