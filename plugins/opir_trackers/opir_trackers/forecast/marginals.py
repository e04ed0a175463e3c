"""Ranges of the boosts of a law of vehicles: what `vehicles.json` keeps under `marginal`.

Flights of the law of missiles from the ground, in a plane without rotation or drag: densities of
the logarithm of the range, the share whose burn ends low and level, and the share of space
launchers whose burns suffice for an orbit. The densities turn the law of the vehicles into laws of
classes by range (`outcomes`).
"""

from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_trackers.forecast.burning_on import Steering, drawn_steering
from opir_trackers.forecast.outcomes import LEVEL, log_elevation
from opir_trackers.forecast.planar_boost import MU, RADIUS_M, PlanarBoost, drawn_stages
from opir_trackers.forecast.vehicles import MISSILE, SPACE, VehicleModel

STEP_S = 1.0

#: Nodes of the density, km, and the width of its kernel in the logarithm.
NODES_KM = np.geomspace(25.0, 20000.0, 24)
WIDTH = 0.2

#: What a space launcher must gain to orbit, gravity included, m/s: 7 800 at 200 km and 1 500 of
#: losses.
ORBIT_M_S = 9300.0


def flown(stages: dict[str, FloatArray], steering: Steering) -> FloatArray:
    """Return planar states (4, n) at the ends of the burns: x ahead, y up from the centre, and
    velocity; nan below.
    """
    boost = PlanarBoost(stages, steering, np.full(len(steering), np.nan))
    over = boost.over_s
    state = boost.at_rest()
    done = np.full_like(state, np.nan)
    crashed = np.zeros(len(over), dtype=bool)
    for now in np.arange(0.0, over.max() + STEP_S, STEP_S).tolist():
        ended = (over >= now) & (over < now + STEP_S)
        state = boost.stepped(state, now, STEP_S)
        crashed |= (np.hypot(state[0], state[1]) < RADIUS_M - 1.0) & (over > now)
        done[:, ended] = state[:, ended]
    done[:, crashed] = np.nan
    return done


def ranges_m(state: FloatArray) -> FloatArray:
    """Return the ranges (n,), m, of free flights over a round Earth; nan without an impact."""
    x, y, u, v = state
    radius = np.hypot(x, y)
    momentum = x * v - y * u
    parameter = momentum**2 / MU
    energy = 0.5 * (u * u + v * v) - MU / radius
    excess = np.sqrt(np.maximum(1.0 + 2.0 * energy * momentum**2 / MU**2, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        now = np.arccos(np.clip((parameter / radius - 1.0) / excess, -1.0, 1.0))
        now = np.where(x * u + y * v >= 0.0, now, 2.0 * np.pi - now)
        cosine = (parameter / RADIUS_M - 1.0) / excess
        down = 2.0 * np.pi - np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
    swept = np.where(energy < 0.0, down - now, np.nan)
    return RADIUS_M * np.abs(np.arctan2(x, y) - np.copysign(swept, momentum))


def elevations(state: FloatArray) -> FloatArray:
    """Return the elevations (n,), rad, of the velocities of planar states (4, n)."""
    x, y, u, v = state
    return np.arctan2(x * u + y * v, np.abs(y * u - x * v))


def marginal_of(model: VehicleModel, draws: int, seed: int) -> dict[str, Any]:
    """Return the densities and shares of a model."""
    rng = np.random.default_rng(seed)
    stages = drawn_stages(model, MISSILE, draws, rng)
    end = flown(stages, drawn_steering(draws, model.data, seed))
    known = np.isfinite(end[0])
    end = end[:, known]
    range_m = ranges_m(end)
    log = np.log(range_m / 1e3)
    flies = np.isfinite(range_m) & (range_m > 1e3 * NODES_KM[0])
    angle = elevations(end)
    climbs = flies & (angle > LEVEL)
    steep = log_elevation(range_m[climbs], angle[climbs])
    away = (np.log(NODES_KM)[:, None] - log[np.isfinite(log)]) / WIDTH
    density = np.exp(-0.5 * away**2).sum(axis=1) / (WIDTH * np.sqrt(2.0 * np.pi) * len(log))
    box = model.data["glide"]
    x, y, u, v = end
    height = np.hypot(x, y) - RADIUS_M
    speed = np.hypot(u, v)
    low, high = np.multiply(box["height_km"], 1e3)
    least, most = np.radians(box["angle_deg"])
    level = (angle > least) & (angle < most)
    glide = np.mean((height > low) & (height < high) & level & (speed > box["least_m_s"]))
    space = drawn_stages(model, SPACE, draws, rng)
    growth = np.maximum(space["growth"], 1e-9)
    gained = np.sum(
        space["first"] * -np.log1p(-np.minimum(growth * space["burn"], 0.98)) / growth, axis=1
    )
    return {
        "range_km": [round(value, 1) for value in NODES_KM.tolist()],
        "density": [float(f"{value:.3g}") for value in np.maximum(density, 1e-3).tolist()],
        "elevation": [
            float(f"{value:.2g}")
            for value in (steep.mean(), steep.std(), climbs.sum() / flies.sum())
        ],
        "glide": float(f"{glide:.2g}"),
        "orbit": float(f"{np.mean(gained > ORBIT_M_S):.2g}"),
    }
