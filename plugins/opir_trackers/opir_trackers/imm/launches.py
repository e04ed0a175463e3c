"""Launch points of young tracks: their paths followed back."""

import numpy as np

from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import TrackerState
from opir_trackers.launch_points import LaunchDelayPrior, LaunchPoints, delays_at_once, launches, updated_points
from opir_trackers.lines_of_sight import emission_s
from opir_trackers.track_priors import first_motion

#: The launch point is estimated for tracks no older than this, s.
_YOUNG_S = 10.0


def with_launch_points(models: TrackingModels, now: TrackerState) -> TrackerState:
    """Return the state with the launch points of young tracks, also of those that have just been initiated."""
    fresh = now.time_s - now.table.begun_s <= _YOUNG_S
    if not np.count_nonzero(fresh):
        return now
    young = np.flatnonzero(fresh & (now.estimates.weight[:, 0] > 0.5))
    if not len(young):
        return now
    table, estimates = now.table.part(young), now.estimates.part(young)
    predicted, thrust = models.path(estimates, now.time_s), models.config.thrust
    inland = models.config.hypotheses.inland_share
    place, seen = estimates.likelier_position_m, table.reports >= 0
    biased = models.shared_covariance(now, estimates, table)
    first_s = emission_s(table.first_s, models.biases.ranges_m(place, now.time_s, seen), models.light_time)
    at_once = delays_at_once(models.period_s, models.association.detection_probability, seen)
    prior = LaunchDelayPrior(at_once, first_motion(predicted, first_s, seen.sum(axis=1) < 2, thrust), inland)
    points = launches(
        predicted, first_s, prior, thrust.launch_noise_m_s2, None if biased is None else biased[:, :3, :3]
    )
    points.covariance[:, 2, 2] += models.config.clock_sigma_s**2
    launch, covariance = now.table.launch.copy(), now.table.launch_covariance.copy()
    launch[young], covariance[young] = updated_points(LaunchPoints(table.launch, table.launch_covariance), points)
    return now.after(now.time_s, now.estimates, now.table.with_launches(launch, covariance))
