"""Ascents of space launchers that share no code with opir: to orbit, short of it, and back to the
site, as tables.

Notional kinematics: thrust and mass flow of a stage are constant, so its acceleration grows; the
flight-path angle is a smooth curve from vertical to level whose shape is sought until the second
stage ends at the wanted height. A round, rotating Earth, no drag. First burns, gaps and second
stages are about what six webcast ascents show. After the last burn the table goes on for `DARK_S`,
in free flight.
"""

from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from foreign_flights import MU, RADIUS_M, SPIN, ecef, geodetic
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

STEP_S = 0.25
DARK_S = 45.0


@frozen(eq=False)
class Ascent:
    """Rows (n, 8) of time since ignition, ECEF state and burning; burns (k, 2), s; impact, rad,
    None if unknown.
    """

    rows: np.ndarray
    burns_s: tuple[tuple[float, float], ...]
    longitude_deg: float
    impact: tuple[float, float] | None = None

    def state(self, time_s: float) -> np.ndarray:
        """Return the ECEF state (6,) at a time since ignition, by the cubic through two rows and
        their velocities.
        """
        low = int(
            np.clip(
                np.searchsorted(self.rows[:, 0], time_s, side="right") - 1, 0, len(self.rows) - 2
            )
        )
        (begin, *before), (end, *after) = self.rows[low, :7], self.rows[low + 1, :7]
        ends = np.array([before, after])
        return np.asarray(
            np.concatenate(
                [
                    part(time_s)
                    for part in _cubic(begin, max(end, begin + 1e-6), ends[:, :3], ends[:, 3:])
                ]
            )
        )

    def write(self, path: Path) -> None:
        """Write the table as the target model `table` reads it."""
        head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
        form = ["%.6f"] + ["%.3f"] * 3 + ["%.5f"] * 3 + ["%d"]
        np.savetxt(path, self.rows, delimiter=",", header=head, comments="", fmt=form)


def _cubic(
    begin_s: float, end_s: float, place: np.ndarray, velocity: np.ndarray
) -> tuple[Any, Any]:
    spline = CubicHermiteSpline([begin_s, end_s], place, velocity)
    return spline, spline.derivative()


def drawn_near_orbit(rng: np.random.Generator) -> Ascent:
    """Return an ascent like that of 14 March 2024 (Starship IFT-3), which came down after half of
    an orbit.

    It was cut off at 7.36 km/s over ground and 150 km, climbing: its perigee was below the ground.
    """
    while True:
        found = drawn_ascent(rng, rng.uniform(0.99, 0.996), (150e3, np.radians(1.3)))
        if found.impact:
            return found


def drawn_ascent(
    rng: np.random.Generator, share: float = 1.0, cut_off: tuple[float, float] | None = None
) -> Ascent:
    """Return an ascent; `share` of the orbital speed is reached at the last cut-off, below 1 it
    comes down.

    `cut_off` are its height and flight-path angle, m and rad; without it, it is level at a random
    height.
    """
    while True:
        latitude = np.radians(rng.uniform(-35.0, 45.0))
        longitude = np.radians(rng.uniform(-180.0, 180.0))
        azimuth = np.radians(rng.uniform(40.0, 120.0))
        first_s = rng.uniform(130.0, 200.0)
        gap_s = rng.uniform(6.0, 16.0)
        lift = rng.uniform(11.5, 15.0)
        growth = rng.uniform(2.6, 3.6)
        upper = rng.uniform(6.5, 9.5)
        most = rng.uniform(3.5, 5.5)
        dip = rng.uniform(0.0, 0.35)
        end = (rng.uniform(150e3, 280e3), 0.0)
        bend = rng.uniform(0.55, 0.85)
        site = (latitude, longitude, azimuth)
        stages = (first_s, gap_s, lift, growth, dip, upper, most)
        found = _flown(site, stages, cut_off or end, bend, share)
        if found is not None:
            return found


def drawn_return(rng: np.random.Generator) -> Ascent:
    """Return a first stage that turns around after its cut-off and burns against its motion."""
    while True:
        ascent = drawn_ascent(rng)
        (_, cut_s), _ = ascent.burns_s
        begin_s = cut_s + rng.uniform(12.0, 25.0)
        end_s = begin_s + rng.uniform(30.0, 50.0)
        size = rng.uniform(14.0, 22.0)
        rows = ascent.rows[ascent.rows[:, 0] <= cut_s]
        rows = rows[: np.argmax(rows[:, 0] == cut_s) + 1].copy()
        rows[-1, 7] = 0.0
        place = rows[-1, 1:4]
        velocity = rows[-1, 4:7]
        level = velocity - place * (place @ velocity) / (place @ place)
        rows = _flown_on(rows, begin_s, np.zeros(3))
        rows = _flown_on(rows, end_s, -size * level / np.linalg.norm(level))
        rows = _flown_on(rows, end_s + DARK_S, np.zeros(3))
        return Ascent(
            rows, ((0.0, cut_s), (begin_s, end_s)), ascent.longitude_deg, fallen(rows[-1, 1:7])
        )


def _flown_on(rows: np.ndarray, until_s: float, force: np.ndarray) -> np.ndarray:
    """Return rows (n, 8), the last of which begins a leg, with those of the leg under a force,
    m/s².
    """
    state = rows[-1, 1:7]
    now = float(rows[-1, 0])
    leg = []
    while now < until_s - 1e-9:
        step = min(STEP_S, until_s - now)
        state = _rk4(state, step, force)
        now = now + step
        leg.append([now, *state, 0.0])
    leg = [[*rows[-1, :7], 0.0], *leg]
    burns = float(np.any(force != 0.0))
    every = np.array(leg)
    every[:-1, 7] = burns
    return np.concatenate([rows[:-1], every])


def fallen(state: np.ndarray) -> tuple[float, float] | None:
    """Return latitude and longitude, rad, of the impact of a free flight, None if it has none in
    two hours.
    """

    def height(_time_s: float, at: np.ndarray) -> float:
        return geodetic(at[:3])[2]

    height.terminal = True
    height.direction = -1.0  # type: ignore[attr-defined]
    exact: dict[str, Any] = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-4, "max_step": 60.0}
    fall = solve_ivp(
        lambda _, at: _rates(at, np.zeros(3)), (0.0, 7200.0), state, events=height, **exact
    )
    return geodetic(fall.y_events[0][0][:3])[:2] if len(fall.t_events[0]) else None


def turned(time_s: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the angles (n,), rad, by which something turns at rates (n,), rad/s, from the first
    time on.
    """
    steps = 0.5 * np.diff(time_s) * (rate[1:] + rate[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def _rates(at: np.ndarray, force: np.ndarray) -> np.ndarray:
    place = at[:3]
    velocity = at[3:]
    axis = np.array([0.0, 0.0, SPIN])
    pull = -MU * place / np.linalg.norm(place) ** 3
    turn = -2.0 * np.cross(axis, velocity) - np.cross(axis, np.cross(axis, place))
    return np.concatenate([velocity, pull + turn + force])


def _rk4(state: np.ndarray, step: float, force: np.ndarray) -> np.ndarray:
    one = _rates(state, force)
    two = _rates(state + 0.5 * step * one, force)
    three = _rates(state + 0.5 * step * two, force)
    four = _rates(state + step * three, force)
    return np.asarray(state + step / 6.0 * (one + 2.0 * two + 2.0 * three + four))


def _flown(
    site: Any, stages: Any, cut_off: tuple[float, float], bend: float, share: float
) -> Ascent | None:
    first_s, gap_s, lift, growth, dip, upper, most = stages
    height_m = cut_off[0]
    (latitude, longitude, azimuth) = site
    # What the rotation gives along the azimuth at this latitude.
    east = SPIN * RADIUS_M * np.cos(latitude) * np.sin(azimuth)

    def course(late_rad: float) -> tuple[np.ndarray, float]:
        return _course(
            first_s, gap_s, lift, growth, dip, upper, most, bend, late_rad, *cut_off, east, share
        )

    def miss(late_rad: float) -> float:
        return course(late_rad)[0][-1, 1] - height_m

    try:
        late_rad = brentq(miss, np.radians(2.0), np.radians(40.0), xtol=1e-5)
    except ValueError:
        return None
    rows, end_s = course(late_rad)
    burn_s = end_s - first_s - gap_s
    if not 200.0 < burn_s < 520.0:
        return None
    time_s, height, speed, angle = rows.T
    origin = ecef(latitude, longitude)
    radius = np.linalg.norm(origin)
    up0 = origin / radius
    east0 = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north0 = np.cross(up0, east0)
    ahead0 = np.sin(azimuth) * east0 + np.cos(azimuth) * north0
    ahead0 /= np.linalg.norm(ahead0)
    turn = turned(time_s, speed * np.cos(angle) / (radius + height))
    up = np.cos(turn)[:, None] * up0 + np.sin(turn)[:, None] * ahead0
    ahead = np.cos(turn)[:, None] * ahead0 - np.sin(turn)[:, None] * up0
    place = (radius + height)[:, None] * up
    velocity = speed[:, None] * (np.sin(angle)[:, None] * up + np.cos(angle)[:, None] * ahead)
    burning = (time_s < first_s) | ((time_s >= first_s + gap_s) & (time_s < end_s))
    table = np.column_stack([time_s, place, velocity, burning])
    table[0, 4:7] = 1e-3 * up0
    # Two rows at each edge, for the force jumps there.
    edges = [first_s, first_s + gap_s]
    for edge in edges:
        row = int(np.argmin(np.abs(table[:, 0] - edge)))
        before = table[row].copy()
        before[0] = table[row, 0]
        before[7] = table[row - 1, 7]
        table = np.insert(table, row, before, axis=0)
    table[-1, 7] = 0.0
    table = _flown_on(table, end_s + DARK_S, np.zeros(3))
    impact = fallen(table[-1, 1:7]) if share < 1.0 else None
    return Ascent(
        table, ((0.0, first_s), (first_s + gap_s, end_s)), float(np.degrees(longitude)), impact
    )


def _course(
    first_s: float, gap_s: float, lift: float, growth: float, dip: float, upper: float, most: float,
    bend: float, late_rad: float, height_m: float, last_rad: float, east: float, share: float,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Return rows (n, 4) of time, height, speed over ground and flight-path angle, and the
    cut-off.
    """
    rise_s = 12.0
    rows = []
    height = 0.0
    speed = 0.1
    now = 0.0
    end_s = np.inf
    goal = share * np.sqrt(MU / (RADIUS_M + height_m)) - east
    angle = 0.5 * np.pi
    cut_angle = late_rad
    while now < end_s - 1e-9 and now < 800.0:
        rows.append([now, height, speed, angle])
        step = min(
            STEP_S,
            first_s - now
            if now < first_s
            else first_s + gap_s - now
            if now < first_s + gap_s
            else STEP_S,
        )
        force = 0.0
        if now < first_s:
            force = lift / (1.0 - (1.0 - 1.0 / growth) * now / first_s)
            force *= 1.0 - dip * np.exp(-(((now - 62.0) / 10.0) ** 2))
        elif now >= first_s + gap_s - 1e-9:
            since = now - first_s - gap_s
            force = upper / max(1.0 - upper * since / 3200.0, 1.0 / most)
        pull = MU / (RADIUS_M + height) ** 2
        was_speed = speed
        was_angle = angle
        speed += step * (force - pull * np.sin(angle))
        now += step
        if now <= first_s:
            part = np.clip((now - rise_s) / (first_s - rise_s), 0.0, 1.0)
            angle = 0.5 * np.pi + (cut_angle - 0.5 * np.pi) * part**bend
        elif now <= first_s + gap_s:
            turn = (speed / (RADIUS_M + height) - pull / speed) * np.cos(angle)
            kept = angle
            angle = angle + step * turn
            start_speed = speed
            start_angle = kept
        else:
            part = np.clip((speed - start_speed) / (goal - start_speed), 0.0, 1.0)
            angle = last_rad + (start_angle - last_rad) * (1.0 - part) ** 1.2
        up = 0.5 * (was_speed * np.sin(was_angle) + speed * np.sin(angle))
        height += step * up
        if speed >= goal:
            end_s = now
    rows.append([now, height, speed, angle])
    return np.array(rows), now
