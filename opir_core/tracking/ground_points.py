"""Where tracks came from and where they come down, with the covariance that the state's brings about."""

from typing import NamedTuple

import numpy as np

from opir_core.flight.forces import Forces
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


def impacts(state: FloatArray, covariance: FloatArray, time_s: float, forces: Forces) -> GroundPoints:
    """Return where free flights from inertial states (n, 6) come down.

    The point is that of the mean under `forces`. The covariance is spread through two-body arcs by central differences,
    one standard deviation either way: their partials differ from those under `forces` by parts in a thousand.
    """
    from opir_core.flight.impact_event import impact

    points = GroundPoints.nowhere(len(state))
    if not len(state):
        return points
    duration, point = impact(state[:, :3], state[:, 3:], forces=forces, tolerance_m=_CLOSE_M)
    ground = turned(point, -(time_s + duration))
    side = np.linalg.cholesky(covariance)
    shifted = state[:, None, None, :] + np.stack([side, -side], axis=1).transpose(0, 1, 3, 2)
    flight, fell = impact(shifted[..., :3], shifted[..., 3:], forces=Forces(zonal=(), gravity=forces.gravity))
    landed = turned(fell.reshape(-1, 3), -(time_s + flight.ravel())).reshape(fell.shape)
    apart = 0.5 * (landed[:, 0] - landed[:, 1])
    plane = apart @ local_axes(ground)[:, :2].transpose(0, 2, 1)
    later = 0.5 * (flight[:, 0] - flight[:, 1])
    return _told(ground, time_s + duration, np.concatenate([plane, later[:, :, None]], axis=2).transpose(0, 2, 1))


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
