"""Ascents of space launchers that share no code with opir: to orbit, short of it, and back to the site, as tables.

Notional kinematics: thrust and mass flow of a stage are constant, so its acceleration grows; the flight-path angle is a
smooth curve from vertical to level whose shape is sought until the second stage ends at the wanted height. A round,
rotating Earth, no drag. First burns, gaps and second stages are about what six webcast ascents show.
"""

from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from foreign_flights import MU, RADIUS_M, SPIN, ecef
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

STEP_S = 0.25


@frozen(eq=False)
class Ascent:
    """Rows (n, 8) of time since ignition, ECEF state and burning; burns (k, 2), s; whether it stays in orbit."""

    rows: np.ndarray
    burns_s: tuple[tuple[float, float], ...]
    in_orbit: bool
    longitude_deg: float

    def state(self, time_s: float) -> np.ndarray:
        """Return the ECEF state (6,) at a time since ignition, by the cubic through two rows and their velocities."""
        low = int(np.clip(np.searchsorted(self.rows[:, 0], time_s, side="right") - 1, 0, len(self.rows) - 2))
        (begin, *before), (end, *after) = self.rows[low, :7], self.rows[low + 1, :7]
        ends = np.array([before, after])
        return np.asarray(
            np.concatenate([part(time_s) for part in _cubic(begin, max(end, begin + 1e-6), ends[:, :3], ends[:, 3:])])
        )

    def write(self, path: Path) -> None:
        """Write the table as the target model `table` reads it."""
        head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
        form = ["%.6f"] + ["%.3f"] * 3 + ["%.5f"] * 3 + ["%d"]
        np.savetxt(path, self.rows, delimiter=",", header=head, comments="", fmt=form)


def _cubic(begin_s: float, end_s: float, place: np.ndarray, velocity: np.ndarray) -> tuple[Any, Any]:
    spline = CubicHermiteSpline([begin_s, end_s], place, velocity)
    return spline, spline.derivative()


def drawn_ascent(rng: np.random.Generator, share: float = 1.0) -> Ascent:
    """Return an ascent; `share` of the orbital speed is reached at the last cut-off, below 1 it comes down."""
    while True:
        latitude, longitude = np.radians(rng.uniform(-35.0, 45.0)), np.radians(rng.uniform(-180.0, 180.0))
        azimuth = np.radians(rng.uniform(40.0, 120.0))
        first_s, gap_s = rng.uniform(130.0, 200.0), rng.uniform(6.0, 16.0)
        lift, growth = rng.uniform(11.5, 15.0), rng.uniform(2.6, 3.6)
        upper, most = rng.uniform(6.5, 9.5), rng.uniform(3.5, 5.5)
        dip = rng.uniform(0.0, 0.35)
        height_m, bend = rng.uniform(150e3, 280e3), rng.uniform(0.55, 0.85)
        found = _flown(
            (latitude, longitude, azimuth), (first_s, gap_s, lift, growth, dip, upper, most), height_m, bend, share
        )
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
        state, now, out = rows[-1, 1:7].copy(), cut_s, [rows]
        level = state[3:] - state[:3] * (state[:3] @ state[3:]) / (state[:3] @ state[:3])
        back = -level / np.linalg.norm(level)
        for until, force in ((begin_s, 0.0), (end_s, size), (end_s + 20.0, 0.0)):
            part = []
            while now < until - 1e-9:
                step = min(STEP_S, until - now)
                state, now = _rk4(state, step, force * back), now + step
                part.append([now, *state, 0.0])
            part[-1][7] = 0.0
            leg = np.array([[out[-1][-1, 0], *out[-1][-1, 1:7], float(force > 0.0)], *part])
            leg[:-1, 7] = float(force > 0.0)
            out.append(leg[1:] if np.array_equal(leg[0, 7:], out[-1][-1, 7:]) else leg)
        out[0] = out[0].copy()
        table = np.concatenate(out)
        return Ascent(table, ((0.0, cut_s), (begin_s, end_s)), False, ascent.longitude_deg)


def _rk4(state: np.ndarray, step: float, force: np.ndarray) -> np.ndarray:
    axis = np.array([0.0, 0.0, SPIN])

    def rates(at: np.ndarray) -> np.ndarray:
        place, velocity = at[:3], at[3:]
        pull = -MU * place / np.linalg.norm(place) ** 3
        turn = -2.0 * np.cross(axis, velocity) - np.cross(axis, np.cross(axis, place))
        return np.concatenate([velocity, pull + turn + force])

    one = rates(state)
    two = rates(state + 0.5 * step * one)
    three = rates(state + 0.5 * step * two)
    four = rates(state + step * three)
    return np.asarray(state + step / 6.0 * (one + 2.0 * two + 2.0 * three + four))


def _flown(site: Any, stages: Any, height_m: float, bend: float, share: float) -> Ascent | None:
    first_s, gap_s, lift, growth, dip, upper, most = stages
    latitude, longitude, azimuth = site
    # What the rotation gives along the azimuth at this latitude.
    east = SPIN * RADIUS_M * np.cos(latitude) * np.sin(azimuth)

    def course(late_rad: float) -> tuple[np.ndarray, float]:
        return _course(first_s, gap_s, lift, growth, dip, upper, most, bend, late_rad, height_m, east, share)

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
    time_s, height, speed, angle, along = rows.T
    origin = ecef(latitude, longitude)
    radius = np.linalg.norm(origin)
    up0 = origin / radius
    east0 = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north0 = np.cross(up0, east0)
    ahead0 = np.sin(azimuth) * east0 + np.cos(azimuth) * north0
    ahead0 /= np.linalg.norm(ahead0)
    turn = along / RADIUS_M
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
        before[0], before[7] = table[row, 0], table[row - 1, 7]
        table = np.insert(table, row, before, axis=0)
    return Ascent(table, ((0.0, first_s), (first_s + gap_s, end_s)), share >= 1.0, float(np.degrees(longitude)))


def _course(
    first_s: float, gap_s: float, lift: float, growth: float, dip: float, upper: float, most: float,
    bend: float, late_rad: float, height_m: float, east: float, share: float,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Return rows (n, 5) of time, height, speed over ground, flight-path angle and way over ground, and the cut-off."""
    rise_s, rows = 12.0, []
    height, along, speed, now, end_s = 0.0, 0.0, 0.1, 0.0, np.inf
    goal = share * np.sqrt(MU / (RADIUS_M + height_m)) - east
    angle, cut_angle = 0.5 * np.pi, late_rad
    while now < end_s - 1e-9 and now < 800.0:
        rows.append([now, height, speed, angle, along])
        step = min(
            STEP_S, first_s - now if now < first_s else first_s + gap_s - now if now < first_s + gap_s else STEP_S
        )
        force = 0.0
        if now < first_s:
            force = lift / (1.0 - (1.0 - 1.0 / growth) * now / first_s)
            force *= 1.0 - dip * np.exp(-(((now - 62.0) / 10.0) ** 2))
        elif now >= first_s + gap_s - 1e-9:
            since = now - first_s - gap_s
            force = upper / max(1.0 - upper * since / 3200.0, 1.0 / most)
        pull = MU / (RADIUS_M + height) ** 2
        was_speed, was_angle = speed, angle
        speed += step * (force - pull * np.sin(angle))
        now += step
        if now <= first_s:
            part = np.clip((now - rise_s) / (first_s - rise_s), 0.0, 1.0)
            angle = 0.5 * np.pi + (cut_angle - 0.5 * np.pi) * part**bend
        elif now <= first_s + gap_s:
            turn = (speed / (RADIUS_M + height) - pull / speed) * np.cos(angle)
            angle, kept = angle + step * turn, angle
            start_speed, start_angle = speed, kept
        else:
            part = np.clip((speed - start_speed) / (goal - start_speed), 0.0, 1.0)
            angle = start_angle * (1.0 - part) ** 1.2
        up = 0.5 * (was_speed * np.sin(was_angle) + speed * np.sin(angle))
        ahead = 0.5 * (was_speed * np.cos(was_angle) + speed * np.cos(angle))
        along += step * ahead * RADIUS_M / (RADIUS_M + height + 0.5 * step * up)
        height += step * up
        if speed >= goal:
            end_s = now
    rows.append([now, height, speed, angle, along])
    for _ in range(40):
        pull = MU / (RADIUS_M + height) ** 2
        along += STEP_S * speed * np.cos(angle) * RADIUS_M / (RADIUS_M + height)
        now += STEP_S
        rows.append([now, height, speed, angle, along])
    return np.array(rows), now - 40 * STEP_S
