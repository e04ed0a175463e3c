"""Where tracks came from and where they come down, with the covariance that the state's brings about."""

from typing import NamedTuple

import numpy as np

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.flight.forces import Forces
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.records import FloatArray
from opir_core.tracking.rays import turned


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

#: No less than gravity's acceleration at the ground, and for some tens of kilometres below it, m/s².
_GRAVITY_M_S2 = 10.0

_NOW = np.zeros((1, 1))


def impacts(state: FloatArray, covariance: FloatArray, time_s: float, forces: Forces) -> GroundPoints:
    """Return where free flights from inertial states (n, 6) come down.

    The point is that of the mean under `forces`. The covariance is spread through two-body arcs by central differences,
    one standard deviation either way: their partials differ from those under `forces` by parts in a thousand. What is
    below the ground already came down before `time_s`. nan in all of a point where one of these arcs does not come
    down: how sure it is then cannot be said.
    """
    points = GroundPoints.nowhere(len(state))
    if not len(state):
        return points
    side = np.linalg.cholesky(covariance).transpose(0, 2, 1)
    mean = state[:, None]
    every, since_s = _above(np.concatenate([mean, mean + side, mean - side], axis=1))
    flight, fell = _fallen(every, forces)
    # One that does not come down, nan, makes all of its row nan.
    flight += 0.0 * np.add.reduce(flight, axis=1, keepdims=True) - since_s
    when = time_s + flight
    ground, landed = turned(fell[:, 0], -when[:, 0]), turned(fell[:, 1:].reshape(-1, 3), -when[:, 1:].ravel())
    landed = landed.reshape(-1, 2, 6, 3)
    plane = 0.5 * (landed[:, 0] - landed[:, 1]) @ local_axes(ground)[:, :2].transpose(0, 2, 1)
    later = 0.5 * (flight[:, 1:7] - flight[:, 7:])
    return _told(ground, when[:, 0], np.concatenate([plane, later[:, :, None]], axis=2).transpose(0, 2, 1))


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
    """Return times to impact (n, k) and points (n, k, 3) of states (n, k, 6); all but the first on two-body arcs."""
    from opir_core.flight.impact_event import impact

    flight, fell = impact(state[:, :, :3], state[:, :, 3:], forces=Forces(zonal=(), gravity=forces.gravity))
    if not forces.is_kepler:
        mean = state[:, 0]
        flight[:, 0], fell[:, 0] = impact(mean[:, :3], mean[:, 3:], forces=forces, tolerance_m=_CLOSE_M)
    return flight, fell


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
