"""Boosts that share no code with opir: staged gravity turns, integrated by SciPy, as tables.

Notional point masses: constant thrust and mass flow (so thrust over mass grows through a stage), a
vertical rise, a pitch-over, then thrust along the velocity relative to the rotating Earth; central
gravity, no drag. Numbers of stages, burn times, accelerations, gaps and pitch-over angles are drawn
wider than any preset of opir.
"""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from attrs import field, frozen
from scipy.integrate import solve_ivp

MU = 3.986004418e14
SPIN = 7.292115e-5
RADIUS_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
STEP_S = 0.5
PITCH_OVER_S = 10.0
AXIS = np.array([0.0, 0.0, SPIN])


@frozen(eq=False)
class ForeignFlight:
    """A flight: its boost, rows of time since ignition, ECEF state and burning; burns, impact (lat,
    lon in rad, s).
    """

    boost: "Boost"
    table: np.ndarray
    burns_s: tuple[tuple[float, float], ...]
    launch: tuple[float, float]
    impact: tuple[float, float, float]
    range_km: float
    free: Any

    @property
    def burnout_s(self) -> float:
        """Return the time of the last burnout since ignition, s."""
        return self.burns_s[-1][1]

    def state(self, time_s: float) -> np.ndarray:
        """Return the ECEF state (6,) at a time since ignition, on the ground before."""
        return np.asarray(self.free(time_s))

    def write(self, path: Path, burn_only: bool = True) -> None:
        """Write the table."""
        rows = self.table[self.table[:, 0] <= self.burnout_s] if burn_only else self.table
        head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
        np.savetxt(
            path,
            rows,
            delimiter=",",
            header=head,
            comments="",
            fmt=["%.6f"] + ["%.4f"] * 3 + ["%.6f"] * 3 + ["%d"],
        )


def ecef(latitude: float, longitude: float) -> np.ndarray:
    """Return the ECEF position of a point on WGS 84."""
    e2 = FLATTENING * (2.0 - FLATTENING)
    n = RADIUS_M / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    return np.array(
        [
            n * np.cos(latitude) * np.cos(longitude),
            n * np.cos(latitude) * np.sin(longitude),
            n * (1 - e2) * np.sin(latitude),
        ]
    )


def geodetic(place: np.ndarray) -> tuple[float, float, float]:
    """Return latitude, longitude and height of an ECEF position, by fixed-point iteration."""
    e2 = FLATTENING * (2.0 - FLATTENING)
    out = float(np.hypot(place[0], place[1]))
    latitude = np.arctan2(place[2], out * (1 - e2))
    height = 0.0
    for _ in range(8):
        n = RADIUS_M / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
        height = (
            out * np.cos(latitude)
            + place[2] * np.sin(latitude)
            - n * (1.0 - e2 * np.sin(latitude) ** 2)
        )
        latitude = np.arctan2(place[2], out * (1 - e2 * n / (n + height)))
    return float(latitude), float(np.arctan2(place[1], place[0])), float(height)


def drawn_flight(
    stages: int, gaps: bool, rng: np.random.Generator, gap_s: tuple[float, float] = (2.0, 12.0)
) -> ForeignFlight:
    """Return a random flight with a number of stages, dark for some time of `gap_s` between them if
    `gaps`.
    """
    while True:
        burn = rng.uniform(*{1: (45.0, 110.0), 2: (40.0, 85.0), 3: (40.0, 70.0)}[stages], stages)
        first = np.concatenate([rng.uniform(14.0, 28.0, 1), rng.uniform(12.0, 30.0, stages - 1)])
        growth = rng.uniform(1.8, 4.5, stages)
        gap = np.append(rng.uniform(*gap_s, stages - 1) if gaps else np.zeros(stages - 1), 0.0)
        rise = rng.uniform(4.0, 10.0)
        kick = np.radians(rng.uniform(4.0, 24.0))
        place = np.arcsin(rng.uniform(-0.85, 0.85)), rng.uniform(-np.pi, np.pi)
        flight = _flown(
            Boost(burn, first, growth, gap, rise, kick, place, rng.uniform(0.0, 2.0 * np.pi))
        )
        if flight is not None and 150.0 < flight.range_km < 12000.0:
            return flight


def directions(launch: tuple[float, float], azimuth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return up and the horizontal direction of an azimuth, rad, at a place."""
    flat = np.cos(launch[0])
    up = np.array([flat * np.cos(launch[1]), flat * np.sin(launch[1]), np.sin(launch[0])])
    east = np.array([-np.sin(launch[1]), np.cos(launch[1]), 0.0])
    return up, np.sin(azimuth) * east + np.cos(azimuth) * np.cross(up, east)


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
    ahead: np.ndarray = field(init=False)

    def __attrs_post_init__(self) -> None:
        up, ahead = directions(self.launch, self.azimuth)
        object.__setattr__(self, "up", up)
        object.__setattr__(self, "ahead", ahead)

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
        size = (
            first / (1.0 - (1.0 - 1.0 / growth) * min((time_s - start_s) / length_s, 1.0))
            if first
            else 0.0
        )
        unit = self.up if time_s < self.rise_s else state[3:] / np.linalg.norm(state[3:])
        if self.rise_s <= time_s < self.rise_s + PITCH_OVER_S:
            lead = self.kick * np.sin(np.pi * (time_s - self.rise_s) / PITCH_OVER_S) ** 2
            unit = np.cos(lead) * unit + np.sin(lead) * self.ahead
            unit /= np.linalg.norm(unit)
        central = -MU / np.linalg.norm(state[:3]) ** 3 * state[:3]
        turning = -2.0 * np.cross(AXIS, state[3:]) - np.cross(AXIS, np.cross(AXIS, state[:3]))
        return np.concatenate([state[3:], central + turning + size * unit])

    def legs(self) -> Iterator[tuple[float, float, float, float, float, float]]:
        """Yield start, end, ignition, burn time, first acceleration (0 in the dark) and growth of
        each leg.
        """
        now = 0.0
        for length, first, growth, dark in zip(
            self.burn_s, self.acceleration_m_s2, self.growth, self.gap_s, strict=True
        ):
            for begin, end, size in (
                (now, now + length, first),
                (now + length, now + length + dark, 0.0),
            ):
                turns = (
                    edge for edge in (self.rise_s, self.rise_s + PITCH_OVER_S) if begin < edge < end
                )
                for one, two in pairwise(sorted({begin, end, *turns})):
                    yield one, two, now, length, size, growth
            now += length + dark


def _landed(time_s: float, state: np.ndarray, start_s: float, *_: float) -> float:
    return geodetic(state[:3])[2] if time_s > start_s + 20.0 else 1.0


_landed.terminal = True
_landed.direction = -1.0  # type: ignore[attr-defined]


def _flown(boost: Boost) -> ForeignFlight | None:
    launch = boost.launch
    legs = []
    state = np.concatenate([ecef(*launch), np.zeros(3)])
    now = 0.0
    exact: dict[str, Any] = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-6, "dense_output": True}
    for one, two, *stage in boost.legs():
        leg = solve_ivp(boost.rates, (one, two), state, args=tuple(stage), **exact)
        legs.append((one, two, bool(stage[2]), leg.sol))
        state = leg.y[:, -1]
        now = two
        if geodetic(state[:3])[2] < 0.0 and now > 5.0:
            return None
    if np.linalg.norm(state[3:]) > 7300.0 or now > 260.0:
        return None
    fall = solve_ivp(
        boost.rates, (now, now + 6000.0), state, args=(now, 1.0, 0.0, 1.0), events=_landed, **exact
    )
    if not len(fall.t_events[0]):
        return None
    legs.append((now, float(fall.t_events[0][0]), False, fall.sol))
    latitude, longitude, _ = geodetic(fall.y_events[0][0][:3])
    one = ecef(*launch)
    two = ecef(latitude, longitude)
    angle = float(np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two))
    burns = np.cumsum(boost.burn_s + boost.gap_s)
    return ForeignFlight(
        boost,
        _table(legs, now + 60.0, boost.up),
        tuple(
            zip(
                (burns - boost.burn_s - boost.gap_s).tolist(),
                (burns - boost.gap_s).tolist(),
                strict=True,
            )
        ),
        launch,
        (latitude, longitude, float(fall.t_events[0][0])),
        angle * 6371.0,
        lambda time_s: _state(legs, time_s),
    )


def _state(legs: list[Any], time_s: float) -> np.ndarray:
    for begin, end, _, solution in legs:
        if begin <= time_s <= end:
            return np.asarray(solution(time_s))
    return np.full(6, np.nan)


def _table(legs: list[Any], until_s: float, up: np.ndarray) -> np.ndarray:
    rows = []
    for begin, end, is_burning, solution in legs:
        times = np.linspace(
            begin, min(end, until_s), int(np.ceil((min(end, until_s) - begin) / STEP_S)) + 1
        )
        rows.append(np.column_stack([times, solution(times).T, np.full(len(times), is_burning)]))
    table = np.concatenate(rows)
    # A start exactly at rest has no direction.
    table[0, 4:7] = 1e-3 * up
    return table
