"""Ascents drawn from the tracker's law of boosts: positions and motions of vehicles at times since
their ignition.

Missiles, gliders and vehicles unlike both fly the law's program of pitch-over and slow steering;
space launchers are steered to an orbit. Weights are those of the forecast's hypotheses: ranges of
missiles and elevations at the ends of their boosts, low and level ends of those of gliders.
"""

from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from numpy.typing import NDArray
from opir_estimation import law_parameters

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_forecast.burning_on import drawn_steering
from opir_forecast.outcomes import Outcomes
from opir_forecast.planar_boost import (
    LAW as ORBITS,
    RADIUS_M,
    PlanarBoost,
    drawn_stages,
    elevations,
    ranges_m,
)
from opir_forecast.stage_endings import StageEndings
from opir_forecast.vehicles import MISSILE, NONE, SPACE, VehicleModel, VehicleStages

LAW = law_parameters("opir_forecast", "ascents")

#: Kinds of ascents, with the laws of their vehicles. They are drawn in the numbers of the law.
KINDS = {"missile": MISSILE, "glide": MISSILE, "orbit": SPACE, "none": NONE}

TABLE_S: float = LAW.step_s
LONGEST_S: float = LAW.longest_s


class AscentRows(NamedTuple):
    """Motions (n,) in the plane of an ascent.

    Angles over the ground, rad; heights, m; level and vertical velocities, m/s; level and vertical
    specific forces, m/s²; integrals of the distance over the ground and of the height over time,
    m s.
    """

    angle: FloatArray
    height: FloatArray
    level: FloatArray
    climb: FloatArray
    level_force: FloatArray
    lift: FloatArray
    distance_s: FloatArray
    height_s: FloatArray


@frozen(eq=False)
class BoostAscents:
    """Ascents (n,): `path` (times, 8, n) of `AscentRows`, `burns` (times, n) and how their
    stages end.

    `log_weight` (n,) are the logarithms of their weights by all that hypotheses say, `log_share`
    (n,) by kinds of vehicles alone, wherever their boosts lead. Single precision is exact to
    centimetres.
    """

    path: NDArray[np.float32]
    burns: BoolArray
    log_weight: FloatArray
    log_share: FloatArray
    endings: StageEndings

    def at(self, since_s: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the rows (8, n) of ascents at times since ignition (n,), and which of them burn."""
        place = np.minimum(since_s / TABLE_S, len(self.path) - 1.001)
        step = place.astype(np.int64)
        ascent = np.arange(len(since_s))
        start, end = (self.path[row, :, ascent].astype(np.float64) for row in (step, step + 1))
        nearest = np.minimum(np.rint(since_s / TABLE_S).astype(np.int64), len(self.path) - 1)
        rows = (start + (place - step)[:, None] * (end - start)).T
        return rows, self.burns[nearest, ascent] & (since_s < LONGEST_S)

    def reaching(self, height_m: FloatArray) -> FloatArray:
        """Return the times since ignition (n,) at which ascents first reach heights (n,), m;
        `LONGEST_S` if never.
        """
        highest = self._highest_m
        below = _last_below(highest, height_m)
        ascent = np.arange(len(height_m))
        low = highest[below, ascent]
        rise = np.maximum(highest[below + 1, ascent] - low, LAW.least_rise_m)
        share = np.clip((height_m - low) / rise, 0.0, 1.0)
        # From rest the height grows as the square of the time.
        since_s = (below + np.where(below == 0, np.sqrt(share), share)) * TABLE_S
        return np.where(highest[-1] < height_m, LONGEST_S, since_s)

    @cached_property
    def _highest_m(self) -> FloatArray:
        heights = AscentRows(*self.path.swapaxes(0, 1)).height
        return np.maximum.accumulate(heights, axis=0).astype(np.float64)

    @cached_property
    def burning_s(self) -> FloatArray:
        """Return the burn times (n,) of ascents, s."""
        return TABLE_S * np.count_nonzero(self.burns, axis=0)


def _last_below(highest: FloatArray, height_m: FloatArray) -> IntArray:
    """Return the last steps (n,) at which rising tables (times, n) are below heights (n,)."""
    ascent = np.arange(len(height_m))
    below = np.zeros_like(ascent)
    above = np.full_like(ascent, len(highest) - 1)
    for _ in range(len(highest).bit_length()):
        middle = (below + above) // 2
        is_below = highest[middle, ascent] < height_m
        below = np.where(is_below, middle, below)
        above = np.where(is_below, above, middle)
    return below


def ascents_of(outcomes: Outcomes) -> BoostAscents:
    """Return the ascents of a law of vehicles, weighed by its hypotheses: the same draws at each
    call.
    """
    path, burns, ends, endings = _drawn_flights(outcomes.model)
    shares = dict(zip(KINDS, _shares(outcomes), strict=True))
    by_kind = list(zip(KINDS, np.split(ends, np.cumsum(LAW.numbers)[:-1], axis=1), strict=True))
    log_weight = [
        _log_shares(shares[kind], _relative_density(outcomes, kind, end), end)
        for kind, end in by_kind
    ]
    log_share = [_log_shares(shares[kind], np.ones(end.shape[1]), end) for kind, end in by_kind]
    return BoostAscents(path, burns, np.concatenate(log_weight), np.concatenate(log_share), endings)


class _Flights(NamedTuple):
    """Paths (times, 8, n), flags (times, n) of burns, planar states (4, n) at the ends of boosts,
    and stages.
    """

    path: NDArray[np.float32]
    burns: BoolArray
    ends: FloatArray
    endings: StageEndings


@lru_cache(maxsize=2)
def _drawn_flights(model: VehicleModel) -> _Flights:
    """Return the flights of all kinds."""
    boosts = [
        _drawn_boost(model, kind, count, number)
        for number, (kind, count) in enumerate(zip(KINDS, LAW.numbers, strict=True))
    ]
    path, burns, ends = (
        np.concatenate(column, axis=-1) for column in zip(*map(_flights_of, boosts), strict=True)
    )
    columns = zip(*(boost.stages for boost in boosts), strict=True)
    stages = VehicleStages(*map(np.concatenate, columns))
    family = np.repeat(list(KINDS.values()), LAW.numbers)
    return _Flights(path, burns, ends, StageEndings(model, family, stages))


def _drawn_boost(model: VehicleModel, kind: str, count: int, number: int) -> PlanarBoost:
    """Return boosts of the kind with a number."""
    rng = np.random.default_rng([11, number])
    stages = drawn_stages(model, KINDS[kind], count, rng)
    steering = drawn_steering(count, model.data, 11 + number)
    height_m = _heights_m(model, kind, count, rng)
    guided_m, tilt_deg, tilt_power = (
        rng.uniform(low, high, count)
        for low, high in (ORBITS.guided_m, ORBITS.tilt_deg, ORBITS.tilt_power)
    )
    program = np.array([guided_m, np.radians(tilt_deg), tilt_power])
    return PlanarBoost(stages, steering, height_m, program)


def _flights_of(boost: PlanarBoost) -> tuple[NDArray[np.float32], BoolArray, FloatArray]:
    """Return paths, flags of burns and ends of boosts (n,); ends are nan once they have crashed."""
    state, force = _flown(boost)
    flies = _flies(state)
    ends = np.minimum(np.ceil(boost.over_s / TABLE_S), len(state) - 1).astype(np.int64)
    end = np.where(flies[:, None], state, np.nan)[ends, :, np.arange(len(ends))].T
    rows = _ascent_rows(state, force)
    return rows, flies & force.any(axis=1), end


def _flies(state: FloatArray) -> BoolArray:
    """Whether ascents with states (times, 4, n) have not crashed yet (times, n)."""
    height = np.hypot(state[:, 0], state[:, 1]) - RADIUS_M
    return np.logical_and.accumulate(height > -1.0, axis=0)


def _flown(boost: PlanarBoost) -> tuple[FloatArray, FloatArray]:
    """Return states (times, 4, n) and specific forces (times, 2, n) at intervals."""
    state = boost.at_rest()
    states = []
    forces = []
    for number in range(int(LONGEST_S / TABLE_S) + 1):
        time_s = number * TABLE_S
        # At an ignition or a burnout, the force just after it.
        forces.append(boost.force(state, time_s + 1e-6))
        states.append(state)
        state = boost.stepped(state, time_s, TABLE_S)
    return np.array(states), np.array(forces)


def _ascent_rows(state: FloatArray, force: FloatArray) -> NDArray[np.float32]:
    """Return the rows (times, 8, n) of states (times, 4, n) with forces (times, 2, n)."""
    x, y = state[:, :2].swapaxes(0, 1)
    radius = np.hypot(x, y)
    up = np.stack([x, y], axis=1) / radius[:, None]
    level = np.stack([y, -x], axis=1) / radius[:, None]
    motion = [
        np.sum(vector * axis, axis=1) for vector in (state[:, 2:], force) for axis in (level, up)
    ]
    distance = np.stack([RADIUS_M * np.arctan2(x, y), radius - RADIUS_M])
    steps = 0.5 * TABLE_S * (distance[:, 1:] + distance[:, :-1])
    sums = np.pad(np.cumsum(steps, axis=1), [(0, 0), (1, 0), (0, 0)])
    rows = AscentRows(distance[0] / RADIUS_M, distance[1], *motion, *sums)
    return np.stack(rows, axis=1, dtype=np.float32, casting="same_kind")


def _heights_m(model: VehicleModel, kind: str, count: int, rng: np.random.Generator) -> FloatArray:
    """Return the heights (count,) at which the burns of a kind shall end level, m; nan for those of
    no such program.
    """
    limits: dict[str, Any] = {
        "glide": [1e3 * height for height in model.data["glide"]["height_km"]],
        "orbit": ORBITS.target_heights_m,
    }
    low, high = limits.get(kind, (0.0, 0.0))
    heights: FloatArray = rng.uniform(low, high, count)
    return heights if kind in limits else np.full(count, np.nan)


def _shares(outcomes: Outcomes) -> tuple[float, ...]:
    """Return the probabilities of the kinds of ascents."""
    missile, orbit, glide, none = outcomes.groups.tolist()
    shares = {"missile": missile, "glide": glide, "orbit": orbit, "none": none + outcomes.odd}
    return tuple(shares[kind] for kind in KINDS)


def _log_shares(share: float, density: FloatArray, end: FloatArray) -> FloatArray:
    """Return the logarithms of the parts (n,) of a kind's share by relative densities (n,) of its
    ascents with states (4, n) at the ends of boosts.

    A program that ends in the ground is a bad draw: before it does, it leads lower than any boost.
    """
    weight = np.where(np.isfinite(end[0]) & np.isfinite(density), density, 0.0)
    part = share * weight / max(float(weight.sum()), 1e-9)
    return np.log(np.maximum(part, LAW.least_weight))


def _relative_density(outcomes: Outcomes, kind: str, end: FloatArray) -> FloatArray:
    """Return the densities (n,) of a kind's ends of boosts over those of its law."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return _density_of_ends(outcomes, kind, end)


def _density_of_ends(outcomes: Outcomes, kind: str, end: FloatArray) -> FloatArray:
    """Return the densities (n,) of ends of boosts, nan of crashes."""
    if kind == "missile":
        range_m = ranges_m(end)
        climbing = outcomes.climbing(range_m, elevations(end))
        return outcomes.missiles(range_m).sum(axis=1) * climbing
    if kind == "glide":
        x, y, u, v = end
        return outcomes.gliding(np.hypot(x, y) - RADIUS_M, elevations(end), np.hypot(u, v))
    return np.ones(end.shape[1])
