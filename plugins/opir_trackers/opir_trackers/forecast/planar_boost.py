"""Boosts of a law of vehicles from the ground, in a plane through the Earth's centre, without
rotation or drag.
"""

from functools import cached_property

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_trackers.forecast.burning_on import Steering
from opir_trackers.forecast.vehicles import BURN, FORCE, GAP, RATIO, STAGES, VehicleModel

#: A sphere with the Earth's gravity.
MU = EARTH_MU_M3_S2
RADIUS_M = EARTH_EQUATORIAL_RADIUS_M

#: Limits of the sine of the thrust's elevation towards an orbit, and the least time, s, in which it
#: changes: the program of a launcher is smooth, and never points far below the horizon.
_SINES = (-0.6, 0.97)
_LEAST_LEFT_S = 15.0


def drawn_stages(
    model: VehicleModel, family: int, count: int, rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Return the stages (count, STAGES) of vehicles: gaps before them, burn times, accelerations,
    growths.
    """
    family_of = np.full(count, family)
    number = rng.choice(
        np.arange(1, STAGES + 1), count, p=model.stages[family] / model.stages[family].sum()
    )
    total = np.zeros((count, 4))
    seen = np.zeros((count, 4))
    columns = {name: np.zeros((count, STAGES)) for name in ("gap", "burn", "first", "growth")}
    hot = rng.random((count, STAGES)) < model.hot[family]
    gap = np.zeros(count)
    for stage in range(STAGES):
        mean, sigma = model.law(family_of, np.full(count, stage), total, seen)
        logs = mean + sigma * rng.normal(size=(count, 4))
        score = model.scores(family_of, np.full(count, stage), logs)
        total = total + score
        seen = seen + 1.0
        ratio = np.maximum(
            np.minimum(logs[:, RATIO], np.log(model.data["highest_m_s2"]) - logs[:, FORCE]), 0.02
        )
        burn = np.exp(logs[:, BURN])
        first = np.exp(logs[:, FORCE])
        row = {"gap": gap, "burn": burn, "first": first, "growth": -np.expm1(-ratio) / burn}
        for name, value in row.items():
            columns[name][:, stage] = np.where(stage < number, value, 0.0)
        gap = np.where(hot[:, stage], 0.0, np.exp(logs[:, GAP]))
    return columns


@frozen(eq=False)
class PlanarBoost:
    """Vehicles (n,): their stages, as of `drawn_stages`, and steering.

    Those with an `orbit_m` (n,), not nan, are steered to the height of an orbit instead, and cut
    off at its speed. States (4, n) are x ahead and y up from the Earth's centre, and velocity.
    """

    stages: dict[str, FloatArray]
    steering: Steering
    orbit_m: FloatArray

    @cached_property
    def starts_s(self) -> FloatArray:
        """Return the ignitions (n, STAGES)."""
        starts: FloatArray = (
            np.cumsum(self.stages["gap"] + self.stages["burn"], axis=1) - self.stages["burn"]
        )
        return starts

    @cached_property
    def over_s(self) -> FloatArray:
        """Return the times (n,) of the last burnout."""
        over: FloatArray = (self.starts_s + self.stages["burn"]).max(axis=1)
        return over

    def at_rest(self) -> FloatArray:
        """Return the states on the ground."""
        state = np.zeros((4, len(self.orbit_m)))
        state[1] = RADIUS_M
        return state

    def stepped(self, state: FloatArray, now: float, step_s: float) -> FloatArray:
        """Return the states after a step, by the midpoint rule."""
        middle = state + 0.5 * step_s * self._rates(state, now)
        return state + step_s * self._rates(middle, now + 0.5 * step_s)

    def _rates(self, state: FloatArray, now: float) -> FloatArray:
        x, y, u, v = state
        ahead, up = self.force(state, now)
        pull: FloatArray = -MU / (x * x + y * y) ** 1.5
        return np.array([u, v, pull * x + ahead, pull * y + up])

    def force(self, state: FloatArray, now: float) -> FloatArray:
        """Return the specific force (2, n), m/s²: nothing after the last burnout, and nothing is
        computed there.
        """
        thrust = np.zeros((2, len(self.orbit_m)))
        rows = np.flatnonzero(now < self.over_s)
        if len(rows):
            thrust[:, rows] = self._thrust(state[:, rows], now, rows)
        return thrust

    def _thrust(self, state: FloatArray, now: float, rows: IntArray) -> FloatArray:
        """Return the specific force (2, m), m/s², of some vehicles, given by their rows."""
        since = now - self.starts_s[rows]
        burn, first, growth = (self.stages[name][rows] for name in ("burn", "first", "growth"))
        on = (since >= 0.0) & (since < burn)
        size = np.sum(np.where(on, first / np.maximum(1.0 - growth * since, 0.02), 0.0), axis=1)
        speed = np.hypot(state[2], state[3])
        steering = self.steering.take(rows)
        rising = (now < steering.rise_s) | (speed < 1.0)
        ahead, up = (
            np.where(rising, rest, part / np.maximum(speed, 1.0))
            for rest, part in ((0.0, state[2]), (1.0, state[3]))
        )
        lead = steering.leads(np.full(len(speed), now))
        cosine = np.cos(lead)
        sine = np.sin(lead)
        unit = np.array([ahead * cosine + up * sine, up * cosine - ahead * sine])
        steered = np.flatnonzero(np.isfinite(self.orbit_m[rows]) & ~rising)
        if len(steered):
            unit[:, steered], cut_off = self._to_orbit(
                state[:, steered], now, size[steered], rows[steered]
            )
            size[steered[cut_off]] = 0.0
        return size * unit

    def _to_orbit(
        self, state: FloatArray, now: float, size: FloatArray, rows: IntArray
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
        fast = u * level[0] + v * level[1]
        circular = np.sqrt(MU / radius)
        push = np.maximum(size, 1.0)
        left_s = np.maximum(
            np.minimum(self.over_s[rows] - now, (circular - fast) / push), _LEAST_LEFT_S
        )
        wanted = 6.0 * (self.orbit_m[rows] + RADIUS_M - radius) / left_s**2 - 4.0 * climb / left_s
        sine = np.clip((wanted + MU / radius**2 - fast**2 / radius) / push, *_SINES)
        return sine * up + np.sqrt(1.0 - sine**2) * level, fast > circular
