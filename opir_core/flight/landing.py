"""Impacts of trial flights relative to their aim points, and Newton's method for the two unknowns
of a launch.
"""

from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.boost import LaunchSite
from opir_core.flight.conic_impact import kepler_impact
from opir_core.geometry import ecef_to_eci_state, eci_to_ecef
from opir_core.geometry.vectors import FloatPair, components, length

if TYPE_CHECKING:
    from opir_core.flight.forces import Forces


@frozen(eq=False, repr=False)
class AimedLanding:
    """Impacts of trial flights: columns (n,) and (n, 3).

    The miss is split along and across the great circle to the aim point, by polar angles about the
    launch point: each of the two unknowns then mostly changes its own coordinate. `duration_s` is
    from the release to impact.
    """

    along_m: FloatArray
    across_m: FloatArray
    miss_m: FloatArray
    duration_s: FloatArray
    impact_ecef_m: FloatArray

    def distance_m(self) -> FloatArray:
        """Return the length of the miss along and across, (n,)."""
        return np.hypot(self.along_m, self.across_m)


def aimed_landing(
    site: LaunchSite,
    aim_ecef_m: FloatArray,
    aim_height_m: FloatArray,
    release: FloatPair,
    forces: "Forces | None",
) -> AimedLanding:
    """Return the impacts of free flights from a release: positions and velocities over the Earth
    (n, 3), ECEF.

    The inertial frame is ECEF frozen at the release; `forces` None is two-body motion.
    """
    duration_s, point_m = _impact(*ecef_to_eci_state(*release, 0.0), aim_height_m, forces)
    impact_m = eci_to_ecef(point_m, duration_s)
    range_rad, bearing_rad = polar_rad(site, impact_m)
    aim_range_rad, aim_bearing_rad = polar_rad(site, aim_ecef_m)
    radius_m = length(*components(aim_ecef_m))
    turn_rad = np.remainder(bearing_rad - aim_bearing_rad + np.pi, 2.0 * np.pi) - np.pi
    miss_m = length(*components(impact_m - aim_ecef_m))
    along_m = radius_m * (range_rad - aim_range_rad)
    across_m = radius_m * np.sin(aim_range_rad) * turn_rad
    return AimedLanding(along_m, across_m, miss_m, duration_s, impact_m)


def _impact(
    position_m: FloatArray, velocity_m_s: FloatArray, height_m: FloatArray, forces: "Forces | None"
) -> FloatPair:
    if forces is None:
        return kepler_impact(position_m, velocity_m_s, height_m)
    from opir_core.flight.propagation import impact

    # The tolerance of a numerical impact, m, small beside the tolerances of aiming.
    return impact(position_m, velocity_m_s, height_m, forces, tolerance_m=1e-3)


def polar_rad(site: LaunchSite, point_ecef_m: FloatArray) -> FloatPair:
    """Return angle from the launch point and bearing at it, geocentric, of points (n, 3)."""
    x, y, z = components(point_ecef_m)
    ex, ey, ez = components(site.axes[:, 0])
    ox, oy, oz = components(site.launch_m)
    radius_m = length(ox, oy, oz)
    nx = (oy * ez - oz * ey) / radius_m
    ny = (oz * ex - ox * ez) / radius_m
    nz = (ox * ey - oy * ex) / radius_m
    east = x * ex + y * ey + z * ez
    north = x * nx + y * ny + z * nz
    outward = (x * ox + y * oy + z * oz) / radius_m
    return np.arctan2(np.hypot(east, north), outward), np.arctan2(east, north)


class Shots(Protocol):
    """Launches with two unknowns: the azimuth, and a positive one that sets the range (speed, or
    time of cut-off).
    """

    def take(self, rows: RowArray) -> Self:
        """Return some of the launches."""

    def in_two_body_motion(self) -> Self:
        """Return the same launches with two-body motion after burnout."""

    def landing(self, azimuth_rad: FloatArray, reach: FloatArray, /) -> AimedLanding:
        """Return the impacts (n,) of flights with these unknowns (n,)."""


_ITERATIONS = 60

#: Steps of the finite differences: rad, and a share of the second unknown.
_STEP = 1e-5

#: The largest correction at once: rad, and a share of the second unknown.
_LARGEST_STEP = 0.2


def corrected(
    shot: Shots,
    azimuth_rad: FloatArray,
    reach: FloatArray,
    tolerance_m: float,
    iterations: int = _ITERATIONS,
) -> FloatPair:
    """Return the unknowns after Newton's method for each target; a step that does not reduce the
    miss is halved.
    """
    start = shot.landing(azimuth_rad, reach)
    # Rows: azimuth, reach, along, across, miss, share of Newton's step to take.
    state = np.stack(
        [azimuth_rad, reach, start.along_m, start.across_m, start.miss_m, np.ones_like(azimuth_rad)]
    )
    for _ in range(iterations):
        rows = np.flatnonzero(state[4] > tolerance_m)
        if not rows.size:
            break
        launches = shot.take(rows)
        (azimuth, reach, along, across, _, share) = state[:, rows]
        turn, gain = _newton_step(launches.in_two_body_motion(), azimuth, reach, along, across)
        azimuth = azimuth + share * turn
        reach = reach * (1.0 + share * gain)
        trial = launches.landing(azimuth, reach)
        nearer = trial.distance_m() < np.hypot(along, across)
        state[5, rows] = np.where(nearer, np.minimum(2.0 * share, 1.0), 0.5 * share)
        better = np.stack([azimuth, reach, trial.along_m, trial.across_m, trial.miss_m])
        state[:5, rows[nearer]] = better[:, nearer]
    return state[0], state[1]


def _newton_step(
    shot: Shots,
    azimuth_rad: FloatArray,
    reach: FloatArray,
    along_m: FloatArray,
    across_m: FloatArray,
) -> FloatPair:
    """Return the corrections of azimuth, rad, and of reach, as a share of it, of bounded size."""
    count = len(azimuth_rad)
    azimuths = np.concatenate([azimuth_rad, azimuth_rad + _STEP, azimuth_rad])
    reaches = np.concatenate([reach, reach, reach * (1.0 + _STEP)])
    landings = shot.take(np.tile(np.arange(count), 3)).landing(azimuths, reaches)
    (along_by_turn, along_by_gain), (across_by_turn, across_by_gain) = (
        column.reshape(3, count)[1:] - column[:count]
        for column in (landings.along_m, landings.across_m)
    )
    determinant = along_by_gain * across_by_turn - along_by_turn * across_by_gain
    turn = _STEP * (across_by_gain * along_m - along_by_gain * across_m) / determinant
    gain = _STEP * (along_by_turn * across_m - across_by_turn * along_m) / determinant
    shrink = _LARGEST_STEP / np.maximum(np.hypot(turn, gain), _LARGEST_STEP)
    return turn * shrink, gain * shrink
