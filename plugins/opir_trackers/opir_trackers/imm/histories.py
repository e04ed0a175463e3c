"""Histories: the measurements of young tracks, one per sensor and slice, which discriminate targets from ghosts.

Lines are assigned per sensor and slice. Two tracks can agree with each sensor and still follow no target (ghosts): each
lies where one target's lines from one sensor pass the other's from another. The discriminant is the distance between
the lines of two sensors over many slices, and the prior. So the measurements of a track are kept as long as they may
belong to another.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import dot, matvec, tangent_axes
from opir_trackers.assignment import distinct, unambiguous
from opir_trackers.association import AssociationModel, hard_measurements, scan_groups, scan_numbers
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs
from opir_trackers.imm.associate_and_update import AssociationResult
from opir_trackers.imm.measurement_weights import LEAST_WEIGHT, AmbiguousMeasurements, predicted_directions
from opir_trackers.lines_of_sight import AngleMeasurements, LinesOfSight, no_measurements

_NONE = np.empty(0, dtype=np.int64)


@frozen(eq=False)
class Histories:
    """Measurements of tracks that may have one another's lines, and the estimates before the first.

    `number` (n,), ascending, are the track numbers, `begun_s` (n,) their start times and `first` (n rows) the initial
    estimates, predicted to the present without measurements. `measurements` (m rows) are mean measurements of tracks 0
    to n - 1 by `sensor` (m,). `contested` are the lines whose assignment is undecided, and `doubt` (n,) is the last
    probability of another assignment.
    """

    number: IntArray
    begun_s: FloatArray
    first: ModeEstimates
    measurements: AngleMeasurements
    sensor: IntArray
    contested: AmbiguousMeasurements = field(factory=AmbiguousMeasurements.empty)
    doubt: FloatArray = field(default=Factory(lambda self: np.ones(len(self.first)), takes_self=True))

    @classmethod
    def none(cls) -> "Histories":
        """Return the histories of no tracks."""
        return cls(_NONE, np.empty(0), ModeEstimates.empty(), no_measurements(), _NONE)

    def __len__(self) -> int:
        return len(self.number)

    @property
    def ambiguity(self) -> FloatArray:
        """Return the expected number (n,) of undecided lines of each track, Σ p (1 - p)."""
        open_ = self.contested
        track = self.measurements.track[open_.measurement]
        return np.bincount(track, open_.weight * (1.0 - open_.weight), len(self)).astype(np.float64)

    def joined(self, new: "Histories") -> "Histories":
        """Return the histories with those of new tracks, of higher numbers."""
        measurements = new.measurements.with_track(new.measurements.track + len(self))
        return Histories(
            number=np.concatenate([self.number, new.number]),
            begun_s=np.concatenate([self.begun_s, new.begun_s]),
            first=ModeEstimates.concatenate([self.first, new.first]),
            measurements=AngleMeasurements.concatenate([self.measurements, measurements]),
            sensor=np.concatenate([self.sensor, new.sensor]),
            contested=self.contested,
            doubt=np.concatenate([self.doubt, new.doubt]),
        )

    def predicted(self, move: Callable[[ModeEstimates, float], ModeEstimates], step_s: float) -> "Histories":
        """Return the histories a step later."""
        return evolve(self, first=move(self.first, step_s)) if len(self.number) else self

    def of(self, keep: BoolArray) -> "Histories":
        """Return the histories of some tracks (n,)."""
        if keep.all():
            return self
        place = np.cumsum(keep) - 1
        stays = keep[self.measurements.track]
        mine = np.flatnonzero(stays)
        measurements = self.measurements.take(mine)
        return Histories(
            number=self.number[keep],
            begun_s=self.begun_s[keep],
            first=self.first.take(np.flatnonzero(keep)),
            measurements=measurements.with_track(place[measurements.track]),
            sensor=self.sensor[mine],
            contested=self.contested.without(~stays, np.cumsum(stays) - 1),
            doubt=self.doubt[keep],
        )

    def with_measurements(
        self, measurements: AngleMeasurements, sensor: IntArray, contested: AmbiguousMeasurements
    ) -> "Histories":
        """Return the histories with more measurements and their ambiguous lines."""
        sensor = np.concatenate([self.sensor, sensor])
        if not len(contested):
            return evolve(
                self, measurements=AngleMeasurements.concatenate([self.measurements, measurements]), sensor=sensor
            )
        fresh = evolve(
            contested,
            measurement=contested.measurement + len(self.measurements),
            line=contested.line + int(self.contested.line.max(initial=-1)) + 1,
            scan=contested.scan + int(self.contested.scan.max(initial=-1)) + 1,
        )
        return evolve(
            self,
            measurements=AngleMeasurements.concatenate([self.measurements, measurements]),
            sensor=sensor,
            contested=AmbiguousMeasurements.concatenate([self.contested, fresh]),
        )


def smooth_boost_s(look_m: float, period_s: float) -> float:
    """Return the time, s, over which a boost's path is smooth enough for its first look to constrain its last.

    Until then the process noise of the jerk, q √3 t^3.5 / √252, is below the error of looks of `look_m` each, one every
    `period_s`, averaged over the whole time.
    """
    return float((look_m * np.sqrt(84.0 * period_s) / JERK_NOISE_M_S3) ** 0.25)


def mean_measurements(
    predicted: PredictedMeasurements, measurements: AngleMeasurements, sensor: IntArray, slice_s: float
) -> tuple[AngleMeasurements, IntArray]:
    """Return one mean measurement per track, sensor and slice, and the sensors.

    Residuals to the track's own path are averaged with their information: near that path nothing is lost.
    """
    return grouped_measurements(predicted, measurements, sensor, slice_s)[:2]


def grouped_measurements(
    predicted: PredictedMeasurements, measurements: AngleMeasurements, sensor: IntArray, slice_s: float
) -> tuple[AngleMeasurements, IntArray, IntArray]:
    """Return mean measurements and sensors, as `mean_measurements`, and the mean (n,) of each measurement."""
    if not len(measurements):
        return measurements, sensor, sensor
    part = np.floor((measurements.time_s - predicted.time_s) / slice_s).astype(np.int64)
    part -= part.min()
    sensors, parts = int(sensor.max()) + 1, int(part.max()) + 1
    key, group = np.unique((measurements.track * sensors + sensor) * parts + part, return_inverse=True)
    residual = measurements.whitened_residuals(predicted.positions(measurements.track, measurements.time_s))
    reweighted = measurements.whitener.transpose(0, 2, 1)
    weight = _sums(group, (reweighted @ measurements.whitener).reshape(-1, 4)).reshape(-1, 2, 2)
    mean: Any = np.linalg.solve(weight, _sums(group, matvec(reweighted, residual))[:, :, None])
    count = np.bincount(group)[:, None]
    time_s = _sums(group, measurements.time_s[:, None])[:, 0] / count[:, 0]
    origin = _sums(group, measurements.origin_m) / count
    track = key // (parts * sensors)
    apart = predicted.positions(track, time_s) - origin
    axes = tangent_axes(apart / np.sqrt(dot(apart, apart))[:, None])
    root: Any = np.linalg.cholesky(weight)
    return (
        AngleMeasurements(track, time_s, origin, axes, mean[:, :, 0], root.transpose(0, 2, 1)),
        key // parts % sensors,
        group,
    )


def with_biases(histories: Histories, bias_sigma_rad: FloatArray) -> AngleMeasurements:
    """Return the measurements of histories, widened so that a whole history is no more accurate than the bias."""
    bias = bias_sigma_rad[histories.sensor]
    if not bias.any():
        return histories.measurements
    _, history, length = np.unique(
        histories.measurements.track * len(bias_sigma_rad) + histories.sensor, return_inverse=True, return_counts=True
    )
    sharp = np.abs(np.linalg.det(histories.measurements.whitener))
    wider = 1.0 / np.sqrt(1.0 + length[history] * bias**2 * sharp)
    return evolve(histories.measurements, whitener=histories.measurements.whitener * wider[:, None, None])


def _sums(group: IntArray, values: FloatArray) -> FloatArray:
    """Return the sums of rows (n, k) by group."""
    total: FloatArray = np.stack([np.bincount(group, column) for column in values.T], axis=1)
    return total


def updated_with_likelihood(
    filter_: ImmFilter, estimates: ModeEstimates, time_s: float, measurements: AngleMeasurements
) -> tuple[FloatArray, ModeEstimates]:
    """Return the log likelihoods (n,) of measurements of tracks, and the updated estimates.

    Only the likelier mode of each track is updated; the other has next to no weight and is mixed from it at the next
    step.
    """
    boost, boost_root = estimates.boost_mean.copy(), estimates.boost_root.copy()
    coast, coast_root = estimates.coast_mean.copy(), estimates.coast_root.copy()
    gained = np.zeros(len(estimates))
    coasts = estimates.weight[:, 1] > estimates.weight[:, 0]
    seen = np.bincount(measurements.track, minlength=len(estimates)) > 0
    modes = ((filter_.boost, boost, boost_root, ~coasts), (filter_.coast, coast, coast_root, coasts))
    for motion, mean, root, mode in modes:
        rows = np.flatnonzero(mode & seen)
        if not len(rows):
            continue
        place = np.full(len(estimates), -1, dtype=np.int64)
        place[rows] = np.arange(len(rows))
        part = measurements.take(np.flatnonzero(place[measurements.track] >= 0))
        part = part.with_track(place[part.track])
        mean[rows], root[rows], gained[rows] = filter_.mode_updated(motion, mean[rows], root[rows], time_s, part)
    return gained, ModeEstimates(estimates.weight, boost, boost_root, coast, coast_root, estimates.detection_rate)


def rows_of(track: IntArray, wanted: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows of tracks `wanted` (n,), one after the other, and the index into `wanted` of each row."""
    order = np.argsort(track, kind="stable")
    ordered = track[order]
    start, stop = np.searchsorted(ordered, wanted), np.searchsorted(ordered, wanted, side="right")
    length = stop - start
    which = np.repeat(np.arange(len(wanted)), length)
    cluster = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)
    return order[cluster], which


#: Lines with a lower log likelihood ratio to false alarms are not a track's, wherever the track is.
_HOPELESS_LOG = -12.0

#: Histories are kept for at least this time, s: a rival may begin some slices later.
_RIVALS_S = 4.0

#: Histories with a lower probability of another assignment are decided.
_SETTLED = 1e-4

#: Decided histories are assigned again once the log of the age has grown by this: √2 times.
_AGAIN = 0.5 * float(np.log(2.0))

#: Largest ambiguity of tracks with decided lines.
_SHARP = 0.5

#: Process-noise density of the jerk of a boost whose thrust is unknown, m/s³/√s: the smooth time goes with its fourth
#: root, so twice as much shortens it by a sixth.
JERK_NOISE_M_S3 = 0.3

#: Histories are closed after this time, s.
LONGEST_S = 60.0

#: Lines no older than this are reweighted, s; older measurements are fixed.
_RECENT_S = 20.0


def slice_measurements(
    path: PredictedMeasurements,
    result: AssociationResult,
    rows: IntArray,
    lines: LinesOfSight,
    model: AssociationModel,
    span: float,
) -> tuple[AngleMeasurements, IntArray, AmbiguousMeasurements]:
    """Return the measurements of tracks in a slice of length `span`, their sensors, and the ambiguous lines.

    The tracks are `rows` of the estimates, and `path` their prediction after the slice.
    """
    place = np.full(len(result.estimates) + 1, -1, dtype=np.int64)
    place[rows] = np.arange(len(rows))
    owner, pairs = place[result.owner], result.pairs if len(rows) > 1 else result.assigned
    free = (result.owner < 0) | (owner >= 0)
    pairs = pairs.part(np.flatnonzero((place[pairs.track] >= 0) & free[pairs.line]))
    pairs, contested = _with_ambiguous(path, evolve(pairs, track=place[pairs.track]), owner, lines, model)
    measurements, sensor = hard_measurements(pairs), lines.sensor[pairs.line].astype(np.int64)
    weight = np.where(owner[pairs.line] == pairs.track, 1.0, LEAST_WEIGHT)
    weighed_sights = evolve(measurements, whitener=measurements.whitener * np.sqrt(weight)[:, None, None])
    means, sensors, part = grouped_measurements(path, weighed_sights, sensor, span)
    rows = np.flatnonzero(contested)
    if not len(rows):
        return means, sensors, AmbiguousMeasurements.empty()
    residual = measurements.whitened_residuals(path.positions(pairs.track, pairs.time_s))
    open_ = AmbiguousMeasurements(
        measurement=part[rows],
        line=pairs.line[rows],
        scan=scan_numbers(lines.sensor, lines.scan)[pairs.line[rows]],
        measured=residual[rows] * pairs.sigma_rad[rows, None],
        sigma_rad=pairs.sigma_rad[rows],
        log_odds=model.log_odds[sensor[rows]] - 2.0 * np.log(pairs.sigma_rad[rows]),
        weight=weight[rows],
        end_s=np.full(len(rows), path.time_s),
    )
    return means, sensors, open_


def _with_ambiguous(
    path: PredictedMeasurements, pairs: GatedPairs, owner: IntArray, lines: LinesOfSight, model: AssociationModel
) -> tuple[GatedPairs, BoolArray]:
    """Return the pairs that count, and which of them (n,) belong to measurements with an ambiguous line."""
    if len(path.root) < 2:
        return pairs, np.zeros(len(pairs), dtype=bool)
    sensor = lines.sensor[pairs.line].astype(np.int64)
    residual = hard_measurements(pairs).whitened_residuals(path.positions(pairs.track, pairs.time_s))
    log = model.log_odds[sensor] - 2.0 * np.log(pairs.sigma_rad) - 0.5 * dot(residual, residual)
    own = owner[pairs.line] == pairs.track
    some = np.flatnonzero(own | (log > _HOPELESS_LOG))
    pairs, own, sensor = pairs.take(some), own[some], sensor[some]
    measurement = pairs.track * (int(sensor.max(initial=0)) + 1) + sensor
    rivals = ~unambiguous(scan_groups(pairs, lines), pairs.line)
    contested = np.bincount(measurement, rivals)[measurement] > 0.0 if len(measurement) else rivals
    some = np.flatnonzero(own | contested)
    return pairs.take(some), contested[some]


def reweighted(
    filter_: ImmFilter, histories: Histories, estimates: ModeEstimates, time_s: float
) -> tuple[Histories, ModeEstimates]:
    """Return histories with ambiguous lines reweighted by estimates at `time_s`, and the updated estimates."""
    recent = np.flatnonzero(histories.contested.end_s > time_s - _RECENT_S)
    if not len(recent):
        return evolve(histories, contested=AmbiguousMeasurements.empty()) if len(
            histories.contested
        ) else histories, estimates
    histories = evolve(histories, contested=histories.contested.part(recent))
    track = histories.measurements.track
    used = distinct(histories.contested.measurement)
    rows = distinct(track[used])
    place = np.full(len(histories), -1, dtype=np.int64)
    place[rows] = np.arange(len(rows))
    part, measurements = estimates.take(rows), histories.measurements.take(used)
    directions = np.zeros((len(track), 2))
    directions[used] = predicted_directions(
        filter_.predicted_measurements(part, time_s), measurements.with_track(place[measurements.track])
    )
    contested = histories.contested.with_probabilities(track, directions)
    histories = evolve(histories, measurements=contested.gathered(histories.measurements)[0], contested=contested)
    theirs = np.flatnonzero(place[track] >= 0)
    first = evolve(histories.first.take(rows), weight=part.weight, detection_rate=part.detection_rate)
    after = updated_with_likelihood(
        filter_, first, time_s, histories.measurements.take(theirs).with_track(place[track[theirs]])
    )[1]
    return histories, estimates.put(rows, _of_likelier_mode(part, after))


def _of_likelier_mode(before: ModeEstimates, after: ModeEstimates) -> ModeEstimates:
    """Return estimates with each track's likelier mode replaced."""
    coasts = (before.weight[:, 1] > before.weight[:, 0])[:, None]
    return ModeEstimates(
        before.weight,
        np.where(coasts, before.boost_mean, after.boost_mean),
        np.where(coasts[:, None], before.boost_root, after.boost_root),
        np.where(coasts, after.coast_mean, before.coast_mean),
        np.where(coasts[:, None], after.coast_root, before.coast_root),
        before.detection_rate,
    )


def due_for_assignment(histories: Histories, age_s: FloatArray, step_s: float) -> BoolArray:
    """Return the tracks (n,) whose histories are assigned again after a step, at ages (n,)."""
    before, after = (np.floor(np.log(np.maximum(age, 1e-9)) / _AGAIN) for age in (age_s - step_s, age_s))
    anew: BoolArray = (age_s < _RIVALS_S) | (histories.doubt > _SETTLED) | (after > before)
    return anew


def are_open(histories: Histories, age_s: FloatArray, boosts: BoolArray, boost_lasts_s: float) -> BoolArray:
    """Return the tracks (n,) whose histories may still change, at ages (n,)."""
    young = age_s < np.where(boosts, boost_lasts_s, LONGEST_S)
    open_: BoolArray = (age_s < _RIVALS_S) | (histories.doubt > _SETTLED) | (histories.ambiguity > _SHARP)
    return young & open_
