"""Boosts that share no code with opir: staged gravity turns, integrated by SciPy, as tables.

Notional point masses: constant thrust and mass flow (so thrust over mass grows through a stage), a
vertical rise, a pitch-over, then thrust along the velocity relative to the rotating Earth; central
gravity, no drag. Numbers of stages, burn times, accelerations, gaps and pitch-over angles are drawn
wider than any preset of opir.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from attrs import field, frozen
from scipy.integrate import solve_ivp

MU = 3.986004418e14
SPIN = 7.292115e-5
RADIUS_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
STEP_S = 0.5
PITCH_OVER_S = 10.0
AXIS = np.array([0.0, 0.0, SPIN])


class Leg(NamedTuple):
    """A part of a boost: start, end and ignition of its stage, s, burn time, s, first acceleration
    (0 in the dark), m/s², and growth of it.
    """

    start_s: float
    end_s: float
    ignition_s: float
    burn_s: float
    first: float
    growth: float

    def acceleration(self, time_s):
        """Return the thrust over mass at a time."""
        share = min((time_s - self.ignition_s) / self.burn_s, 1.0)
        return self.first / (1.0 - (1.0 - 1.0 / self.growth) * share)


@frozen(eq=False)
class ForeignFlight:
    """A flight: its boost, rows (n, 8) of time since ignition, ECEF state and burning; burns, s,
    and impact (latitude, longitude, rad, time, s). `solutions` are those of the legs.
    """

    boost: "Boost"
    table: np.ndarray
    burns_s: tuple[tuple[float, float], ...]
    impact: tuple[float, float, float]
    range_km: float
    solutions: list[tuple[Leg, Any]]

    @property
    def burnout_s(self):
        """The time of the last burnout since ignition, s."""
        return self.burns_s[-1][1]

    def state(self, time_s):
        """Return the ECEF state (6,) at a time since ignition, nan outside the flight."""
        for leg, solution in self.solutions:
            if leg.start_s <= time_s <= leg.end_s:
                return np.asarray(solution(time_s))
        return np.full(6, np.nan)


def ecef(latitude, longitude):
    """Return the ECEF position of a point on WGS 84."""
    n = RADIUS_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    level = n * np.cos(latitude)
    north = n * (1.0 - ECCENTRICITY_SQUARED) * np.sin(latitude)
    return np.array([level * np.cos(longitude), level * np.sin(longitude), north])


def geodetic(place):
    """Return latitude, longitude and height of an ECEF position, by fixed-point iteration."""
    x, y, z = place.tolist()
    level = float(np.hypot(x, y))
    latitude = np.arctan2(z, level * (1.0 - ECCENTRICITY_SQUARED))
    height = 0.0
    for _ in range(8):
        root = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
        n = RADIUS_M / np.sqrt(root)
        height = level * np.cos(latitude) + z * np.sin(latitude) - n * root
        latitude = np.arctan2(z, level * (1.0 - ECCENTRICITY_SQUARED * n / (n + height)))
    return float(latitude), float(np.arctan2(y, x)), float(height)


def distance_m(start, end):
    """Return the distance of two points, rad, along a sphere."""
    a = ecef(*start)
    b = ecef(*end)
    return RADIUS_M * float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def drawn_flight(stages, gaps, rng, gap_s=(2.0, 12.0)):
    """Return a random flight with a number of stages, dark for some time of `gap_s` between them if
    `gaps`.
    """
    burns_s = {1: (45.0, 110.0), 2: (40.0, 85.0), 3: (40.0, 70.0)}
    while True:
        burn_s = rng.uniform(*burns_s[stages], stages)
        first = np.append(rng.uniform(14.0, 28.0, 1), rng.uniform(12.0, 30.0, stages - 1))
        growth = rng.uniform(1.8, 4.5, stages)
        dark_s = rng.uniform(*gap_s, stages - 1) if gaps else np.zeros(stages - 1)
        rise_s = rng.uniform(4.0, 10.0)
        kick = np.radians(rng.uniform(4.0, 24.0))
        launch = float(np.arcsin(rng.uniform(-0.85, 0.85))), float(rng.uniform(-np.pi, np.pi))
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        boost = Boost(burn_s, first, growth, np.append(dark_s, 0.0), rise_s, kick, launch, azimuth)
        flight = flown(boost)
        if flight is not None and 150.0 < flight.range_km < 12000.0:
            return flight


def directions(launch, azimuth):
    """Return up and the horizontal direction of an azimuth, rad, at a place."""
    latitude, longitude = launch
    level = np.cos(latitude)
    up = np.array([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    return up, np.sin(azimuth) * east + np.cos(azimuth) * np.cross(up, east)


def free_rates(state):
    """Return the rates (6,) of a state in the rotating frame under central gravity."""
    x, y, z, u, v, w = state.tolist()
    pull = -MU / (x * x + y * y + z * z) ** 1.5
    across = pull + SPIN * SPIN
    acceleration = (across * x + 2.0 * SPIN * v, across * y - 2.0 * SPIN * u, pull * z)
    return np.array([u, v, w, *acceleration])


@frozen(eq=False)
class Boost:
    """Kinematics of a boost: stages, vertical rise, pitch-over by `kick` rad towards an azimuth,
    and the launch.
    """

    burn_s: np.ndarray
    acceleration_m_s2: np.ndarray
    growth: np.ndarray
    gap_s: np.ndarray
    rise_s: float
    kick: float
    launch: tuple[float, float]
    azimuth: float
    up: np.ndarray = field(init=False)
    along: np.ndarray = field(init=False)

    def __attrs_post_init__(self):
        up, along = directions(self.launch, self.azimuth)
        object.__setattr__(self, "up", up)
        object.__setattr__(self, "along", along)

    @property
    def end_s(self):
        """The last burnout, s after ignition."""
        return float(self.burn_s.sum() + self.gap_s.sum())

    def rates(self, time_s, state, leg):
        """Return the rates (6,) of a state in the rotating frame."""
        rates = free_rates(state)
        if leg.first:
            rates[3:] += leg.acceleration(time_s) * self.thrust_axis(time_s, state, leg)
        return rates

    def thrust_axis(self, time_s, state, _leg):
        """Return the direction of the thrust."""
        if time_s < self.rise_s:
            return self.up
        axis = state[3:] / np.linalg.norm(state[3:])
        turn = (time_s - self.rise_s) / PITCH_OVER_S
        if turn < 1.0:
            lead = self.kick * np.sin(np.pi * turn) ** 2
            axis = np.cos(lead) * axis + np.sin(lead) * self.along
            axis /= np.linalg.norm(axis)
        return np.asarray(axis)

    def legs(self):
        """Yield the legs: burns, split where the thrust turns, and gaps."""
        start_s = 0.0
        stages = (self.burn_s, self.acceleration_m_s2, self.growth, self.gap_s)
        for burn_s, first, growth, gap_s in zip(*(stage.tolist() for stage in stages), strict=True):
            end_s = start_s + burn_s
            edges = (self.rise_s, self.rise_s + PITCH_OVER_S)
            for size, lower_s, upper_s in ((first, start_s, end_s), (0.0, end_s, end_s + gap_s)):
                turns = [edge for edge in edges if lower_s < edge < upper_s]
                for begin, end in pairwise(sorted({lower_s, upper_s, *turns})):
                    yield Leg(begin, end, start_s, burn_s, size, growth)
            start_s = end_s + gap_s


def dark_leg(start_s, duration_s):
    """Return a leg of free flight."""
    return Leg(start_s, start_s + duration_s, start_s, 1.0, 0.0, 1.0)


def ground(_time_s, state, _leg):
    """Return the height, m: an integration ends where it falls below zero."""
    return geodetic(state[:3])[2]


ground.terminal = True
ground.direction = -1.0


def flown(boost):
    """Return the flight of a boost; None where it hits the ground early or does not come down."""
    exact = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-6, "dense_output": True}
    solutions = []
    state = np.concatenate([ecef(*boost.launch), np.zeros(3)])
    for leg in boost.legs():
        flight = solve_ivp(boost.rates, (leg.start_s, leg.end_s), state, args=(leg,), **exact)
        solutions.append((leg, flight.sol))
        state = flight.y[:, -1]
        if leg.end_s > 5.0 and geodetic(state[:3])[2] < 0.0:
            return None
    if np.linalg.norm(state[3:]) > 7300.0 or boost.end_s > 260.0:
        return None
    dark = dark_leg(boost.end_s, 6000.0)
    span = (dark.start_s, dark.end_s)
    fall = solve_ivp(boost.rates, span, state, args=(dark,), events=ground, **exact)
    if not len(fall.t_events[0]):
        return None
    landed_s = float(fall.t_events[0][0])
    solutions.append((dark._replace(end_s=landed_s), fall.sol))
    place = geodetic(fall.y_events[0][0][:3])[:2]
    ends = np.cumsum(boost.burn_s + boost.gap_s) - boost.gap_s
    burns = zip((ends - boost.burn_s).tolist(), ends.tolist(), strict=True)
    range_km = distance_m(boost.launch, place) / 1e3
    rows = table_rows(solutions, boost)
    return ForeignFlight(boost, rows, tuple(burns), (*place, landed_s), range_km, solutions)


def table_rows(solutions, boost):
    """Return rows (n, 8) of legs, up to a minute after the last burnout."""
    rows = []
    for leg, solution in solutions:
        end_s = min(leg.end_s, boost.end_s + 60.0)
        steps = int(np.ceil((end_s - leg.start_s) / STEP_S))
        times = np.linspace(leg.start_s, end_s, steps + 1)
        is_burning = np.full(len(times), leg.first > 0.0)
        rows.append(np.column_stack([times, solution(times).T, is_burning]))
    table = np.concatenate(rows)
    # A start exactly at rest has no direction.
    table[0, 4:7] = 1e-3 * boost.up
    return table
