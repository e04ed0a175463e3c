"""Arcs to propagate, by class: flights of a warning system, and arcs that break propagators."""

import numpy as np

from opir_core.constants import EARTH_MU_M3_S2 as MU

#: Positions, m, and velocities, m/s, (n, 3), and durations, s, (n,).
States = tuple[np.ndarray, ...]


def frames(rng, count):
    """Return pairs of unit vectors (n, 3) at right angles."""
    axis, side = rng.normal(size=(2, count, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    normal = np.cross(axis, side)
    return axis, normal / np.linalg.norm(normal, axis=1)[:, None]


def flights(rng, count, elevation, speed):
    """Return burnouts at 100 to 300 km, with times anywhere up to the way back to that height."""
    up, along = frames(rng, count)
    radius = 6378e3 + rng.uniform(100e3, 300e3, count)
    climb = speed * np.sin(elevation)
    across = speed * np.cos(elevation)
    velocity = climb[:, None] * up + across[:, None] * along
    sinking = MU / radius**2 - across**2 / radius
    duration = rng.uniform(0.0, 1.0, count) * np.minimum(2.0 * climb / sinking, 3600.0)
    return radius[:, None] * up, velocity, duration


def conics(rng, e, farthest_m, nu):
    """Return states on conics of these eccentricities and true anomalies, within a day."""
    pericentre, along = frames(rng, e.size)
    p = rng.uniform(6.55e6, farthest_m, e.size) * (1.0 + e)
    r = (p / (1.0 + e * np.cos(nu)))[:, None]
    scale = np.sqrt(MU / p)[:, None]
    sine = np.sin(nu)[:, None]
    cosine = np.cos(nu)[:, None]
    position = r * (cosine * pericentre + sine * along)
    velocity = scale * (-sine * pericentre + (e[:, None] + cosine) * along)
    return position, velocity, rng.uniform(-86400.0, 86400.0, e.size)


def ballistic(rng, count):
    elevation = np.radians(rng.uniform(15.0, 80.0, count))
    return flights(rng, count, elevation, rng.uniform(2e3, 7.2e3, count))


def near_circular(rng, count):
    e = 10.0 ** rng.uniform(-16.0, -3.0, count)
    return conics(rng, e, 4.2e7, rng.uniform(-np.pi, np.pi, count))


def near_parabolic(rng, count):
    e = 1.0 + 10.0 ** rng.uniform(-15.0, -3.0, count) * rng.choice([-1.0, 1.0], count)
    return conics(rng, e, 2e7, rng.uniform(-2.5, 2.5, count))


def near_rectilinear(rng, count):
    lean = 10.0 ** rng.uniform(-12.0, -7.0, count)
    return flights(rng, count, 0.5 * np.pi - lean, rng.uniform(1e3, 7e3, count))


def vertical(rng, count):
    elevation = np.full(count, 0.5 * np.pi)
    position, velocity, duration = flights(rng, count, elevation, rng.uniform(1e3, 7e3, count))
    climb = np.linalg.norm(velocity, axis=1) / np.linalg.norm(position, axis=1)
    return position, climb[:, None] * position, duration


def hyperbolic(rng, count):
    e = rng.uniform(1.01, 10.0, count)
    return conics(rng, e, 5e7, 0.98 * np.arccos(-1.0 / e) * rng.uniform(-1.0, 1.0, count))


CLASSES = (ballistic, near_circular, near_parabolic, near_rectilinear, vertical, hyperbolic)
