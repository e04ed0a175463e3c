"""Initiation of Stone Soup tracks near the ground, and deletion after a time without detection."""

from datetime import datetime, timedelta
from itertools import islice
from typing import Any

import numpy as np
from opir_estimation import FIRST_HEIGHT_M
from opir_trackers import (
    FIRST_CLIMB_M_S,
    FIRST_FORCE_M_S2,
    TrackCandidates,
    prior_axes,
    prior_sigmas,
)
from ordered_set import OrderedSet
from stonesoup.base import Property
from stonesoup.deleter.base import Deleter
from stonesoup.initiator.base import GaussianInitiator
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.track import Track
from stonesoup.types.update import Update

from opir_core.arrays import FloatArray
from opir_core.geometry import intersection_with_ellipsoid

#: Prior standard deviations of specific force, m/s², and of the jerk, m/s³, per axis; notional.
_FORCE_SIGMA_M_S2 = 20.0
_JERK_SIGMA_M_S3 = 0.5


class GroundInitiator(GaussianInitiator):  # type: ignore[misc]
    """A track for each unassociated detection: near the ground on its line of sight, updated by it.

    The prior is that of the tracker `imm` for a cluster of one sensor
    (docs/explanation/association.md). A line that misses the Earth starts no track.
    """

    updater: Any = Property(doc="the tracker's updater")
    ndim_state: int = Property(default=9, doc="6, 9 or 12")

    def initiate(self, detections: Any, timestamp: datetime, **_: Any) -> "OrderedSet[Track]":
        """Return tracks started by unassociated detections."""
        tracks: OrderedSet[Track] = OrderedSet([])
        for detection in detections:
            model = detection.measurement_model
            place = _ground(model, detection)
            if np.isfinite(place).all():
                mean, covariance = ground_prior(place, self.ndim_state)
                prior = GaussianStatePrediction(mean, covariance, timestamp=detection.timestamp)
                # Named here, or Stone Soup draws a name from the system's entropy.
                name = f"{timestamp.isoformat()} {len(tracks)}"
                tracks.add(
                    Track([self.updater.update(SingleHypothesis(prior, detection))], id=name)
                )
        return tracks


class SilenceDeleter(Deleter):  # type: ignore[misc]
    """Deletion of tracks without detection for too long, sooner for tentative or uncertain ones.

    Uncertainty deletes no track that is still detected. One sensor leaves the position along its
    line of sight open, by hundreds of kilometres in the end; a new track in its place would be
    assumed near the ground.
    """

    needed_hits: int = Property(doc="detections after which a track is no longer tentative")
    tentative_s: float = Property(doc="longest silence of a tentative track")
    silence_s: float = Property(doc="longest silence of a track")
    lost_sigma_m: float = Property(
        doc="standard deviation of a position, on any axis, beyond which it is tentative"
    )

    def check_for_deletion(self, track: Any, timestamp: datetime | None = None, **_: Any) -> bool:
        """Whether a track is deleted."""
        time = track.timestamp if timestamp is None else timestamp
        last_update = next(
            state.timestamp for state in reversed(track.states) if isinstance(state, Update)
        )
        variance = np.diag(track.covar)[:3]
        is_lost = not variance.max() <= self.lost_sigma_m**2
        patience = (
            self.silence_s
            if has_hits(track, self.needed_hits) and not is_lost
            else self.tentative_s
        )
        return time - last_update > timedelta(seconds=patience) or not np.isfinite(variance).all()


def has_hits(track: Any, needed: int) -> bool:
    """Whether a track has at least this number of detections."""
    updates = (state for state in track.states if isinstance(state, Update))
    return next(islice(updates, needed - 1, None), None) is not None


def ground_prior(place_ecef_m: FloatArray, ndim_state: int) -> tuple[FloatArray, FloatArray]:
    """Return mean (d, 1) and covariance (d, d), ECEF, of a target near the ground at (3,)."""
    candidate = TrackCandidates(place_ecef_m[None], np.zeros(1), np.ones(1, dtype=np.int64))
    axes = prior_axes(candidate)[0]
    position_sigma, velocity_sigma = prior_sigmas(candidate)
    mean = np.zeros(ndim_state)
    covariance = np.zeros((ndim_state, ndim_state))
    mean[:3] = place_ecef_m
    mean[3:6] = FIRST_CLIMB_M_S * axes[2]
    covariance[:3, :3] = (axes.T * position_sigma[0] ** 2) @ axes
    covariance[3:6, 3:6] = (axes.T * velocity_sigma[0] ** 2) @ axes
    for block, sigma in ((2, _FORCE_SIGMA_M_S2), (3, _JERK_SIGMA_M_S3)):
        rows = np.arange(3 * block, min(3 * block + 3, ndim_state))
        covariance[rows, rows] = float(sigma) ** 2
    if ndim_state > 6:
        mean[6:9] = FIRST_FORCE_M_S2 * axes[2]
    return mean[:, None], covariance


def _ground(model: Any, detection: Any) -> FloatArray:
    elevation, bearing = (float(angle) for angle in detection.state_vector[:, 0])
    level = np.cos(elevation)
    local = np.array([level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation)])
    origin = np.asarray(model.translation_offset, dtype=np.float64).reshape(1, 3)
    place: FloatArray = intersection_with_ellipsoid(
        origin, (local @ model.rotation_matrix)[None], FIRST_HEIGHT_M
    )[0]
    return place
