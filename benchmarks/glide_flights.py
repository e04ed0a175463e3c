"""Boosts that end low and level, and the glides after them, that share no code with opir, as
tables.

Notional kinematics of a point mass: one or two burns whose flight-path angle is a smooth curve from
vertical to level, whose shape is sought until the last ends at the wanted height; then lift
balances weight less centrifugal force at a constant ratio of lift to drag, in air whose density
falls exponentially, on a course of constant curvature; below the final speed it falls. A round,
rotating Earth; speeds are those over the ground.
"""

import numpy as np
from ascents import DARK_S, STEP_S, Ascent, turned
from foreign_flights import MU, RADIUS_M, directions, ecef, geodetic
from scipy.optimize import brentq

SCALE_M = 7000.0
LONGEST_S = 4000.0
#: Thrust is no farther than this from the velocity, but for the first seconds.
FARTHEST_RAD = np.radians(20.0)
SLOW_S = 15.0


def drawn_glide(rng: np.random.Generator) -> Ascent:
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
        last_m_s = rng.uniform(700.0, 1800.0)
        place = float(np.arcsin(rng.uniform(-0.8, 0.8))), float(rng.uniform(-np.pi, np.pi))
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        curve = np.radians(rng.normal(0.0, 8.0)) / 4e6
        edges = np.cumsum(np.append(0.0, np.insert(burn_s, 1, gap_s)[: 2 * stages - 1]))
        course = _Course(edges, first, growth, height_m, level_rad)
        try:
            bend = brentq(course.miss_m, 1.0, 9.0, xtol=1e-4)
        except ValueError:
            continue
        rows = course.rows(bend)
        if 2300.0 < rows[-1][2] < 6800.0 and course.lead_rad(np.array(rows)) < FARTHEST_RAD:
            glide = _glided(rows[-1], ratio, last_m_s)
            return _on_the_earth(np.array(rows), np.array(glide), edges, place, azimuth, curve)


class _Course:
    """A boost over a round Earth: edges of its burns and gaps, s, first accelerations and their
    growth, its end.
    """

    def __init__(
        self,
        edges: np.ndarray,
        first: np.ndarray,
        growth: np.ndarray,
        height_m: float,
        level_rad: float,
    ) -> None:
        self.edges = edges
        self.first = first
        self.growth = growth
        self.height_m = height_m
        self.level_rad = level_rad

    def miss_m(self, bend: float) -> float:
        """Return by how much the boost ends too high, m."""
        return self.rows(bend)[-1][1] - self.height_m

    def lead_rad(self, rows: np.ndarray) -> float:
        """Return the largest angle between thrust and velocity, from `SLOW_S` on, that bends the
        path as it does.
        """
        time_s, height, speed, angle = rows[rows[:, 0] > SLOW_S].T
        pull = MU / (RADIUS_M + height) ** 2 - speed**2 / (RADIUS_M + height)
        side = speed * np.gradient(angle, time_s) + pull * np.cos(angle)
        along = np.gradient(speed, time_s) + pull * np.sin(angle)
        lit = along > 5.0
        return float(np.max(np.abs(np.arctan2(side, along))[lit]))

    def rows(self, bend: float) -> list[list[float]]:
        """Return rows of time, height, speed and flight-path angle."""
        height = 0.0
        speed = 0.1
        angle = 0.5 * np.pi
        now = 0.0
        rows = []
        for leg, (begin, end) in enumerate(zip(self.edges[:-1], self.edges[1:], strict=True)):
            while now < end - 1e-9:
                rows.append([now, height, speed, angle])
                step = min(STEP_S, end - now)
                force = self._force(leg, (now - begin) / (end - begin))
                was_speed = speed
                was_angle = angle
                speed += step * (force - MU / (RADIUS_M + height) ** 2 * np.sin(angle))
                now += step
                part = np.clip((now - 5.0) / (self.edges[-1] - 5.0), 0.0, 1.0)
                angle = self.level_rad + (0.5 * np.pi - self.level_rad) * (1.0 - part) ** bend
                up = 0.5 * (was_speed * np.sin(was_angle) + speed * np.sin(angle))
                height += step * up
        return [*rows, [now, height, speed, angle]]

    def _force(self, leg: int, part: float) -> float:
        """Return the specific force, m/s², in a leg, of which a part is over; every second leg is
        dark.
        """
        first = self.first[leg // 2]
        growth = self.growth[leg // 2]
        return float(first / (1.0 - (1.0 - 1.0 / growth) * part)) if leg % 2 == 0 else 0.0


def _glided(last: list[float], ratio: float, last_m_s: float) -> list[list[float]]:
    """Return rows of a glide from the end of a boost, as those of `_Course.rows`, and of its end on
    the ground.
    """
    now, height, speed, angle = last
    top_m = height
    rows = []
    lift = MU / (RADIUS_M + height) ** 2 - speed**2 / (RADIUS_M + height)
    density = lift / speed**2
    while speed > last_m_s and now < LONGEST_S:
        pull = MU / (RADIUS_M + height) ** 2
        lift = max(pull - speed**2 / (RADIUS_M + height), 0.05)
        wanted = top_m - SCALE_M * np.log(lift / speed**2 / density)
        # The angle with which it begins dies away.
        climb = (
            speed * np.sin(angle) * np.exp(-STEP_S / 10.0)
            + (wanted - height) * (1.0 - np.exp(-STEP_S / 10.0)) / 10.0
        )
        speed -= STEP_S * (lift / ratio + pull * np.sin(angle))
        angle = float(np.arcsin(np.clip(climb / speed, -0.5, 0.5)))
        height = height + STEP_S * climb
        now = now + STEP_S
        rows.append([now, height, speed, angle])
    # It falls three times as far as it is high.
    return [
        *rows,
        [now + STEP_S, height, 300.0, 0.0],
        [now + STEP_S + 0.01 * height, 0.0, 300.0, 0.0],
    ]


def _on_the_earth(
    boost: np.ndarray,
    glide: np.ndarray,
    edges: np.ndarray,
    place: tuple[float, float],
    azimuth: float,
    curve: float,
) -> Ascent:
    """Return the flight of rows along a course from a place, its curvature, rad/m, after the
    boost.
    """
    up0, ahead0 = directions(place, azimuth)
    radius = float(np.linalg.norm(ecef(*place)))
    time_s, height, speed, angle = np.concatenate([boost, glide]).T
    up, ahead = np.empty((2, len(time_s), 3))
    up[0] = up0
    ahead[0] = ahead0
    turn = np.diff(turned(time_s, speed * np.cos(angle) / (radius + height)))
    bend = np.where(np.arange(len(turn)) >= len(boost) - 1, curve * RADIUS_M * turn, 0.0)
    for row, (far, aside) in enumerate(zip(turn.tolist(), bend.tolist(), strict=True)):
        up[row + 1] = np.cos(far) * up[row] + np.sin(far) * ahead[row]
        onward = np.cos(far) * ahead[row] - np.sin(far) * up[row]
        ahead[row + 1] = np.cos(aside) * onward + np.sin(aside) * np.cross(up[row + 1], onward)
    velocity = speed[:, None] * (np.sin(angle)[:, None] * up + np.cos(angle)[:, None] * ahead)
    rows = np.column_stack([time_s, (radius + height)[:, None] * up, velocity, np.zeros(len(up))])
    burns = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    for begin, end in burns:
        rows[(rows[:, 0] >= begin - 1e-9) & (rows[:, 0] < end - 1e-9), 7] = 1.0
    impact = geodetic(radius * up[-1])[:2]
    rows = rows[rows[:, 0] <= edges[-1] + DARK_S]
    rows[0, 4:7] = 1e-3 * up0
    # Two rows at each edge, for the force jumps there.
    for edge in edges[1:]:
        row = int(np.argmin(np.abs(rows[:, 0] - edge)))
        before = rows[row].copy()
        before[7] = rows[row - 1, 7]
        rows = np.insert(rows, row, before, axis=0)
    return Ascent(rows, tuple(burns), float(np.degrees(place[1])), impact)
