"""Orbit insertion: boosts on a class profile that end in a circular orbit.

At burnout the radius is that of the orbit, the velocity is at right angles to it, and the speed in
the inertial frame is that of the circular orbit, v² = mu/r (vis-viva with a = r; Bate, Mueller and
White, Fundamentals of Astrodynamics, 1971, sections 1.6 and 1.8). Burnout speed relative to the
Earth, burnout flight path angle and the pitch exponent of the profile follow from these three
conditions by Newton's method, target by target.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.flight.boost import (
    BoostPath,
    LaunchSite,
    ascent_of_shape,
    boost_path,
    launch_site,
    shape_of,
)
from opir_core.flight.universal_anomaly import cross, dot
from opir_core.geometry import Geodetic, ecef_to_eci_state
from opir_core.geometry.vectors import components, length
from opir_core.scene.target_classes import BoostProfile

#: Iterations of Newton's method, and the share of its step of the finite differences.
_STEP = 1e-6

#: The largest correction at once, of the unknowns' natural scale.
_LARGEST_STEP = 0.2

#: The largest error of an insertion: of the radius as a share of it, and of velocities as shares of
#: the orbit's speed.
_TOLERANCE = 1e-10


@frozen(eq=False, repr=False)
class Insertion:
    """The flights of n targets into circular orbits: columns (n,) and (n, 3).

    Burnout speed and the ECEF velocity are relative to the Earth; ECI is ECEF frozen at scene
    epoch. Where `converged` is False no ascent of the profile reaches the orbit, and the states are
    those of the last trial.
    """

    burnout_speed_m_s: FloatArray
    pitch_exponent: FloatArray
    burnout_s: FloatArray
    burnout_position_ecef_m: FloatArray
    burnout_velocity_ecef_m_s: FloatArray
    burnout_position_eci_m: FloatArray
    burnout_velocity_eci_m_s: FloatArray
    converged: BoolArray
    path: BoostPath


@frozen(eq=False, repr=False)
class _Ascents:
    """Launches (n,) with their burn times, pitch starts and speed shapes, and the radius of the
    orbit.
    """

    site: LaunchSite
    azimuth_rad: FloatArray
    burn_s: FloatArray
    start_s: FloatArray
    shape: FloatArray
    radius_m: FloatArray

    def errors(self, unknowns: FloatArray) -> FloatArray:
        """Return the errors (3, n) of trials (3, n): radius, radial speed and inertial speed, as
        shares.

        The unknowns are the logarithms of burnout speed, m/s, and of the pitch exponent, and the
        turn from the vertical, rad.
        """
        speed_m_s = np.exp(unknowns[0])
        exponent = np.exp(unknowns[1])
        turn_rad = unknowns[2]
        course = ascent_of_shape(self.burn_s, self.start_s, self.shape, exponent, turn_rad)
        plane = self.site.plane(self.azimuth_rad)
        height_m = course.burnout_height_m(speed_m_s)
        swept_rad = course.burnout_swept_rad(speed_m_s, plane.radius_m)
        position, velocity = ecef_to_eci_state(
            *plane.state(height_m, swept_rad, speed_m_s, turn_rad), 0.0
        )
        radius_m = length(*components(position))
        orbital_m_s = np.sqrt(EARTH_MU_M3_S2 / self.radius_m)
        radial_m_s = np.sum(position * velocity, axis=1) / radius_m
        inertial_m_s = length(*components(velocity))
        return np.stack(
            [
                radius_m / self.radius_m - 1.0,
                radial_m_s / orbital_m_s,
                inertial_m_s / orbital_m_s - 1.0,
            ]
        )


@np.errstate(all="ignore")
def insertion(
    launch: Geodetic,
    ignition_s: FloatArray,
    azimuth_rad: FloatArray,
    altitude_m: FloatArray,
    profiles: Sequence[BoostProfile],
) -> Insertion:
    """Return the flights of n targets, one profile each, into circular orbits; columns (n,).

    `azimuth_rad` is the launch azimuth over the rotating Earth, clockwise from true north;
    `altitude_m` that of the orbit above the equatorial radius.
    """
    burn, start, shape, exponent = shape_of(profiles)
    radius_m = EARTH_EQUATORIAL_RADIUS_M + altitude_m
    ascents = _Ascents(launch_site(*launch), azimuth_rad, burn, start, shape, radius_m)
    right_angle = np.full(len(profiles), 0.5 * np.pi)
    unknowns, converged = _solved(
        ascents, np.stack([0.5 * np.log(EARTH_MU_M3_S2 / radius_m), np.log(exponent), right_angle])
    )
    speed_m_s = np.exp(unknowns[0])
    exponent = np.exp(unknowns[1])
    turn_rad = unknowns[2]
    course = ascent_of_shape(burn, start, shape, exponent, turn_rad)
    path = boost_path(ascents.site, ignition_s, azimuth_rad, speed_m_s, course)
    ecef = path.state(np.arange(len(profiles)), path.burnout_s)
    eci = ecef_to_eci_state(*ecef, path.burnout_s)
    return Insertion(speed_m_s, exponent, path.burnout_s, *ecef, *eci, converged, path)


def _solved(ascents: _Ascents, unknowns: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the unknowns (3, n) after Newton's method for each target, and which have
    converged.
    """
    errors = ascents.errors(unknowns)
    for _ in range(30):
        is_open = ~(np.abs(errors).max(axis=0) <= _TOLERANCE)
        if not is_open.any():
            break
        # Each unknown of order one: a logarithm or an angle.
        slopes = np.stack(
            [
                (ascents.errors(unknowns + _STEP * axis[:, None]) - errors) / _STEP
                for axis in np.eye(3)
            ]
        )
        step = _step(slopes, errors)
        unknowns = np.where(is_open, unknowns - step, unknowns)
        errors = ascents.errors(unknowns)
    return unknowns, np.abs(errors).max(axis=0) <= _TOLERANCE


def _step(slopes: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the corrections (3, n) that cancel errors (3, n), by Cramer's rule, of bounded size.

    `slopes[k]` (3, n) are the derivatives of the errors in unknown k.
    """
    a, b, c = slopes
    determinant = _triple(a, b, c)
    step = (
        np.stack([_triple(errors, b, c), _triple(a, errors, c), _triple(a, b, errors)])
        / determinant
    )
    return step * (_LARGEST_STEP / np.maximum(np.abs(step).max(axis=0), _LARGEST_STEP))


def _triple(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the determinants (n,) of the matrices with columns a, b and c, (3, n)."""
    return dot(a, cross(b, c))
