"""Predict: tracks at the end of a slice, their measurements in it, and its lines within their
gates.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from opir_estimation import (
    BOOST,
    GatedPairs,
    LinesOfSight,
    LookTimes,
    ModeEstimates,
    PredictedMeasurements,
    Registration,
)

from opir_core.arrays import BoolArray, FloatArray
from opir_trackers.association import NearestLines, lone_lines
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import TrackerState, TrackTable


class SlicePrediction(NamedTuple):
    """Estimates and predicted measurements at the end of a slice, s, and its length, s; `lines` are
    those in the slice, `pairs` those within gates.

    `registration` is that with which the lines were corrected. `nearest` is the assignment of the
    lines, and of those of each instant, where it is unambiguous. `watched` is how long tracks were
    looked at in the slice, once its lines are associated, None for throughout. Without tracks or
    lines no measurements are predicted.
    """

    estimates: ModeEstimates
    path: PredictedMeasurements
    pairs: GatedPairs
    lines: LinesOfSight
    end_s: float
    span_s: float
    registration: Registration
    nearest: NearestLines | None = None
    watched: LookTimes | None = None


def predict(
    models: TrackingModels, state: TrackerState, end_s: float, lines: LinesOfSight
) -> SlicePrediction:
    """Return the tracks at the end of a slice with lines; the last prediction is kept, for labels
    need the same.
    """
    arguments = state.table, state.registration, state.time_s, end_s, lines
    # The memo is the models' own: with them among what it keeps, they would outlive their run.
    return models.memo.of("prediction", partial(_predicted, models), *arguments)


def _predicted(
    models: TrackingModels,
    table: TrackTable,
    registration: Registration,
    start_s: float,
    end_s: float,
    lines: LinesOfSight,
) -> SlicePrediction:
    span_s = end_s - start_s
    estimates = models.memo.of("moved", models.filter.predicted_open, table.estimates, span_s)
    times = end_s, span_s, registration
    if not table.number.size or not lines.scan.size:
        return SlicePrediction(estimates, _NO_PATH, GatedPairs.empty(), lines, *times)
    path = models.path(estimates, end_s)
    if registration.widens_gates:
        path = _widened(path, models, estimates.likelier_state, table.seen, registration)
    pairs = models.gated_pairs(path, lines, span_s)
    lone = lone_lines(pairs, lines, models.association)
    return SlicePrediction(estimates, path, pairs, lines, *times, lone)


def _widened(
    path: PredictedMeasurements,
    models: TrackingModels,
    state: FloatArray,
    seen: BoolArray,
    registration: Registration,
) -> PredictedMeasurements:
    """Return predictions of states (n, 6), seen by sensors (n, sensors), with the errors that these
    may have.
    """
    vantages = models.vantages(registration, path.time_s)
    return path._replace(bias_covariance=registration.gate_covariance(state, seen, vantages))


_NO_PATH = PredictedMeasurements(0.0, np.empty((0, 5, 3)), np.empty((0, BOOST, BOOST)))
