"""Associate: the track of each line of a slice, by the associator."""

import numpy as np
from opir_estimation import LinesOfSight

from opir_core.arrays import IntArray
from opir_trackers.association import unassigned
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction, predict
from opir_trackers.imm.state import TrackerState
from opir_trackers.onset.posterior import standing
from opir_trackers.parts import Association, AssociationProblem, require_shape


def associate(
    models: TrackingModels, state: TrackerState, prediction: SlicePrediction
) -> Association:
    """Return the association of a slice's lines with the tracks that are predicted."""
    lines = prediction.lines
    if not prediction.pairs.track.size and (state.memory is None or not lines.scan.size):
        return Association(
            lines=lines,
            owner=unassigned(lines.scan.size),
            pairs=prediction.pairs,
            memory=state.memory,
        )
    parts = models.parts
    association = parts.associator.associate(_problem(models, state, prediction))
    _require_owners(models, association.owner, state, lines)
    return association


def _require_owners(
    models: TrackingModels, owner: IntArray, state: TrackerState, lines: LinesOfSight
) -> None:
    """Raise the error of an associator that returns no track rows of the lines."""
    parts = models.parts
    if parts.associates_itself:
        return
    count = state.table.number.size
    is_right = owner.shape == lines.scan.shape and owner.dtype.kind == "i"
    require_shape(
        parts.associator,
        parts.owners["association"],
        f"track rows of {lines.scan.size} lines, -1 to {count - 1}",
        is_right=is_right
        and (not owner.size or -1 <= int(owner.min()) <= int(owner.max()) < count),
    )


def _problem(
    models: TrackingModels, state: TrackerState, prediction: SlicePrediction
) -> AssociationProblem:
    """Return the association of lines with the tracks that are predicted."""
    table = state.table
    return AssociationProblem(
        lines=prediction.lines,
        pairs=prediction.pairs,
        number=table.number,
        path=prediction.path,
        reports=table.reports,
        model=models.association,
        end_s=prediction.end_s,
        span_s=prediction.span_s,
        memory=state.memory,
        known_nearest=prediction.nearest,
        stands=standing(table.motion),
    )


def track_numbers(models: TrackingModels, state: TrackerState, lines: LinesOfSight) -> IntArray:
    """Return the track number (n,) of each line of sight of the next tick, -1 for none.

    Only lines of one sensor and one instant compete, so the result does not depend on how the scene
    is cut into calls.
    """
    number = state.table.number
    if not number.size or not lines.scan.size:
        return unassigned(lines.scan.size)
    lines = models.corrected(state.registration, lines)
    prediction = predict(models, state, state.time_s + models.config.cadence_s, lines)
    eligible = models.confirmed(state)
    prediction = prediction._replace(lines=lines.of_instants())
    if False in eligible:
        rows = eligible[prediction.pairs.track].nonzero()[0]
        prediction = prediction._replace(pairs=prediction.pairs.take(rows), nearest=None)
    owner = models.parts.associator.labels(_problem(models, state, prediction), eligible)
    _require_owners(models, owner, state, lines)
    return np.where(owner < 0, -1, number[owner])
