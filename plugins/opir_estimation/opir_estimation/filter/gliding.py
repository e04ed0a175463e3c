"""Where a glider is that is seen no more: a coasting track falls freely, but lift carries a glider
and drag slows it.

In an equilibrium glide lift is the weight less the centrifugal force, g - v²/r. What a glider does
besides, pull up, bank or sink, is a spread about that. Over tens of seconds these forces are
constant.
"""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_estimation.directions import dot
from opir_estimation.lines_of_sight import ground_velocities

#: Lift upwards and aside and drag, as shares of the weight less the centrifugal force: means and
#: standard deviations. Ratios of lift to drag from 1.5 to 4, and banks up to 30°; notional.
_MEAN = np.array([1.0, 0.0, -0.45])
_SIGMA = np.array([0.5, 0.4, 0.2])


def glided(
    state: FloatArray, covariance: FloatArray, since_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states (n, 6) in ECEF and covariances (n, 6, 6) of gliders, given those of free falls
    for (n,) s.
    """
    place = state[:, :3]
    velocity = state[:, 3:]
    axes = _glide_axes(place / np.sqrt(dot(place, place))[:, None], velocity)
    weight = _carried_m_s2(place, velocity + ground_velocities(place))
    moved = np.stack([0.5 * since_s * since_s, since_s], axis=1) * weight[:, None]
    side = (moved[:, :, None, None] * axes[:, None]).reshape(-1, 6, 3)
    return state + side @ _MEAN, covariance + (side * _SIGMA**2) @ side.mT


def glide_drag_m_s2(state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean forces (n,) along the flight of gliders with inertial states (n, 6), m/s²,
    below 0, and their standard deviations.
    """
    weight = _carried_m_s2(state[:, :3], state[:, 3:])
    return _MEAN[2] * weight, _SIGMA[2] * weight


def _carried_m_s2(place: FloatArray, inertial: FloatArray) -> FloatArray:
    """Return the weight less the centrifugal force (n,), at least 0, of inertial velocities (n,
    3).
    """
    radius = np.sqrt(dot(place, place))
    return np.maximum(EARTH_MU_M3_S2 / radius - dot(inertial, inertial), 0.0) / radius


def _glide_axes(up: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3, 3), as columns: up across velocities, aside, and along them."""
    speed = np.sqrt(dot(velocity, velocity))
    forward = velocity / np.maximum(speed, 1.0)[:, None]
    up = up - forward * dot(up, forward)[:, None]
    up /= np.maximum(np.sqrt(dot(up, up)), 1e-9)[:, None]
    return np.stack([up, np.cross(forward, up), forward], axis=2)
