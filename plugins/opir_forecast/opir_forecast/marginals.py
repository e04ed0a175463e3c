"""Ranges of the boosts of a law of vehicles: the figures under `marginal` in `vehicles.json`.

Flights of the law of missiles from the ground, in a plane without rotation or drag: densities of
the logarithm of the range, the share whose burn ends low and level, and the share of space
launchers whose burns suffice for an orbit. The densities turn the law of the vehicles into laws of
classes by range (`outcomes`).
"""

from typing import Any

import numpy as np
from opir_estimation import law_parameters

from opir_core.arrays import FloatArray
from opir_forecast.burning_on import Steering, drawn_steering
from opir_forecast.outcomes import LEVEL, is_glide, log_elevation
from opir_forecast.planar_boost import (
    RADIUS_M,
    PlanarBoost,
    drawn_stages,
    elevations,
    ranges_m,
)
from opir_forecast.vehicles import MISSILE, SPACE, VehicleModel, VehicleStages

LAW = law_parameters("opir_forecast", "ascents")
ORBITS = law_parameters("opir_forecast", "orbits")


def burn_ends(stages: VehicleStages, steering: Steering) -> FloatArray:
    """Return planar states (4, n) at the ends of the burns: x forwards, y up from the centre, and
    velocity; nan below.
    """
    boost = _unguided(stages, steering)
    over_s = boost.over_s
    state = boost.at_rest()
    ends = np.full_like(state, np.nan)
    crashed = np.zeros(over_s.shape, bool)
    step_s = LAW.marginal_step_s
    for time_s in np.arange(0.0, over_s.max() + step_s, step_s):
        ended = (over_s >= time_s) & (over_s < time_s + step_s)
        state = boost.stepped(state, time_s, step_s)
        crashed |= (np.hypot(*state[:2]) < RADIUS_M - 1.0) & (over_s > time_s)
        ends[:, ended] = state[:, ended]
    ends[:, crashed] = np.nan
    return ends


def _unguided(stages: VehicleStages, steering: Steering) -> PlanarBoost:
    """Return boosts that are steered to no orbit."""
    nowhere = np.full(len(steering), np.nan)
    return PlanarBoost(stages, steering, nowhere, np.stack([nowhere] * 3))


def marginal_of(model: VehicleModel, draws: int, seed: int) -> dict[str, Any]:
    """Return the densities and shares of a model, from a number of drawn boosts."""
    rng = np.random.default_rng(seed)
    stages = drawn_stages(model, MISSILE, draws, rng)
    end = burn_ends(stages, drawn_steering(draws, model.data, seed))
    end = end[:, np.isfinite(end[0])]
    range_m = ranges_m(end)
    nodes_km = np.geomspace(LAW.nearest_km, LAW.farthest_km, LAW.nodes)
    density = np.maximum(_density(np.log(range_m / 1e3), nodes_km), 1e-3)
    x, y, u, v = end
    glide = np.mean(is_glide(model, np.hypot(x, y) - RADIUS_M, elevations(end), np.hypot(u, v)))
    space = drawn_stages(model, SPACE, draws, rng)
    orbit = np.mean(_ideal_speeds(space) > ORBITS.ideal_speed_m_s)
    elevation = _elevation_law(range_m, elevations(end), 1e3 * nodes_km[0])
    return {
        "range_km": [round(value, 1) for value in nodes_km.tolist()],
        "density": [float(f"{value:.3g}") for value in density.tolist()],
        "elevation": [float(f"{value:.2g}") for value in elevation],
        "glide": float(f"{glide:.2g}"),
        "orbit": float(f"{orbit:.2g}"),
    }


def _elevation_law(
    range_m: FloatArray, angle: FloatArray, nearest_m: float
) -> tuple[float, float, float]:
    """Return mean and deviation of the log elevations of boosts that climb, and their share."""
    flies = np.isfinite(range_m) & (range_m > nearest_m)
    climbs = flies & (angle > LEVEL)
    steep = log_elevation(range_m[climbs], angle[climbs])
    return steep.mean(), steep.std(), climbs.sum() / flies.sum()


def _density(log_km: FloatArray, nodes_km: FloatArray) -> FloatArray:
    """Return the densities of the logarithms of ranges (n,), nan without an impact, at nodes."""
    distance = (np.log(nodes_km)[:, None] - log_km[np.isfinite(log_km)]) / LAW.kernel
    total = np.exp(-0.5 * distance**2).sum(axis=1)
    return total / (LAW.kernel * np.sqrt(2.0 * np.pi) * len(log_km))


def _ideal_speeds(stages: VehicleStages) -> FloatArray:
    """Return the speeds (n,), m/s, that vehicles gain without gravity."""
    growth = np.maximum(stages.growth_per_s, 1e-9)
    gained = -np.log1p(-np.minimum(growth * stages.burn_s, 0.98))
    return np.sum(stages.first_m_s2 * gained / growth, axis=1)
