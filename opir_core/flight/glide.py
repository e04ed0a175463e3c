"""Boost-glide flights: a boost on a class profile, equilibrium glide at a constant lift-to-drag
ratio, and free fall.

In equilibrium glide lift balances weight less centrifugal force, m (g - v²/r), at a small flight
path angle. With the lift-to-drag ratio E, gravity g and radius r constant, and v_c² = g r,

    v(t) = v_c tanh(a),  a = artanh(v_0/v_c) - g t/(E v_c),
    s = (E r/2) ln((1 - v²/v_c²) / (1 - v_0²/v_c²)) = E r ln(cosh(a_0)/cosh(a)),

and in an exponential atmosphere of scale height H, where the density follows from lift ~ rho v²,

    h = h_0 + H ln((v²/(v_c² - v²)) / (v_0²/(v_c² - v_0²))) = h_0 + 2 H ln(sinh(a)/sinh(a_0))

(Eggers, Allen and Neice, A comparative analysis of the performance of long-range hypervelocity
vehicles, NACA TN 4046, 1957; Vinh, Busemann and Culp, Hypersonic and Planetary Entry Flight
Mechanics, 1980). g and r are those at burnout; the way goes along a great circle of geocentric
directions over the WGS 84 ellipsoid, and speeds are relative to the Earth: its rotation acts on the
free fall only. The boost ends in the direction in which the glide begins. At the final speed lift
and drag end, and free flight under the scene's forces leads down to the aim point.
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_POLAR_RADIUS_M
from opir_core.flight.aiming import (
    LaunchSolution,
    aimed_launches,
    forces_on,
    surface_range_m,
)
from opir_core.flight.boost import BoostPath, ascent, boost_path, launch_site
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.free_flight import free_flight_ephemeris
from opir_core.flight.landing import polar_rad
from opir_core.flight.rows import Rows
from opir_core.geometry import Geodetic, ecef_to_eci_state, geodetic_to_ecef
from opir_core.geometry.vectors import FloatPair, components, dot, length
from opir_core.scene.target_classes import BoostProfile, EquilibriumGlide

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel


@frozen(eq=False, repr=False)
class GlideShape(Rows):
    """The constants of n glides: lift-to-drag ratio, final speed and scale height, columns (n,)."""

    lift_to_drag: FloatArray
    final_speed_m_s: FloatArray
    scale_height_m: FloatArray

    @classmethod
    def of(cls, flights: Iterable[object]) -> "GlideShape":
        """Return the constants of those flights after burnout that are glides."""
        columns = [
            (flight.lift_to_drag, flight.final_speed_m_s, flight.scale_height_m)
            for flight in flights
            if isinstance(flight, EquilibriumGlide)
        ]
        return cls(*np.array(columns, dtype=np.float64).reshape(-1, 3).T)


@frozen(eq=False, repr=False)
class GlidePath(Rows):
    """The equilibrium glides of n targets from their burnout: columns (n,), directions (n, 3) in
    ECEF.

    `up` is the geocentric direction at burnout, `heading` that of flight at right angles to it;
    `height_m` the height above the ellipsoid along `up`; `start` and `end` the parameters a at
    burnout and at the final speed.
    """

    shape: GlideShape
    up: FloatArray
    heading: FloatArray
    radius_m: FloatArray
    height_m: FloatArray
    start: FloatArray
    end: FloatArray

    @staticmethod
    def from_burnout(
        position_m: FloatArray, velocity_m_s: FloatArray, shape: GlideShape
    ) -> "GlidePath":
        """Return the glides from burnout states (n, 3), ECEF, the velocity relative to the
        Earth.
        """
        radius_m = length(*components(position_m))
        up = position_m / radius_m[:, None]
        level = velocity_m_s - dot(velocity_m_s, up)[:, None] * up
        speed_m_s = length(*components(level))
        circular_m_s = np.sqrt(EARTH_MU_M3_S2 / radius_m)
        return GlidePath(
            shape,
            up,
            level / speed_m_s[:, None],
            radius_m,
            radius_m - _ground_radius_m(up),
            np.arctanh(speed_m_s / circular_m_s),
            np.arctanh(shape.final_speed_m_s / circular_m_s),
        )

    @property
    def time_scale_s(self) -> FloatArray:
        """Return E v_c/g, (n,): the glide's parameter falls by 1 in that time."""
        return self.shape.lift_to_drag * np.sqrt(self.radius_m**3 / EARTH_MU_M3_S2)

    @property
    def duration_s(self) -> FloatArray:
        """Return the times from burnout to the final speed, (n,)."""
        return (self.start - self.end) * self.time_scale_s

    @property
    def final_height_m(self) -> FloatArray:
        """Return the heights (n,) above the ellipsoid, along the geocentric direction, at the final
        speed.
        """
        return self.height_m - 2.0 * self.shape.scale_height_m * np.log(
            np.sinh(self.start) / np.sinh(self.end)
        )

    def state(self, since_s: FloatArray) -> FloatPair:
        """Return ECEF positions and velocities relative to the Earth (n, 3) at times (n,) since
        burnout.
        """
        drag_free = 1.0 / self.time_scale_s
        a = self.start - since_s * drag_free
        swept = self.shape.lift_to_drag * np.log(np.cosh(self.start) / np.cosh(a))
        rate = self.shape.lift_to_drag * np.tanh(a) * drag_free
        sine = np.sin(swept)[:, None]
        cosine = np.cos(swept)[:, None]
        outward = cosine * self.up + sine * self.heading
        onward = cosine * self.heading - sine * self.up
        ground_m = _ground_radius_m(outward)
        slope_m = _ground_slope_m(outward, onward)
        height_m = self.height_m - 2.0 * self.shape.scale_height_m * np.log(
            np.sinh(self.start) / np.sinh(a)
        )
        climb_m_s = -2.0 * self.shape.scale_height_m * drag_free / np.tanh(a) + slope_m * rate
        radius_m = ground_m + height_m
        velocity = climb_m_s[:, None] * outward + (radius_m * rate)[:, None] * onward
        return radius_m[:, None] * outward, velocity

    def climb_at_start_m_s(self) -> FloatArray:
        """Return the geocentric radial speeds (n,) with which the glides begin."""
        _, velocity = self.state(np.zeros_like(self.start))
        return dot(velocity, self.up)


def _ground_radius_m(direction: FloatArray) -> FloatArray:
    """Return the distances (n,) of the WGS 84 ellipsoid from the Earth's centre in unit directions
    (n, 3).
    """
    x, y, z = components(direction)
    a = EARTH_EQUATORIAL_RADIUS_M
    b = EARTH_POLAR_RADIUS_M
    return 1.0 / np.sqrt((x * x + y * y) / (a * a) + z * z / (b * b))


def _ground_slope_m(direction: FloatArray, onward: FloatArray) -> FloatArray:
    """Return the derivatives (n,) of `_ground_radius_m` in the angle from the direction onward,
    m/rad.
    """
    a = EARTH_EQUATORIAL_RADIUS_M
    b = EARTH_POLAR_RADIUS_M
    x, y, z = components(direction * onward)
    return -(_ground_radius_m(direction) ** 3) * ((x + y) / (a * a) + z / (b * b))


@frozen(eq=False, repr=False)
class GlideLaunch(LaunchSolution):
    """Launches (n,) whose flights glide after burnout, with the constants of their glides."""

    shape: GlideShape = field(kw_only=True)

    def turned(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> "GlideLaunch":
        """Return the launches with ascents that end in the direction in which their glides
        begin.
        """
        launch = self
        # Each correction leaves about a thousandth of the error.
        for _ in range(5):
            position, velocity = launch.burnout(azimuth_rad, speed_m_s)
            glide = GlidePath.from_burnout(position, velocity, self.shape)
            climb_m_s = dot(velocity, glide.up)
            turn_rad = launch.course.turn_rad + (climb_m_s - glide.climb_at_start_m_s()) / speed_m_s
            launch = evolve(launch, course=launch.course.with_turn(turn_rad))
        return launch

    def glide(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> GlidePath:
        """Return the glides of launches whose ascents have turned."""
        return GlidePath.from_burnout(*self.burnout(azimuth_rad, speed_m_s), self.shape)

    def release(self, azimuth_rad: FloatArray, speed_m_s: FloatArray) -> FloatPair:
        """Return positions and velocities at the end of the glide, nan where it would end below the
        ground.
        """
        glide = self.turned(azimuth_rad, speed_m_s).glide(azimuth_rad, speed_m_s)
        position, velocity = glide.state(glide.duration_s)
        flies = (glide.duration_s > 0.0) & (glide.final_height_m > 0.0)
        return np.where(flies[:, None], position, np.nan), velocity


@frozen(eq=False, repr=False)
class GlideFlight:
    """The flights of n targets from launch over burnout and release, where free flight begins, to
    the aim point.

    Columns (n,) and (n, 3); burnout speed and ECEF velocities are relative to the Earth. `miss_m`
    is the distance of the impact from the aim point. Where `converged` is False, `complaints` says
    why, and what depends on the solution is nan.
    """

    azimuth_rad: FloatArray
    burnout_speed_m_s: FloatArray
    burnout_s: FloatArray
    burnout_position_ecef_m: FloatArray
    burnout_velocity_ecef_m_s: FloatArray
    release_s: FloatArray
    release_position_ecef_m: FloatArray
    release_velocity_ecef_m_s: FloatArray
    impact_s: FloatArray
    impact_ecef_m: FloatArray
    miss_m: FloatArray
    converged: BoolArray
    complaints: tuple[str, ...]
    path: BoostPath
    glide: GlidePath

    def state(self, target: RowArray, time_s: FloatArray) -> FloatPair:
        """Return ECEF positions and velocities (m, 3) of targets (m,) in their glides at times
        (m,).
        """
        return self.glide.take(target).state(time_s - self.burnout_s[target])


@np.errstate(all="ignore")
def glide_flight(
    launch: Geodetic,
    aim_point: Geodetic,
    ignition_s: FloatArray,
    profiles: Sequence[BoostProfile],
    shape: GlideShape,
    *,
    forces: "ForceModel" = "kepler",
    tolerance_m: float = 0.01,
) -> GlideFlight:
    """Return the boost-glide flights of n targets, one profile each; columns (n,).

    `forces` act after the glide. Targets whose aim point is outside the range of their profile, or
    is missed by more than the tolerance, are reported in `complaints`.
    """
    n = len(profiles)
    aim_m = geodetic_to_ecef(*aim_point)
    range_m = surface_range_m(*launch[:2], *aim_point[:2])
    site = launch_site(*launch)
    course = ascent(profiles, np.zeros(n))
    shot = GlideLaunch(site, course, aim_m, aim_point.height_m, forces_on(forces, n), shape=shape)
    aimed = aimed_launches(shot, range_m, profiles, _guess, tolerance_m)
    azimuth_rad = aimed.azimuth_rad
    speed_m_s = aimed.speed_m_s
    turned = shot.turned(azimuth_rad, speed_m_s)
    path = boost_path(site, ignition_s, azimuth_rad, speed_m_s, turned.course)
    burnout = path.state(np.arange(n), path.burnout_s)
    glide = turned.glide(azimuth_rad, speed_m_s)
    release_s = path.burnout_s + glide.duration_s
    return GlideFlight(
        np.remainder(azimuth_rad, 2.0 * np.pi),
        speed_m_s,
        path.burnout_s,
        *burnout,
        release_s,
        *glide.state(glide.duration_s),
        release_s + aimed.landing.duration_s,
        aimed.landing.impact_ecef_m,
        aimed.landing.miss_m,
        aimed.converged,
        aimed.complaints,
        path,
        glide,
    )


def _guess(shot: GlideLaunch) -> FloatPair:
    """Return first guesses of azimuths and burnout speeds: those whose glide is as long as the way.

    The way that boost and fall cover is half the burn at the burnout speed.
    """
    psi, azimuth_rad = polar_rad(shot.site, shot.aim_ecef_m)
    shape = shot.shape
    radius_m = length(*components(shot.site.launch_m))
    circular_m_s = np.sqrt(EARTH_MU_M3_S2 / radius_m)
    final_share = 1.0 - (shape.final_speed_m_s / circular_m_s) ** 2
    glided = psi
    speed_m_s = np.zeros_like(psi)
    for _ in range(3):
        speed_m_s = circular_m_s * np.sqrt(
            1.0 - final_share * np.exp(-2.0 * glided / shape.lift_to_drag)
        )
        glided = np.maximum(psi - 0.5 * shot.course.burn_time_s * speed_m_s / radius_m, 0.0)
    return azimuth_rad, speed_m_s


def glide_ephemeris(
    flight: GlideFlight, tolerance_m: float = 0.01, forces: "ForceModel" = "kepler"
) -> Ephemeris:
    """Return the ECEF ephemeris of n targets from burnout to impact; `forces` as in
    `glide_flight`.
    """
    glide = Ephemeris.build(
        flight.state, flight.burnout_s, flight.release_s, tolerance_m=tolerance_m
    )
    state = ecef_to_eci_state(
        flight.release_position_ecef_m, flight.release_velocity_ecef_m_s, flight.release_s
    )
    fall = free_flight_ephemeris(
        flight.release_s, flight.impact_s, *state, forces=forces, tolerance_m=tolerance_m
    )
    return Ephemeris.joined([glide, fall])
