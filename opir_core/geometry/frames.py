"""From the Earth-fixed frame to the inertial one and back: one rotation about z.

ECI is ECEF frozen at the scene epoch: the frames coincide at `time_s` = 0.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry.vectors import components, floats, vector


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def ecef_to_eci(position_m: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Return ECEF vectors (..., 3) in ECI at `time_s` seconds since scene epoch."""
    return _turned(position_m, EARTH_ROTATION_RAD_S * floats(time_s))


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def eci_to_ecef(position_m: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Return ECI vectors (..., 3) in ECEF at `time_s` seconds since scene epoch."""
    return _turned(position_m, -EARTH_ROTATION_RAD_S * floats(time_s))


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def ecef_to_eci_state(
    position_m: ArrayLike, velocity_m_s: ArrayLike, time_s: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return position (m) and velocity (m/s) in ECI of a state given in ECEF: v + omega x r, turned."""
    position, velocity = np.broadcast_arrays(floats(position_m), floats(velocity_m_s))
    x, y, _ = components(position)
    vx, vy, vz = components(velocity)
    carried = vector(vx - EARTH_ROTATION_RAD_S * y, vy + EARTH_ROTATION_RAD_S * x, vz)
    return ecef_to_eci(position, time_s), ecef_to_eci(carried, time_s)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def eci_to_ecef_state(
    position_m: ArrayLike, velocity_m_s: ArrayLike, time_s: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return position (m) and velocity (m/s) relative to the turning Earth of a state given in ECI."""
    inertial_position, inertial_velocity = np.broadcast_arrays(floats(position_m), floats(velocity_m_s))
    position = eci_to_ecef(inertial_position, time_s)
    x, y, _ = components(position)
    vx, vy, vz = components(eci_to_ecef(inertial_velocity, time_s))
    return position, vector(vx + EARTH_ROTATION_RAD_S * y, vy - EARTH_ROTATION_RAD_S * x, vz)


def _turned(vectors: ArrayLike, angle_rad: FloatArray) -> FloatArray:
    """Return vectors turned about z by an angle."""
    x, y, z = components(vectors)
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return vector(cosine * x - sine * y, sine * x + cosine * y, z)
