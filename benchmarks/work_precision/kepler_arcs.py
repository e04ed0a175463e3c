"""Arcs to propagate, by class: what a warning system flies, and what breaks propagators."""

import numpy as np

from opir_core.constants import EARTH_MU_M3_S2 as MU

#: Positions, m, and velocities, m/s, (n, 3), and durations, s, (n,).
States = tuple[np.ndarray, ...]


def frames(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of unit vectors at right angles."""
    first, second = rng.normal(size=(2, count, 3))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(first, second)
    return first, second / np.linalg.norm(second, axis=1)[:, None]


def flights(
    rng: np.random.Generator, count: int, elevation: np.ndarray, speed: np.ndarray
) -> States:
    """Return burnouts at 100 to 300 km, with times anywhere up to the way back to that height."""
    up, along = frames(rng, count)
    radius = 6378e3 + rng.uniform(100e3, 300e3, count)
    climb = speed * np.sin(elevation)
    across = speed * np.cos(elevation)
    velocity = climb[:, None] * up + across[:, None] * along
    sinking = MU / radius**2 - across**2 / radius
    return (
        radius[:, None] * up,
        velocity,
        rng.uniform(0.0, 1.0, count) * np.minimum(2.0 * climb / sinking, 3600.0),
    )


def conics(
    rng: np.random.Generator, e: np.ndarray, q: np.ndarray, nu: np.ndarray, duration: np.ndarray
) -> States:
    """Return states on conics of these eccentricities, pericentre distances and true anomalies."""
    ahead, along = frames(rng, e.size)
    p = q * (1.0 + e)
    r = p / (1.0 + e * np.cos(nu))
    scale = np.sqrt(MU / p)
    position = r[:, None] * (np.cos(nu)[:, None] * ahead + np.sin(nu)[:, None] * along)
    velocity = scale[:, None] * (-np.sin(nu)[:, None] * ahead + (e + np.cos(nu))[:, None] * along)
    return position, velocity, duration


def ballistic(rng: np.random.Generator, count: int) -> States:
    return flights(
        rng, count, np.radians(rng.uniform(15.0, 80.0, count)), rng.uniform(2e3, 7.2e3, count)
    )


def near_circular(rng: np.random.Generator, count: int) -> States:
    e = 10.0 ** rng.uniform(-16.0, -3.0, count)
    q = rng.uniform(6.6e6, 4.2e7, count)
    return conics(
        rng, e, q, rng.uniform(-np.pi, np.pi, count), rng.uniform(-1.0, 1.0, count) * 86400.0
    )


def near_parabolic(rng: np.random.Generator, count: int) -> States:
    e = 1.0 + 10.0 ** rng.uniform(-15.0, -3.0, count) * rng.choice([-1.0, 1.0], count)
    return conics(
        rng,
        e,
        rng.uniform(6.5e6, 2e7, count),
        rng.uniform(-2.5, 2.5, count),
        rng.uniform(-1.0, 1.0, count) * 86400.0,
    )


def near_rectilinear(rng: np.random.Generator, count: int) -> States:
    off = 10.0 ** rng.uniform(-12.0, -7.0, count)
    return flights(rng, count, 0.5 * np.pi - off, rng.uniform(1e3, 7e3, count))


def vertical(rng: np.random.Generator, count: int) -> States:
    position, velocity, duration = flights(
        rng, count, np.full(count, 0.5 * np.pi), rng.uniform(1e3, 7e3, count)
    )
    climb = np.linalg.norm(velocity, axis=1) / np.linalg.norm(position, axis=1)
    return position, climb[:, None] * position, duration


def hyperbolic(rng: np.random.Generator, count: int) -> States:
    e = rng.uniform(1.01, 10.0, count)
    nu = 0.98 * np.arccos(-1.0 / e) * rng.uniform(-1.0, 1.0, count)
    return conics(
        rng, e, rng.uniform(6.5e6, 5e7, count), nu, rng.uniform(-1.0, 1.0, count) * 86400.0
    )


CLASSES = (ballistic, near_circular, near_parabolic, near_rectilinear, vertical, hyperbolic)
