"""Flights drawn from the tracker's own prior of boosts, flown by SciPy over the rotating Earth, as
tables.

Vehicles are those of its law of stages (`opir_forecast.vehicles`), sites and clouds those
of `launch_points`: all that is taken from the tracker. Missiles are kept so that their ranges are
log-uniform over the ranges of all classes, as the prior's. Space launchers are steered to a
circular orbit; those whose burns do not suffice are drawn again, and some are cut off early, as
failures. Gliders and unknown classes are left out. Where a flight starts is uniform. Half of the
flights are hidden by clouds at first: they do not burn in the table before a uniform time.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from foreign_flights import (
    AXIS,
    MU,
    RADIUS_M,
    STEP_S,
    Boost,
    dark_leg,
    distance_m,
    ecef,
    geodetic,
    ground,
)
from opir_forecast.burning_on import drawn_steering
from opir_forecast.launch_points import AT_ONCE, BEFORE_S, SITES, site_shares
from opir_forecast.vehicles import (
    BURN,
    FORCE,
    GAP,
    MISSILE,
    RATIO,
    SPACE,
    STAGES,
    vehicle_model,
)
from opir_trackers.configs import HypothesesConfig
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

#: Lowest height of a launch site, m: land is hardly lower.
LOWEST_M = -500.0
#: Ranges of missiles, m: limits of the classes, and octaves in which as many are kept.
RANGES_M = np.geomspace(50e3, 16e6, 9)
#: Classes by their longest range, m.
KINDS = {"SRBM": 1e6, "IRBM": 5.5e6, "ICBM": np.inf}

Launch = tuple[tuple[float, float], float]


class Program(NamedTuple):
    """The thrust of a boost: its stages, vertical rise, and its lead, rad, before the velocity
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
    """A flight: rows (n, 8) of time since ignition, ECEF state and burning; burnout s, launch and
    impact (rad), class and range.

    `impact` is None for an orbit. The flight is not seen before `hidden_s`, s after ignition.
    """

    table: np.ndarray
    burnout_s: float
    launch: tuple[float, float]
    impact: tuple[float, float] | None
    kind: str
    range_m: float
    hidden_s: float = 0.0

    @property
    def seen_s(self):
        """The time since ignition from which the flight is seen, s; inf if it never is."""
        lit = (self.table[:, 0] >= self.hidden_s) & (self.table[:, 7] > 0.0)
        return float(np.min(self.table[lit, 0], initial=np.inf))

    def state(self, time_s):
        """Return the ECEF state (6,) at a time since ignition, nan outside the table."""
        times, index = np.unique(self.table[:, 0], return_index=True)
        rows = self.table[index]
        if not times[0] <= time_s <= times[-1]:
            return np.full(6, np.nan)
        place = CubicHermiteSpline(times, rows[:, 1:4], rows[:, 4:7])
        return np.concatenate([place(time_s), place(time_s, 1)])

    def seen_table(self):
        """Return the rows of the table, dark where the flight is hidden."""
        rows = self.table.copy()
        rows[rows[:, 0] < self.hidden_s, 7] = 0.0
        return rows


@frozen(eq=False)
class PriorBoost(Boost):
    """A boost whose thrust is that of a program, in the plane of its launch."""

    program: Program | None = None
    side: np.ndarray = field(init=False)

    def __attrs_post_init__(self):
        super().__attrs_post_init__()
        object.__setattr__(self, "side", np.cross(self.along, self.up))

    def thrust_axis(self, time_s, state, leg):
        """Return the direction of the thrust."""
        program = self.program
        assert program
        speed = float(np.linalg.norm(state[3:]))
        if time_s < self.rise_s or speed < 1.0:
            return self.up
        if program.orbit_m is not None:
            return self.axis_to_orbit(time_s, state, leg.acceleration(time_s), program.orbit_m)
        axis = state[3:] / speed
        lead = program.lead(time_s)
        return np.cos(lead) * axis + np.sin(lead) * np.cross(axis, self.side)

    def axis_to_orbit(self, time_s, state, acceleration, orbit_m):
        """Return the direction that ends at the height of the orbit without climbing: a climb
        linear in the time.
        """
        radius = float(np.linalg.norm(state[:3]))
        up = state[:3] / radius
        inertial = inertial_velocity(state)
        climb = float(inertial @ up)
        level_m_s = np.linalg.norm(inertial - climb * up)
        along = state[3:] - climb * up
        # At first the motion has no direction of its own.
        along = along + self.along * max(100.0 - float(np.linalg.norm(along)), 0.0)
        needed_s = (np.sqrt(MU / radius) - level_m_s) / acceleration
        remaining_s = max(min(self.end_s - time_s, needed_s), 15.0)
        lift = 6.0 * (orbit_m + RADIUS_M - radius) / remaining_s**2 - 4.0 * climb / remaining_s
        weight = MU / radius**2 - level_m_s**2 / radius
        sine = np.clip((lift + weight) / acceleration, -0.6, 0.97)
        return sine * up + np.sqrt(1.0 - sine**2) * along / np.linalg.norm(along)


def inertial_velocity(state):
    """Return the inertial velocity, along the axes of the rotating Earth."""
    return np.asarray(state[3:] + np.cross(AXIS, state[:3]))


def drawn_flights_of_prior(rng, count):
    """Return flights of the prior, in random order."""
    model = vehicle_model()
    groups = model.data["groups"]
    share = groups["missile"] / (groups["missile"] + groups["orbit"])
    missiles = int(np.round(count * share))
    flights = [*missile_flights(model, rng, missiles)]
    flights += [launcher_flight(model, rng) for _ in range(count - missiles)]
    clouds_s = rng.uniform(0.0, BEFORE_S, count)
    hidden_s = np.where(rng.random(count) < AT_ONCE, 0.0, clouds_s).tolist()
    pairs = zip(rng.permutation(count), hidden_s, strict=True)
    return [flights[row]._replace(hidden_s=time_s) for row, time_s in pairs]


def missile_flights(model, rng, count):
    """Yield flights of missiles whose ranges are about log-uniform: as many of each octave."""
    octaves = len(RANGES_M) - 1
    missing = np.bincount(rng.integers(0, octaves, count), minlength=octaves)
    while missing.any():
        flight = flown(program_of(model, MISSILE, rng), launch_of(rng))
        if flight and flight.impact:
            octave = int(np.searchsorted(RANGES_M, flight.range_m)) - 1
            if 0 <= octave < octaves and missing[octave]:
                missing[octave] -= 1
                yield flight


def launcher_flight(model, rng):
    """Return a flight of a space launcher, to orbit or failed on its way."""
    while True:
        orbit_m = float(rng.uniform(180e3, 400e3))
        program = program_of(model, SPACE, rng)._replace(orbit_m=orbit_m)
        launch = launch_of(rng)
        flight = flown(program, launch)
        if flight is None or flight.impact is not None:
            continue
        if rng.random() < model.data["failure_probability"]:
            flight = flown(program._replace(cut_off=float(rng.uniform(0.2, 1.0))), launch)
        if flight:
            return flight


def launch_of(rng):
    """Return a random place and azimuth, rad."""
    place = float(np.arcsin(rng.uniform(-0.85, 0.85))), float(rng.uniform(-np.pi, np.pi))
    return place, float(rng.uniform(0.0, 2.0 * np.pi))


def program_of(model, family, rng):
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
    logs = logs[0, :stages]
    force = logs[:, FORCE]
    highest = np.log(model.data["highest_m_s2"])
    ratio = np.maximum(np.minimum(logs[:, RATIO], highest - force), 0.02)
    steering = drawn_steering(1, model.data, int(rng.integers(2**31)))
    kind = rng.choice(len(SITES), p=site_shares(HypothesesConfig().inland_share))
    return Program(
        burn_s=np.exp(logs[:, BURN]),
        acceleration_m_s2=np.exp(force),
        growth=np.exp(ratio),
        gap_s=np.append(np.exp(logs[:-1, GAP]), 0.0),
        rise_s=float(steering.rise_s[0]),
        lead=lambda time_s: float(steering.leads(np.array([time_s]))[0]),
        site_m=max(rng.normal(*SITES[kind]), LOWEST_M),
    )


def below_ground(time_s, state, leg):
    """Return the height above the lowest site, m."""
    return ground(time_s, state, leg) - LOWEST_M


def surplus_m_s(_time_s, state, _leg):
    """Return the speed beyond that of a circular orbit: where it is reached, the burn ends."""
    circular = np.sqrt(MU / np.linalg.norm(state[:3]))
    return float(np.linalg.norm(inertial_velocity(state)) - circular)


below_ground.terminal = surplus_m_s.terminal = True
below_ground.direction = -1.0
surplus_m_s.direction = 1.0


def flown(program, launch):
    """Return the flight of a program from a place; None where it falls back to the ground in its
    burn.
    """
    boost = PriorBoost(*program[:4], program.rise_s, 0.0, *launch, program=program)
    state = np.concatenate([ecef(*boost.launch) + program.site_m * boost.up, 1e-3 * boost.up])
    events = [below_ground] if program.orbit_m is None else [below_ground, surplus_m_s]
    end_s = program.cut_off * boost.end_s
    exact = {"rtol": 1e-8, "atol": 1e-4, "max_step": 10.0, "dense_output": True}
    rows = []
    for leg in boost.legs():
        if leg.start_s >= end_s:
            break
        span = (leg.start_s, min(leg.end_s, end_s))
        flight = solve_ivp(boost.rates, span, state, args=(leg,), events=events, **exact)
        stop_s = float(flight.t[-1])
        steps = int(np.ceil((stop_s - leg.start_s) / STEP_S))
        times = np.linspace(leg.start_s, stop_s, steps + 1)
        states = flight.sol(times).T
        if len(flight.t_events[0]):
            return None
        is_burning = np.full(len(times), leg.first > 0.0)
        rows.append(np.column_stack([times, states, is_burning]))
        state = states[-1]
        if flight.status == 1:
            break
    return with_fall(program, boost, np.concatenate(rows))


def with_fall(program, boost, rows):
    """Return the flight of a boost with its free flight, None if it neither lands nor orbits."""
    burnout_s = float(rows[rows[:, 7] > 0.0, 0].max())
    exact = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-4, "dense_output": True}
    leg = dark_leg(float(rows[-1, 0]), 7200.0)
    span = (leg.start_s, leg.end_s)
    fall = solve_ivp(
        boost.rates, span, rows[-1, 1:7], args=(leg,), events=ground, max_step=200.0, **exact
    )
    times = np.arange(leg.start_s, min(leg.start_s + 40.0, float(fall.t[-1])), STEP_S)
    free = np.column_stack([times, fall.sol(times).T, np.zeros(len(times))])
    table = np.concatenate([rows, free])
    if not len(fall.t_events[0]):
        lowest_m = np.linalg.norm(fall.y[:3], axis=0).min() - RADIUS_M
        orbit = PriorFlight(table, burnout_s, boost.launch, None, "SLV", np.nan)
        return orbit if lowest_m > 120e3 else None
    impact = geodetic(fall.y_events[0][0][:3])[:2]
    range_m = distance_m(boost.launch, impact)
    kind = next(name for name, longest_m in KINDS.items() if range_m < longest_m)
    kind = kind if program.orbit_m is None else "SLV"
    return PriorFlight(table, burnout_s, boost.launch, impact, kind, range_m)
