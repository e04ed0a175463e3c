"""Where a glider may come down: within the reach of its equilibrium glide."""

from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.estimation import dot
from opir_core.geometry import ecef_to_geodetic
from opir_trackers.filter.thrust import air_velocity
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.lines_of_sight import earth_rotated

#: Ratios of lift to drag about that of the class, shares of the reach, and standard deviation of
#: the turn, rad.
_LIFT = (0.7, 1.45)
_SHARE = (0.5, 1.1)
_TURN_RAD = np.radians(12.0)

#: Steps of an even sequence in three dimensions: powers of the inverse root of x⁴ = x + 1
#: (Kronecker's sequence).
_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)


class GlideEnds(NamedTuple):
    """Places (p, 2), latitude and longitude, rad, times (p,) and weights of gliders' ends."""

    place: FloatArray
    when_s: FloatArray
    weight: FloatArray


def reached(
    outcomes: Outcomes, state: FloatArray, out_s: FloatArray, weight: FloatArray, falls: FloatArray
) -> GlideEnds | None:
    """Return where gliders come down whose burns end with inertial states (p, 6) at times.

    `weight` (p,) are the particles' weights as gliders, `falls` (p,) those as what falls. None if
    gliders have less than the share of one particle, which regions do not resolve.

    The range of an equilibrium glide from speed v to w is R/2 · L/D · ln((1 - w²/c²) / (1 -
    v²/c²)), c the speed of an orbit (Eggers, Allen and Neice, NACA TR 1381, 1958).
    """
    glides = weight.sum()
    if not len(weight) * glides > glides + falls.sum():
        return None
    after = [outcomes.hypotheses[number].target_class for number in outcomes.columns("glide")]
    lifts: list[Any] = [one.after_burnout for one in after if one]
    count = len(state)
    even = (np.arange(count)[:, None] * _STEPS + 0.5) % 1.0
    pick = np.arange(count) % len(lifts)
    ratio = (
        np.array([one.lift_to_drag for one in lifts])[pick]
        * _LIFT[0]
        * (_LIFT[1] / _LIFT[0]) ** even[:, 0]
    )
    slow = np.array([one.final_speed_m_s for one in lifts])[pick]
    radius = np.sqrt(dot(state[:, :3], state[:, :3]))
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity))
    square = EARTH_MU_M3_S2 / radius
    keeps = np.clip(1.0 - speed * speed / square, 0.02, 1.0)
    far = (
        0.5
        * EARTH_EQUATORIAL_RADIUS_M
        * ratio
        * np.log(np.maximum((1.0 - slow * slow / square) / keeps, 1.02))
    )
    far = np.minimum(far * (_SHARE[0] + (_SHARE[1] - _SHARE[0]) * even[:, 1]), 1.9e7)
    up = state[:, :3] / radius[:, None]
    ahead = velocity - up * dot(up, velocity)[:, None]
    ahead /= np.maximum(np.sqrt(dot(ahead, ahead)), 1.0)[:, None]
    turn = _TURN_RAD * np.sqrt(12.0) * (even[:, 2] - 0.5)
    course = np.cos(turn)[:, None] * ahead + np.sin(turn)[:, None] * np.cross(up, ahead)
    angle = (far / EARTH_EQUATORIAL_RADIUS_M)[:, None]
    there = EARTH_EQUATORIAL_RADIUS_M * (np.cos(angle) * up + np.sin(angle) * course)
    # Courses are over the ground, which turns with it.
    found = ecef_to_geodetic(earth_rotated(there, -out_s))
    when = out_s + far / np.maximum(0.6 * speed, 100.0)
    return GlideEnds(np.stack([found.latitude_rad, found.longitude_rad], axis=1), when, weight)
