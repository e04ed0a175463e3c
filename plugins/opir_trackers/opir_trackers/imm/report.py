"""Reported tracks of `imm`."""

from collections.abc import Mapping, Sequence
from math import cos, sin
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve
from opir_estimation import ModeEstimates, glided
from opir_forecast import BoostEstimates, LaunchForecasts

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.plugin import REPORTED_TYPES, TARGET_TYPES, Sensor, Tracks
from opir_trackers.imm.state import TrackTable


class ReportedTracks(NamedTuple):
    """The tracks that are reported at a time, with inertial means (n, 6) and covariances (n, 6, 6).

    `is_brief` is as in `Tracks`, `reports` (n, H) are the log likelihoods of sensors' reports, and
    `end` (n,) are codes into `TRACK_ENDS` of tracks that ended since the last tick.
    """

    time_s: float
    table: TrackTable
    mean: FloatArray
    covariance: FloatArray
    is_brief: BoolArray
    reports: FloatArray
    end: ByteArray


def boost_estimates(reported: ReportedTracks, launched: BoolArray) -> BoostEstimates:
    """Return the record of tracks that forecasts are made from; `launched` (n,) are forecast."""
    table = reported.table
    estimates = table.estimates
    hits, spell, silent_s = estimates.detection_rate.T
    return BoostEstimates(
        table.number,
        launched,
        estimates.weight[:, 0],
        estimates.burn_share,
        estimates.burn_mean,
        estimates.burn_root,
        estimates.coast_mean,
        estimates.coast_root,
        silent_s,
        spell / np.maximum(hits, 1.0),
        table.launch,
        table.launch_covariance,
        reported.reports,
    )


def tracks_of(
    reported: ReportedTracks,
    forecasts: LaunchForecasts,
    launched: BoolArray,
    hypotheses: Mapping[str, Any],
) -> Tracks:
    """Return tracks with their forecasts and columns of hypotheses; those that are not `launched`
    (n,) have no launch point and no impact.
    """
    table = reported.table
    return Tracks(
        np.array([reported.time_s] * table.number.size),
        table.number,
        *earth_fixed(reported.mean, reported.covariance, reported.time_s),
        *_launches(table, launched),
        forecasts.impact,
        forecasts.impact_covariance,
        impact_sigmas=forecasts.impact_sigmas,
        impact_regions=forecasts.impact_regions,
        probability_burning=forecasts.probability_burning,
        probability_relights=forecasts.probability_relights,
        seen_s=table.seen_s - table.first_s,
        is_brief=reported.is_brief,
        end=np.where(reported.end > 0, reported.end, forecasts.end).astype(np.uint8),
        **hypotheses,
    )


def _launches(table: TrackTable, launched: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return launches (n, 3) and covariances (n, 3, 3), unknown where a track is no launch."""
    no_launch = (~launched).nonzero()[0]
    if not no_launch.size:
        return table.launch, table.launch_covariance
    launch = table.launch.copy()
    covariance = table.launch_covariance.copy()
    launch[no_launch] = np.nan
    covariance[no_launch] = np.nan
    return launch, covariance


def with_glides(tracks: Tracks, estimates: ModeEstimates, share: FloatArray) -> Tracks:
    """Return tracks whose states are mixtures with those of gliders, as far as they coast; `share`
    (n,) is P(glide).
    """
    share = share * estimates.weight[:, 1]
    # A less probable glide does not count.
    rows = (share > 0.01).nonzero()[0]
    if not rows.size:
        return tracks
    gliding = glided(
        tracks.state[rows], tracks.state_covariance[rows], estimates.detection_rate[rows, 2]
    )
    state, covariance = mixed_with(
        tracks.state, tracks.state_covariance, rows, gliding, share[rows]
    )
    return evolve(tracks, state=state, state_covariance=covariance)


def mixed_with(
    state: FloatArray,
    covariance: FloatArray,
    rows: IntArray,
    alternative: tuple[FloatArray, FloatArray],
    share: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return states (n, 6) and covariances (n, 6, 6), of rows those of mixtures with alternatives
    in shares (m,).
    """
    difference = alternative[0] - state[rows]
    weight = share[:, None, None]
    state = state.copy()
    covariance = covariance.copy()
    state[rows] += share[:, None] * difference
    spread = weight * (1.0 - weight) * difference[:, :, None] * difference[:, None, :]
    mixed = weight * alternative[1] + (1.0 - weight) * covariance[rows] + spread
    covariance[rows] = 0.5 * (mixed + mixed.mT)
    return state, covariance


def type_log_likelihoods(sensors: Sequence[Sensor]) -> FloatArray:
    """Return log P(reported | true), (sensors, reported types + 1, true types), from the confusion
    matrices.

    The last reported type is none. A sensor without a confusion matrix gives no information.
    """
    table = np.zeros((len(sensors), len(REPORTED_TYPES) + 1, len(TARGET_TYPES)))
    for number, sensor in enumerate(sensors):
        for column, true in enumerate(TARGET_TYPES):
            if true in sensor.confusion:
                chances = sensor.confusion[true]
                # A report that the matrix excludes is next to impossible.
                stated = [max(chances.get(name, 0.0), 1e-6) for name in REPORTED_TYPES]
                table[number, :-1, column] = np.log(stated)
    return table


def type_evidence(reports: IntArray, evidence: FloatArray) -> FloatArray:
    """Return log likelihoods (n, types) of the last report of each sensor, (n, sensors), by
    `type_log_likelihoods`.
    """
    return evidence[np.arange(len(evidence)), reports].sum(axis=1)


def earth_fixed(
    state: FloatArray, covariance: FloatArray, time_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return inertial states (n, 6) and covariances (n, 6, 6) in ECEF, velocities relative to the
    rotating Earth.
    """
    change = to_earth(time_s)
    moved = change @ covariance @ change.T
    return state @ change.T, 0.5 * (moved + moved.mT)


def to_earth(time_s: float) -> FloatArray:
    """Return the matrix (6, 6) that takes an inertial state to ECEF, velocity over the ground."""
    turned_rad = EARTH_ROTATION_RAD_S * time_s
    sine = sin(turned_rad)
    cosine = cos(turned_rad)
    fast = EARTH_ROTATION_RAD_S * cosine
    slow = EARTH_ROTATION_RAD_S * sine
    return np.array(
        (
            (cosine, sine, 0.0, 0.0, 0.0, 0.0),
            (-sine, cosine, 0.0, 0.0, 0.0, 0.0),
            (0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            (-slow, fast, 0.0, cosine, sine, 0.0),
            (-fast, -slow, 0.0, -sine, cosine, 0.0),
            (0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        )
    )
