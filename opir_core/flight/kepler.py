"""Two-body propagation of position and velocity, every conic, forward and back."""

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.stumpff import Floats
from opir_core.flight.universal_anomaly import solve

#: States a block: large enough to hide numpy's overhead, small enough for its arrays to stay in a second-level cache.
_BLOCK = 4096


class KeplerStatus(IntEnum):
    """Why a propagated state is `nan`."""

    OK = 0
    NOT_FINITE = 1
    AT_CENTRE = 2
    OUT_OF_RANGE = 3
    NOT_CONVERGED = 4


def propagate_kepler(
    position_m: ArrayLike, velocity_m_s: ArrayLike, duration_s: ArrayLike, mu_m3_s2: float = EARTH_MU_M3_S2
) -> tuple[Floats, Floats]:
    """Return position, m, and velocity, m/s, after `duration_s` on the two-body arc through the given state."""
    position, velocity, duration, shape = _columns(position_m, velocity_m_s, duration_s)
    end_position, end_velocity = np.empty_like(position), np.empty_like(velocity)
    with np.errstate(all="ignore"):
        for start in range(0, duration.size, _BLOCK):
            block = slice(start, start + _BLOCK)
            end_position[block], end_velocity[block] = _propagate_block(position[block], velocity[block], duration[block], mu_m3_s2)
    return end_position.reshape(shape + (3,)), end_velocity.reshape(shape + (3,))


def _columns(position_m: ArrayLike, velocity_m_s: ArrayLike, duration_s: ArrayLike):
    position, velocity, duration = (np.asarray(x, dtype=float) for x in (position_m, velocity_m_s, duration_s))
    shape = np.broadcast_shapes(position.shape[:-1], velocity.shape[:-1], duration.shape)
    position, velocity = (np.broadcast_to(x, (*shape, 3)).reshape(-1, 3) for x in (position, velocity))
    return position, velocity, np.broadcast_to(duration, shape).reshape(-1), shape


def _propagate_block(position: Floats, velocity: Floats, duration: Floats, mu: float):
    x, y, z = position.T
    vx, vy, vz = velocity.T
    r0 = np.sqrt(x * x + y * y + z * z)
    speed = np.sqrt(mu / r0)
    sigma = (x * vx + y * vy + z * vz) / (r0 * speed)
    alpha = 2.0 - (vx * vx + vy * vy + vz * vz) / (speed * speed)
    time = duration * (speed / r0)
    n = np.sqrt(np.abs(alpha)) * np.abs(alpha) / (2 * np.pi)
    time = np.where(alpha > 0, time - np.rint(time * n) / n, time)
    back = np.where(time < 0.0, -1.0, 1.0)
    s, g0, g1, g2 = solve(sigma * back, alpha, time * back)
    g1 = g1 * back
    r = g0 + sigma * g1 + g2
    f, g = 1.0 - g2, (g1 + sigma * g2) * (r0 / speed)
    df, dg = -g1 / r * (speed / r0), (g0 + sigma * g1) / r
    return (f[:, None] * position + g[:, None] * velocity), (df[:, None] * position + dg[:, None] * velocity)
