"""Predict: tracks at the end of a slice, their measurements in it, and its lines within their
gates.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_estimation import (
    BOOST,
    GatedPairs,
    LinesOfSight,
    ModeEstimates,
    PredictedMeasurements,
    Registration,
)

from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.crowds import CrowdPairs, Crowds
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable


class SlicePrediction(NamedTuple):
    """Estimates and predicted measurements at the end of a slice, s, and its length, s; `lines` are
    those in the slice.

    Without tracks or lines no measurements are predicted. `pairs` are the gated pairs of tracks
    outside crowds, and of crowds' tracks in sensors that do not follow them; `crowd_pairs` are
    those of the crowds' focal-plane tracks, None without crowds.
    """

    estimates: ModeEstimates
    path: PredictedMeasurements
    pairs: GatedPairs
    crowd_pairs: CrowdPairs | None
    lines: LinesOfSight
    end_s: float
    span_s: float


def predict(
    models: TrackingModels, state: TrackerState, end_s: float, lines: LinesOfSight
) -> SlicePrediction:
    """Return the tracks at the end of a slice with lines; the last prediction is kept, for labels
    need the same.
    """
    arguments = state.estimates, state.table, state.crowds, state.registration
    return models.memo.of("prediction", _predicted, models, *arguments, state.time_s, end_s, lines)


def _predicted(
    models: TrackingModels,
    estimates: ModeEstimates,
    table: TrackTable,
    crowds: Crowds,
    registration: Registration,
    start_s: float,
    end_s: float,
    lines: LinesOfSight,
) -> SlicePrediction:
    span_s = end_s - start_s
    estimates = models.memo.of("moved", models.filter.predicted_open, estimates, span_s)
    if not table.number.size or not lines.scan.size:
        return SlicePrediction(estimates, _NO_PATH, GatedPairs.empty(), None, lines, end_s, span_s)
    path = models.path(estimates, end_s)
    if registration.widens_gates:
        vantages = models.vantages(registration, end_s)
        state = estimates.likelier_state
        path = path._replace(
            bias_covariance=registration.gate_covariance(state, table.reports >= 0, vantages)
        )
    crowd_pairs = None
    if crowds.are_there:
        pairs = _lone_pairs(models, path, lines, span_s, table, crowds)
        crowd_pairs = crowd.paired(crowds.tracks, start_s, lines, span_s, models.config.gate_sigma)
    else:
        pairs = models.gated_pairs(path, lines, span_s)
    return SlicePrediction(estimates, path, pairs, crowd_pairs, lines, end_s, span_s)


_NO_PATH = PredictedMeasurements(0.0, np.empty((0, 5, 3)), np.empty((0, BOOST, BOOST)))


def _lone_pairs(
    models: TrackingModels,
    path: PredictedMeasurements,
    lines: LinesOfSight,
    span_s: float,
    table: TrackTable,
    crowds: Crowds,
) -> GatedPairs:
    follows = crowds.follows(table.number, table.reports.shape[1])
    rows = np.flatnonzero(~follows.all(axis=1))
    bias = path.bias_covariance
    subset = path._replace(
        derivative=path.derivative[rows],
        root=path.root[rows],
        bias_covariance=None if bias is None else bias[rows],
    )
    pairs = models.gated_pairs(subset, lines if len(rows) else lines.take(rows), span_s)
    pairs = evolve(pairs, track=rows[pairs.track])
    return pairs.take(np.flatnonzero(~follows[pairs.track, lines.sensor[pairs.line]]))
