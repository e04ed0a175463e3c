"""Where and when a two-body arc comes down through the WGS 84 ellipsoid, or through a surface of constant height above it."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.constants import (
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_MU_M3_S2,
    EARTH_POLAR_RADIUS_M,
)
from opir_core.flight.stumpff import Floats, universal_functions

_NEWTON_STEPS = 8


def kepler_impact(
    position_m: ArrayLike, velocity_m_s: ArrayLike, height_m: ArrayLike = 0.0, mu_m3_s2: float = EARTH_MU_M3_S2
) -> tuple[Floats, Floats]:
    """Return the time to impact, s, and the point of impact, m (ECI), of two-body arcs from the given states.

    The impact is the first descent through the surface of geodetic height `height_m` above the WGS 84 ellipsoid, whose axis is
    the z axis of the frame; a start on or below the surface first has to rise through it. `nan` where there is none.
    """
    position, velocity = (np.asarray(x, dtype=float) for x in (position_m, velocity_m_s))
    height = np.asarray(height_m, dtype=float)
    shape = np.broadcast_shapes(position.shape[:-1], velocity.shape[:-1], height.shape)
    position, velocity = (np.broadcast_to(x, (*shape, 3)).reshape(-1, 3) for x in (position, velocity))
    with np.errstate(all="ignore"):
        duration, point = _impacts(position, velocity, np.broadcast_to(height, shape).reshape(-1), mu_m3_s2)
    return duration.reshape(shape), point.reshape((*shape, 3))


def _impacts(position: Floats, velocity: Floats, height: Floats, mu: float) -> tuple[Floats, Floats]:
    r0 = np.sqrt(_dot(position, position))
    speed = np.sqrt(mu / r0)
    radial, tangent = position / r0[:, None], velocity / speed[:, None]
    sigma, alpha = _dot(radial, tangent), 2.0 - _dot(tangent, tangent)
    h = np.cross(radial, tangent)
    momentum = _dot(h, h)
    outer, inner = (EARTH_EQUATORIAL_RADIUS_M + height) / r0, (EARTH_POLAR_RADIUS_M + height) / r0
    s = _anomaly_at_radius(0.5 * (inner + outer), sigma, alpha, momentum)
    low = _anomaly_at_radius(outer, sigma, alpha, momentum)
    high = _anomaly_at_radius(inner, sigma, alpha, momentum)
    low = np.where(np.isnan(low) | (low > high), 0.0, low)
    for _ in range(_NEWTON_STEPS):
        g0, g1, g2, g3 = universal_functions(alpha, s)
        r = g0 + sigma * g1 + g2
        point = position * (1.0 - g2)[:, None] + (r0 * (g1 + sigma * g2))[:, None] * tangent
        rate = (radial * -g1[:, None] + tangent * (g0 + sigma * g1)[:, None])
        altitude, normal = _height_and_normal(point)
        s = np.clip(s - (altitude - height) / (r0 * _dot(normal, rate)), low, high)
    duration = (g1 + sigma * g2 + g3) * (r0 / speed)
    missed = ~(np.abs(altitude - height) < 1e-6)
    return np.where(missed, np.nan, duration), np.where(missed[:, None], np.nan, point)


def _dot(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _anomaly_at_radius(radius: Floats, sigma: Floats, alpha: Floats, momentum: Floats) -> Floats:
    """Return the first universal anomaly > 0 at which the arc descends through `radius` (in units of its start)."""
    end = -np.sqrt(radius * (2.0 - alpha * radius) - momentum)
    rising = sigma > 0.0
    over = np.where(rising, sigma - end, 1.0 - radius)
    under = np.where(rising, alpha * (radius + 1.0) - 2.0, -sigma - end)
    k = np.sqrt(np.abs(alpha))
    half = np.arctan2(k * over, under)
    bound = 2.0 * np.where(half < 0.0, half + np.pi, half) / k
    tangent = over / under
    z = alpha * tangent * tangent
    free = 2.0 * np.arctanh(k * tangent) / k
    small = 2.0 * tangent * (1.0 - z * (1.0 / 3.0 - z / 5.0))
    s = np.where(np.abs(z) < 1e-6, small, np.where(alpha > 0.0, bound, free))
    return np.where((alpha > 0.0) & (s < 0.0), bound, np.where(s >= 0.0, s, np.nan))


def _height_and_normal(point: Floats) -> tuple[Floats, Floats]:
    """Return height above the ellipsoid, m, and the outward unit normal (Bowring, Survey Review 23, 1976)."""
    e2, a, b = EARTH_ECCENTRICITY_SQUARED, EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
    x, y, z = point.T
    rho = np.hypot(x, y)
    reduced = np.hypot(b * rho, a * z)
    cos_u, sin_u = b * rho / reduced, a * z / reduced
    over, under = z + e2 * a * a / b * sin_u**3, rho - e2 * a * cos_u**3
    length = np.hypot(over, under)
    cos_lat, sin_lat = under / length, over / length
    height = rho * cos_lat + z * sin_lat - a * np.sqrt(1.0 - e2 * sin_lat * sin_lat)
    east_free = np.where(rho > 0.0, rho, 1.0)
    normal = np.stack([cos_lat * x / east_free, cos_lat * y / east_free, sin_lat], axis=1)
    return height, normal
