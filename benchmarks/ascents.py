"""Ascents of space launchers that share no code with opir: to orbit, short of it, and back to the
site, as tables.

Notional kinematics: thrust and mass flow of a stage are constant, so its acceleration grows; the
flight-path angle is a smooth curve from vertical to level whose shape is sought until the second
stage ends at the wanted height. A round, rotating Earth, no drag. First burns, gaps and second
stages are about those of six webcast ascents. After the last burn the table goes on for `DARK_S`,
in free flight.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from foreign_flights import MU, RADIUS_M, SPIN, directions, ecef, free_rates, geodetic
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

STEP_S = 0.25
DARK_S = 45.0
RISE_S = 12.0


@frozen(eq=False)
class Ascent:
    """Rows (n, 8) of time since ignition, ECEF state and burning; burns (k, 2), s; impact, rad,
    None if unknown.
    """

    rows: np.ndarray
    burns_s: tuple[tuple[float, float], ...]
    longitude_deg: float
    impact: tuple[float, float] | None = None

    def state(self, time_s):
        """Return the ECEF state (6,) at a time since ignition, by the cubic through two rows and
        their velocities.
        """
        times = self.rows[:, 0]
        row = np.searchsorted(times, time_s, side="right") - 1
        rows = self.rows[int(np.clip(row, 0, len(times) - 2)) :][:2]
        spline = CubicHermiteSpline(
            [rows[0, 0], max(rows[1, 0], rows[0, 0] + 1e-6)], rows[:, 1:4], rows[:, 4:7]
        )
        return np.concatenate([spline(time_s), spline(time_s, 1)])


class Launcher(NamedTuple):
    """Parameters of an ascent: site (rad) and azimuth; first burn and gap, s; lift-off
    acceleration, m/s², its growth and dip; acceleration of the upper stage and the highest, m/s²;
    bend of the path; at cut-off height, m, flight-path angle, rad, and share of the orbital speed.
    """

    site: tuple[float, float]
    azimuth: float
    first_s: float
    gap_s: float
    lift: float
    growth: float
    upper: float
    highest: float
    dip: float
    height_m: float
    cut_off_rad: float
    bend: float
    share: float

    @property
    def second_s(self):
        """The ignition of the second stage, s."""
        return self.first_s + self.gap_s

    def acceleration(self, time_s):
        """Return the thrust over mass."""
        if time_s < self.first_s:
            dip = 1.0 - self.dip * np.exp(-(((time_s - 62.0) / 10.0) ** 2))
            return self.lift / (1.0 - (1.0 - 1.0 / self.growth) * time_s / self.first_s) * dip
        if time_s < self.second_s - 1e-9:
            return 0.0
        burnt = self.upper * (time_s - self.second_s) / 3200.0
        return self.upper / max(1.0 - burnt, 1.0 / self.highest)


def drawn_near_orbit(rng):
    """Return an ascent like that of 14 March 2024 (Starship IFT-3), which came down after half of
    an orbit.

    It was cut off at 7.36 km/s over ground and 150 km, climbing: its perigee was below the ground.
    """
    while True:
        ascent = drawn_ascent(rng, rng.uniform(0.99, 0.996), (150e3, np.radians(1.3)))
        if ascent.impact:
            return ascent


def drawn_ascent(rng, share=1.0, cut_off=None):
    """Return an ascent; `share` of the orbital speed is reached at the last cut-off, below 1 it
    comes down.

    `cut_off` are its height and flight-path angle, m and rad; without it, it is level at a random
    height.
    """
    while True:
        launcher = Launcher(
            site=(np.radians(rng.uniform(-35.0, 45.0)), np.radians(rng.uniform(-180.0, 180.0))),
            azimuth=np.radians(rng.uniform(40.0, 120.0)),
            first_s=rng.uniform(130.0, 200.0),
            gap_s=rng.uniform(6.0, 16.0),
            lift=rng.uniform(11.5, 15.0),
            growth=rng.uniform(2.6, 3.6),
            upper=rng.uniform(6.5, 9.5),
            highest=rng.uniform(3.5, 5.5),
            dip=rng.uniform(0.0, 0.35),
            height_m=rng.uniform(150e3, 280e3),
            cut_off_rad=0.0,
            bend=rng.uniform(0.55, 0.85),
            share=share,
        )
        if cut_off:
            launcher = launcher._replace(height_m=cut_off[0], cut_off_rad=cut_off[1])
        ascent = flown(launcher)
        if ascent is not None:
            return ascent


def drawn_return(rng):
    """Return a first stage that turns around after its cut-off and burns against its motion."""
    ascent = drawn_ascent(rng)
    (_, cut_s), _ = ascent.burns_s
    begin_s = cut_s + rng.uniform(12.0, 25.0)
    end_s = begin_s + rng.uniform(30.0, 50.0)
    size = rng.uniform(14.0, 22.0)
    rows = ascent.rows[: np.argmax(ascent.rows[:, 0] == cut_s) + 1]
    place = rows[-1, 1:4]
    velocity = rows[-1, 4:7]
    level = velocity - place * (place @ velocity) / (place @ place)
    rows = extended(rows, begin_s, np.zeros(3))
    rows = extended(rows, end_s, -size * level / np.linalg.norm(level))
    rows = extended(rows, end_s + DARK_S, np.zeros(3))
    burns = ((0.0, cut_s), (begin_s, end_s))
    return Ascent(rows, burns, ascent.longitude_deg, impact_of(rows[-1, 1:7]))


def extended(rows, until_s, force):
    """Return rows (n, 8), the last of which begins a leg, with those of the leg under a force."""
    start_s = rows[-1, 0]
    times = np.append(np.arange(start_s, until_s - 1e-9, STEP_S), until_s)
    span = (start_s, until_s)
    settings = {"t_eval": times, "method": "DOP853", "rtol": 1e-10, "atol": 1e-5}
    change = np.append(np.zeros(3), force)
    leg = solve_ivp(lambda _, state: free_rates(state) + change, span, rows[-1, 1:7], **settings)
    is_burning = np.full(len(times), float(np.any(force != 0.0)))
    is_burning[-1] = 0.0
    return np.concatenate([rows[:-1], np.column_stack([times, leg.y.T, is_burning])])


def impact_of(state):
    """Return latitude and longitude, rad, of the impact of a free flight, None if it has none in
    two hours.
    """

    def height(_time_s, place):
        return geodetic(place[:3])[2]

    height.terminal = True
    height.direction = -1.0
    exact = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-4, "max_step": 60.0}
    fall = solve_ivp(lambda _, at: free_rates(at), (0.0, 7200.0), state, events=height, **exact)
    return geodetic(fall.y_events[0][0][:3])[:2] if len(fall.t_events[0]) else None


def turned(time_s, rate):
    """Return the angles (n,), rad, of a turn at rates (n,), rad/s, from the first time on."""
    steps = 0.5 * np.diff(time_s) * (rate[1:] + rate[:-1])
    return np.append(0.0, np.cumsum(steps))


def with_edges(rows, edges):
    """Return rows (n, 8) with two rows at each edge, for the force jumps there."""
    for edge in edges.tolist():
        row = int(np.argmin(np.abs(rows[:, 0] - edge)))
        edge_row = rows[row].copy()
        edge_row[7] = rows[row - 1, 7]
        rows = np.insert(rows, row, edge_row, axis=0)
    return rows


def flown(launcher):
    """Return the ascent of a launcher, None if it does not reach its height or burns too long."""

    def miss_m(late_rad):
        return float(course(launcher, late_rad)[-1, 1] - launcher.height_m)

    try:
        late_rad = brentq(miss_m, np.radians(2.0), np.radians(40.0), xtol=1e-5)
    except ValueError:
        return None
    rows = course(launcher, late_rad)
    end_s = float(rows[-1, 0])
    if not 200.0 < end_s - launcher.second_s < 520.0:
        return None
    burns_s = ((0.0, launcher.first_s), (launcher.second_s, end_s))
    table = over_ground(rows, launcher)
    time_s = table[:, 0]
    for begin_s, cut_s in burns_s:
        table[(time_s >= begin_s) & (time_s < cut_s), 7] = 1.0
    table = with_edges(table, np.array([launcher.first_s, launcher.second_s]))
    table = extended(table, end_s + DARK_S, np.zeros(3))
    impact = impact_of(table[-1, 1:7]) if launcher.share < 1.0 else None
    return Ascent(table, burns_s, float(np.degrees(launcher.site[1])), impact)


def over_ground(rows, launcher):
    """Return rows (n, 8) of a course (n, 4) along a great circle, dark."""
    time_s, height, speed, angle = rows.T
    radius = np.linalg.norm(ecef(*launcher.site))
    up, along = directions(launcher.site, launcher.azimuth)
    turn = turned(time_s, speed * np.cos(angle) / (radius + height))[:, None]
    outward = np.cos(turn) * up + np.sin(turn) * along
    onward = np.cos(turn) * along - np.sin(turn) * up
    place = (radius + height)[:, None] * outward
    climb = (speed * np.sin(angle))[:, None]
    velocity = climb * outward + (speed * np.cos(angle))[:, None] * onward
    table = np.column_stack([time_s, place, velocity, np.zeros(len(rows))])
    table[0, 4:7] = 1e-3 * up
    return table


def course(launcher, late_rad):
    """Return rows (n, 4) of time, height, speed over ground and flight-path angle to the cut-off;
    `late_rad` is the angle at the first cut-off.
    """
    latitude, _ = launcher.site
    # The Earth turns along the azimuth at this latitude.
    east = SPIN * RADIUS_M * np.cos(latitude) * np.sin(launcher.azimuth)
    goal = launcher.share * np.sqrt(MU / (RADIUS_M + launcher.height_m)) - east
    edges = (launcher.first_s, launcher.second_s)
    time_s = height = 0.0
    speed = 0.1
    angle = 0.5 * np.pi
    rows = [[time_s, height, speed, angle]]
    staged = (speed, angle)
    while speed < goal and time_s < 800.0:
        step_s = min([STEP_S, *(edge - time_s for edge in edges if edge > time_s)])
        pull = MU / (RADIUS_M + height) ** 2
        climb = speed * np.sin(angle)
        speed += step_s * (launcher.acceleration(time_s) - pull * np.sin(angle))
        time_s += step_s
        if time_s <= launcher.first_s:
            share = max((time_s - RISE_S) / (launcher.first_s - RISE_S), 0.0)
            angle = 0.5 * np.pi + (late_rad - 0.5 * np.pi) * share**launcher.bend
        elif time_s <= launcher.second_s:
            staged = (speed, angle)
            angle += step_s * (speed / (RADIUS_M + height) - pull / speed) * np.cos(angle)
        else:
            share = np.clip((speed - staged[0]) / (goal - staged[0]), 0.0, 1.0)
            end_rad = launcher.cut_off_rad
            angle = end_rad + (staged[1] - end_rad) * (1.0 - share) ** 1.2
        height += 0.5 * step_s * (climb + speed * np.sin(angle))
        rows.append([time_s, height, speed, angle])
    return np.array(rows)
