"""What the steps of `imm` use of a scene: settings, filter, and models of its sensors, of
association and of motion.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from attrs import field, frozen
from numpy.typing import NDArray
from opir_estimation import (
    GatedPairs,
    ImmFilter,
    LinesOfSight,
    LookTimes,
    ModeEstimates,
    PredictedMeasurements,
    Registration,
    Vantages,
    candidates,
    gated,
)
from opir_forecast import Outcomes, log_unreported, site_height_m, vehicle_model

from opir_core.arrays import BoolArray, FloatArray
from opir_core.flight import forces_of
from opir_core.plugin import TrackerContext
from opir_trackers.association import AssociationModel
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.single_sensor import SingleSensor
from opir_trackers.imm.state import TrackerState, TrackTable, sighting_memory_s
from opir_trackers.imm.watch import LookSpans
from opir_trackers.onset.areas import AreaPosteriors
from opir_trackers.onset.posterior import GroupPosterior
from opir_trackers.parts import (
    Association,
    Associator,
    Initiator,
    PartContext,
    Pruner,
    made_part,
    maker_of,
)
from opir_trackers.sensors import (
    Biases,
    clutter_per_sr,
    longest_silence_s,
    mean_detection_probability,
    vantages_of,
)
from opir_trackers.track_priors import filter_of, needed_scans_of

_Answer = TypeVar("_Answer")


class Memo:
    """The last result of each function, by name: labels and estimates need the same predictions,
    gates and pairs.
    """

    def __init__(self) -> None:
        self._results: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def of(self, name: str, function: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """Return the value of a function, stored if its last arguments were the same objects and
        numbers.
        """
        result = self._results.get(name)
        # Records are equal to themselves alone.
        if result is None or result[0] != arguments:
            result = (arguments, function(*arguments))
            self._results[name] = result
        return result[1]

    def of_column(
        self, name: str, function: Callable[[Any], _Answer], column: NDArray[Any]
    ) -> _Answer:
        """Return the value of a function of a column, stored if that was the same array."""
        result = self._results.get(name)
        if result is None or result[0][0] is not column:
            result = ((column,), function(column))
            self._results[name] = result
        return result[1]


@frozen(eq=False)
class TrackingParts:
    """The exchangeable parts of the tracker, the owner of each in words by its role, and whether the
    associator is of this distribution.
    """

    associator: Associator
    initiator: Initiator
    pruner: Pruner
    owners: Mapping[str, str]
    associates_itself: bool

    @classmethod
    def of(cls, config: ImmConfig, context: TrackerContext) -> "TrackingParts":
        """Return the parts that the settings name."""
        part_context = PartContext(
            tracker=context, settings=config, forces=forces_of(context.forces)
        )
        associator = made_part(Associator, "association", part_context)
        roles = ("association", "initiation", "pruning")
        return cls(
            associator=associator,
            initiator=made_part(Initiator, "initiation", part_context),
            pruner=made_part(Pruner, "pruning", part_context),
            owners={role: maker_of(role, part_context).owner for role in roles},
            associates_itself=type(associator).__module__.startswith("opir_trackers."),
        )


@frozen(eq=False)
class TrackingModels:
    """The models of a scene, and what several steps and the labels ask of them.

    `needed_scans` is M of M-of-N track initiation; `period_s`, `memory_s` and `silence_limit_s`
    (sensors,) are scan periods, of which `slowest_s` is the longest, how long detections are kept,
    and the longest silence of a track in view.
    """

    config: ImmConfig
    needed_scans: int
    filter: ImmFilter
    association: AssociationModel
    light_time: bool
    biases: Biases
    period_s: FloatArray
    slowest_s: float
    memory_s: FloatArray
    silence_limit_s: FloatArray
    unreported: FloatArray
    areas: AreaPosteriors
    single: SingleSensor
    parts: TrackingParts
    watch: LookSpans | None = None
    memo: Memo = field(factory=Memo)

    @classmethod
    def of(cls, config: ImmConfig, context: TrackerContext) -> "TrackingModels":
        """Return the models of a scene's sensors."""
        filter_ = filter_of(config, context)
        period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in context.sensors])
        detection_probability = mean_detection_probability(context.sensors)
        biases = Biases.of(context.sensors, config.clock_sigma_s)
        outcomes = Outcomes(vehicle_model(config.boost_prior), context.hypotheses)
        clutter = clutter_per_sr(context, config.false_alarms_per_sr)
        unreported = log_unreported(period_s, detection_probability, context.confirmation)
        site_m = site_height_m(config.hypotheses.inland_share)
        return cls(
            config=config,
            needed_scans=needed_scans_of(config, context),
            filter=filter_,
            association=AssociationModel(detection_probability, config.false_alarms_per_sr),
            light_time=context.light_time,
            biases=biases,
            period_s=period_s,
            slowest_s=float(period_s.max(initial=0.0)),
            memory_s=sighting_memory_s(
                period_s, min(config.slice_s, config.cadence_s), config.recent_scans
            ),
            silence_limit_s=longest_silence_s(context.sensors, config.recent_scans),
            unreported=unreported,
            areas=AreaPosteriors.of(config.hypotheses, clutter, detection_probability),
            single=SingleSensor(outcomes, filter_, biases, unreported, site_m),
            parts=TrackingParts.of(config, context),
            watch=LookSpans.of(context.sensors, period_s, detection_probability),
        )

    @property
    def groups(self) -> GroupPosterior:
        """The posterior of what is first seen in no area."""
        return self.areas.posteriors[0]

    def silent_s(self, table: TrackTable, time_s: float | FloatArray) -> FloatArray:
        """Return for how long (n,), s, tracks were looked at in vain before times."""
        if self.watch is None:
            return time_s - table.seen_s
        times_s = np.full_like(table.seen_s, time_s)
        return self.watch.silent_s(times_s, table.seen_s, table.seen)

    def watched(
        self, seen: BoolArray, end_s: float, span_s: float, looks: Association
    ) -> LookTimes | None:
        """Return how long tracks (n,) of sensors `seen` (n, sensors) were looked at in a slice with
        looks, None for throughout.
        """
        if self.watch is None:
            return None
        has_look = np.zeros_like(seen)
        has_look[looks.pairs.track, looks.sensor] = True
        return self.watch.in_slice(end_s, span_s, seen, has_look)

    def path(self, estimates: ModeEstimates, time_s: float) -> PredictedMeasurements:
        """Return the predictions of estimates about their time."""
        return self.memo.of("path", self.filter.predicted_measurements, estimates, time_s)

    def moments(self, estimates: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity."""
        return self.memo.of("moments", self.filter.moments, estimates)

    def corrected(self, registration: Registration, lines: LinesOfSight) -> LinesOfSight:
        """Return lines of sight without the errors of their sensors that are known."""
        if not registration.corrects:
            return lines
        return self.memo.of(
            "corrected",
            lambda registration_, raw: registration_.corrected(raw),
            registration,
            lines,
        )

    def vantages(self, registration: Registration, time_s: float) -> Vantages:
        """Return the sensors at a time, their angles weighted as the registration leaves them."""
        places = self.memo.of("vantages", vantages_of, self.biases.sensors, time_s)
        return places._replace(weight=self.biases.weights(registration.apart_rad))

    def gated_pairs(
        self, path: PredictedMeasurements, lines: LinesOfSight, span_s: float
    ) -> GatedPairs:
        """Return the gated pairs of tracks and the lines of a span."""
        gate = self.config.gate_sigma
        light_time = self.light_time
        return gated(
            path, lines, *candidates(path, lines, span_s, gate, light_time), gate, light_time
        )

    def longest(self, time_s: FloatArray, table: TrackTable) -> FloatArray:
        """Return the longest of times (sensors,) of the sensors that saw each track (n,), s."""
        return np.maximum.reduce(np.where(table.seen, time_s, 0.0), axis=1, initial=0.0)

    def confirmed(self, state: TrackerState) -> BoolArray:
        """Return which tracks (n,) are reported: those with enough detections that are probably no
        false alarms.
        """
        return (state.table.hits >= 2 * self.needed_scans) & ~state.table.motion.are_noise

    def shared_covariance(self, state: TrackerState, table: TrackTable) -> FloatArray | None:
        """Return the covariances (n, 6, 6) of tracks due to the errors that sensors share; None for
        none.
        """
        if not (state.registration.has_errors and table.number.size):
            return None
        vantages = self.vantages(state.registration, state.time_s)
        path = self.path(table.estimates, state.time_s)
        likelier = np.hstack([table.estimates.likelier_state, path.derivative[:, 2]])
        return state.registration.covariance(likelier, table.seen, vantages)
