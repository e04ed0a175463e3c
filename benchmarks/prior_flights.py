"""Flights drawn from the tracker's own prior of boosts, flown by SciPy over the rotating Earth, as tables.

What a boost does is the prior's; where it starts, and when, is uniform. `programs_of_prior` is all that is taken from
the tracker.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from foreign_flights import AXIS, MU, RADIUS_M, STEP_S, Boost, ecef, geodetic
from opir_trackers.forecast.prior_boosts import class_codes, prior_boosts
from scipy.integrate import solve_ivp

from opir_core.plugin import TARGET_TYPES

#: Free flight is followed for so long, s: what has not come down then is in orbit.
LONGEST_S = 7200.0
#: Free flight that the tables have, s.
COAST_S = 40.0


class Program(NamedTuple):
    """The thrust of a boost: stages, vertical rise, and by how much, rad, it leads the velocity downwards at times."""

    burn_s: np.ndarray
    acceleration_m_s2: np.ndarray
    growth_per_s: np.ndarray
    gap_s: np.ndarray
    rise_s: float
    lead: Callable[[float], float]


class PriorFlight(NamedTuple):
    """A flight: rows of time since ignition, ECEF state and burning; burnout s, launch, impact (rad), class by range.

    `impact` is None for what stays in orbit.
    """

    table: np.ndarray
    burnout_s: float
    launch: tuple[float, float]
    impact: tuple[float, float] | None
    kind: str

    def write(self, path: Path) -> None:
        """Write the table as the target model `table` reads it."""
        head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
        form = ["%.6f"] + ["%.4f"] * 3 + ["%.6f"] * 3 + ["%d"]
        np.savetxt(path, self.table, delimiter=",", header=head, comments="", fmt=form)


@frozen(eq=False)
class PriorBoost(Boost):
    """A boost whose thrust is that of a program, in the plane of its launch."""

    lead: Callable[[float], float] = lambda _time_s: 0.0

    def rates(
        self, time_s: float, state: np.ndarray, start_s: float, length_s: float, first: float, growth: float
    ) -> np.ndarray:
        """Return the rates of a state in the rotating frame, in a burn or (first acceleration 0) in the dark."""
        size = first / (1.0 - (1.0 - 1.0 / growth) * min((time_s - start_s) / length_s, 1.0)) if first else 0.0
        speed = float(np.linalg.norm(state[3:]))
        unit = self.up if time_s < self.rise_s or speed < 1.0 else state[3:] / speed
        if time_s >= self.rise_s:
            lead = self.lead(time_s)
            unit = np.cos(lead) * unit + np.sin(lead) * np.cross(unit, np.cross(self.ahead, self.up))
        central = -MU / np.linalg.norm(state[:3]) ** 3 * state[:3]
        turning = -2.0 * np.cross(AXIS, state[3:]) - np.cross(AXIS, np.cross(AXIS, state[:3]))
        return np.concatenate([state[3:], central + turning + size * unit])


def drawn_flights_of_prior(rng: np.random.Generator, count: int) -> list[PriorFlight]:
    """Return flights of the prior; programs that fall back to the ground in their burn are drawn again."""
    flights = list[PriorFlight]()
    while len(flights) < count:
        for program in programs_of_prior(rng, count - len(flights)):
            place = float(np.arcsin(rng.uniform(-0.85, 0.85))), float(rng.uniform(-np.pi, np.pi))
            flight = flown(program, place, float(rng.uniform(0.0, 2.0 * np.pi)))
            flights += [flight] if flight else []
    return flights


def programs_of_prior(rng: np.random.Generator, count: int) -> list[Program]:
    """Return programs drawn with the weights of the tracker's prior."""
    prior = prior_boosts()
    weight = np.exp(prior.log_weight - prior.log_weight.max())
    found = list[Program]()
    for row in rng.choice(len(weight), count, p=weight / weight.sum()).tolist():
        one = prior.programs.take(np.array([row]))
        used = np.flatnonzero(one.burn_s[0] > 0.0)
        stages = (one.burn_s, one.acceleration_m_s2, one.growth_per_s, one.gap_s)
        lead = lambda time_s, one=one: float(one.leads(np.array([time_s]))[0])  # noqa: E731
        found.append(Program(*(column[0, used] for column in stages), float(one.rise_s[0]), lead))
    return found


def flown(program: Program, launch: tuple[float, float], azimuth: float) -> PriorFlight | None:
    """Return the flight of a program from a place; None where it falls back to the ground in its burn."""
    ratio = 1.0 / (1.0 - program.growth_per_s * program.burn_s)
    boost = PriorBoost(
        *program[:2], ratio, np.append(program.gap_s[:-1], 0.0), program.rise_s, 0.0, launch, azimuth, lead=program.lead
    )
    state, now, rows = np.concatenate([ecef(*launch), 1e-3 * boost.up]), 0.0, []
    exact: dict[str, Any] = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-5, "dense_output": True}
    for one, two, *stage in boost.legs():
        leg = solve_ivp(boost.rates, (one, two), state, args=tuple(stage), max_step=10.0, **exact)
        times = np.linspace(one, two, int(np.ceil((two - one) / STEP_S)) + 1)
        states = leg.sol(times).T
        if any(geodetic(each[:3])[2] < -1.0 for each in states[:: max(1, len(states) // 20)]):
            return None
        rows.append(np.column_stack([times, states, np.full(len(times), bool(stage[2]))]))
        state, now = states[-1], two
    fall = solve_ivp(
        boost.rates, (now, now + LONGEST_S), state, args=(now, 1.0, 0.0, 1.0), events=_ground, max_step=200.0, **exact
    )
    times = np.arange(now, min(now + COAST_S, float(fall.t[-1])), STEP_S)
    rows.append(np.column_stack([times, fall.sol(times).T, np.zeros(len(times))]))
    if not len(fall.t_events[0]):
        return PriorFlight(np.concatenate(rows), now, launch, None, "SLV")
    impact = geodetic(fall.y_events[0][0][:3])[:2]
    start, end = ecef(*launch), ecef(*impact)
    range_m = RADIUS_M * float(np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end))
    kind = TARGET_TYPES[int(class_codes(np.array([range_m]))[0])]
    return PriorFlight(np.concatenate(rows), now, launch, impact, kind)


def _ground(_time_s: float, state: np.ndarray, *_: float) -> float:
    return geodetic(state[:3])[2]


_ground.terminal, _ground.direction = True, -1.0  # type: ignore[attr-defined]
