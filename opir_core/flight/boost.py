"""Boosted flight on the class profiles, over the rotating WGS 84 Earth.

A profile's speed and flight path angle are relative to the Earth, and to the sphere that osculates the ellipsoid in the
launch azimuth at the launch point.
"""

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import EARTH_ECCENTRICITY_SQUARED, EARTH_EQUATORIAL_RADIUS_M
from opir_core.flight.ascent import Ascent, lean_rad, series_value, speed_ratio, vertical_climb_s
from opir_core.geometry import east_north_up_axes, geodetic_to_ecef


@frozen(eq=False)
class LaunchPlane:
    """The vertical plane of each of n launches: vectors (n, 3) in ECEF, and the radius (n,) of the circle in it."""

    launch_m: FloatArray
    up: FloatArray
    heading: FloatArray
    radius_m: FloatArray

    def state(
        self, height_m: FloatArray, swept_rad: FloatArray, speed_m_s: FloatArray, lean_rad: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return ECEF position and velocity relative to the Earth, (n, 3), from the course in the plane, (n,).

        The position is launch + (h cos(phi) - 2 R sin²(phi/2)) up + (R + h) sin(phi) heading: near the ground nothing
        is lost to the size of the Earth.
        """
        half = np.sin(0.5 * swept_rad)
        rise = height_m * np.cos(swept_rad) - 2.0 * self.radius_m * half * half
        along = (self.radius_m + height_m) * np.sin(swept_rad)
        tilt = lean_rad + swept_rad
        velocity = self._combined(speed_m_s * np.cos(tilt), speed_m_s * np.sin(tilt))
        return self.launch_m + self._combined(rise, along), velocity

    def take(self, target: RowArray) -> "LaunchPlane":
        """Return the planes of some targets."""
        return LaunchPlane(self.launch_m[target], self.up[target], self.heading[target], self.radius_m[target])

    def _combined(self, rise: FloatArray, along: FloatArray) -> FloatArray:
        return rise[:, None] * self.up + along[:, None] * self.heading


@frozen(eq=False)
class LaunchSite:
    """The places of n launches: position (n, 3) and axes east, north, up (n, 3, 3) in ECEF, radii of curvature (n,)."""

    launch_m: FloatArray
    axes: FloatArray
    meridian_radius_m: FloatArray
    normal_radius_m: FloatArray

    def plane(self, azimuth_rad: FloatArray) -> LaunchPlane:
        """Return the planes of launches with these azimuths (n,), clockwise from true north (Euler's radius)."""
        sine, cosine = np.sin(azimuth_rad), np.cos(azimuth_rad)
        curvature = cosine * cosine / self.meridian_radius_m + sine * sine / self.normal_radius_m
        heading = sine[:, None] * self.axes[:, 0] + cosine[:, None] * self.axes[:, 1]
        return LaunchPlane(self.launch_m, self.axes[:, 2], heading, 1.0 / curvature)

    def take(self, target: RowArray) -> "LaunchSite":
        """Return the sites of some launches."""
        return LaunchSite(
            *(v[target] for v in (self.launch_m, self.axes, self.meridian_radius_m, self.normal_radius_m))
        )


def launch_site(latitude_rad: ArrayLike, longitude_rad: ArrayLike, height_m: ArrayLike) -> LaunchSite:
    """Return the sites of launches at geodetic coordinates that broadcast to (n,); at a pole the longitude counts."""
    columns = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (latitude_rad, longitude_rad, height_m)))
    latitude, longitude, height = (np.atleast_1d(column).ravel() for column in columns)
    sine = np.sin(latitude)
    w = 1.0 - EARTH_ECCENTRICITY_SQUARED * sine * sine
    normal = EARTH_EQUATORIAL_RADIUS_M / np.sqrt(w)
    meridian = normal * (1.0 - EARTH_ECCENTRICITY_SQUARED) / w
    launch = geodetic_to_ecef(latitude, longitude, height)
    return LaunchSite(launch, east_north_up_axes(latitude, longitude), meridian + height, normal + height)


@frozen(eq=False)
class BoostPath:
    """Where n targets are from ignition to burnout."""

    ignition_s: FloatArray
    burnout_s: FloatArray
    burnout_speed_m_s: FloatArray
    plane: LaunchPlane
    ascent: Ascent
    _climb_series_s: FloatArray
    _swept_series_rad: FloatArray

    def state(self, target: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ECEF positions and velocities relative to the Earth (m, 3) of targets (m,) at times (m,).

        Outside ignition to burnout both are nan.
        """
        course = self.ascent
        burn, start, k = course.burn_time_s[target], course.pitch_start_s[target], course.speed_shape[target]
        burning = (time_s >= self.ignition_s[target]) & (time_s <= self.burnout_s[target])
        elapsed = np.minimum(np.where(burning, time_s - self.ignition_s[target], 0.0), burn)
        u = np.maximum((elapsed - start) / (burn - start), 0.0)
        x = np.sqrt(np.sqrt(u))
        swept = series_value(self._swept_series_rad, target, x)
        climb = np.where(
            elapsed < start, vertical_climb_s(elapsed, burn, k), series_value(self._climb_series_s, target, x)
        )
        speed = np.where(burning, self.burnout_speed_m_s[target], np.nan)
        lean = lean_rad(u, course.pitch_exponent[target], course.turn_rad[target])
        return self.plane.take(target).state(speed * climb, swept, speed * speed_ratio(elapsed, burn, k), lean)

    def breakpoints_s(self) -> FloatArray:
        """Return the times (n, 1) within the burn at which the course is not smooth: pitch-over."""
        return (self.ignition_s + self.ascent.pitch_start_s)[:, None]


def boost_path(
    site: LaunchSite, ignition_s: ArrayLike, azimuth_rad: FloatArray, burnout_speed_m_s: FloatArray, course: Ascent
) -> BoostPath:
    """Return the paths of n launches, with azimuths and burnout speeds relative to the Earth (n,)."""
    plane = site.plane(azimuth_rad)
    ignition = np.broadcast_to(np.asarray(ignition_s, dtype=np.float64), azimuth_rad.shape)
    swept_series = course.swept_series_rad(burnout_speed_m_s, plane.radius_m)
    burnout = ignition + course.burn_time_s
    return BoostPath(ignition, burnout, burnout_speed_m_s, plane, course, course.climb_series_s(), swept_series)
