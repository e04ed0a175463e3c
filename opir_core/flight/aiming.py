"""Aiming: the launch azimuth and burnout speed of flights that reach their aim points on the
rotating WGS 84 Earth.

The burnout flight path angle is that of the profile, shifted with range as for minimum-energy arcs,
(pi - psi)/4 over a ground angle psi (Bate, Mueller and White, Fundamentals of Astrodynamics, 1971,
section 6.2): longer ranges fly flatter. Azimuth and speed then follow by Newton's method, with the
derivatives of two-body arcs under all forces, from a guess within a few percent of the range.
Flights become ephemerides in ECEF, from ignition to impact.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from attrs import evolve, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, EARTH_MU_M3_S2
from opir_core.flight.boost import Ascent, BoostPath, LaunchSite, ascent, boost_path, launch_site
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.free_flight import free_flight_ephemeris
from opir_core.flight.landing import AimedLanding, aimed_landing, corrected, polar_rad
from opir_core.flight.rows import Rows
from opir_core.geometry import (
    Geodetic,
    ecef_to_eci,
    ecef_to_eci_state,
    geodesic_inverse,
    geodetic_to_ecef,
)
from opir_core.geometry.vectors import FloatPair, components, dot, floats, length
from opir_core.scene.target_classes import BoostProfile

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel, Forces


@frozen(eq=False, repr=False)
class LaunchSolution(Rows):
    """Launches (n,) with the ECEF position (n, 3) and height (n,) of their aim points; `forces`
    None is two-body.
    """

    site: LaunchSite
    course: Ascent
    aim_ecef_m: FloatArray
    aim_height_m: FloatArray
    forces: "Forces | None" = None

    def in_two_body_motion(self) -> "LaunchSolution":
        """Return the same launches with two-body motion."""
        return self if self.forces is None else evolve(self, forces=None)

    def burnout(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> FloatPair:
        """Return burnout positions and velocities relative to the Earth, (n, 3), ECEF."""
        plane = self.site.plane(azimuth_rad)
        height_m = self.course.burnout_height_m(speed_m_s)
        swept_rad = self.course.burnout_swept_rad(speed_m_s, plane.radius_m)
        return plane.state(height_m, swept_rad, speed_m_s, self.course.turn_rad)

    def release(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> FloatPair:
        """Return positions and velocities, as `burnout` does, at which free flight begins: those at
        burnout.
        """
        return self.burnout(azimuth_rad, speed_m_s)

    def landing(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> AimedLanding:
        """Return the impacts of flights; the inertial frame is ECEF frozen at the release."""
        release = self.release(azimuth_rad, speed_m_s)
        return aimed_landing(self.site, self.aim_ecef_m, self.aim_height_m, release, self.forces)


@frozen(eq=False, repr=False)
class AimedLaunches:
    """Launches (n,) at their aim points; nan, with complaints, where no flight comes down there."""

    azimuth_rad: FloatArray
    speed_m_s: FloatArray
    landing: AimedLanding
    converged: BoolArray
    complaints: tuple[str, ...]


@np.errstate(all="ignore")
def aimed_launches(
    shot: LaunchSolution,
    range_m: FloatArray,
    profiles: Sequence[BoostProfile],
    guess: Callable[[Any], FloatPair],
    tolerance_m: float,
) -> AimedLaunches:
    """Return the launches that hit their aim points to within the tolerance.

    Those in the range limits of their profiles are solved, from `guess` in two-body motion. Without
    a solution azimuth and speed are those of the nearest trial, nan for trials without impact.
    """
    shortest_m, longest_m = _range_limits_m(profiles)
    within = (range_m >= shortest_m) & (range_m <= longest_m)
    rows = np.flatnonzero(within)
    trials = shot.take(rows)
    two_body = trials.in_two_body_motion()
    unknowns = corrected(two_body, *guess(two_body), tolerance_m)
    if two_body is not trials:
        unknowns = corrected(trials, *unknowns, tolerance_m)
    azimuth_rad = np.full(len(profiles), np.nan)
    speed_m_s = azimuth_rad.copy()
    azimuth_rad[rows], speed_m_s[rows] = unknowns
    landing = shot.landing(azimuth_rad, speed_m_s)
    converged = landing.miss_m <= tolerance_m
    complaints = tuple(
        "" if is_hit else _complaint(profile, distance_m, is_within)
        for is_hit, profile, distance_m, is_within in zip(
            converged, profiles, range_m, within, strict=True
        )
    )
    return AimedLaunches(azimuth_rad, speed_m_s, landing, converged, complaints)


def _range_limits_m(profiles: Sequence[BoostProfile]) -> FloatArray:
    """Return the shortest and longest ranges (2, n) of profiles."""
    limits = [(profile.minimum_range_m, profile.maximum_range_m) for profile in profiles]
    return np.array(limits, dtype=np.float64).reshape(-1, 2).T


def _complaint(profile: BoostProfile, range_m: float, within: bool) -> str:
    """Return why a target cannot reach its aim point."""
    distance = f"the aim point is {range_m / 1e3:.0f} km from the launch point"
    limits = (
        f"{profile.name} flies {profile.minimum_range_m / 1e3:g} to"
        f" {profile.maximum_range_m / 1e3:g} km"
    )
    if within:
        limits = f"no flight of {profile.name} was found that comes down on it, although {limits}"
    return f"{distance}; {limits}"


def _guess(shot: LaunchSolution) -> FloatPair:
    """Return first guesses of azimuths and burnout speeds."""
    # First for a sphere at rest, with burnout at the launch point.
    psi, azimuth_rad = polar_rad(shot.site, shot.aim_ecef_m)
    radius_m = length(*components(shot.site.launch_m))
    speed_m_s = hitting_speed_m_s(radius_m, radius_m, 0.5 * np.pi - shot.course.turn_rad, psi)
    landing = shot.landing(azimuth_rad, speed_m_s)
    distance_m = landing.distance_m()
    duration_s = landing.duration_s
    for _ in range(2):
        azimuth, speed = _guess_in_rotation(shot, azimuth_rad, speed_m_s, duration_s)
        landing = shot.landing(azimuth, speed)
        nearer = (landing.distance_m() < distance_m) | np.isnan(distance_m)
        azimuth_rad = np.where(nearer, azimuth, azimuth_rad)
        speed_m_s = np.where(nearer, speed, speed_m_s)
        distance_m = np.where(nearer, landing.distance_m(), distance_m)
        duration_s = np.where(nearer, landing.duration_s, duration_s)
    return azimuth_rad, speed_m_s


def _guess_in_rotation(
    shot: LaunchSolution, azimuth_rad: FloatArray, speed_m_s: FloatArray, duration_s: FloatArray
) -> FloatPair:
    """Return better azimuths and burnout speeds, from a guess and its time of free flight.

    The aim point is rotated by that time and hit in the inertial frame, from the burnout point and
    inertial flight path angle of the guess; the velocity of the Earth's rotation is then
    subtracted.
    """
    position, relative = shot.burnout(azimuth_rad, speed_m_s)
    _, inertial = ecef_to_eci_state(position, relative, 0.0)
    aim = ecef_to_eci(shot.aim_ecef_m, np.where(np.isfinite(duration_s), duration_s, 0.0))
    up, radius_m = _direction(position)
    heading, _ = _direction(_level(aim, up))
    level_m_s = length(*components(_level(inertial, up)))
    gamma = np.arctan2(dot(inertial, up), level_m_s)
    psi = np.arctan2(dot(aim, heading), dot(aim, up))
    speed = hitting_speed_m_s(radius_m, length(*components(aim)), gamma, psi)[:, None]
    course = np.sin(gamma)[:, None] * up + np.cos(gamma)[:, None] * heading
    burnout = speed * course - (inertial - relative)
    turn = np.arctan2(dot(np.cross(burnout, relative), up), dot(_level(burnout, up), relative))
    return azimuth_rad + turn, length(*components(burnout))


def hitting_speed_m_s(
    start_m: FloatArray, end_m: FloatArray, gamma_rad: FloatArray, psi_rad: FloatArray
) -> FloatArray:
    """Return the speed of a two-body arc from one radius, at a flight path angle, to another
    radius.

    With the range angle psi, v² = (mu/r1) (1 - cos psi) / (cos gamma ((r1/r2) cos gamma - cos(gamma
    + psi))), written without cancellation (Bate, Mueller and White, Fundamentals of Astrodynamics,
    1971, section 6.2, for r1 = r2).
    """
    half_sine = np.sin(0.5 * psi_rad)
    drop = (start_m - end_m) / end_m * np.cos(gamma_rad) + 2.0 * np.sin(
        gamma_rad + 0.5 * psi_rad
    ) * half_sine
    return half_sine * np.sqrt(2.0 * EARTH_MU_M3_S2 / start_m / (np.cos(gamma_rad) * drop))


def _direction(vectors: FloatArray) -> FloatPair:
    """Return unit vectors and lengths."""
    size = length(*components(vectors))
    return vectors / size[:, None], size


def _level(vectors: FloatArray, up: FloatArray) -> FloatArray:
    """Return the components of vectors perpendicular to unit vectors."""
    return vectors - dot(vectors, up)[:, None] * up


@frozen(eq=False)
class Aim:
    """The flights of n targets from launch to aim point: columns (n,) and (n, 3).

    `azimuth_rad` is the launch azimuth, clockwise from true north; burnout speed and flight path
    angle and the ECEF velocity are relative to the Earth. ECI is ECEF frozen at scene epoch.
    `miss_m` is the distance of the impact from the aim point. Where `converged` is False,
    `complaints` says why, and what depends on the solution is nan.
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
    """Return the flights of n targets, one profile each; launches, aim points and ignition times
    broadcast to (n,).

    `forces` act from burnout to impact; a ballistic coefficient is one number, or one each (n,).
    Targets whose aim point is outside the range of their profile, or is missed by more than the
    tolerance, are reported in `complaints`.
    """
    n = len(profiles)
    launch, aim_point = (
        Geodetic(*(np.broadcast_to(floats(v), (n,)) for v in place))
        for place in (launch, aim_point)
    )
    range_m = surface_range_m(*launch[:2], *aim_point[:2])
    course = ascent(profiles, _flight_path_angle_rad(range_m, profiles))
    site = launch_site(*launch)
    aim_m = geodetic_to_ecef(*aim_point)
    shot = LaunchSolution(site, course, aim_m, aim_point.height_m, forces_on(forces, n))
    aimed = aimed_launches(shot, range_m, profiles, _guess, tolerance_m)
    path = boost_path(site, ignition_s, aimed.azimuth_rad, aimed.speed_m_s, course)
    ecef = path.state(np.arange(n), path.burnout_s)
    return Aim(
        range_m,
        np.remainder(aimed.azimuth_rad, 2.0 * np.pi),
        aimed.speed_m_s,
        0.5 * np.pi - course.turn_rad,
        path.burnout_s,
        *ecef,
        *ecef_to_eci_state(*ecef, path.burnout_s),
        path.burnout_s + aimed.landing.duration_s,
        aimed.landing.impact_ecef_m,
        aimed.landing.miss_m,
        aimed.converged,
        aimed.complaints,
        path,
    )


def surface_range_m(
    latitude_1_rad: ArrayLike,
    longitude_1_rad: ArrayLike,
    latitude_2_rad: ArrayLike,
    longitude_2_rad: ArrayLike,
) -> FloatArray:
    """Return the distance over the WGS 84 ellipsoid between two places, m, to 90 m.

    Lambert's formula for long lines, first order in the flattening; beyond 15 900 km, where it
    fails, the geodesic.
    """
    arguments = (latitude_1_rad, longitude_1_rad, latitude_2_rad, longitude_2_rad)
    places = np.broadcast_arrays(*(floats(v) for v in arguments))
    distance = np.asarray(_lambert_range_m(*places))
    beyond = distance > 1.59e7
    if beyond.any():
        distance[beyond] = geodesic_inverse(*(v[beyond] for v in places)).distance_m
    return distance


def _lambert_range_m(
    latitude_1: FloatArray, longitude_1: FloatArray, latitude_2: FloatArray, longitude_2: FloatArray
) -> FloatArray:
    beta_1, beta_2 = (
        np.arctan((1.0 - EARTH_FLATTENING) * np.tan(v)) for v in (latitude_1, latitude_2)
    )
    half_sum = 0.5 * (beta_1 + beta_2)
    half_difference = 0.5 * (beta_2 - beta_1)
    half_turn = 0.5 * (longitude_2 - longitude_1)
    spread = np.cos(beta_1) * np.cos(beta_2)
    sin_sum = np.sin(half_sum) ** 2
    cos_sum = np.cos(half_sum) ** 2
    sin_difference = np.sin(half_difference) ** 2
    cos_difference = np.cos(half_difference) ** 2
    chord = sin_difference + spread * np.sin(half_turn) ** 2
    antichord = sin_sum + spread * np.cos(half_turn) ** 2
    angle = 2.0 * np.arctan2(np.sqrt(chord), np.sqrt(antichord))
    x = (
        (angle - np.sin(angle))
        * sin_sum
        * cos_difference
        / np.where(antichord > 0.0, antichord, 1.0)
    )
    y = (angle + np.sin(angle)) * cos_sum * sin_difference / np.where(chord > 0.0, chord, 1.0)
    return EARTH_EQUATORIAL_RADIUS_M * (angle - 0.5 * EARTH_FLATTENING * (x + y))


def forces_on(model: "ForceModel", n: int) -> "Forces | None":
    """Return the forces on n targets; None, without importing numerical propagation, for two-body
    motion.
    """
    if model == "kepler":
        return None
    from opir_core.flight.forces import forces_of

    return forces_of(model).broadcast(n)


def _flight_path_angle_rad(range_m: FloatArray, profiles: Sequence[BoostProfile]) -> FloatArray:
    """Return burnout flight path angles (n,): the profile's at its reference range, flatter beyond
    it.
    """
    reference_rad = np.array([profile.burnout_flight_path_angle_rad for profile in profiles])
    reference_m = np.array([profile.reference_range_m for profile in profiles])
    # The mean radius of the Earth (IUGG: (2 a + b)/3 of WGS 84).
    mean_radius_m = EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING / 3.0)
    return reference_rad + 0.25 * (reference_m - range_m) / mean_radius_m


class BoostMotion(Protocol):
    """The boosts of n targets: states in ECEF at scene times between ignition and burnout, and the
    times (n, k) at which the course is not smooth.
    """

    @property
    def ignition_s(self) -> FloatArray:
        """Scene times of ignition, (n,) s."""

    @property
    def burnout_s(self) -> FloatArray:
        """Scene times of burnout, (n,) s."""

    def state(self, target: RowArray, time_s: FloatArray) -> FloatPair:
        """Return positions, m, and velocities, m/s (m, 3), of targets (m,) at times (m,)."""

    def breakpoints_s(self) -> FloatArray:
        """Return the times (n, k) at which the course is not smooth."""


def boost_ephemeris(path: BoostMotion, tolerance_m: float = 0.01) -> Ephemeris:
    """Return the ECEF ephemeris of the boost of n targets, ignition to burnout, to a tolerance in
    m.
    """
    return Ephemeris.build(
        path.state, path.ignition_s, path.burnout_s, path.breakpoints_s(), tolerance_m
    )


def coast_ephemeris(
    flight: Aim, tolerance_m: float = 0.01, forces: "ForceModel" = "kepler"
) -> Ephemeris:
    """Return the ECEF ephemeris of the free flight of n targets, burnout to impact; `forces` as in
    `aim`.
    """
    states = flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s
    return free_flight_ephemeris(
        flight.burnout_s, flight.impact_s, *states, forces=forces, tolerance_m=tolerance_m
    )
