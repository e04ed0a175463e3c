"""Update: tracks after the lines of a slice, with doubt in outliers, and what they show of the
sensors.
"""

import numpy as np
from attrs import evolve
from opir_estimation import (
    FEW_PAIRS,
    AngleMeasurements,
    Followed,
    GatedPairs,
    ModeEstimates,
    PredictedMeasurements,
    group_maxima,
    no_measurements,
    registered,
    shifted,
)

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.association import hard_measurements, merged
from opir_trackers.imm.agreement import with_agreement
from opir_trackers.imm.burnouts import with_looks
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.motion import motion_after
from opir_trackers.imm.outliers import (
    FEW,
    OutlierFractions,
    SliceSpan,
    clean_log_likelihood,
    predicted_directions,
    reweighted,
    suspect_tracks,
)
from opir_trackers.imm.predict import SlicePrediction
from opir_trackers.imm.state import TrackerState
from opir_trackers.parts import Association


def update(
    models: TrackingModels,
    state: TrackerState,
    prediction: SlicePrediction,
    association: Association,
    reported: IntArray,
) -> TrackerState:
    """Return the state after a slice's lines, of reported types (m,), as far as they have
    tracks.
    """
    table = state.table
    if not table.number.size:
        return state._replace(time_s=prediction.end_s)
    lines = prediction.lines
    if models.watch is not None:
        times = prediction.end_s, prediction.span_s
        prediction = prediction._replace(watched=models.watched(table.seen, *times, association))
    looks = _measurements(prediction, association)
    estimates, outliers = _updated_estimates(models, prediction, association, looks, table.outliers)
    estimates = models.filter.with_open_coast(
        estimates, prediction.estimates, table.estimates, prediction.span_s
    )
    log = table.outliers if outliers is None else outliers
    burned = table.estimates.weight[:, 0] > 0.5
    table = table.changed(estimates=estimates, outliers=log)
    table = models.single.with_burnouts(table, burned, prediction.end_s)
    next_state = state._replace(time_s=prediction.end_s, table=table, memory=association.memory)
    if not lines.scan.size:
        return next_state
    next_state = with_looks(next_state, prediction, looks)
    next_state = _registered(models, next_state, prediction, association)
    next_state = with_agreement(models, next_state, prediction, association)
    return _with_detections(models, next_state, prediction, association, reported)


def _with_detections(
    models: TrackingModels,
    state: TrackerState,
    prediction: SlicePrediction,
    association: Association,
    reported: IntArray,
) -> TrackerState:
    """Return the state with the lines of a slice in its table, and single sensors' tracks as ascents
    say.
    """
    before = state.table
    lines = prediction.lines
    table = before.with_detections(association.owner, lines.time_s, lines.sensor, reported)
    motion = motion_after(models, state, prediction, association)
    if motion is not table.motion:
        table = table.changed(motion=motion)
    if table.reports.shape[1] == 1 or -1 in table.reports:
        table = models.single.with_ascents(table, before.seen_s, state.time_s)
    return state._replace(table=table)


def _updated_estimates(
    models: TrackingModels,
    prediction: SlicePrediction,
    association: Association,
    looks: AngleMeasurements,
    log: FloatArray,
) -> tuple[ModeEstimates, FloatArray | None]:
    """Return the estimates after a slice's lines, and the log likelihoods of outlier fractions as
    of `_with_outliers`.
    """
    if not prediction.lines.scan.size:
        return _filtered(models, prediction, looks), None
    posterior = _updated(models, prediction, association, looks)
    return _with_outliers(models, posterior, prediction, association, log)


def _measurements(prediction: SlicePrediction, association: Association) -> AngleMeasurements:
    """Return the measurements of a slice, many of which count as few.

    Tracks that were silent, whose burns may begin at the first look, are updated with each look,
    and few tracks too.
    """
    if not prediction.lines.scan.size:
        return no_measurements()
    pairs = association.pairs
    if pairs.track.size <= FEW_PAIRS:
        return hard_measurements(pairs)
    silence_s = prediction.estimates.detection_rate[:, 2]
    was_silent = (silence_s > prediction.span_s)[pairs.track]
    rows = (~was_silent).nonzero()[0]
    means = merged(pairs.take(rows), association.sensor[rows], prediction.path)
    if True in was_silent:
        means = GatedPairs.concatenate([means, pairs.take(was_silent.nonzero()[0])])
    return hard_measurements(means)


def _updated(
    models: TrackingModels,
    prediction: SlicePrediction,
    association: Association,
    looks: AngleMeasurements,
) -> ModeEstimates:
    """Return the estimates after measurements; all lines count as detections."""
    posterior = _filtered(models, prediction, looks)
    if association.pairs.track.size <= FEW_PAIRS:
        return posterior
    rate = _with_all_looks(posterior.detection_rate, association, looks.track, prediction.end_s)
    return evolve(posterior, detection_rate=rate)


def _filtered(
    models: TrackingModels, prediction: SlicePrediction, looks: AngleMeasurements
) -> ModeEstimates:
    """Return the predicted estimates after the looks of a slice."""
    times = prediction.end_s, looks, prediction.span_s, prediction.watched
    return models.filter.updated(prediction.estimates, *times)


def _with_all_looks(
    detection_rate: FloatArray, association: Association, counted: IntArray, end_s: float
) -> FloatArray:
    """Return detection rates (n, 3) in which all looks of a slice are detections, in place of those
    of tracks `counted` (m,).
    """
    count = len(detection_rate)
    owner = association.owner
    pairs = association.pairs
    last_s = group_maxima(pairs.track, pairs.time_s, count)
    rate = detection_rate.copy()
    rate[:, 0] += np.bincount(owner[owner >= 0], minlength=count) - np.bincount(
        counted, minlength=count
    )
    rate[:, 2] = np.minimum(rate[:, 2], end_s - last_s)
    return rate


def _with_outliers(
    models: TrackingModels,
    posterior: ModeEstimates,
    prediction: SlicePrediction,
    association: Association,
    log: FloatArray,
) -> tuple[ModeEstimates, FloatArray | None]:
    """Return estimates with outliers weighted down, but for tracks that share lines, and the log
    likelihoods.

    `log` (n, fractions) are those of the outlier fractions before the slice; None follows where all
    tracks have next to none.
    """
    fractions = OutlierFractions(log)
    assigned = association.single
    gate = models.config.gate_sigma
    share = fractions.share
    suspects = _suspects(association, share)
    if not suspects.size and True not in (share > FEW):
        return posterior, None
    outliers = clean_log_likelihood(assigned, fractions, gate)
    if not suspects.size:
        return posterior, log + outliers
    weighted = reweighted(
        models.filter,
        prediction.estimates.take(suspects),
        posterior.take(suspects),
        SliceSpan(prediction.end_s, prediction.span_s, gate),
        _of_tracks(assigned, suspects, len(posterior)),
        fractions.take(suspects),
    )
    outliers[suspects] = weighted.outliers
    # Doubted lines were detected all the same, in the time that was watched.
    estimates = posterior.put(suspects, weighted.estimates)
    log = fractions.after(outliers).log
    return evolve(estimates, detection_rate=posterior.detection_rate), log


def _suspects(association: Association, share: FloatArray) -> IntArray:
    """Return the tracks that may have outliers, but for those that share lines."""
    suspects = suspect_tracks(association.single, share)
    if suspects.size and association.doubtful.size:
        return np.setdiff1d(suspects, association.doubtful, assume_unique=True)
    return suspects


def _of_tracks(pairs: GatedPairs, rows: IntArray, count: int) -> GatedPairs:
    """Return the pairs of some of the tracks (count,), renumbered."""
    number = np.full(count, -1, dtype=np.int64)
    number[rows] = np.arange(len(rows))
    pairs = pairs.take((number[pairs.track] >= 0).nonzero()[0])
    return evolve(pairs, track=number[pairs.track])


def _registered(
    models: TrackingModels,
    state: TrackerState,
    prediction: SlicePrediction,
    association: Association,
) -> TrackerState:
    """Return the state with the registration after a slice's pairs, and its tracks
    shifted by the change.

    Tracks that share a line with others, or have a choice of lines of a scan, do not count: what is
    chosen by nearness makes noise look small.
    """
    assigned = _unshared(association.single, prediction)
    if not len(assigned):
        return state
    sensor = prediction.lines.sensor[assigned.line].astype(np.int64)
    if state.registration.is_due(state.time_s, len(state.table)):
        state = _with_registration(models, state, assigned, sensor)
    elif state.registration.has_outliers:
        looks = state.table.number, assigned.track, sensor
        state = state._replace(registration=state.registration.counted(state.time_s, *looks))
    registration = state.registration.after_few_looks(
        assigned, sensor, prediction.registration, len(state.table)
    )
    return state._replace(registration=registration)


def _with_registration(
    models: TrackingModels, state: TrackerState, assigned: GatedPairs, sensor: IntArray
) -> TrackerState:
    """Return the state with the registration after pairs of sensors (m,), and all that follows."""
    prior = evolve(state.registration.at(state.time_s), compared_s=state.time_s)
    vantages = models.vantages(prior, state.time_s)
    table = state.table
    path = models.path(table.estimates, state.time_s)
    moments = models.moments(table.estimates)
    tracks = Followed.of(table.number, moments, path.derivative[:, 2], table.seen)
    residuals = _with_residuals(assigned, path)
    registration = registered(prior, residuals, sensor, tracks, vantages)
    change = registration.known.mean - prior.known.mean
    estimates = shifted(table.estimates, change, tracks, vantages)
    return state._replace(registration=registration, table=table.with_estimates(estimates))


def _with_residuals(assigned: GatedPairs, path: PredictedMeasurements) -> GatedPairs:
    """Return pairs with residuals about the updated tracks in place of innovations.

    A prediction may be tens of kilometres off along the line of the only sensor so far: misfits
    would not be linear.
    """
    return evolve(assigned, measured=assigned.measured - predicted_directions(path, assigned))


def _unshared(assigned: GatedPairs, prediction: SlicePrediction) -> GatedPairs:
    """Return the assigned pairs of tracks none of whose lines is in another's gate, and that have
    one line of a scan in their own.
    """
    pairs = prediction.pairs
    if len(pairs) == len(assigned):
        return assigned
    scans = np.column_stack([pairs.track, prediction.lines.scan[pairs.line]])
    _, scan, looks = np.unique(scans, axis=0, return_inverse=True, return_counts=True)
    is_shared = (np.bincount(pairs.line)[pairs.line] > 1) | (looks[scan.ravel()] > 1)
    return assigned.take((~np.isin(assigned.track, pairs.track[is_shared])).nonzero()[0])
