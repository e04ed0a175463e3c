"""Boosts of a law of vehicles from the ground, in a plane through the Earth's centre, without
rotation or drag.
"""

from functools import cached_property

import numpy as np
from attrs import frozen
from opir_estimation import law_parameters

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_forecast.burning_on import Steering
from opir_forecast.vehicles import GAP, STAGES, VehicleModel, VehicleStages

#: A sphere with the Earth's gravity.
MU = EARTH_MU_M3_S2
RADIUS_M = EARTH_EQUATORIAL_RADIUS_M

LAW = law_parameters("opir_forecast", "orbits")


def drawn_stages(
    model: VehicleModel, family: int, count: int, rng: np.random.Generator
) -> VehicleStages:
    """Return the drawn stages (count, STAGES) of vehicles of a family."""
    families = np.full(count, family)
    share = model.stages[family]
    size = rng.choice(np.arange(1, STAGES + 1), count, p=share / share.sum())
    hot = rng.random((count, STAGES)) < model.hot[family]
    total = np.zeros((count, 4))
    stages = np.zeros((4, count, STAGES))
    gap = np.zeros(count)
    for step in range(STAGES):
        stage = np.full(count, step)
        mean, sigma = model.law(families, stage, total, np.full(total.shape, float(step)))
        logs = mean + sigma * rng.normal(size=(count, 4))
        total = total + model.scores(families, stage, logs)
        stages[:, :, step] = np.where(step < size, [gap, *model.figures(logs)], 0.0)
        gap = np.where(hot[:, step], 0.0, np.exp(logs[:, GAP]))
    return VehicleStages(*stages)


@frozen(eq=False)
class PlanarBoost:
    """Vehicles (n,): their stages and steering.

    Those with an `orbit_m` (n,), not nan, follow a program up to a height, are steered to the
    height of an orbit from there on, and cut off at its speed; `program` (3, n) are that height,
    m, and angle, rad, and power of the program (`_through_air`). States (4, n) are x forwards and y
    up from the Earth's centre, and velocity.
    """

    stages: VehicleStages
    steering: Steering
    orbit_m: FloatArray
    program: FloatArray

    @cached_property
    def starts_s(self) -> FloatArray:
        """Return the ignitions (n, STAGES)."""
        return self.stages.starts_s

    @cached_property
    def over_s(self) -> FloatArray:
        """Return the times (n,) of the last burnout."""
        return (self.starts_s + self.stages.burn_s).max(axis=1)

    def at_rest(self) -> FloatArray:
        """Return the states on the ground."""
        state = np.zeros((4, len(self.orbit_m)))
        state[1] = RADIUS_M
        return state

    def stepped(self, state: FloatArray, time_s: float, step_s: float) -> FloatArray:
        """Return the states after a step, by the midpoint rule."""
        middle = state + 0.5 * step_s * self._rates(state, time_s)
        return state + step_s * self._rates(middle, time_s + 0.5 * step_s)

    def _rates(self, state: FloatArray, time_s: float) -> FloatArray:
        x, y, u, v = state
        force_x, force_y = self.force(state, time_s)
        pull: FloatArray = -MU / (x * x + y * y) ** 1.5
        return np.array([u, v, pull * x + force_x, pull * y + force_y])

    def force(self, state: FloatArray, time_s: float) -> FloatArray:
        """Return the specific force (2, n), m/s²; it is computed for vehicles before their last
        burnout alone.
        """
        thrust = np.zeros((2, len(self.orbit_m)))
        rows = np.flatnonzero(time_s < self.over_s)
        if len(rows):
            thrust[:, rows] = self._thrust(state[:, rows], time_s, rows)
        return thrust

    def _thrust(self, state: FloatArray, time_s: float, rows: IntArray) -> FloatArray:
        """Return the specific force (2, m), m/s², of some vehicles, given by their rows."""
        size = self._size(time_s, rows)
        unit, rising = self._turning(state, time_s, rows)
        guided = np.flatnonzero(np.isfinite(self.orbit_m[rows]) & ~rising)
        if len(guided):
            unit[:, guided], cut_off = self._guided(
                state[:, guided], time_s, size[guided], rows[guided]
            )
            size[guided[cut_off]] = 0.0
        return size * unit

    def _turning(
        self, state: FloatArray, time_s: float, rows: IntArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return thrust directions (2, m) of gravity turns, and which vehicles still rise."""
        speed = np.hypot(state[2], state[3])
        steering = self.steering.take(rows)
        rising = (time_s < steering.rise_s) | (speed < 1.0)
        x, y = np.where(rising, [[0.0], [1.0]], state[2:] / np.maximum(speed, 1.0))
        return _turned_down(x, y, steering.leads(np.full(len(speed), time_s))), rising

    def _size(self, time_s: float, rows: IntArray) -> FloatArray:
        """Return the magnitude (m,) of the specific force, m/s²; 0 between stages."""
        since = time_s - self.starts_s[rows]
        burn, acceleration, growth = (column[rows] for column in self.stages[1:])
        is_lit = (since >= 0.0) & (since < burn)
        force = acceleration / np.maximum(1.0 - growth * since, 0.02)
        return np.sum(np.where(is_lit, force, 0.0), axis=1)

    def _guided(
        self, state: FloatArray, time_s: float, size: FloatArray, rows: IntArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return thrust directions (2, m) of launchers, and which are as fast as their orbit."""
        unit, cut_off = self._to_orbit(state, time_s, size, rows)
        height = np.hypot(*state[:2]) - RADIUS_M
        guided_m, *tilt = self.program[:, rows]
        in_air = np.flatnonzero(height < guided_m)
        if len(in_air):
            angle, power = (column[in_air] for column in tilt)
            unit[:, in_air] = _through_air(state[:, in_air], size[in_air], angle, power)
        return unit, cut_off

    def _to_orbit(
        self, state: FloatArray, time_s: float, size: FloatArray, rows: IntArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return thrust directions (2, m) that end at the height of an orbit without climbing, and
        who is fast enough.

        The climb is a cubic of the time that is left.
        """
        x, y, u, v = state
        radius = np.hypot(x, y)
        up = np.array([x, y]) / radius
        level = np.array([up[1], -up[0]])
        climb = u * up[0] + v * up[1]
        speed = u * level[0] + v * level[1]
        circular = np.sqrt(MU / radius)
        push = np.maximum(size, 1.0)
        burn_left_s = np.minimum(self.over_s[rows] - time_s, (circular - speed) / push)
        left_s = np.maximum(burn_left_s, LAW.least_left_s)
        lift = 6.0 * (self.orbit_m[rows] + RADIUS_M - radius) / left_s**2 - 4.0 * climb / left_s
        needed = lift + MU / radius**2 - speed**2 / radius
        sine = np.clip(needed / push, *LAW.thrust_sines)
        return sine * up + np.sqrt(1.0 - sine**2) * level, speed > circular


def _through_air(
    state: FloatArray, size: FloatArray, last_rad: FloatArray, power: FloatArray
) -> FloatArray:
    """Return thrust directions (2, n) of launchers whose path tilts by powers (n,) of the height, to
    angles from the vertical (n,) at the height of a first cut-off.

    The root of the height is, with an even force, a tilt that grows evenly with time. The thrust
    leads the velocity by what bends the path more than gravity does.
    """
    x, y, u, v = state
    radius = np.hypot(x, y)
    speed = np.maximum(np.hypot(u, v), 1.0)
    climb = np.clip((u * x + v * y) / (radius * speed), -1.0, 1.0)
    bend = _program_bends(radius, speed, climb, last_rad, power)
    sine = np.clip(bend / np.maximum(size, 1.0), -LAW.attack_sine, LAW.attack_sine)
    return _turned_down(u / speed, v / speed, np.arcsin(sine))


def _program_bends(
    radius: FloatArray,
    speed: FloatArray,
    climb: FloatArray,
    last_rad: FloatArray,
    power: FloatArray,
) -> FloatArray:
    """Return the accelerations (n,), m/s², across paths that bend them to their program."""
    height = np.maximum(radius - RADIUS_M, 1.0)
    program = last_rad * (height / LAW.tilted_m) ** power
    angle = np.arccos(climb)
    rate = power * program / height * speed * climb + (program - angle) / LAW.tilt_s
    bend: FloatArray = speed * rate - MU / radius**2 * np.sin(angle)
    return bend


def _turned_down(x: FloatArray, y: FloatArray, lead: FloatArray) -> FloatArray:
    """Return directions (2, n) turned downwards by angles (n,), rad."""
    cosine = np.cos(lead)
    sine = np.sin(lead)
    return np.array([x * cosine + y * sine, y * cosine - x * sine])


def ranges_m(state: FloatArray) -> FloatArray:
    """Return the ranges (n,), m, of free flights over a round Earth from planar states (4, n); nan
    without an impact.
    """
    x, y, u, v = state
    radius = np.hypot(x, y)
    momentum = x * v - y * u
    energy = 0.5 * (u * u + v * v) - MU / radius
    flown = _flown_angles(radius, momentum, energy, x * u + y * v >= 0.0)
    swept = np.where(energy < 0.0, flown, np.nan)
    return RADIUS_M * np.abs(np.arctan2(x, y) - np.copysign(swept, momentum))


def _flown_angles(
    radius: FloatArray, momentum: FloatArray, energy: FloatArray, rises: BoolArray
) -> FloatArray:
    """Return the angles (n,), rad, that orbits sweep from a radius to the impact."""
    parameter = momentum**2 / MU
    excess = np.sqrt(np.maximum(1.0 + 2.0 * energy * momentum**2 / MU**2, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        anomaly = np.arccos(np.clip((parameter / radius - 1.0) / excess, -1.0, 1.0))
        anomaly = np.where(rises, anomaly, 2.0 * np.pi - anomaly)
        cosine = (parameter / RADIUS_M - 1.0) / excess
        impact = 2.0 * np.pi - np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
    flown: FloatArray = impact - anomaly
    return flown


def elevations(state: FloatArray) -> FloatArray:
    """Return the elevations (n,), rad, of the velocities of planar states (4, n)."""
    x, y, u, v = state
    return np.arctan2(x * u + y * v, np.abs(y * u - x * v))
