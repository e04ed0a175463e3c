"""Ascents drawn from the tracker's law of boosts: where a vehicle is, and how it moves, at times
since its ignition.

Missiles, gliders and vehicles unlike both fly the law's program of pitch-over and slow steering;
space launchers are steered to an orbit. Weights are those of the forecast's hypotheses: ranges of
missiles and elevations at the ends of their boosts, low and level ends of those of gliders.
"""

from collections.abc import Iterator
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray
from opir_trackers.forecast.burning_on import drawn_steering
from opir_trackers.forecast.marginals import elevations, ranges_m
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.planar_boost import RADIUS_M, PlanarBoost, drawn_stages
from opir_trackers.forecast.vehicles import MISSILE, NONE, SPACE, VehicleModel

#: Families of ascents, and how many are drawn: many of missiles, whose weights differ most.
MISSILES, GLIDERS, LAUNCHERS, OTHERS = range(4)
NUMBERS = (1800, 400, 600, 400)

#: Laws of their vehicles.
_LAWS = (MISSILE, MISSILE, SPACE, NONE)

#: Ascents are flown in steps of `TABLE_S` up to `LONGEST_S` after ignition. At 40 m/s² a chord of a
#: step is 45 m off its arc; a burn that ends within a step ends a little sooner or later, as one of
#: another vehicle of the law.
TABLE_S = 3.0
LONGEST_S = 700.0

#: Heights of orbits to which launchers are steered, m. Notional. Gliders are steered to where they
#: end their burns.
ORBITS_M = (180e3, 400e3)

#: Rows of an ascent: angle over the ground, rad; height, m; level and vertical velocity, m/s; level
#: and vertical specific force, m/s²; integrals of distance over the ground and of height over time,
#: m s.
ANGLE, HEIGHT, LEVEL, CLIMB, LEVEL_FORCE, LIFT, AHEAD_S, ABOVE_S = range(8)


class Moment(NamedTuple):
    """Rows (8, n) of ascents at times of their own, and which of them burn."""

    rows: FloatArray
    burns: BoolArray


@frozen(eq=False)
class BoostAscents:
    """Ascents (n,): `path` (times, 8, n), `burns` (times, n) and the logarithms of their weights
    (n,).

    Single precision is exact to centimetres.
    """

    path: NDArray[np.float32]
    burns: BoolArray
    log_weight: FloatArray

    def at(self, since_s: FloatArray) -> Moment:
        """Return the ascents at times since ignition (n,)."""
        place = np.minimum(since_s / TABLE_S, len(self.path) - 1.001)
        first = place.astype(np.int64)
        each = np.arange(len(since_s))
        part = place - first
        before, after = (self.path[row, :, each].astype(np.float64) for row in (first, first + 1))
        nearest = np.minimum(np.rint(since_s / TABLE_S).astype(np.int64), len(self.path) - 1)
        return Moment(
            (before + part[:, None] * (after - before)).T,
            self.burns[nearest, each] & (since_s < LONGEST_S),
        )

    def reaching(self, height_m: FloatArray) -> FloatArray:
        """Return the times since ignition (n,) at which ascents first reach heights (n,), m;
        `LONGEST_S` if never.
        """
        highest = self._highest_m
        each = np.arange(len(height_m))
        below = np.zeros_like(each)
        above = np.full_like(each, len(highest) - 1)
        for _ in range(len(highest).bit_length()):
            middle = (below + above) // 2
            is_below = highest[middle, each] < height_m
            below = np.where(is_below, middle, below)
            above = np.where(is_below, above, middle)
        low = highest[below, each]
        high = highest[below + 1, each]
        part = np.clip((height_m - low) / np.maximum(high - low, _LEAST_RISE_M), 0.0, 1.0)
        # From rest the height grows as the square of the time.
        since_s = (below + np.where(below == 0, np.sqrt(part), part)) * TABLE_S
        return np.where(highest[-1] < height_m, LONGEST_S, since_s)

    @cached_property
    def _highest_m(self) -> FloatArray:
        return np.maximum.accumulate(self.path[:, HEIGHT], axis=0).astype(np.float64)

    @cached_property
    def burning_s(self) -> FloatArray:
        """Return for how long (n,) ascents burn, s."""
        return np.asarray(TABLE_S * np.count_nonzero(self.burns, axis=0))


def ascents_of(outcomes: Outcomes) -> BoostAscents:
    """Return the ascents of a law of vehicles, weighed by its hypotheses: the same draws at each
    call.
    """
    path, burns, ends = _drawn_flights(outcomes.model)
    parts = np.split(ends, np.cumsum(NUMBERS)[:-1], axis=1)
    return BoostAscents(
        path, burns, np.concatenate([_log_weights(outcomes, *part) for part in enumerate(parts)])
    )


@lru_cache(maxsize=2)
def _drawn_flights(model: VehicleModel) -> tuple[NDArray[np.float32], BoolArray, FloatArray]:
    """Return paths (times, 8, n), which burn (times, n), and planar states (4, n) at the ends of
    the boosts.
    """
    path = []
    burns = []
    ends = []
    for family, count in enumerate(NUMBERS):
        rng = np.random.default_rng([11, family])
        stages = drawn_stages(model, _LAWS[family], count, rng)
        boost = PlanarBoost(
            stages, drawn_steering(count, model.data, 11 + family), _heights_m(model, family, rng)
        )
        rows, lit, states = map(np.array, zip(*_flown(boost), strict=True))
        last = np.minimum(np.ceil(boost.over_s / TABLE_S).astype(np.int64), len(states) - 1)
        path.append(rows.astype(np.float32))
        burns.append(lit)
        ends.append(states[last, :, np.arange(count)].T)
    return np.concatenate(path, axis=2), np.concatenate(burns, axis=1), np.concatenate(ends, axis=1)


def _flown(boost: PlanarBoost) -> Iterator[tuple[FloatArray, BoolArray, FloatArray]]:
    """Yield rows (8, n), which ascents burn, and states (4, n), nan once on the ground again, at
    intervals.
    """
    state = boost.at_rest()
    flies = np.ones(len(boost.orbit_m), dtype=np.bool_)
    behind = np.zeros((2, len(boost.orbit_m)))
    sums = np.zeros_like(behind)
    for number in range(int(LONGEST_S / TABLE_S) + 1):
        now = number * TABLE_S
        # At an ignition or a burnout, what follows.
        force = boost.force(state, now + 1e-6)
        x, y = state[:2]
        radius = np.hypot(x, y)
        up = np.array([x, y]) / radius
        level = np.array([y, -x]) / radius
        flies = flies & (radius > RADIUS_M - 1.0)
        away = np.array([RADIUS_M * np.arctan2(x, y), radius - RADIUS_M])
        sums = sums + 0.5 * TABLE_S * (away + behind) * (number > 0)
        behind = away
        motion = [
            np.sum(each * axis, axis=0) for each in (state[2:], force) for axis in (level, up)
        ]
        rows = np.array([away[0] / RADIUS_M, away[1], *motion, *sums])
        yield rows, flies & np.any(force, axis=0), np.where(flies, state, np.nan)
        state = boost.stepped(state, now, TABLE_S)


def _heights_m(model: VehicleModel, family: int, rng: np.random.Generator) -> FloatArray:
    """Return the heights at which the burns of a family shall end level, m; nan for those of no
    such program.
    """
    limits = {
        GLIDERS: [1e3 * height for height in model.data["glide"]["height_km"]],
        LAUNCHERS: ORBITS_M,
    }
    low, high = limits.get(family, (0.0, 0.0))
    heights: FloatArray = rng.uniform(low, high, NUMBERS[family])
    return heights if family in limits else np.full(NUMBERS[family], np.nan)


def _log_weights(outcomes: Outcomes, family: int, end: FloatArray) -> FloatArray:
    """Return the logarithms of the weights (n,) of a family's ascents with states (4, n) at the
    ends of boosts.

    A program that ends in the ground is a bad draw: before it does, it leads lower than any boost.
    """
    missile, orbit, glide, none = outcomes.groups.tolist()
    weight = np.ones(end.shape[1])
    if family == MISSILES:
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = ranges_m(end)
            weight = outcomes.missiles(range_m).sum(axis=1) * outcomes.climbing(
                range_m, elevations(end)
            )
    elif family == GLIDERS:
        radius = np.hypot(end[0], end[1])
        speed = np.hypot(end[2], end[3])
        weight = outcomes.gliding(radius - RADIUS_M, elevations(end), speed)
    weight = np.where(np.isfinite(end[0]) & np.isfinite(weight), weight, 0.0)
    share = (missile, glide, orbit, none + outcomes.odd)[family]
    return np.asarray(np.log(np.maximum(share * weight / max(float(weight.sum()), 1e-9), _LEAST)))


#: Least rise of an ascent in a step, m, by which is divided.
_LEAST_RISE_M = 1e-3

#: Weight of an ascent that no hypothesis explains.
_LEAST = 1e-12
