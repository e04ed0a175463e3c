"""Gating, association and update of tracks with the lines of sight of a slice, until the assignment settles."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.association import (
    Association,
    AssociationModel,
    ambiguous_tracks,
    associate_nearest,
    connected_tracks,
    is_unambiguous,
    scan_numbers,
)
from opir_trackers.configs import ImmConfig
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.mode_mixing import have_uncertain_velocity
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs, candidates, gated
from opir_trackers.imm.measurement_weights import (
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
from opir_trackers.triangulation import FAR_M

#: Gate of the repeated association, standard deviations: wider than the first.
SETTLING_GATE = 6.0

#: Lines are reassigned where a slice moved a track by more than this share of one look's error: a shift s changes the
#: log odds of a line between two tracks d apart by s d, in errors; tracks more than 3 apart share few lines.
_RESTLESS = 1.0 / 3.0

_Asked = TypeVar("_Asked")
_Answer = TypeVar("_Answer")

_NONE = np.empty(0, dtype=np.int64)


class AssociationResult(NamedTuple):
    """Estimates after a slice, the track row of each line, -1 for none, the assigned pairs, and all pairs.

    `outliers` (n, fractions) is the log likelihood of the outlier fractions of each track; None where all tracks have
    next to none.
    """

    estimates: ModeEstimates
    owner: IntArray
    assigned: GatedPairs
    pairs: GatedPairs
    outliers: FloatArray | None = None


@frozen(eq=False)
class AssociateAndUpdate:
    """Association and update of tracks with lines of sight."""

    config: ImmConfig
    filter: ImmFilter
    model: AssociationModel
    light_time: bool
    biases: Biases
    #: Cached results: labels and estimates need the same predictions, gated pairs and assignments.
    last: dict[str, tuple[Any, float, Any]] = field(factory=dict)
    pair_cache: list[tuple[PredictedMeasurements, float, LinesOfSight, GatedPairs]] = field(factory=list)
    assignment_cache: list[tuple[GatedPairs, IntArray | None, Association]] = field(factory=list)
    correction_cache: list[Any] = field(factory=list)

    def predicted(self, estimates: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the estimates a step later, as `predicted_open`."""
        return self.cached("moved", self.filter.predicted_open, estimates, step_s)

    def predicted_measurements(self, estimates: ModeEstimates, time_s: float) -> PredictedMeasurements:
        """Return the predictions of the estimates about their time."""
        return self.cached("predicted_measurements", self.filter.predicted_measurements, estimates, time_s)

    def with_bias_covariance(
        self, estimates: ModeEstimates, time_s: float, reports: IntArray, registration: Registration
    ) -> PredictedMeasurements:
        """Return the predictions including the shared errors of the sensors that see each track, by `reports`."""
        predicted_measurements = self.predicted_measurements(estimates, time_s)
        if not registration.widens_gates:
            return predicted_measurements
        return self.cached(
            "blurred",
            lambda one, when: one._replace(
                bias_covariance=registration.gate_covariance(
                    estimates.likelier_state, reports >= 0, self.vantages(registration, when)
                )
            ),
            predicted_measurements,
            time_s,
        )

    def vantages(self, registration: Registration, time_s: float) -> Vantages:
        """Return the sensors at a time, their angles weighted as the registration leaves them."""
        places = self.cached("vantages", lambda own, when: Vantages.of(own.sensors, when), self.biases, time_s)
        return places._replace(weight=self.biases.weights(registration.apart_rad))

    def moments(self, estimates: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity."""
        return self.cached("moments", lambda one, _: self.filter.moments(one), estimates, 0.0)

    def with_velocity_prior(self, estimates: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the estimates with the velocity covariance of the tracks `rows` bounded by the prior."""
        rows = rows[have_uncertain_velocity(self.moments(estimates)[1][rows])]
        return self.filter.with_velocity_prior(estimates, rows) if len(rows) else estimates

    def cached(
        self, name: str, function: Callable[[_Asked, float], _Answer], argument: _Asked, value: float
    ) -> _Answer:
        """Return a function's result; the last result is kept by name."""
        cached = self.last.get(name)
        if cached is None or cached[0] is not argument or cached[1] != value:
            cached = self.last[name] = argument, value, function(argument, value)
        answer: _Answer = cached[2]
        return answer

    def updated_tracks(
        self,
        estimates: ModeEstimates,
        end_s: float,
        lines: LinesOfSight,
        span: float,
        with_history: IntArray,
        table: TrackTable,
        registration: Registration,
    ) -> AssociationResult:
        """Return the estimates after a slice's lines, and their association, given the track table.

        Lines are reassigned by the updated estimates until nothing changes, at most `settling` times: among near
        targets a whole slice is more informative than one scan. Rows `with_history` are left out: all their data decide
        their assignment.
        """
        ahead = self.with_bias_covariance(estimates, end_s, table.reports, registration)
        pairs, fractions = self.gated_pairs(ahead, lines, span), OutlierFractions(table.outliers)
        association = self.nearest_association(pairs, lines)
        after = self.filter.updated(estimates, end_s, association.measurements, span)
        ambiguous = (
            self._unsettled(estimates, after, pairs, lines, with_history)
            if self.config.settling and association.is_ambiguous
            else _NONE
        )
        first = AssociationResult(after, association.owner, association.assigned, pairs)
        result = self._reassociated(first, estimates, ahead, lines, span, pairs, ambiguous) if len(ambiguous) else first
        share = self.cached("shares", lambda log, _: OutlierFractions(log).share, fractions.log, 0.0)
        suspects = suspect_tracks(result.assigned, share)
        if len(suspects) and association.is_ambiguous:
            suspects = np.setdiff1d(suspects, ambiguous_tracks(pairs, lines), assume_unique=True)
        if not len(suspects):
            if not np.count_nonzero(share > FEW):
                return result
            outliers = fractions.log + clean_log_likelihood(result.assigned, fractions, self.config.gate_sigma)
            return AssociationResult(result.estimates, result.owner, result.assigned, result.pairs, outliers)
        return self._with_outlier_weights(
            result, estimates, SliceSpan(end_s, span, self.config.gate_sigma), fractions, suspects
        )

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

    def _unsettled(
        self, estimates: ModeEstimates, after: ModeEstimates, pairs: GatedPairs, lines: LinesOfSight, young: IntArray
    ) -> IntArray:
        """Return the ambiguous tracks in clusters in which one, not in `young`, moved enough to change assignments."""
        rivals = ambiguous_tracks(pairs, lines)
        shift = after.take(rivals).likelier_position_m - estimates.take(rivals).likelier_position_m
        far = np.sqrt(np.sum(shift * shift, axis=1)) > _RESTLESS * lines.sigma_rad.max(initial=0.0) * FAR_M
        restless = np.setdiff1d(rivals[far], young, assume_unique=True)
        return rivals[connected_tracks(pairs, restless)[rivals]]

    def _reassociated(
        self,
        first: AssociationResult,
        estimates: ModeEstimates,
        ahead: PredictedMeasurements,
        lines: LinesOfSight,
        span: float,
        pairs: GatedPairs,
        busy: IntArray,
    ) -> AssociationResult:
        """Return the result with the lines of the ambiguous tracks reassigned."""
        place = np.full(len(estimates) + 1, -1, dtype=np.int64)
        place[busy] = np.arange(len(busy))
        rows = np.flatnonzero(place[pairs.track] >= 0)
        track, line = place[pairs.track[rows]], pairs.line[rows]
        before, then = estimates.take(busy), first.estimates.take(busy)
        result, mine, end_s = None, place[first.owner], ahead.time_s
        bias_covariance = None if ahead.bias_covariance is None else ahead.bias_covariance[busy]
        for _ in range(self.config.settling):
            path = self.filter.predicted_measurements(then, end_s)._replace(bias_covariance=bias_covariance)
            closer = gated(path, lines, track, line, SETTLING_GATE, self.light_time)
            anew = self.nearest_association(closer, lines)
            if np.array_equal(anew.owner, mine):
                break
            result, mine = anew, anew.owner
            then = self.filter.updated(before, end_s, result.measurements, span)
        if result is None:
            return first
        others = np.where((first.owner >= 0) & (place[first.owner] < 0), first.owner, -1)
        owner = np.where(mine >= 0, busy[mine], others)
        kept = first.assigned.take(np.flatnonzero(place[first.assigned.track] < 0))
        settled = evolve(result.assigned, track=busy[result.assigned.track])
        assigned = GatedPairs.concatenate([kept, settled])
        return AssociationResult(first.estimates.put(busy, then), owner, assigned, pairs)

    def gated_pairs(
        self, predicted_measurements: PredictedMeasurements, lines: LinesOfSight, span: float
    ) -> GatedPairs:
        """Return the gated pairs of all tracks and the lines of a span; the last result is cached."""
        if self.pair_cache:
            before, reach, known, pairs = self.pair_cache[0]
            if before is predicted_measurements and reach == span and known is lines:
                return pairs
        gate = self.config.gate_sigma
        pairs = gated(
            predicted_measurements,
            lines,
            *candidates(predicted_measurements, lines, span, gate, self.light_time),
            gate,
            self.light_time,
        )
        self.pair_cache[:] = [(predicted_measurements, span, lines, pairs)]
        return pairs

    def nearest_association(self, pairs: GatedPairs, lines: LinesOfSight) -> Association:
        """Return the likeliest assignment of each scan; the last result is cached."""
        if self.assignment_cache and self.assignment_cache[0][0] is pairs:
            _, scans, association = self.assignment_cache[0]
            scan = None if is_unambiguous(pairs, lines) else scan_numbers(lines.sensor, lines.scan)
            if scans is scan or (scans is not None and scan is not None and np.array_equal(scans, scan)):
                return association
        association = associate_nearest(pairs, lines, self.model)
        self.assignment_cache[:] = [
            (pairs, scan_numbers(lines.sensor, lines.scan) if association.is_ambiguous else None, association)
        ]
        return association
