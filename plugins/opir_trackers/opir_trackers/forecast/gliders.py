"""Impact points of gliders: within the reach of their equilibrium glide."""

from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.estimation import dot
from opir_core.geometry import ecef_to_geodetic
from opir_trackers.filter.thrust import air_velocity
from opir_trackers.forecast.burning_on import LAW
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.lines_of_sight import earth_rotated

#: Steps of an even sequence in three dimensions: powers of the inverse root of x⁴ = x + 1
#: (Kronecker's sequence).
_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)


class GlideEnds(NamedTuple):
    """Places (p, 2), latitude and longitude, rad, times (p,) and weights of gliders' ends."""

    place: FloatArray
    time_s: FloatArray
    weight: FloatArray


def glide_ends(
    outcomes: Outcomes, state: FloatArray, out_s: FloatArray, weight: FloatArray, falls: FloatArray
) -> GlideEnds | None:
    """Return the ends of gliders whose burns end with inertial states (p, 6) at times.

    `weight` (p,) are the particles' weights as gliders, `falls` (p,) those of ballistic impacts.
    None if gliders have less than the share of one particle, which regions do not resolve.
    """
    glides = weight.sum()
    if not len(weight) * glides > glides + falls.sum():
        return None
    even = (np.arange(len(state))[:, None] * _STEPS + 0.5) % 1.0
    radius = np.sqrt(dot(state[:, :3], state[:, :3]))
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity))
    range_m = _glide_ranges_m(outcomes, radius, speed, even)
    up = state[:, :3] / radius[:, None]
    forwards = velocity - up * dot(up, velocity)[:, None]
    forwards /= np.maximum(np.sqrt(dot(forwards, forwards)), 1.0)[:, None]
    turn = np.radians(LAW.glide_turn_deg) * np.sqrt(12.0) * (even[:, 2] - 0.5)
    course = np.cos(turn)[:, None] * forwards + np.sin(turn)[:, None] * np.cross(up, forwards)
    angle = (range_m / EARTH_EQUATORIAL_RADIUS_M)[:, None]
    end = EARTH_EQUATORIAL_RADIUS_M * (np.cos(angle) * up + np.sin(angle) * course)
    # Courses are over the ground, which turns with it.
    point = ecef_to_geodetic(earth_rotated(end, -out_s))
    time_s = out_s + range_m / np.maximum(0.6 * speed, 100.0)
    return GlideEnds(np.stack([point.latitude_rad, point.longitude_rad], axis=1), time_s, weight)


def _glide_ranges_m(
    outcomes: Outcomes, radius: FloatArray, speed: FloatArray, even: FloatArray
) -> FloatArray:
    """Return the ranges (p,), m, of glides from radii and speeds (p,), by even draws (p, 3).

    The range of an equilibrium glide from speed v to w is R/2 · L/D · ln((1 - w²/c²) / (1 -
    v²/c²)), c the speed of an orbit (Eggers, Allen and Neice, NACA TR 1381, 1958).
    """
    classes = [outcomes.hypotheses[number].target_class for number in outcomes.columns("glide")]
    glides: list[Any] = [glider.after_burnout for glider in classes if glider]
    pick = np.arange(len(radius)) % len(glides)
    lift_to_drag, final_m_s = np.array(
        [(glide.lift_to_drag, glide.final_speed_m_s) for glide in glides]
    )[pick].T
    low, high = LAW.glide_ratio
    ratio = lift_to_drag * low * (high / low) ** even[:, 0]
    square = EARTH_MU_M3_S2 / radius
    start = np.clip(1.0 - speed * speed / square, 0.02, 1.0)
    log = np.log(np.maximum((1.0 - final_m_s * final_m_s / square) / start, 1.02))
    reach = 0.5 * EARTH_EQUATORIAL_RADIUS_M * ratio * log
    low, high = LAW.glide_share
    share = low + (high - low) * even[:, 1]
    return np.minimum(reach * share, LAW.farthest_glide_m)
