"""Flights drawn from the tracker's own prior of boosts, flown by SciPy over the rotating Earth, as
tables.

Vehicles are those of its law of stages (`opir_trackers.forecast.vehicles`), sites and clouds those
of `launch_points`: all that is taken from the tracker. Missiles are kept so that their ranges are
log-uniform over the ranges of all classes, as the prior's. Space launchers are steered to a
circular orbit; those whose burns do not suffice are drawn again, and some are cut off early, as
failures. Gliders, and what is none of these, are left out. Where a flight starts is uniform. Half
of the flights are hidden by clouds at first: they do not burn in the table before a uniform time.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from attrs import field, frozen
from foreign_flights import MU, RADIUS_M, SPIN, STEP_S, Boost, ecef, geodetic
from opir_trackers.configs import HypothesesConfig
from opir_trackers.forecast.burning_on import drawn_steering
from opir_trackers.forecast.vehicles import (
    BURN,
    FORCE,
    GAP,
    MISSILE,
    RATIO,
    SPACE,
    STAGES,
    VehicleModel,
    vehicle_model,
)
from opir_trackers.launch_points import AT_ONCE, BEFORE_S, SITES, site_shares
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

#: Time, s, for which free flight is followed: what has not come down then is in orbit.
LONGEST_S = 7200.0
#: Free flight that the tables have, s.
COAST_S = 40.0
#: Lowest height of a launch site, m: land is hardly lower.
LOWEST_M = -500.0
#: Heights of orbits, m, and the lowest perigee of one.
ORBITS_M = (180e3, 400e3)
PERIGEE_M = 120e3
#: Ranges of missiles, m: limits of the classes, and octaves in which as many are kept.
RANGES_M = np.geomspace(50e3, 16e6, 9)
#: A class by range, m.
KINDS = ((1e6, "SRBM"), (5.5e6, "IRBM"), (np.inf, "ICBM"))


class Program(NamedTuple):
    """The thrust of a boost: its stages, vertical rise, and by how much, rad, it leads the velocity
    downwards.

    `site_m` is the height of the launch site above the ellipsoid, `orbit_m` that of the orbit to
    which it is steered instead, `cut_off` the share of the time to the last burnout after which it
    fails.
    """

    burn_s: np.ndarray
    acceleration_m_s2: np.ndarray
    growth: np.ndarray
    gap_s: np.ndarray
    rise_s: float
    lead: Callable[[float], float]
    site_m: float = 0.0
    orbit_m: float | None = None
    cut_off: float = 1.0


class PriorFlight(NamedTuple):
    """A flight: rows of time since ignition, ECEF state and burning; burnout s, launch, impact
    (rad), class by range.

    `impact` is None for what stays in orbit. It is not seen before `hidden_s`, s after ignition.
    """

    table: np.ndarray
    burnout_s: float
    launch: tuple[float, float]
    impact: tuple[float, float] | None
    kind: str
    range_m: float
    hidden_s: float = 0.0

    @property
    def seen_s(self) -> float:
        """Return the time since ignition from which the flight is seen, s; inf for one that is
        never.
        """
        seen = (self.table[:, 0] >= self.hidden_s) & (self.table[:, 7] > 0.0)
        return float(np.min(self.table[seen, 0], initial=np.inf))

    def state(self, time_s: float) -> np.ndarray:
        """Return the ECEF state (6,) at a time since ignition, nan outside the table."""
        time, first = np.unique(self.table[:, 0], return_index=True)
        rows = self.table[first]
        if not time[0] <= time_s <= time[-1]:
            return np.full(6, np.nan)
        place = CubicHermiteSpline(time, rows[:, 1:4], rows[:, 4:7])
        return np.concatenate([place(time_s), place.derivative()(time_s)])

    def write(self, path: Path) -> None:
        """Write the table as the target model `table` reads it, dark where the flight is hidden."""
        head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
        form = ["%.6f"] + ["%.4f"] * 3 + ["%.6f"] * 3 + ["%d"]
        rows = self.table.copy()
        rows[rows[:, 0] < self.hidden_s, 7] = 0.0
        np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt=form)


@frozen(eq=False)
class PriorBoost(Boost):
    """A boost whose thrust is that of a program, in the plane of its launch."""

    program: Program | None = None
    aside: tuple[float, ...] = field(init=False)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        object.__setattr__(self, "aside", tuple(np.cross(self.ahead, self.up).tolist()))

    def rates(
        self,
        time_s: float,
        state: np.ndarray,
        start_s: float,
        length_s: float,
        first: float,
        growth: float,
    ) -> np.ndarray:
        """Return the rates of a state in the rotating frame, in a burn or (first acceleration 0) in
        the dark.
        """
        x, y, z, fast_x, fast_y, fast_z = state.tolist()
        pull = -MU / (x * x + y * y + z * z) ** 1.5
        turn = SPIN * SPIN
        rates = np.array(
            [
                fast_x,
                fast_y,
                fast_z,
                (pull + turn) * x + 2.0 * SPIN * fast_y,
                (pull + turn) * y - 2.0 * SPIN * fast_x,
                pull * z,
            ]
        )
        if first:
            size = first / (1.0 - (1.0 - 1.0 / growth) * min((time_s - start_s) / length_s, 1.0))
            rates[3:] += size * self._unit(time_s, state, size)
        return rates

    def _unit(self, time_s: float, state: np.ndarray, size: float) -> np.ndarray:
        """Return the direction of the thrust."""
        program = self.program
        speed = float(np.linalg.norm(state[3:]))
        assert program
        if time_s < self.rise_s or speed < 1.0:
            return self.up
        if program.orbit_m is not None:
            return self._to_orbit(time_s, state, size)
        unit = state[3:] / speed
        lead = program.lead(time_s)
        (x, y, z), (aside_x, aside_y, aside_z) = unit.tolist(), self.aside
        below = np.array(
            [y * aside_z - z * aside_y, z * aside_x - x * aside_z, x * aside_y - y * aside_x]
        )
        return np.cos(lead) * unit + np.sin(lead) * below

    def _to_orbit(self, time_s: float, state: np.ndarray, size: float) -> np.ndarray:
        """Return the direction that ends at the height of the orbit without climbing: a climb
        linear in the time.
        """
        assert self.program
        assert self.program.orbit_m
        radius = float(np.linalg.norm(state[:3]))
        up = state[:3] / radius
        inertial = _inertial(state)
        climb = float(inertial @ up)
        level_m_s = np.linalg.norm(inertial - climb * up)
        ahead = state[3:] - climb * up
        # At first the motion has no direction of its own.
        ahead = ahead + self.ahead * max(100.0 - float(np.linalg.norm(ahead)), 0.0)
        needed_s = (np.sqrt(MU / radius) - level_m_s) / size
        left_s = max(min(self.burn_s.sum() + self.gap_s.sum() - time_s, needed_s), 15.0)
        wanted = 6.0 * (self.program.orbit_m + RADIUS_M - radius) / left_s**2 - 4.0 * climb / left_s
        sine = np.clip((wanted + MU / radius**2 - level_m_s**2 / radius) / size, -0.6, 0.97)
        return sine * up + np.sqrt(1.0 - sine**2) * ahead / np.linalg.norm(ahead)


def drawn_flights_of_prior(rng: np.random.Generator, count: int) -> list[PriorFlight]:
    """Return flights of the prior, in random order."""
    model = vehicle_model()
    missile, orbit = (model.data["groups"][name] for name in ("missile", "orbit"))
    missiles = int(np.round(count * missile / (missile + orbit)))
    flights = [*_missiles(model, rng, missiles), *_launchers(model, rng, count - missiles)]
    hidden_s = np.where(
        rng.random(count) < AT_ONCE, 0.0, rng.uniform(0.0, BEFORE_S, count)
    ).tolist()
    order = rng.permutation(count)
    return [
        flights[row]._replace(hidden_s=late_s) for row, late_s in zip(order, hidden_s, strict=True)
    ]


def _missiles(model: VehicleModel, rng: np.random.Generator, count: int) -> list[PriorFlight]:
    """Return flights of missiles whose ranges are about log-uniform: as many of each part of
    them.
    """
    parts = len(RANGES_M) - 1
    wanted = np.bincount(rng.integers(0, parts, count), minlength=parts)
    found = list[PriorFlight]()
    while wanted.any():
        flight = flown(program_of(model, MISSILE, rng), *_place(rng))
        part = (
            int(np.searchsorted(RANGES_M, flight.range_m)) - 1 if flight and flight.impact else -1
        )
        if flight and 0 <= part < parts and wanted[part]:
            wanted[part] -= 1
            found.append(flight)
    return found


def _launchers(model: VehicleModel, rng: np.random.Generator, count: int) -> list[PriorFlight]:
    found = list[PriorFlight]()
    while len(found) < count:
        program = program_of(model, SPACE, rng)._replace(orbit_m=float(rng.uniform(*ORBITS_M)))
        place = _place(rng)
        flight = None
        if (whole := flown(program, *place)) and whole.impact is None:
            fails = rng.random() < model.data["failure_probability"]
            flight = (
                flown(program._replace(cut_off=float(rng.uniform(0.2, 1.0))), *place)
                if fails
                else whole
            )
        found += [flight] if flight else []
    return found


def _place(rng: np.random.Generator) -> tuple[tuple[float, float], float]:
    place = float(np.arcsin(rng.uniform(-0.85, 0.85))), float(rng.uniform(-np.pi, np.pi))
    return place, float(rng.uniform(0.0, 2.0 * np.pi))


def program_of(model: VehicleModel, family: int, rng: np.random.Generator) -> Program:
    """Return the program of a vehicle drawn from the law of a family."""
    logs = np.full((1, STAGES, 4), np.nan)
    row = np.array([family])
    stages = int(rng.choice(STAGES, p=model.stages[family] / model.stages[family].sum())) + 1
    for stage in range(stages):
        known = model.given(logs)
        total = known.total[:, family]
        number = known.number[:, family]
        mean, sigma = model.law(row, np.array([stage]), total, number)
        logs[:, stage] = mean + sigma * rng.normal(size=(1, 4))
        if rng.random() < known.hot[0, family]:
            logs[:, stage, GAP] = -np.inf
    drawn = logs[0, :stages]
    highest = np.log(model.data["highest_m_s2"])
    ratio = np.maximum(np.minimum(drawn[:, RATIO], highest - drawn[:, FORCE]), 0.02)
    gap_s = np.append(np.exp(drawn[:-1, GAP]), 0.0)
    steering = drawn_steering(1, model.data, int(rng.integers(2**31)))
    lead = lambda time_s: float(steering.leads(np.array([time_s]))[0])  # noqa: E731
    burn_s = np.exp(drawn[:, BURN])
    first = np.exp(drawn[:, FORCE])
    kind = rng.choice(len(SITES), p=site_shares(HypothesesConfig().inland_share))
    site_m = max(rng.normal(*SITES[kind]), LOWEST_M)
    return Program(burn_s, first, np.exp(ratio), gap_s, float(steering.rise_s[0]), lead, site_m)


def flown(program: Program, launch: tuple[float, float], azimuth: float) -> PriorFlight | None:
    """Return the flight of a program from a place; None where it falls back to the ground in its
    burn.
    """
    boost = PriorBoost(*program[:4], program.rise_s, 0.0, launch, azimuth, program=program)
    state = np.concatenate([ecef(*launch) + program.site_m * boost.up, 1e-3 * boost.up])
    now = 0.0
    rows = []
    exact: dict[str, Any] = {"method": "RK45", "rtol": 1e-8, "atol": 1e-4, "dense_output": True}
    end_s = program.cut_off * float(program.burn_s.sum() + program.gap_s.sum())
    for one, two, *stage in boost.legs():
        if one >= end_s:
            break
        events = [_below_ground, *([_fast_enough] if program.orbit_m is not None else [])]
        span = (one, min(two, end_s))
        leg = solve_ivp(
            boost.rates, span, state, args=tuple(stage), max_step=10.0, events=events, **exact
        )
        now = float(leg.t[-1])
        times = np.linspace(one, now, int(np.ceil((now - one) / STEP_S)) + 1)
        states = leg.sol(times).T
        if len(leg.t_events[0]):
            return None
        rows.append(np.column_stack([times, states, np.full(len(times), bool(stage[2]))]))
        state = states[-1]
        if leg.status == 1:
            break
    return _with_fall(program, boost, rows)


def _with_fall(program: Program, boost: PriorBoost, rows: list[np.ndarray]) -> PriorFlight | None:
    """Return the flight of a boost whose rows are known, with its free flight."""
    now = float(rows[-1][-1, 0])
    state = rows[-1][-1, 1:7]
    burnt_s = max(float(part[-1, 0]) for part in rows if part[-1, 7])
    exact: dict[str, Any] = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-4, "dense_output": True}
    span = (now, now + LONGEST_S)
    dark = (now, 1.0, 0.0, 1.0)
    fall = solve_ivp(boost.rates, span, state, args=dark, events=_ground, max_step=200.0, **exact)
    times = np.arange(now, min(now + COAST_S, float(fall.t[-1])), STEP_S)
    table = np.concatenate(
        [*rows, np.column_stack([times, fall.sol(times).T, np.zeros(len(times))])]
    )
    if not len(fall.t_events[0]):
        lowest = np.linalg.norm(fall.y[:3], axis=0).min() - RADIUS_M
        return (
            PriorFlight(table, burnt_s, boost.launch, None, "SLV", np.nan)
            if lowest > PERIGEE_M
            else None
        )
    impact = geodetic(fall.y_events[0][0][:3])[:2]
    start = ecef(*boost.launch)
    end = ecef(*impact)
    range_m = RADIUS_M * float(np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end))
    by_range = next(name for least_m, name in KINDS if range_m < least_m)
    kind = by_range if program.orbit_m is None else "SLV"
    return PriorFlight(table, burnt_s, boost.launch, impact, kind, range_m)


def _inertial(state: np.ndarray) -> np.ndarray:
    """Return the inertial velocity, along the axes of the rotating Earth."""
    return state[3:] + SPIN * np.array([-state[1], state[0], 0.0])


def _ground(_time_s: float, state: np.ndarray, *_: float) -> float:
    return geodetic(state[:3])[2]


_ground.terminal = True
_ground.direction = -1.0  # type: ignore[attr-defined]


def _below_ground(time_s: float, state: np.ndarray, *_: float) -> float:
    return _ground(time_s, state) - LOWEST_M


_below_ground.terminal = True
_below_ground.direction = -1.0  # type: ignore[attr-defined]


def _fast_enough(_time_s: float, state: np.ndarray, *_: float) -> float:
    """Return the speed beyond that of a circular orbit: where it is reached, the burn ends."""
    return float(np.linalg.norm(_inertial(state)) - np.sqrt(MU / np.linalg.norm(state[:3])))


_fast_enough.terminal = True
_fast_enough.direction = 1.0  # type: ignore[attr-defined]
