"""Where tracks came from and where they come down, with the covariance that the state's brings about."""

from typing import NamedTuple

import numpy as np

from opir_core.flight.forces import Forces
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.records import FloatArray, IntArray
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import along, turned

#: How far back a path is followed to the ground, s, and in what steps.
_BACK_S, _STEP_S = 30.0, 0.25

#: A path that does not reach the ground going back began where it is lowest, if that is no higher, m.
_LOW_M = 2000.0

#: Slower than this a launch is taken to go straight up: how fast it drifts is not known, m/s.
_SLOW_M_S = 5.0

#: No path leaves the ground slower than this, m/s.
_SLOWEST_M_S = 1.0


class GroundPoints(NamedTuple):
    """Latitude_rad, longitude_rad and scene time_s (n, 3), and covariances (n, 3, 3) as in `Tracks`; nan for none."""

    place: FloatArray
    covariance: FloatArray

    @classmethod
    def nowhere(cls, count: int) -> "GroundPoints":
        """Return no points."""
        return cls(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))


def impacts(state: FloatArray, covariance: FloatArray, time_s: float, forces: Forces) -> GroundPoints:
    """Return where free flights from inertial states (n, 6) come down.

    The point is that of the mean under `forces`. The covariance is spread through two-body arcs by central differences,
    one standard deviation either way: their partials differ from those under `forces` by parts in a thousand.
    """
    from opir_core.flight.impact_event import impact

    points = GroundPoints.nowhere(len(state))
    if not len(state):
        return points
    duration, point = impact(state[:, :3], state[:, 3:], forces=forces)
    ground = turned(point, -(time_s + duration))
    side = np.linalg.cholesky(covariance)
    shifted = state[:, None, None, :] + np.stack([side, -side], axis=1).transpose(0, 1, 3, 2)
    flight, fell = impact(shifted[..., :3], shifted[..., 3:], forces=Forces(zonal=(), gravity=forces.gravity))
    landed = turned(fell.reshape(-1, 3), -(time_s + flight.ravel())).reshape(fell.shape)
    apart = 0.5 * (landed[:, 0] - landed[:, 1])
    plane = apart @ local_axes(ground)[:, :2].transpose(0, 2, 1)
    later = 0.5 * (flight[:, 0] - flight[:, 1])
    return _told(ground, time_s + duration, np.concatenate([plane, later[:, :, None]], axis=2).transpose(0, 2, 1))


def launches(outlook: Outlook) -> GroundPoints:
    """Return where boosts began: where each path, followed back as its Taylor series, reaches the ground.

    The covariance is that of the position there, less what moving along the path takes up; its height, over the
    speed of the climb, is the time's.
    """
    count = len(outlook.side)
    if not count:
        return GroundPoints.nowhere(0)
    back = -np.arange(0.0, _BACK_S + _STEP_S, _STEP_S)
    track, when = np.repeat(np.arange(count), len(back)), outlook.time_s + np.tile(back, count)
    path = turned(outlook.positions(track, when), -when)
    height = ecef_to_geodetic(path).height_m.reshape(count, -1)
    below = height <= 0.0
    lowest = np.where(below.any(axis=1), np.argmax(below, axis=1), np.argmin(height, axis=1))
    begun_s = back[lowest]
    known = np.flatnonzero((height[np.arange(count), lowest] < _LOW_M) & (lowest > 0))
    points = GroundPoints.nowhere(count)
    if len(known):
        found = _launched(outlook, known, outlook.time_s + begun_s[known])
        points.place[known], points.covariance[known] = found
    return points


def _launched(outlook: Outlook, rows: IntArray, when: FloatArray) -> GroundPoints:
    ground = turned(outlook.positions(rows, when), -when)
    later, latest = (turned(outlook.positions(rows, t), -t) for t in (when + _STEP_S, when + 2.0 * _STEP_S))
    axes = local_axes(ground)
    east, north, up = along(axes, (later - ground) / _STEP_S).T
    gain = along(axes, (latest - 2.0 * later + ground) / _STEP_S**2)[:, 2]
    inertial = np.stack([turned(axes[:, row], when) for row in range(3)], axis=1)
    side = inertial @ outlook.position_sides(rows, when)
    climb = np.where(up > _SLOW_M_S, up, np.inf)
    plane = side[:, :2] - (np.stack([east, north], axis=1) / climb[:, None])[:, :, None] * side[:, 2:]
    delay = -side[:, 2:] / _rise_pace(side[:, 2], up, gain)[:, None, None]
    return _told(ground, when, np.concatenate([plane, delay], axis=1))


def _rise_pace(side: FloatArray, up_m_s: FloatArray, gain_m_s2: FloatArray) -> FloatArray:
    """Return the mean speed (n,) of the climb through one standard deviation of height, from rows (n, k) of its side.

    A path that leaves the ground from rest has no speed to divide by there, and gains it on the way.
    """
    rise = np.sqrt(np.sum(side * side, axis=1))
    begun = np.maximum(up_m_s, 0.0)
    pace: FloatArray = 0.5 * (begun + np.sqrt(begun * begun + 2.0 * np.maximum(gain_m_s2, 0.0) * rise))
    return np.maximum(pace, _SLOWEST_M_S)


def _told(ground: FloatArray, when: FloatArray, plane: FloatArray) -> GroundPoints:
    where = ecef_to_geodetic(ground)
    place = np.stack([where.latitude_rad, where.longitude_rad, when], axis=1)
    return GroundPoints(place, plane @ plane.transpose(0, 2, 1))


def surer(known: GroundPoints, fresh: GroundPoints) -> GroundPoints:
    """Return of each pair of points the one whose place has the smaller covariance."""
    before, after = (np.trace(points.covariance[:, :2, :2], axis1=1, axis2=2) for points in (known, fresh))
    better = np.isfinite(after) & ~(before <= after)
    place = np.where(better[:, None], fresh.place, known.place)
    return GroundPoints(place, np.where(better[:, None, None], fresh.covariance, known.covariance))
