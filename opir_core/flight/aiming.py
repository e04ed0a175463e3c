"""Aiming: the burnout state whose free flight comes down at the aim point, on the rotating WGS 84 Earth.

Two unknowns, launch azimuth and burnout speed, meet the two coordinates of the aim point. The burnout flight path angle
is the profile's, shifted with range as that of minimum-energy arcs is, (pi - psi)/4 over a ground angle psi (Bate,
Mueller and White, Fundamentals of Astrodynamics, 1971, section 6.2): longer ranges fly flatter.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from opir_core.flight.ascent import ascent
from opir_core.flight.boost import BoostPath, boost_path, launch_site
from opir_core.flight.profiles import BoostProfile
from opir_core.flight.shooting import solved
from opir_core.flight.shot import Shot
from opir_core.geometry import Geodetic, ecef_to_eci_state, geodesic_inverse, geodetic_to_ecef

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel, Forces

#: The mean radius of the Earth that turns ranges into angles, m (IUGG: (2 a + b)/3 of WGS 84).
_MEAN_RADIUS_M = EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING / 3.0)

#: Up to here Lambert's formula is within 90 m of the geodesic, m.
_LAMBERT_REACH_M = 1.59e7


@frozen(eq=False)
class Aim:
    """The flights of n targets from launch to aim point: columns (n,) and (n, 3).

    `azimuth_rad` is the launch azimuth, clockwise from true north; burnout speed and flight path angle and the ECEF
    velocity are relative to the Earth. ECI is ECEF frozen at scene epoch. `miss_m` is the distance of the impact from
    the aim point. Where `converged` is False, `complaints` says why, and what depends on the solution is nan.
    """

    range_m: FloatArray
    azimuth_rad: FloatArray
    burnout_speed_m_s: FloatArray
    burnout_flight_path_angle_rad: FloatArray
    burnout_s: FloatArray
    burnout_position_ecef_m: FloatArray
    burnout_velocity_ecef_m_s: FloatArray
    burnout_position_eci_m: FloatArray
    burnout_velocity_eci_m_s: FloatArray
    impact_s: FloatArray
    impact_ecef_m: FloatArray
    miss_m: FloatArray
    converged: BoolArray
    complaints: tuple[str, ...]
    path: BoostPath


def aim(
    launch: Geodetic,
    aim_point: Geodetic,
    ignition_s: ArrayLike,
    profiles: Sequence[BoostProfile],
    *,
    forces: "ForceModel" = "kepler",
    tolerance_m: float = 0.01,
) -> Aim:
    """Return the flights of n targets, one profile each; launches, aim points and ignition times broadcast to (n,).

    `forces` act from burnout to impact; a ballistic coefficient is one number, or one each (n,). Targets whose aim
    point lies outside the range of their profile, or is not met to within the tolerance, are reported in `complaints`.
    """
    n = len(profiles)
    launch, aim_point = (Geodetic(*(_column(v, n) for v in place)) for place in (launch, aim_point))
    range_m = surface_range_m(
        launch.latitude_rad, launch.longitude_rad, aim_point.latitude_rad, aim_point.longitude_rad
    )
    site, course = launch_site(*launch), ascent(profiles, _flight_path_angle_rad(range_m, profiles))
    shot = Shot(site, course, geodetic_to_ecef(*aim_point), aim_point.height_m, _forces_of(forces, n))
    azimuth_rad, speed_m_s = _solved_within_limits(shot, range_m, profiles, tolerance_m)
    landing = shot.landing(azimuth_rad, speed_m_s)
    converged = landing.miss_m <= tolerance_m
    path = boost_path(site, _column(ignition_s, n), azimuth_rad, speed_m_s, course)
    return Aim(
        range_m,
        np.remainder(azimuth_rad, 2.0 * np.pi),
        speed_m_s,
        0.5 * np.pi - course.turn_rad,
        path.burnout_s,
        *_burnout_states(path),
        path.burnout_s + landing.duration_s,
        landing.impact_ecef_m,
        landing.miss_m,
        converged,
        _complaints(range_m, profiles, converged),
        path,
    )


def surface_range_m(
    latitude_1_rad: ArrayLike, longitude_1_rad: ArrayLike, latitude_2_rad: ArrayLike, longitude_2_rad: ArrayLike
) -> FloatArray:
    """Return the distance over the WGS 84 ellipsoid between two places, m, to 90 m.

    Lambert's formula for long lines, first order in the flattening; beyond 15 900 km, where it fails, the geodesic.
    """
    arguments = (latitude_1_rad, longitude_1_rad, latitude_2_rad, longitude_2_rad)
    places = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in arguments))
    distance = np.asarray(_lambert_range_m(*places))
    far = distance > _LAMBERT_REACH_M
    if far.any():
        distance[far] = geodesic_inverse(*(v[far] for v in places)).distance_m
    return distance


def _lambert_range_m(
    latitude_1: FloatArray, longitude_1: FloatArray, latitude_2: FloatArray, longitude_2: FloatArray
) -> FloatArray:
    beta_1, beta_2 = (np.arctan((1.0 - EARTH_FLATTENING) * np.tan(v)) for v in (latitude_1, latitude_2))
    half_sum, half_difference = 0.5 * (beta_1 + beta_2), 0.5 * (beta_2 - beta_1)
    half_turn = 0.5 * (longitude_2 - longitude_1)
    spread = np.cos(beta_1) * np.cos(beta_2)
    sin_sum, cos_sum = np.sin(half_sum) ** 2, np.cos(half_sum) ** 2
    sin_difference, cos_difference = np.sin(half_difference) ** 2, np.cos(half_difference) ** 2
    chord = sin_difference + spread * np.sin(half_turn) ** 2
    antichord = sin_sum + spread * np.cos(half_turn) ** 2
    angle = 2.0 * np.arctan2(np.sqrt(chord), np.sqrt(antichord))
    x = (angle - np.sin(angle)) * sin_sum * cos_difference / np.where(antichord > 0.0, antichord, 1.0)
    y = (angle + np.sin(angle)) * cos_sum * sin_difference / np.where(chord > 0.0, chord, 1.0)
    distance: FloatArray = EARTH_EQUATORIAL_RADIUS_M * (angle - 0.5 * EARTH_FLATTENING * (x + y))
    return distance


def _burnout_states(path: BoostPath) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return position and velocity at burnout, ECEF and then ECI, each (n, 3)."""
    ecef = path.state(np.arange(len(path.burnout_s)), path.burnout_s)
    return *ecef, *ecef_to_eci_state(*ecef, path.burnout_s)


def _forces_of(model: "ForceModel", n: int) -> "Forces | None":
    """Return the forces on n targets, None for two-body motion, which imports no numerical propagation."""
    if model == "kepler":
        return None
    from opir_core.flight.forces import forces_of

    return forces_of(model).broadcast(n)


def _solved_within_limits(
    shot: Shot, range_m: FloatArray, profiles: Sequence[BoostProfile], tolerance_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and burnout speeds (n,), nan where the aim point is out of the profile's range."""
    azimuth_rad, speed_m_s = np.full(len(range_m), np.nan), np.full(len(range_m), np.nan)
    rows = np.flatnonzero(_is_within_limits(range_m, profiles))
    azimuth_rad[rows], speed_m_s[rows] = solved(shot.take(rows), tolerance_m)
    return azimuth_rad, speed_m_s


def _flight_path_angle_rad(range_m: FloatArray, profiles: Sequence[BoostProfile]) -> FloatArray:
    """Return burnout flight path angles (n,): the profile's at its reference range, flatter beyond it."""
    reference_rad = np.array([profile.burnout_flight_path_angle_rad for profile in profiles])
    reference_m = np.array([profile.reference_range_m for profile in profiles])
    return reference_rad + 0.25 * (reference_m - range_m) / _MEAN_RADIUS_M


def _is_within_limits(range_m: FloatArray, profiles: Sequence[BoostProfile]) -> BoolArray:
    shortest = np.array([profile.minimum_range_m for profile in profiles])
    longest = np.array([profile.maximum_range_m for profile in profiles])
    return (range_m >= shortest) & (range_m <= longest)


def _complaints(range_m: FloatArray, profiles: Sequence[BoostProfile], converged: BoolArray) -> tuple[str, ...]:
    """Return for each target why it cannot reach its aim point, or an empty string."""
    within = _is_within_limits(range_m, profiles)
    return tuple(
        "" if hits else _complaint(range_m[row], profile, bool(within[row]))
        for row, (profile, hits) in enumerate(zip(profiles, converged, strict=True))
    )


def _complaint(range_m: float, profile: BoostProfile, is_within_limits: bool) -> str:
    distance = f"the aim point is {range_m / 1e3:.0f} km from the launch point"
    limits = f"{profile.name} flies {profile.minimum_range_m / 1e3:g} to {profile.maximum_range_m / 1e3:g} km"
    if is_within_limits:
        return f"{distance}; no flight of {profile.name} was found that comes down on it, although {limits}"
    return f"{distance}; {limits}"


def _column(values: ArrayLike, n: int) -> FloatArray:
    return np.broadcast_to(np.asarray(values, dtype=np.float64), (n,))
