"""Boosts that end low and level, and the glides after them, that share no code with opir, as
tables.

Notional kinematics of a point mass: one or two burns whose flight-path angle is a smooth curve from
vertical to level, whose shape is sought until the last ends at the wanted height; then lift
balances weight less centrifugal force at a constant ratio of lift to drag, in air whose density
falls exponentially, on a course of constant curvature; below the final speed it falls. A round,
rotating Earth; speeds are those over the ground.
"""

from typing import NamedTuple

import numpy as np
from ascents import DARK_S, STEP_S, Ascent, turned, with_edges
from foreign_flights import MU, RADIUS_M, directions, ecef, geodetic
from scipy.optimize import brentq

SCALE_M = 7000.0
#: Thrust is no farther than this from the velocity, but for the first `SLOW_S`.
FARTHEST_RAD = np.radians(20.0)
SLOW_S = 15.0


class Glide(NamedTuple):
    """Parameters of a glide: ratio of lift to drag, final speed, m/s, and curvature, rad/m."""

    ratio: float
    final_m_s: float
    curve: float


def drawn_glide(rng):
    """Return a boost and the first `DARK_S` of its glide, with the place where it comes down."""
    while True:
        stages = int(rng.integers(1, 3))
        burn_s = rng.uniform(55.0, 110.0, stages) / (1.0, 1.4)[stages - 1]
        first = rng.uniform(17.0, 28.0, stages)
        growth = rng.uniform(1.8, 3.5, stages)
        gap_s = float(rng.uniform(1.0, 8.0)) if stages == 2 else 0.0
        height_m = rng.uniform(42e3, 80e3)
        level_rad = np.radians(rng.uniform(-1.0, 3.0))
        ratio = rng.uniform(1.6, 3.6)
        final_m_s = rng.uniform(700.0, 1800.0)
        place = float(np.arcsin(rng.uniform(-0.8, 0.8))), float(rng.uniform(-np.pi, np.pi))
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        glide = Glide(ratio, final_m_s, np.radians(rng.normal(0.0, 8.0)) / 4e6)
        edges = np.cumsum([0.0, *np.insert(burn_s, 1, gap_s)[: 2 * stages - 1].tolist()])
        course = Course(edges, first, growth, height_m, level_rad)
        try:
            bend = brentq(course.miss_m, 1.0, 9.0, xtol=1e-4)
        except ValueError:
            continue
        rows = course.rows(bend)
        if 2300.0 < rows[-1, 2] < 6800.0 and lead_rad(rows) < FARTHEST_RAD:
            return flight_of(rows, glide, edges, place, azimuth)


class Course(NamedTuple):
    """A boost over a round Earth: edges of its burns and gaps, s, first accelerations and their
    growth, and its end.
    """

    edges: np.ndarray
    first: np.ndarray
    growth: np.ndarray
    height_m: float
    level_rad: float

    def miss_m(self, bend):
        """Return the height of the end above the wanted one."""
        return float(self.rows(bend)[-1, 1] - self.height_m)

    def rows(self, bend):
        """Return rows (n, 4) of time, height, speed and flight-path angle."""
        time_s = height = 0.0
        speed = 0.1
        angle = 0.5 * np.pi
        rows = [[time_s, height, speed, angle]]
        end_s = self.edges[-1]
        for leg, (begin, end) in enumerate(zip(self.edges[:-1], self.edges[1:], strict=True)):
            while time_s < end - 1e-9:
                step_s = min(STEP_S, end - time_s)
                force = self.force(leg, (time_s - begin) / (end - begin))
                climb = speed * np.sin(angle)
                speed += step_s * (force - MU / (RADIUS_M + height) ** 2 * np.sin(angle))
                time_s += step_s
                share = np.clip((time_s - 5.0) / (end_s - 5.0), 0.0, 1.0)
                angle = self.level_rad + (0.5 * np.pi - self.level_rad) * (1.0 - share) ** bend
                height += 0.5 * step_s * (climb + speed * np.sin(angle))
                rows.append([time_s, height, speed, angle])
        return np.array(rows)

    def force(self, leg, share):
        """Return the specific force, m/s², at a share of a leg; every second leg is dark."""
        if leg % 2:
            return 0.0
        growth = self.growth[leg // 2]
        return float(self.first[leg // 2] / (1.0 - (1.0 - 1.0 / growth) * share))


def lead_rad(rows):
    """Return the largest angle between thrust and velocity, from `SLOW_S` on, that bends the path
    of a boost.
    """
    time_s, height, speed, angle = rows[rows[:, 0] > SLOW_S].T
    pull = MU / (RADIUS_M + height) ** 2 - speed**2 / (RADIUS_M + height)
    side = speed * np.gradient(angle, time_s) + pull * np.cos(angle)
    along = np.gradient(speed, time_s) + pull * np.sin(angle)
    return float(np.max(np.abs(np.arctan2(side, along))[along > 5.0]))


def glide_rows(boost_end, glide):
    """Return rows (n, 4) of a glide from the end of a boost, and of its end on the ground."""
    time_s, height, speed, angle = boost_end.tolist()
    top_m = height
    rows = []
    density = (MU / (RADIUS_M + height) ** 2 - speed**2 / (RADIUS_M + height)) / speed**2
    # The angle with which it begins dies away.
    decay = np.exp(-STEP_S / 10.0)
    while speed > glide.final_m_s and time_s < 4000.0:
        pull = MU / (RADIUS_M + height) ** 2
        lift = max(pull - speed**2 / (RADIUS_M + height), 0.05)
        balance_m = top_m - SCALE_M * np.log(lift / speed**2 / density)
        climb = speed * np.sin(angle) * decay + (balance_m - height) * (1.0 - decay) / 10.0
        speed -= STEP_S * (lift / glide.ratio + pull * np.sin(angle))
        angle = float(np.arcsin(np.clip(climb / speed, -0.5, 0.5)))
        height += STEP_S * climb
        time_s += STEP_S
        rows.append([time_s, height, speed, angle])
    # It falls three times as far as it is high.
    begin_s = time_s + STEP_S
    fall = [[begin_s, height, 300.0, 0.0], [begin_s + 0.01 * height, 0.0, 300.0, 0.0]]
    return np.array([*rows, *fall])


def course_axes(up, along, turn, bend):
    """Return the directions up and along (n + 1, 3) of a course from the first ones, after turns
    (n,) over the Earth and bends (n,) to the left, rad.
    """
    rows = [(up, along)]
    for arc, aside in zip(turn.tolist(), bend.tolist(), strict=True):
        onward = np.cos(arc) * along - np.sin(arc) * up
        up = np.cos(arc) * up + np.sin(arc) * along
        along = np.cos(aside) * onward + np.sin(aside) * np.cross(up, onward)
        rows.append((up, along))
    return np.array(rows).transpose(1, 0, 2)


def flight_of(boost, glide, edges, place, azimuth):
    """Return the flight of rows along a course from a place, curved after the boost."""
    first_up, first_along = directions(place, azimuth)
    radius = float(np.linalg.norm(ecef(*place)))
    rows = np.concatenate([boost, glide_rows(boost[-1], glide)])
    time_s, height, speed, angle = rows.T
    turn = np.diff(turned(time_s, speed * np.cos(angle) / (radius + height)))
    is_glide = np.arange(len(turn)) >= len(boost) - 1
    bend = np.where(is_glide, glide.curve * RADIUS_M * turn, 0.0)
    up, along = course_axes(first_up, first_along, turn, bend)
    climb = (speed * np.sin(angle))[:, None]
    velocity = climb * up + (speed * np.cos(angle))[:, None] * along
    table = np.column_stack([time_s, (radius + height)[:, None] * up, velocity, np.zeros(len(up))])
    table[0, 4:7] = 1e-3 * first_up
    burns = tuple(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    for begin_s, end_s in burns:
        table[(time_s >= begin_s - 1e-9) & (time_s < end_s - 1e-9), 7] = 1.0
    impact = geodetic(radius * up[-1])[:2]
    table = with_edges(table[time_s <= edges[-1] + DARK_S], edges[1:])
    return Ascent(table, burns, float(np.degrees(place[1])), impact)
