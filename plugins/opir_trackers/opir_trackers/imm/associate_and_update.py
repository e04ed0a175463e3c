"""Gating, association and update of tracks with the lines of sight of a slice."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_trackers.association import (
    Association,
    AssociationModel,
    ambiguous_tracks,
    associate_nearest,
    hard_measurements,
    merged,
)
from opir_trackers.configs import ImmConfig
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.mode_mixing import have_uncertain_velocity
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs, candidates, gated
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.crowds import CrowdPairs, Crowds, CrowdUpdate, SensorView
from opir_trackers.imm.outliers import (
    FEW,
    OutlierFractions,
    SliceSpan,
    clean_log_likelihood,
    reweighted,
    suspect_tracks,
)
from opir_trackers.imm.track_management import TrackTable
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.registration.registration import Registration
from opir_trackers.registration.shared_errors import Vantages
from opir_trackers.sensors import Biases

_NONE = np.empty(0, dtype=np.int64)

_Answer = TypeVar("_Answer")


class AssociationResult(NamedTuple):
    """Estimates after a slice, the track row of each line, -1 for none, the pairs assigned to lone tracks, the crowds,
    and the pairs within the gates of lone tracks.

    `outliers` (n, fractions) is the log likelihood of the outlier fractions of each track; None where all tracks have
    next to none.
    """

    estimates: ModeEstimates
    owner: IntArray
    assigned: GatedPairs
    crowds: Crowds
    pairs: GatedPairs
    outliers: FloatArray | None = None


class Memo:
    """The last result of each function, by name: labels and estimates need the same predictions, gates and pairs."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def of(self, name: str, function: Callable[..., _Answer], *asked: Any) -> _Answer:
        """Return what a function returns, or returned if it was last asked with the same objects and numbers."""
        last = self._last.get(name)
        if last is None or not all(one is other or _are_equal(one, other) for one, other in zip(last[0], asked, strict=True)):
            last = self._last[name] = asked, function(*asked)
        answer: _Answer = last[1]
        return answer


def _are_equal(one: object, other: object) -> bool:
    return isinstance(one, float) and isinstance(other, float) and one == other


@frozen(eq=False)
class AssociateAndUpdate:
    """Association and update of tracks with lines of sight."""

    config: ImmConfig
    filter: ImmFilter
    model: AssociationModel
    light_time: bool
    biases: Biases
    memo: Memo = field(factory=Memo)

    def predicted(self, estimates: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the estimates a step later, as `predicted_open`."""
        return self.memo.of("moved", self.filter.predicted_open, estimates, step_s)

    def predicted_measurements(self, estimates: ModeEstimates, time_s: float) -> PredictedMeasurements:
        """Return the predictions of the estimates about their time."""
        return self.memo.of("path", self.filter.predicted_measurements, estimates, time_s)

    def with_bias_covariance(
        self, estimates: ModeEstimates, time_s: float, reports: IntArray, registration: Registration
    ) -> PredictedMeasurements:
        """Return the predictions including the shared errors of the sensors that see each track, by `reports`."""
        return self.memo.of("blurred", self._blurred, estimates, time_s, reports, registration)

    def _blurred(
        self, estimates: ModeEstimates, time_s: float, reports: IntArray, registration: Registration
    ) -> PredictedMeasurements:
        path = self.predicted_measurements(estimates, time_s)
        if not registration.widens_gates:
            return path
        vantages = self.vantages(registration, time_s)
        shared = registration.gate_covariance(estimates.likelier_state, reports >= 0, vantages)
        return path._replace(bias_covariance=shared)

    def corrected(self, registration: Registration, lines: LinesOfSight) -> LinesOfSight:
        """Return lines of sight without the errors of their sensors that are known."""
        if not registration.corrects:
            return lines
        return self.memo.of("corrected", lambda known, raw: known.corrected(raw), registration, lines)

    def vantages(self, registration: Registration, time_s: float) -> Vantages:
        """Return the sensors at a time, their angles weighted as the registration leaves them."""
        places = self.memo.of("vantages", Vantages.of, self.biases.sensors, time_s)
        return places._replace(weight=self.biases.weights(registration.apart_rad))

    def moments(self, estimates: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity."""
        return self.memo.of("moments", self.filter.moments, estimates)

    def with_velocity_prior(self, estimates: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the estimates with the velocity covariance of the tracks `rows` bounded by the prior."""
        rows = rows[have_uncertain_velocity(self.moments(estimates)[1][rows])]
        return self.filter.with_velocity_prior(estimates, rows) if len(rows) else estimates

    def view(self, registration: Registration) -> SensorView:
        """Return the sensors, what is left of their errors, and whether light takes time."""
        return SensorView(self.biases.sensors, registration.apart_rad, self.light_time)

    def updated_tracks(
        self,
        estimates: ModeEstimates,
        end_s: float,
        lines: LinesOfSight,
        span: float,
        table: TrackTable,
        crowds: Crowds,
        registration: Registration,
    ) -> AssociationResult:
        """Return the estimates after a slice's lines, and their association, given what is known of tracks, crowds and
        sensors."""
        ahead = self.with_bias_covariance(estimates, end_s, table.reports, registration)
        view, pairs = self.view(registration), self.lone_pairs(ahead, lines, span, table, crowds)
        if len(table) > 1:
            rows = crowd.contested_tracks(pairs.track, pairs.line, lines.sensor[pairs.line], table.reports >= 0)
            crowds = self._with_tracks(crowds, rows, ahead, table, view)
        update = None
        if crowds.are_there:
            update, pairs = self._followed(crowds, pairs, lines, end_s, span, ahead, table, view)
        association = associate_nearest(pairs, lines, self.model)
        owner, used, sensor = association.owner, association.assigned, lines.sensor[association.assigned.line]
        if update is not None:
            crowds = self._with_new_sensors(update.crowds, used, lines.sensor, ahead, table, view)
            theirs = crowd.equivalent_pairs(update, table.number, ahead, self.light_time)
            used, sensor = GatedPairs.concatenate([used, theirs]), np.append(sensor, update.equivalent.sensor)
            owner = np.where(update.number >= 0, np.searchsorted(table.number, update.number), owner)
        after = self._updated(estimates, end_s, span, owner, used, sensor, ahead)
        result = AssociationResult(after, owner, association.assigned, crowds, pairs)
        shared = ambiguous_tracks(pairs, lines) if association.is_ambiguous else _NONE
        slice_span = SliceSpan(end_s, span, self.config.gate_sigma)
        return self._with_outliers(result, estimates, slice_span, OutlierFractions(table.outliers), shared)

    def _with_outliers(
        self,
        result: AssociationResult,
        estimates: ModeEstimates,
        span: SliceSpan,
        fractions: OutlierFractions,
        shared: IntArray,
    ) -> AssociationResult:
        """Return the result with outliers weighted down, but for tracks `shared`, which share lines."""
        share = self.memo.of("shares", lambda log: OutlierFractions(log).share, fractions.log)
        suspects = suspect_tracks(result.assigned, share)
        if len(suspects) and len(shared):
            suspects = np.setdiff1d(suspects, shared, assume_unique=True)
        if len(suspects):
            return self._with_outlier_weights(result, estimates, span, fractions, suspects)
        if not np.count_nonzero(share > FEW):
            return result
        return result._replace(outliers=fractions.log + clean_log_likelihood(result.assigned, fractions, span.gate))

    def _followed(
        self,
        crowds: Crowds,
        pairs: GatedPairs,
        lines: LinesOfSight,
        end_s: float,
        span: float,
        ahead: PredictedMeasurements,
        table: TrackTable,
        view: SensorView,
    ) -> tuple[CrowdUpdate, GatedPairs]:
        """Return the crowds after a slice, with the tracks that share lines with them, and the pairs of lone tracks."""
        near = self.crowd_pairs(crowds, end_s - span, lines, span)
        update = crowd.updated_crowds(crowds, near, lines, end_s, self.model, self.config.gate_sigma, view)
        sharing = np.unique(pairs.track[np.isin(pairs.line, np.flatnonzero(update.number >= 0))])
        pairs = _of_lone_tracks(pairs, update, table, lines.sensor)
        # Those that join now are alone for this slice.
        return update._replace(crowds=self._with_tracks(update.crowds, sharing, ahead, table, view)), pairs

    def _with_new_sensors(
        self,
        crowds: Crowds,
        assigned: GatedPairs,
        sensor: IndexArray,
        ahead: PredictedMeasurements,
        table: TrackTable,
        view: SensorView,
    ) -> Crowds:
        """Return the crowds with focal-plane tracks in the sensors that gave their tracks lines of their own."""
        fresh = np.zeros(table.reports.shape, dtype=bool)
        fresh[assigned.track, sensor[assigned.line]] = True
        fresh &= crowds.holds(table.number)[:, None] & ~crowds.follows(table.number, table.reports.shape[-1])
        rows = np.flatnonzero(fresh.any(axis=1))
        return crowd.joined(crowds, table.number, rows, ahead, fresh, view) if len(rows) else crowds

    def _with_tracks(
        self, crowds: Crowds, rows: IntArray, ahead: PredictedMeasurements, table: TrackTable, view: SensorView
    ) -> Crowds:
        """Return the crowds with tracks `rows`, of which some may be in."""
        rows = rows[~crowds.holds(table.number[rows])]
        seen = table.reports >= 0
        return crowd.joined(crowds, table.number, rows, ahead, seen, view) if len(rows) else crowds

    def _updated(
        self,
        estimates: ModeEstimates,
        end_s: float,
        span: float,
        owner: IntArray,
        used: GatedPairs,
        sensor: IndexArray,
        ahead: PredictedMeasurements,
    ) -> ModeEstimates:
        """Return the estimates after pairs, many of which count as few; all their looks count as detections.

        Tracks that were silent, whose burns may begin at the first look, are updated with each look.
        """
        silent = estimates.detection_rate[:, 2] > span
        raw = silent[used.track]
        if raw.all():
            return self.filter.updated(estimates, end_s, hard_measurements(used), span)
        each, some = np.flatnonzero(raw), np.flatnonzero(~raw)
        few = merged(used.take(some), sensor[some], ahead)
        pairs = few if not len(each) else GatedPairs.concatenate([few, used.take(each)])
        after = self.filter.updated(estimates, end_s, hard_measurements(pairs), span)
        count = len(estimates)
        more = np.bincount(owner[owner >= 0], minlength=count) - np.bincount(pairs.track, minlength=count)
        last_s = np.full(count, -np.inf)
        np.maximum.at(last_s, used.track, used.time_s)
        rate = after.detection_rate.copy()
        rate[:, 0] += more
        rate[:, 2] = np.minimum(rate[:, 2], end_s - last_s)
        return evolve(after, detection_rate=rate)

    def _with_outlier_weights(
        self,
        result: AssociationResult,
        estimates: ModeEstimates,
        span: SliceSpan,
        fractions: OutlierFractions,
        suspects: IntArray,
    ) -> AssociationResult:
        """Return the result with the lines of unambiguous tracks `suspects` reweighted."""
        outliers = clean_log_likelihood(result.assigned, fractions, span.gate)
        place = np.full(len(estimates), -1, dtype=np.int64)
        place[suspects] = np.arange(len(suspects))
        mine = result.assigned.take(np.flatnonzero(place[result.assigned.track] >= 0))
        assigned, before, after = (
            evolve(mine, track=place[mine.track]),
            estimates.take(suspects),
            result.estimates.take(suspects),
        )
        weighed = reweighted(self.filter, before, after, span, assigned, fractions.take(suspects))
        outliers[suspects] = weighed.outliers
        return result._replace(
            estimates=result.estimates.put(suspects, weighed.estimates), outliers=fractions.after(outliers).log
        )

    def lone_pairs(
        self, path: PredictedMeasurements, lines: LinesOfSight, span: float, table: TrackTable, crowds: Crowds
    ) -> GatedPairs:
        """Return the gated pairs of tracks outside crowds, and of crowds' tracks in sensors that do not follow them."""
        if not crowds.are_there:
            return self.gated_pairs(path, lines, span)
        return self.memo.of("lone", self._lone_pairs, path, lines, span, table, crowds)

    def _lone_pairs(
        self, path: PredictedMeasurements, lines: LinesOfSight, span: float, table: TrackTable, crowds: Crowds
    ) -> GatedPairs:
        follows = crowds.follows(table.number, table.reports.shape[1])
        rows = np.flatnonzero(~follows.all(axis=1))
        bias = path.bias_covariance
        part = path._replace(
            derivative=path.derivative[rows],
            root=path.root[rows],
            bias_covariance=None if bias is None else bias[rows],
        )
        pairs = self.gated_pairs(part, lines if len(rows) else lines.take(rows), span)
        pairs = evolve(pairs, track=rows[pairs.track])
        return pairs.take(np.flatnonzero(~follows[pairs.track, lines.sensor[pairs.line]]))

    def gated_pairs(self, path: PredictedMeasurements, lines: LinesOfSight, span: float) -> GatedPairs:
        """Return the gated pairs of all tracks and the lines of a span."""
        return self.memo.of("gated", self._gated_pairs, path, lines, span)

    def _gated_pairs(self, path: PredictedMeasurements, lines: LinesOfSight, span: float) -> GatedPairs:
        gate, light_time = self.config.gate_sigma, self.light_time
        return gated(path, lines, *candidates(path, lines, span, gate, light_time), gate, light_time)

    def crowd_pairs(self, crowds: Crowds, start_s: float, lines: LinesOfSight, span: float) -> CrowdPairs:
        """Return the crowds' focal-plane tracks at the start of a span, and the pairs with its lines in their gates."""
        return self.memo.of("crowded", crowd.paired, crowds.tracks, start_s, lines, span, self.config.gate_sigma)


def _of_lone_tracks(pairs: GatedPairs, update: CrowdUpdate, table: TrackTable, sensor: IndexArray) -> GatedPairs:
    """Return the pairs with lines that no focal-plane track has, without those of tracks that have one there."""
    follows = update.crowds.follows(table.number, table.reports.shape[1])
    free = ~follows[pairs.track, sensor[pairs.line]] & (update.number[pairs.line] < 0)
    return pairs.take(np.flatnonzero(free))
