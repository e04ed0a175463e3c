"""Boosted flight of the generic target classes over the rotating WGS 84 Earth.

Speed and flight path angle of a class profile are relative to the Earth, and to the sphere that
osculates the ellipsoid in the launch azimuth at the launch point. The profiles, with their source,
are in `opir_core/data/class_profiles.json`: notional kinematic templates for warning simulation,
not any vehicle.

With height h above a sphere of radius R and swept angle phi, h' = v sin(gamma) and phi' = v
cos(gamma) / (R + h). After pitch-over the flight path angle varies as u^n, u = (t - tv)/(T - tv),
with a fractional n. In x = u^(1/4) height and swept angle are so smooth that one Chebyshev series
of degree 32 over the turn is exact to less than 1e-9 m for every profile. Series are integrated
exactly (Trefethen, Approximation Theory and Approximation Practice, 2013, ch. 19).
"""

from collections.abc import Mapping, Sequence
from functools import cache
from math import factorial
from types import MappingProxyType

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import EARTH_ECCENTRICITY_SQUARED, EARTH_EQUATORIAL_RADIUS_M
from opir_core.flight.rows import Rows, TrailingRows
from opir_core.geometry import east_north_up_axes, geodetic_to_ecef
from opir_core.geometry.vectors import FloatPair, floats
from opir_core.scene.target_classes import (
    Ballistic,
    BoostProfile,
    core_profiles,
    core_target_classes,
)


@cache
def boost_profiles() -> Mapping[str, BoostProfile]:
    """Return the profiles of the core's classes with ballistic flights, by name."""
    flown = {
        profile.name
        for kind in core_target_classes().values()
        for profile in kind.profiles
        if isinstance(kind.after_burnout, Ballistic)
    }
    return MappingProxyType(
        {name: profile for name, profile in core_profiles().items() if name in flown}
    )


def boost_profile(name: str) -> BoostProfile:
    """Return the profile of that name; a `ValueError` lists the known names."""
    try:
        return boost_profiles()[name]
    except KeyError:
        raise ValueError(
            f"no boost profile {name!r}; there are {', '.join(sorted(boost_profiles()))}"
        ) from None


#: Degree of the series in x; `docs/design/turn_series.py` compares other degrees and powers of u.
_DEGREE = 32


@frozen(eq=False, repr=False)
class Ascent(TrailingRows):
    """The ascents of n targets for unit burnout speed, given by profile and burnout flight path
    angle.

    Columns (n,): `burn_time_s`, `pitch_start_s`, `speed_shape`, `pitch_exponent` as in the profile;
    `turn_rad` is the burnout flight path angle from the vertical. At the 33 nodes of the turn (33,
    n): `climb_rate_s` and `sweep_rate_s` are dh/dx and (R + h) dphi/dx over burnout speed,
    `climb_s` is height over burnout speed.
    """

    burn_time_s: FloatArray
    pitch_start_s: FloatArray
    speed_shape: FloatArray
    pitch_exponent: FloatArray
    turn_rad: FloatArray
    climb_rate_s: FloatArray
    sweep_rate_s: FloatArray
    climb_s: FloatArray

    def with_turn(self, turn_rad: FloatArray) -> "Ascent":
        """Return the ascents with other burnout flight path angles from the vertical (n,)."""
        shape = self.burn_time_s, self.pitch_start_s, self.speed_shape, self.pitch_exponent
        return ascent_of_shape(*shape, turn_rad)

    def burnout_height_m(self, burnout_speed_m_s: FloatArray) -> FloatArray:
        """Return the height at burnout, (n,)."""
        return burnout_speed_m_s * self.climb_s[-1]

    def burnout_swept_rad(self, burnout_speed_m_s: FloatArray, radius_m: FloatArray) -> FloatArray:
        """Return the angle swept at burnout over spheres of that radius, (n,)."""
        flatness_s = radius_m / burnout_speed_m_s
        swept: FloatArray = np.zeros(np.shape(flatness_s))
        for weight, rate_s, climb_s in zip(
            _integral_at_nodes()[-1], self.sweep_rate_s, self.climb_s, strict=True
        ):
            swept += weight * (rate_s / (flatness_s + climb_s))
        return swept

    def climb_series_s(self) -> FloatArray:
        """Return Chebyshev coefficients (34, n) of height over burnout speed during the turn."""
        series: FloatArray = _applied(_integral_series(), self.climb_rate_s)
        series[0] += self.climb_s[0]
        return series

    def swept_series_rad(self, burnout_speed_m_s: FloatArray, radius_m: FloatArray) -> FloatArray:
        """Return Chebyshev coefficients (34, n) of the angle swept during the turn over spheres of
        that radius.
        """
        rate = self.sweep_rate_s / (radius_m / burnout_speed_m_s + self.climb_s)
        return _applied(_integral_series(), rate)


def ascent(profiles: Sequence[BoostProfile], burnout_flight_path_angle_rad: ArrayLike) -> Ascent:
    """Return the ascents of targets with these profiles, one per target, and burnout flight path
    angles (n,).
    """
    burn, start, k, n = shape_of(profiles)
    angle = floats(burnout_flight_path_angle_rad)
    return ascent_of_shape(burn, start, k, n, 0.5 * np.pi - np.broadcast_to(angle, burn.shape))


def shape_of(profiles: Sequence[BoostProfile]) -> FloatArray:
    """Return burn times, pitch starts, speed shapes and pitch exponents (4, n) of profiles."""
    names = ("burn_time_s", "pitch_start_s", "speed_shape", "pitch_exponent")
    return np.array([[getattr(profile, name) for profile in profiles] for name in names], float)


def ascent_of_shape(
    burn: FloatArray, start: FloatArray, k: FloatArray, n: FloatArray, turn: FloatArray
) -> Ascent:
    """Return the ascents (n,) of these burn times, pitch starts, speed shapes, pitch exponents and
    turns.
    """
    x = _nodes()[:, None]
    u = (x * x) * (x * x)
    pace_s = speed_ratio(start + (burn - start) * u, burn, k) * (4.0 * x * x * x) * (burn - start)
    lean = lean_rad(u, n, turn)
    climb_rate_s = pace_s * np.cos(lean)
    sweep_rate_s = pace_s * np.sin(lean)
    climb_s = vertical_climb_s(start, burn, k) + _applied(_integral_at_nodes(), climb_rate_s)
    return Ascent(burn, start, k, n, turn, climb_rate_s, sweep_rate_s, climb_s)


def speed_ratio(
    elapsed_s: FloatArray, burn_time_s: FloatArray, speed_shape: FloatArray
) -> FloatArray:
    """Return speed over burnout speed, 0 at ignition to 1 at burnout."""
    return np.expm1(speed_shape * elapsed_s / burn_time_s) / np.expm1(speed_shape)


def lean_rad(u: FloatArray, pitch_exponent: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return the angle of the velocity from the local vertical at fraction u of the turn, in [0,
    1].
    """
    return turn_rad * np.sin(0.5 * np.pi * u**pitch_exponent)


def vertical_climb_s(
    elapsed_s: FloatArray, burn_time_s: FloatArray, speed_shape: FloatArray
) -> FloatArray:
    """Return height over burnout speed in vertical flight: T (e^y - 1 - y) / (k (e^k - 1)), y = k
    t/T.

    Without cancellation for small k, where it is t²/(2T).
    """
    share = elapsed_s / burn_time_s
    return (
        elapsed_s
        * share
        * _second_exponential(speed_shape * share)
        * (speed_shape / np.expm1(speed_shape))
    )


def series_value(series: FloatArray, target: RowArray, x: FloatArray) -> FloatArray:
    """Return Chebyshev series (K, n) of targets (m,) at x in [0, 1] (m,), by Clenshaw's
    recurrence.
    """
    double_y = 4.0 * x - 2.0
    later = np.zeros_like(double_y)
    latest = np.zeros_like(double_y)
    for coefficient in series[:0:-1]:
        later, latest = latest, double_y * latest - later + coefficient[target]
    return 0.5 * double_y * latest - later + series[0][target]


def _second_exponential(y: FloatArray) -> FloatArray:
    """Return (e^y - 1 - y) / y² for y >= 0: below 1 by its Taylor series, to 1e-17."""
    small = np.minimum(y, 1.0)
    large = np.maximum(y, 1.0)
    series = np.zeros_like(y)
    for power in range(18, 1, -1):
        series = series * small + 1.0 / factorial(power)
    return np.where(y < 1.0, series, (np.expm1(large) - large) / (large * large))


@cache
def _nodes() -> FloatArray:
    """Return the Chebyshev-Lobatto points of [0, 1], ascending."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)


@cache
def _integral_series() -> FloatArray:
    """Return the matrix (34, 33) from values at the nodes to Chebyshev coefficients of the integral
    from x = 0.
    """
    node = np.arange(_DEGREE + 1)
    order = np.arange(_DEGREE + 1)[:, None]
    ends = np.where((node == 0) | (node == _DEGREE), 0.5, 1.0)
    series = np.zeros((_DEGREE + 3, _DEGREE + 1))
    series[:-2] = (2.0 / _DEGREE) * ends * np.cos(np.pi * order * (_DEGREE - node) / _DEGREE)
    series[_DEGREE] *= 0.5
    integral = np.zeros((_DEGREE + 2, _DEGREE + 1))
    integral[1:] = 0.25 * (series[:-2] - series[2:]) / np.arange(1, _DEGREE + 2)[:, None]
    signs = (-1.0) ** np.arange(1, _DEGREE + 2)[:, None]
    integral[0] = -(signs * integral[1:]).sum(axis=0)
    return integral


@cache
def _integral_at_nodes() -> FloatArray:
    """Return the matrix (33, 33) from values at the nodes to integrals from x = 0 to the nodes."""
    order = np.arange(_DEGREE + 2)
    polynomials = np.cos(np.pi * order * (_DEGREE - np.arange(_DEGREE + 1)[:, None]) / _DEGREE)
    return _applied(polynomials, _integral_series())


def _applied(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """Return matrix · columns, summed in an order that does not depend on the number of columns,
    unlike BLAS.
    """
    total = np.zeros((len(matrix), *columns.shape[1:]))
    for weights, row in zip(matrix.T, columns, strict=True):
        total += weights[:, None] * row
    return total


@frozen(eq=False, repr=False)
class LaunchPlane(Rows):
    """The vertical plane of each of n launches: vectors (n, 3) in ECEF, and the radius (n,) of the
    circle in it.
    """

    launch_m: FloatArray
    up: FloatArray
    heading: FloatArray
    radius_m: FloatArray

    def state(
        self,
        height_m: FloatArray,
        swept_rad: FloatArray,
        speed_m_s: FloatArray,
        lean_rad: FloatArray,
    ) -> FloatPair:
        """Return ECEF position and velocity relative to the Earth, (n, 3), from the course in the
        plane, (n,).

        The position is launch + (h cos(phi) - 2 R sin²(phi/2)) up + (R + h) sin(phi) heading,
        without cancellation near the ground.
        """
        half = np.sin(0.5 * swept_rad)
        rise = height_m * np.cos(swept_rad) - 2.0 * self.radius_m * half * half
        along = (self.radius_m + height_m) * np.sin(swept_rad)
        tilt = lean_rad + swept_rad
        velocity = self._combined(speed_m_s * np.cos(tilt), speed_m_s * np.sin(tilt))
        return self.launch_m + self._combined(rise, along), velocity

    def _combined(self, rise: FloatArray, along: FloatArray) -> FloatArray:
        return rise[:, None] * self.up + along[:, None] * self.heading


@frozen(eq=False, repr=False)
class LaunchSite(Rows):
    """The sites of n launches: position (n, 3) and axes east, north, up (n, 3, 3) in ECEF, radii of
    curvature (n,).
    """

    launch_m: FloatArray
    axes: FloatArray
    meridian_radius_m: FloatArray
    normal_radius_m: FloatArray

    def plane(self, azimuth_rad: FloatArray) -> LaunchPlane:
        """Return the planes of launches with these azimuths (n,), clockwise from true north
        (Euler's radius).
        """
        sine = np.sin(azimuth_rad)
        cosine = np.cos(azimuth_rad)
        curvature = cosine * cosine / self.meridian_radius_m + sine * sine / self.normal_radius_m
        heading = sine[:, None] * self.axes[:, 0] + cosine[:, None] * self.axes[:, 1]
        return LaunchPlane(self.launch_m, self.axes[:, 2], heading, 1.0 / curvature)


def launch_site(
    latitude_rad: ArrayLike, longitude_rad: ArrayLike, height_m: ArrayLike
) -> LaunchSite:
    """Return the launch sites at geodetic coordinates that broadcast to (n,); at a pole longitude
    orients the axes.
    """
    columns = np.broadcast_arrays(*(floats(v) for v in (latitude_rad, longitude_rad, height_m)))
    latitude, longitude, height = (np.atleast_1d(column).ravel() for column in columns)
    sine = np.sin(latitude)
    w = 1.0 - EARTH_ECCENTRICITY_SQUARED * sine * sine
    normal = EARTH_EQUATORIAL_RADIUS_M / np.sqrt(w)
    meridian = normal * (1.0 - EARTH_ECCENTRICITY_SQUARED) / w
    launch = geodetic_to_ecef(latitude, longitude, height)
    return LaunchSite(
        launch, east_north_up_axes(latitude, longitude), meridian + height, normal + height
    )


@frozen(eq=False)
class BoostPath:
    """The boosted flight of n targets, ignition to burnout."""

    ignition_s: FloatArray
    burnout_s: FloatArray
    burnout_speed_m_s: FloatArray
    plane: LaunchPlane
    ascent: Ascent
    _climb_series_s: FloatArray
    _swept_series_rad: FloatArray

    def state(self, target: RowArray, time_s: FloatArray) -> FloatPair:
        """Return ECEF positions and velocities relative to the Earth (m, 3) of targets (m,) at
        times (m,).

        Outside ignition to burnout both are nan.
        """
        course = self.ascent
        burn = course.burn_time_s[target]
        start = course.pitch_start_s[target]
        k = course.speed_shape[target]
        burning = (time_s >= self.ignition_s[target]) & (time_s <= self.burnout_s[target])
        elapsed = np.minimum(np.where(burning, time_s - self.ignition_s[target], 0.0), burn)
        u = np.maximum((elapsed - start) / (burn - start), 0.0)
        x = np.sqrt(np.sqrt(u))
        swept = series_value(self._swept_series_rad, target, x)
        climb = np.where(
            elapsed < start,
            vertical_climb_s(elapsed, burn, k),
            series_value(self._climb_series_s, target, x),
        )
        speed = np.where(burning, self.burnout_speed_m_s[target], np.nan)
        lean = lean_rad(u, course.pitch_exponent[target], course.turn_rad[target])
        return self.plane.take(target).state(
            speed * climb, swept, speed * speed_ratio(elapsed, burn, k), lean
        )

    def breakpoints_s(self) -> FloatArray:
        """Return the times (n, 1) of pitch-over, where the course is not smooth."""
        return (self.ignition_s + self.ascent.pitch_start_s)[:, None]


def boost_path(
    site: LaunchSite,
    ignition_s: ArrayLike,
    azimuth_rad: FloatArray,
    burnout_speed_m_s: FloatArray,
    course: Ascent,
) -> BoostPath:
    """Return the paths of n launches, with azimuths and burnout speeds relative to the Earth
    (n,).
    """
    plane = site.plane(azimuth_rad)
    ignition = np.broadcast_to(floats(ignition_s), azimuth_rad.shape)
    swept_series = course.swept_series_rad(burnout_speed_m_s, plane.radius_m)
    burnout = ignition + course.burn_time_s
    return BoostPath(
        ignition, burnout, burnout_speed_m_s, plane, course, course.climb_series_s(), swept_series
    )
