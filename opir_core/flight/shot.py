"""A shot: from launch azimuth and burnout speed to where the free flight comes down on the rotating Earth."""

from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.ascent import Ascent
from opir_core.flight.boost import LaunchSite
from opir_core.flight.conic_impact import kepler_impact
from opir_core.geometry import ecef_to_eci_state, eci_to_ecef
from opir_core.geometry.vectors import components, length

if TYPE_CHECKING:
    from opir_core.flight.forces import Forces

#: The error of a numerical impact, m: a small share of the tolerances that aiming is asked for.
_IMPACT_TOLERANCE_M = 1e-3


@frozen(eq=False)
class Landing:
    """Where flights come down: columns (n,) and (n, 3).

    The miss is split along and across the great circle to the aim point, by polar angles about the launch point: there
    each of the two unknowns moves mostly its own coordinate. `duration_s` is from burnout to impact.
    """

    along_m: FloatArray
    across_m: FloatArray
    miss_m: FloatArray
    duration_s: FloatArray
    impact_ecef_m: FloatArray

    def distance_m(self) -> FloatArray:
        """Return the length of the miss along and across: how far there is to go, (n,)."""
        return np.hypot(self.along_m, self.across_m)


@frozen(eq=False)
class Shot:
    """Launches (n,) and where they aim: ECEF position (n, 3) and height (n,) of the aim points.

    `forces` act in free flight; None is two-body motion.
    """

    site: LaunchSite
    course: Ascent
    aim_ecef_m: FloatArray
    aim_height_m: FloatArray
    forces: "Forces | None" = None

    def take(self, rows: RowArray) -> "Shot":
        """Return some of the shots."""
        forces = None if self.forces is None else self.forces.take(rows)
        return Shot(
            self.site.take(rows), self.course.take(rows), self.aim_ecef_m[rows], self.aim_height_m[rows], forces
        )

    def in_two_body_motion(self) -> "Shot":
        """Return the same shots with no force but the point mass."""
        return self if self.forces is None else evolve(self, forces=None)

    def burnout(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return burnout positions and velocities relative to the Earth, (n, 3), ECEF."""
        plane = self.site.plane(azimuth_rad)
        height_m = self.course.burnout_height_m(speed_m_s)
        swept_rad = self.course.burnout_swept_rad(speed_m_s, plane.radius_m)
        return plane.state(height_m, swept_rad, speed_m_s, self.course.turn_rad)

    def landing(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> Landing:
        """Return where the flights come down; the inertial frame is ECEF frozen at burnout."""
        duration_s, point_m = self._impact(*ecef_to_eci_state(*self.burnout(azimuth_rad, speed_m_s), 0.0))
        impact_m = eci_to_ecef(point_m, duration_s)
        range_rad, bearing_rad = self.polar_rad(impact_m)
        aim_range_rad, aim_bearing_rad = self.polar_rad(self.aim_ecef_m)
        radius_m = length(*components(self.aim_ecef_m))
        turn_rad = np.remainder(bearing_rad - aim_bearing_rad + np.pi, 2.0 * np.pi) - np.pi
        miss_m = length(*components(impact_m - self.aim_ecef_m))
        along_m, across_m = radius_m * (range_rad - aim_range_rad), radius_m * np.sin(aim_range_rad) * turn_rad
        return Landing(along_m, across_m, miss_m, duration_s, impact_m)

    def _impact(self, position_m: FloatArray, velocity_m_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.forces is None:
            return kepler_impact(position_m, velocity_m_s, self.aim_height_m)
        from opir_core.flight.impact_event import impact

        return impact(position_m, velocity_m_s, self.aim_height_m, self.forces, tolerance_m=_IMPACT_TOLERANCE_M)

    def polar_rad(self, point_ecef_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return angle from the launch point and bearing at it, geocentric, of points (n, 3)."""
        x, y, z = components(point_ecef_m)
        ex, ey, ez = components(self.site.axes[:, 0])
        ox, oy, oz = components(self.site.launch_m)
        radius_m = length(ox, oy, oz)
        nx, ny, nz = (oy * ez - oz * ey) / radius_m, (oz * ex - ox * ez) / radius_m, (ox * ey - oy * ex) / radius_m
        east, north = x * ex + y * ey + z * ez, x * nx + y * ny + z * nz
        outward = (x * ox + y * oy + z * oz) / radius_m
        return np.arctan2(np.hypot(east, north), outward), np.arctan2(east, north)
