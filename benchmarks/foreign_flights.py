"""Boosts that share no code with opir: staged gravity turns, integrated by SciPy, as tables of the target model `table`.

Notional point masses: constant thrust and mass flow (so thrust over mass grows through a stage), a vertical rise, a
pitch-over, then thrust along the velocity relative to the rotating Earth; central gravity, no drag. Numbers of stages,
burn times, accelerations, gaps and pitch-over angles are drawn wider than any preset of opir.
"""

from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from scipy.integrate import solve_ivp

MU, SPIN, RADIUS_M, FLATTENING = 3.986004418e14, 7.292115e-5, 6378137.0, 1.0 / 298.257223563
STEP_S, PITCH_OVER_S = 0.5, 10.0
AXIS = np.array([0.0, 0.0, SPIN])


@frozen(eq=False)
class ForeignFlight:
    """A flight: rows of time since ignition, ECEF state and burning; burns, and the impact (lat, lon in rad, s)."""

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
        np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt=["%.6f"] + ["%.4f"] * 3 + ["%.6f"] * 3 + ["%d"])


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
    e2, out = FLATTENING * (2.0 - FLATTENING), float(np.hypot(place[0], place[1]))
    latitude, height = np.arctan2(place[2], out * (1 - e2)), 0.0
    for _ in range(8):
        n = RADIUS_M / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
        height = out * np.cos(latitude) + place[2] * np.sin(latitude) - n * (1.0 - e2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(place[2], out * (1 - e2 * n / (n + height)))
    return float(latitude), float(np.arctan2(place[1], place[0])), float(height)


def drawn_flight(stages: int, gaps: bool, rng: np.random.Generator) -> ForeignFlight:
    """Return a random flight with a number of stages, dark for 2 to 12 s between them if `gaps`."""
    while True:
        burn = rng.uniform(*{1: (45.0, 110.0), 2: (40.0, 85.0), 3: (40.0, 70.0)}[stages], stages)
        first = np.concatenate([rng.uniform(14.0, 28.0, 1), rng.uniform(12.0, 30.0, stages - 1)])
        growth = rng.uniform(1.8, 4.5, stages)
        gap = np.append(rng.uniform(2.0, 12.0, stages - 1) if gaps else np.zeros(stages - 1), 0.0)
        rise, kick = rng.uniform(4.0, 10.0), np.radians(rng.uniform(4.0, 24.0))
        place = np.arcsin(rng.uniform(-0.85, 0.85)), rng.uniform(-np.pi, np.pi)
        flight = _flown(burn, first, growth, gap, rise, kick, rng.uniform(0.0, 2.0 * np.pi), place)
        if flight is not None and 150.0 < flight.range_km < 12000.0:
            return flight


def _flown(burn, first, growth, gap, rise, kick, azimuth, launch) -> ForeignFlight | None:  # type: ignore[no-untyped-def]
    up = np.array(
        [np.cos(launch[0]) * np.cos(launch[1]), np.cos(launch[0]) * np.sin(launch[1]), np.sin(launch[0])]
    )
    east = np.array([-np.sin(launch[1]), np.cos(launch[1]), 0.0])
    ahead = np.sin(azimuth) * east + np.cos(azimuth) * np.cross(up, east)

    def pull(state: np.ndarray) -> np.ndarray:
        place, speed = state[:3], state[3:]
        central = -MU / np.linalg.norm(place) ** 3 * place
        return central - 2.0 * np.cross(AXIS, speed) - np.cross(AXIS, np.cross(AXIS, place))

    def rates(time, state, start, length, accel, ratio):  # type: ignore[no-untyped-def]
        size = accel / (1.0 - (1.0 - 1.0 / ratio) * min((time - start) / length, 1.0)) if accel else 0.0
        if time < rise:
            unit = up
        else:
            unit = state[3:] / np.linalg.norm(state[3:])
            if time < rise + PITCH_OVER_S:
                lead = kick * np.sin(np.pi * (time - rise) / PITCH_OVER_S) ** 2
                unit = np.cos(lead) * unit + np.sin(lead) * ahead
                unit /= np.linalg.norm(unit)
        return np.concatenate([state[3:], pull(state) + size * unit])

    legs, state, now, burns = [], np.concatenate([ecef(*launch), np.zeros(3)]), 0.0, []
    for length, accel, ratio, dark in zip(burn, first, growth, gap, strict=True):
        pieces = [(now, now + length, accel)] + ([(now + length, now + length + dark, 0.0)] if dark else [])
        burns.append((now, now + length))
        start = now
        for begin, end, size in pieces:
            edges = sorted({begin, end} | {edge for edge in (rise, rise + PITCH_OVER_S) if begin < edge < end})
            for one, two in zip(edges[:-1], edges[1:], strict=True):
                leg = solve_ivp(
                    rates, (one, two), state, "DOP853", rtol=1e-10, atol=1e-6, dense_output=True,
                    args=(start, length, size, ratio),
                )
                legs.append((one, two, bool(size), leg.sol))
                state, now = leg.y[:, -1], two
                if geodetic(state[:3])[2] < 0.0 and now > 5.0:
                    return None
    if np.linalg.norm(state[3:]) > 7300.0 or burns[-1][1] > 260.0:
        return None

    def landed(time, state, *_):  # type: ignore[no-untyped-def]
        return np.linalg.norm(state[:3]) - 6.36e6 - 0.5e3 if time < now + 20.0 else geodetic(state[:3])[2]

    landed.terminal, landed.direction = True, -1.0  # type: ignore[attr-defined]
    fall = solve_ivp(
        rates, (now, now + 6000.0), state, "DOP853", rtol=1e-10, atol=1e-6, dense_output=True, events=landed,
        args=(now, 1.0, 0.0, 1.0),
    )
    if not len(fall.t_events[0]):
        return None
    legs.append((now, float(fall.t_events[0][0]), False, fall.sol))
    latitude, longitude, _ = geodetic(fall.y_events[0][0][:3])
    one, two = ecef(*launch), ecef(latitude, longitude)
    angle = np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two)

    def at(time: float) -> np.ndarray:
        if time <= 0.0:
            return np.concatenate([ecef(*launch), np.zeros(3)])
        for begin, end, _, sol in legs:
            if begin <= time <= end:
                return np.asarray(sol(time))
        return np.full(6, np.nan)

    rows = []
    for begin, end, is_burning, sol in legs:
        end = min(end, now + 60.0)
        times = np.linspace(begin, end, int(np.ceil((end - begin) / STEP_S)) + 1)
        rows.append(np.column_stack([times, sol(times).T, np.full(len(times), is_burning)]))
    table = np.concatenate(rows)
    # A start exactly at rest has no direction.
    table[0, 4:7] = 1e-3 * up
    return ForeignFlight(
        table, tuple(burns), launch, (latitude, longitude, float(fall.t_events[0][0])), angle * 6371.0, at
    )
