"""Where tracks came from and where they come down, with the covariance that the state's brings about."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.estimation.lines_of_sight import turned
from opir_core.flight.forces import Forces
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_geodetic, local_axes


class GroundPoints(NamedTuple):
    """Latitude_rad, longitude_rad and scene time_s (n, 3), and covariances (n, 3, 3) as in `Tracks`; nan for none."""

    place: FloatArray
    covariance: FloatArray

    @classmethod
    def nowhere(cls, count: int) -> "GroundPoints":
        """Return no points."""
        return cls(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))


#: Impacts are worked out to within this, m: they are known to hundreds of metres at best.
_CLOSE_M = 1.0

#: What fell below the ground is followed back to this high above it, m.
_CLEAR_M = 10.0

#: Impacts of states one standard deviation off may bend away from a line by so many standard deviations of the ellipse
#: that they make: along a bow 95 % ellipses that bend by 0.25 hold 93 %, by 0.5 hold 88, by 1 hold 80, by 3 hold 58.
_MOST_BENT = 1.0

#: An ellipse of 95 % with a longer semi-axis, m, is no plane's on a round Earth.
_WIDEST_M, _SQUARE_95 = 3e6, 5.991

#: No less than gravity's acceleration at the ground, and for some tens of kilometres below it, m/s².
_GRAVITY_M_S2 = 10.0

_NOW = np.zeros((1, 1))


def impacts(state: FloatArray, covariance: FloatArray, time_s: float, forces: Forces) -> GroundPoints:
    """Return where free flights from inertial states (n, 6) come down.

    The point is that of the mean under `forces`. The covariance is spread through two-body arcs by central differences,
    one standard deviation either way: their partials differ from those under `forces` by parts in a thousand. What is
    below the ground already came down before `time_s`. nan in all of a point where one of these arcs does not come
    down, where they bend too far from lines, and of ellipses too wide for a plane: how sure it is then cannot be said.
    """
    points = GroundPoints.nowhere(len(state))
    if not len(state):
        return points
    side = np.linalg.cholesky(covariance).transpose(0, 2, 1)
    mean = state[:, None]
    every, since_s = _above(np.concatenate([mean, mean + side, mean - side], axis=1))
    flight, fell = _fallen(every, Forces(zonal=(), gravity=forces.gravity))
    flight -= since_s
    landed = turned(fell.reshape(-1, 3), -(time_s + flight).ravel()).reshape(fell.shape)
    when, ground = time_s + flight[:, 0], landed[:, 0]
    if not forces.is_kepler:
        forced, point = _fallen(every[:, 0], forces)
        when = time_s + forced - since_s[:, 0]
        ground = turned(point, -when)
    axes = local_axes(ground)[:, :2].transpose(0, 2, 1)
    one, other = landed[:, 1:7], landed[:, 7:]
    plane = 0.5 * (one - other) @ axes
    bend = np.add.reduce(0.5 * (one + other) - landed[:, :1], axis=1)[:, None] @ axes
    later = 0.5 * (flight[:, 1:7] - flight[:, 7:])
    told = _told(ground, when, np.concatenate([plane, later[:, :, None]], axis=2).transpose(0, 2, 1))
    vague = ~_are_flat(told.covariance, bend[:, 0])
    told.place[vague], told.covariance[vague] = np.nan, np.nan
    return told


def _are_flat(covariance: FloatArray, bend: FloatArray) -> BoolArray:
    """Return which impacts have ellipses that can be told, by their covariances (n, 3, 3) and bends (n, 2), m."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    aside, along = bend[:, 0], bend[:, 1]
    bent = north * aside**2 - 2.0 * both * aside * along + east * along**2
    across = east * north - both**2
    # The longer axis is shorter than that: beyond half of the trace, the characteristic polynomial is positive there.
    far = _WIDEST_M**2 / _SQUARE_95
    narrow = ((far - east) * (far - north) > both**2) & (east + north < 2.0 * far)
    flat: BoolArray = (bent <= _MOST_BENT**2 * across) & narrow
    return flat


def _above(state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states (n, k, 6) before any fell below the ground, and how long ago that is, (n, 1) s, or (1, 1) for all.

    A fall through the ground is followed back to above it as if gravity, all of it downwards, were harder than it is:
    so the way back is not taken for too short. The others of a row go with it.
    """
    place, speed = state[:, :, :3], state[:, :, 3:]
    if np.minimum.reduce(np.add.reduce(place * place, axis=2), axis=None) > EARTH_EQUATORIAL_RADIUS_M**2:
        return state, _NOW
    height_m = ecef_to_geodetic(place).height_m
    low = height_m < 0.0
    fall_m_s = -np.sum(local_axes(place)[:, :, 2] * speed, axis=2)
    climb_m = _CLEAR_M - height_m
    root = fall_m_s**2 - 2.0 * _GRAVITY_M_S2 * climb_m
    fell = low & (fall_m_s > 0.0) & (root > 0.0)
    back_s = np.where(fell, 2.0 * climb_m / (fall_m_s + np.sqrt(np.where(fell, root, 1.0))), 0.0)
    since_s: FloatArray = back_s.max(axis=1, keepdims=True)
    rows = np.flatnonzero(since_s)
    earlier = state.copy()
    earlier[rows] = np.concatenate(propagate_kepler(place[rows], speed[rows], -since_s[rows]), axis=2)
    return earlier, since_s


def _fallen(state: FloatArray, forces: Forces) -> tuple[FloatArray, FloatArray]:
    """Return times to impact (...) and points (..., 3) of states (..., 6) under forces."""
    from opir_core.flight.impact_event import impact

    place_m, velocity_m_s = state[..., :3], state[..., 3:]
    if forces.is_kepler:
        return impact(place_m, velocity_m_s, forces=forces)
    return impact(place_m, velocity_m_s, forces=forces, tolerance_m=_CLOSE_M)


def _told(ground: FloatArray, when: FloatArray, plane: FloatArray) -> GroundPoints:
    where = ecef_to_geodetic(ground)
    place = np.stack([where.latitude_rad, where.longitude_rad, when], axis=1)
    return GroundPoints(place, plane @ plane.transpose(0, 2, 1))


def renewed(known: GroundPoints, fresh: GroundPoints) -> GroundPoints:
    """Return points with those that are known afresh in the place of the old.

    Not the surer of two: what follows from less is now and then surer and wrong.
    """
    new = np.isfinite(fresh.place[:, 0])
    place = np.where(new[:, None], fresh.place, known.place)
    return GroundPoints(place, np.where(new[:, None, None], fresh.covariance, known.covariance))
