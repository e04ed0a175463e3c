"""Drawn flights as tables, and what geostationary sensors see of them.

Kinematic and notional: speed, angle from the vertical and heading by share of the burn, integrated
over a sphere. Burn times, burnout speeds and turns are drawn about medians of the type; the course
between is smooth, staged or tabulated.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import LinesOfSight, tangent_axes

from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.flight.conic_impact import kepler_impact
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import (
    ecef_to_eci_state,
    ecef_to_geodetic,
    eci_to_ecef,
    eci_to_ecef_state,
    geodetic_to_ecef,
    local_axes,
)
from opir_core.interfaces.columns import Columns

GEO_M = 4.2164e7
SLOTS_RAD = (-0.4, 0.6)

#: Rows of a table, evenly over the burn.
ROWS = 2001

#: Radius of the sphere over which courses are integrated, m.
RADIUS_M = 6.371e6

#: Medians and sigmas of the logarithms of burn time, s, and burnout speed, m/s; mean and sigma of
#: the turn, degrees.
BURNS = {
    "SRBM": ((65.0, 0.2), (1600.0, 0.3), (48.0, 6.0)),
    "IRBM": ((118.0, 0.2), (4000.0, 0.25), (52.0, 6.0)),
    "ICBM": ((206.0, 0.2), (6800.0, 0.06), (64.0, 5.0)),
}

#: Of smooth courses: k of a speed like expm1(k share), exponent of the turn; of all: share of the
#: vertical rise.
SMOOTH = {"SRBM": (0.95, 0.85, 0.09), "IRBM": (1.45, 0.55, 0.068), "ICBM": (1.8, 0.525, 0.048)}

#: Shares of the burns of stages, of the speed they add, and how much the acceleration grows within
#: one.
STAGES = {"SRBM": (2, (0.45, 0.55)), "IRBM": (2, (0.4, 0.6)), "ICBM": (3, (0.27, 0.35, 0.38))}
EVENNESS = 60.0
GROWTH = (2.0, 3.5)

#: Between stages nothing burns for this long, s.
GAP_S = (0.5, 1.5)


@frozen(eq=False)
class Flown(Columns):
    """Flights by table: starts and burns (n,), s, ECEF positions and velocities (n, 2001, 3), dark
    spells (n, 2, 2).

    A spell is two shares of the burn between which nothing is seen.
    """

    start_s: np.ndarray
    burn_s: np.ndarray
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    dark: np.ndarray

    @property
    def burnout_s(self):
        """Return the scene times (n,) at which the burns end."""
        return self.start_s + self.burn_s

    def at(self, row, time_s):
        """Return ECEF positions and velocities (m, 3) on the burn, by cubic Hermite arcs; held at
        both ends.
        """
        place = np.clip((time_s - self.start_s[row]) / self.burn_s[row], 0.0, 1.0) * (ROWS - 1)
        low = np.minimum(place.astype(np.int64), ROWS - 2)
        s = (place - low)[:, None]
        step = (self.burn_s[row] / (ROWS - 1))[:, None]
        p = self.position_m[row, low]
        q = self.position_m[row, low + 1]
        u = self.velocity_m_s[row, low]
        v = self.velocity_m_s[row, low + 1]
        there = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * p + s**2 * (3.0 - 2.0 * s) * q
        there += step * (s * (1.0 - s) ** 2 * u - s**2 * (1.0 - s) * v)
        return there, (1.0 - s) * u + s * v

    def is_lit(self, row, time_s):
        """Return which flights burn at times (m,)."""
        share = ((time_s - self.start_s[row]) / self.burn_s[row])[:, None]
        return (share[:, 0] > 0.0) & (share[:, 0] < 1.0) & ~np.any(
            (share > self.dark[row, :, 0]) & (share < self.dark[row, :, 1]), axis=1
        )  # fmt: skip

    def burnouts(self):
        """Return inertial positions and velocities (n, 3) and times (n,) of the ends of burns."""
        inertial = ecef_to_eci_state(
            self.position_m[:, -1], self.velocity_m_s[:, -1], self.burnout_s
        )
        return *inertial, self.burnout_s

    def states(self, tick_s, forces="kepler"):
        """Return ECEF states (n, 6) at a tick: on the burn, or in free flight after it."""
        row = np.arange(len(self))
        state = np.concatenate(self.at(row, np.full(len(row), tick_s)), axis=1)
        after_burnout = np.flatnonzero(self.burnout_s < tick_s)
        position, velocity, end_s = (burnout[after_burnout] for burnout in self.burnouts())
        if len(after_burnout):
            flown = _flown(position, velocity, tick_s - end_s, forces)
            state[after_burnout] = np.concatenate(
                eci_to_ecef_state(*flown, np.full(len(after_burnout), tick_s)), axis=1
            )
        return state

    def impacts(self, forces="kepler"):
        """Return impacts (n, 3): latitude and longitude, rad, and time, s; nan of flights that do
        not come down.
        """
        position, velocity, end_s = self.burnouts()
        if forces == "kepler":
            duration_s, point_m = kepler_impact(position, velocity)
        else:
            from opir_core.flight.propagation import impact

            duration_s, point_m = impact(position, velocity, 0.0, forces)
        when = end_s + duration_s
        place = ecef_to_geodetic(eci_to_ecef(point_m, when))
        return np.stack([place.latitude_rad, place.longitude_rad, when], axis=1)


def _flown(position, velocity, span_s, forces):
    if forces == "kepler":
        return propagate_kepler(position, velocity, span_s)
    from opir_core.flight.propagation import propagate

    return propagate(position, velocity, span_s, forces)


class Course(NamedTuple):
    """Speed over that at burnout, angle from the vertical and turn of the heading, rad, (n, 2001),
    and dark spells.
    """

    pace: np.ndarray
    lean_rad: np.ndarray
    swerve_rad: np.ndarray
    dark: np.ndarray


class Drawn(NamedTuple):
    """What flights (n,) have whatever their course: starts and burns, s, burnout speed and turn,
    and axes at launch.
    """

    start_s: np.ndarray
    burn_s: np.ndarray
    speed_m_s: np.ndarray
    turn_rad: np.ndarray
    lift: np.ndarray
    launch_m: np.ndarray
    up: np.ndarray
    heading: np.ndarray
    right: np.ndarray


def flown(kind, count, seed, course):
    """Return flights of a type far from each other; `course` is "smooth", "staged" or
    "tabulated".
    """
    drawn = _drawn(kind, count, seed)
    share = np.linspace(0.0, 1.0, ROWS)
    way = {"smooth": _smooth, "staged": _staged, "tabulated": _tabulated}[course]
    path = way(kind, drawn, share, np.random.default_rng(7000 + seed))
    return Flown(drawn.start_s, drawn.burn_s, *_integrated(drawn, path), path.dark)


def _drawn(kind, count, seed):
    """Return flights from a jittered grid over what both sensors see, hundreds of kilometres
    apart.
    """
    rng = np.random.default_rng(3000 + seed)
    (burn, speed, turn) = BURNS[kind]
    columns = int(np.ceil(np.sqrt(0.6 * count)))
    rows = int(np.ceil(count / columns))
    cell = np.arange(count)
    jitter = rng.uniform(-0.25, 0.25, (2, count))
    latitude = -0.85 + 1.7 * ((cell // columns + 0.5 + jitter[0]) / rows)
    longitude = -0.35 + 0.9 * ((cell % columns + 0.5 + jitter[1]) / columns)
    launch = geodetic_to_ecef(latitude, longitude, 0.0)
    axes = local_axes(launch)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, count)[:, None]
    heading = np.sin(azimuth) * axes[:, 0] + np.cos(azimuth) * axes[:, 1]
    return Drawn(
        start_s=rng.uniform(3.0, 6.0, count),
        burn_s=burn[0] * np.exp(burn[1] * rng.normal(size=count)),
        speed_m_s=speed[0] * np.exp(speed[1] * rng.normal(size=count)),
        turn_rad=np.radians(turn[0] + turn[1] * rng.normal(size=count)),
        lift=np.full(count, SMOOTH[kind][2]),
        launch_m=launch,
        up=axes[:, 2],
        heading=heading,
        right=np.cross(heading, axes[:, 2]),
    )


def _smooth(kind, drawn, share, rng):
    """Return courses without stages, whose acceleration grows and whose turn slows."""
    count = len(drawn.start_s)
    (growth, exponent, _) = SMOOTH[kind]
    growth = growth * np.exp(0.2 * rng.normal(size=(count, 1)))
    u = _since_lift(drawn, share)
    lean = drawn.turn_rad[:, None] * u ** (exponent * np.exp(0.15 * rng.normal(size=(count, 1))))
    pace = np.expm1(growth * share) / np.expm1(growth)
    return Course(pace, lean, np.zeros_like(pace), np.ones((count, 2, 2)))


def _since_lift(drawn, share):
    return np.maximum((share - drawn.lift[:, None]) / (1.0 - drawn.lift[:, None]), 0.0)


def _staged(kind, drawn, share, rng):
    """Return courses of stages with a short gap between them, whose acceleration grows within
    each.
    """
    count = len(drawn.start_s)
    (stages, gains) = STAGES[kind]
    burns = rng.dirichlet(EVENNESS * np.ones(stages) / stages, count)
    gains = rng.dirichlet(EVENNESS * np.array(gains), count)
    ends = np.concatenate([np.zeros((count, 1)), np.cumsum(burns, axis=1)], axis=1)
    gap = rng.uniform(*GAP_S, (count, stages)) / drawn.burn_s[:, None]
    growth = rng.uniform(*GROWTH, (count, stages))
    pace = np.zeros((count, len(share)))
    dark = np.ones((count, 2, 2))
    for stage in range(stages):
        start = ends[:, stage] + (gap[:, stage] if stage else 0.0)
        if stage:
            dark[:, stage - 1, 0] = ends[:, stage]
            dark[:, stage - 1, 1] = start
        s = np.clip((share - start[:, None]) / (ends[:, stage + 1] - start)[:, None], 0.0, 1.0)
        rate = growth[:, stage, None] - 1.0
        # Acceleration goes like 1 / (1 - m s) with the mass that is left: the speed like its
        # integral.
        mass = rate / (1.0 + rate)
        pace += gains[:, stage, None] * np.log1p(-mass * s) / np.log1p(-mass)
    bend = rng.uniform(0.5, 2.5, (count, 1))
    u = _since_lift(drawn, share)
    lean = drawn.turn_rad[:, None] * np.expm1(-bend * u) / np.expm1(-bend)
    return Course(pace, lean, np.zeros_like(pace), dark)


def _tabulated(kind, drawn, share, rng):
    """Return courses that no formula comes near: thrust that sags, a turn that overshoots, a
    swerve.
    """
    count = len(drawn.start_s)
    sag = rng.uniform(0.1, 0.25, (count, 1))
    pace = share**1.3 + sag * np.sin(2.0 * np.pi * share) * share / (2.0 * np.pi)
    u = _since_lift(drawn, share)
    over = rng.uniform(0.05, 0.15, (count, 1))
    lean = drawn.turn_rad[:, None] * (np.sin(0.5 * np.pi * u**0.8) + over * np.sin(np.pi * u) ** 2)
    swerve = np.radians(rng.normal(scale=6.0, size=(count, 1))) * 0.5 * (1.0 - np.cos(np.pi * u))
    return Course(pace / pace[:, -1:], lean, swerve, np.ones((count, 2, 2)))


def _integrated(drawn, course):
    """Return ECEF positions and velocities (n, rows, 3) of courses."""
    step = (drawn.burn_s / (ROWS - 1))[:, None]
    speed = drawn.speed_m_s[:, None] * course.pace
    level = speed * np.sin(course.lean_rad)
    height = _summed(speed * np.cos(course.lean_rad), step)
    swept = _summed(level * np.cos(course.swerve_rad) / (RADIUS_M + height), step)
    aside = _summed(level * np.sin(course.swerve_rad), step)
    up, heading, right = (axis[:, None] for axis in (drawn.up, drawn.heading, drawn.right))
    sine = np.sin(swept)[..., None]
    cosine = np.cos(swept)[..., None]
    outward = cosine * up + sine * heading
    onward = cosine * heading - sine * up
    place = drawn.launch_m[:, None] - RADIUS_M * up
    position = place + (RADIUS_M + height)[..., None] * outward + aside[..., None] * right
    velocity = (speed * np.cos(course.lean_rad))[..., None] * outward
    velocity = velocity + level[..., None] * (
        np.cos(course.swerve_rad)[..., None] * onward + np.sin(course.swerve_rad)[..., None] * right
    )
    return position, velocity


def _summed(rate, step):
    total = np.zeros_like(rate)
    np.cumsum(0.5 * (rate[:, 1:] + rate[:, :-1]) * step, axis=1, out=total[:, 1:])
    return total


class Seeing(NamedTuple):
    """How like sensors see: scan period, s, error, rad, chance of a detection, bias, rad, and what
    goes wrong.

    `outliers` is the share of lines of sight that point elsewhere: evenly within `astray_rad` of
    the target, or of the Earth's middle where `everywhere`. The second sensor sees nothing after
    the share `dies` of a burn.
    """

    period_s: float
    sigma_rad: float
    chance: float
    bias_rad: float = 0.0
    outliers: float = 0.0
    astray_rad: float = 0.0
    everywhere: bool = False
    dies: float = 2.0


def _sights(truth, seeing, origin, end_s, rng):
    """Return the flights, times and lines of a sensor's detections: those of flights that burn when
    their light leaves, before `end_s` of each flight.
    """
    looks = seeing.period_s * np.arange(1, int(truth.burnout_s.max() / seeing.period_s) + 4)
    flight, look = np.nonzero(rng.random((len(truth), len(looks))) < seeing.chance)
    time_s = looks[look]
    left_s = time_s - 0.125
    for _ in range(3):
        line = truth.at(flight, left_s)[0] - origin
        left_s = time_s - np.linalg.norm(line, axis=1) / SPEED_OF_LIGHT_M_S
    lit = truth.is_lit(flight, left_s) & (left_s < end_s[flight])
    return flight[lit], time_s[lit], line[lit]


def _strays(flight, count, seeing, rng):
    """Return the errors (n, 2) of lines of sight, rad, and which of them are outliers."""
    bias = seeing.bias_rad * rng.normal(size=(count, 2))
    stray = bias[flight] + seeing.sigma_rad * rng.normal(size=(len(flight), 2))
    wrong = rng.random(len(flight)) < seeing.outliers
    angle_rad = seeing.astray_rad * np.sqrt(rng.random(len(flight)))
    turn = rng.uniform(0.0, 2.0 * np.pi, len(flight))
    elsewhere = angle_rad[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.where(wrong[:, None], elsewhere, stray), wrong


def seen(truth, seeing, seed, sensors=2):
    """Return flights and rays, by time; whose outliers they are tells -1."""
    rng = np.random.default_rng(1000 + seed)
    parts = []
    owners = []
    for sensor, slot in enumerate(SLOTS_RAD[:sensors]):
        origin = GEO_M * np.array([np.cos(slot), np.sin(slot), 0.0])
        end_s = truth.start_s + truth.burn_s * (seeing.dies if sensor else 1.0)
        flight, time_s, line = _sights(truth, seeing, origin, end_s, rng)
        stray, wrong = _strays(flight, len(truth), seeing, rng)
        if seeing.everywhere:
            line = np.where(wrong[:, None], -origin, line)
        direction = line / np.linalg.norm(line, axis=1)[:, None]
        axes = tangent_axes(direction)
        turned = direction + stray[:, :1] * axes[:, 0] + stray[:, 1:] * axes[:, 1]
        rays = LinesOfSight(
            time_s,
            np.full(len(flight), sensor, dtype=np.int32),
            np.round(time_s / seeing.period_s).astype(np.int64),
            np.tile(origin, (len(flight), 1)),
            turned / np.linalg.norm(turned, axis=1)[:, None],
            np.full(len(flight), seeing.sigma_rad),
        )
        parts.append(rays)
        owners.append(np.where(wrong, -1, flight))
    every = LinesOfSight.concatenate(parts)
    owner = np.concatenate(owners)
    order = np.lexsort((owner, every.sensor, every.time_s))
    return owner[order], every.take(order)
