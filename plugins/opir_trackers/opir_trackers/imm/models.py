"""What the steps of `imm` use of a scene: settings, filter, and models of its sensors, of
association and of motion.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from attrs import field, frozen
from opir_estimation import (
    GatedPairs,
    ImmFilter,
    LinesOfSight,
    ModeEstimates,
    PredictedMeasurements,
    Registration,
    Vantages,
    candidates,
    gated,
)
from opir_forecast import Outcomes, site_height_m, vehicle_model

from opir_core.arrays import BoolArray, FloatArray
from opir_core.plugin import TrackerContext
from opir_trackers.association import AssociationModel
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.crowds import SensorView
from opir_trackers.imm.single_sensor import SingleSensor
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import (
    TrackTable,
    longest_silence_s,
    mean_detection_probability,
    sighting_memory_s,
)
from opir_trackers.onset.posterior import GroupPosterior
from opir_trackers.sensors import Biases, clutter_per_sr, vantages_of
from opir_trackers.track_priors import filter_of

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


@frozen(eq=False)
class TrackingModels:
    """The models of a scene, and what several steps and the labels ask of them.

    `needed_scans` is M of M-of-N track initiation; `period_s`, `memory_s` and `silence_limit_s`
    (sensors,) are scan periods, how long detections are kept, and the longest silence of a track in
    view.
    """

    config: ImmConfig
    needed_scans: int
    filter: ImmFilter
    association: AssociationModel
    light_time: bool
    biases: Biases
    period_s: FloatArray
    memory_s: FloatArray
    silence_limit_s: FloatArray
    groups: GroupPosterior
    single: SingleSensor
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
        site_m = site_height_m(config.hypotheses.inland_share)
        return cls(
            config=config,
            needed_scans=config.needed_scans or needed_scans(period_s),
            filter=filter_,
            association=AssociationModel(detection_probability, config.false_alarms_per_sr),
            light_time=context.light_time,
            biases=biases,
            period_s=period_s,
            memory_s=sighting_memory_s(
                period_s, min(config.slice_s, config.cadence_s), config.recent_scans
            ),
            silence_limit_s=longest_silence_s(context.sensors, config.recent_scans),
            groups=GroupPosterior.of(config.hypotheses, clutter, detection_probability),
            single=SingleSensor(outcomes, filter_, biases, period_s, site_m),
        )

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

    def view(self, registration: Registration) -> SensorView:
        """Return the sensors, what is left of their errors, and whether light takes time."""
        return SensorView(self.biases.sensors, registration.apart_rad, self.light_time)

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
        return np.max(np.where(table.reports >= 0, time_s, 0.0), axis=1, initial=0.0)

    def confirmed(self, state: TrackerState) -> BoolArray:
        """Return which tracks (n,) are reported: those with enough detections that are probably no
        false alarms.
        """
        return (state.table.hits >= 2 * self.needed_scans) & ~state.motion.are_noise

    def shared_covariance(
        self, state: TrackerState, estimates: ModeEstimates, table: TrackTable
    ) -> FloatArray | None:
        """Return the covariances (n, 6, 6) of tracks due to the errors that sensors share; None for
        none.
        """
        if not state.registration.has_errors:
            return None
        vantages = self.vantages(state.registration, state.time_s)
        return state.registration.covariance(estimates.likelier_state, table.reports >= 0, vantages)


def needed_scans(period_s: FloatArray) -> int:
    """Return M of M-of-N track initiation for sensors with scan periods (n,), s.

    A track is reported after 2 M detections. M is 4 if the fastest sensor makes four scans in 4 s,
    else 2. At 10 s per scan four scans are most of a burn: of 30
    launches before two sensors 21 were tracked, after 74 s in the median; with M = 2 all, after 31
    s. What it costs: no false track in two hours with sensors that confirm their detections over
    scans. Where every false alarm is reported (two scanners, 17 a scan), 29 tracks of noise have
    enough detections in ten minutes; all are recognised as noise, and none is reported.
    """
    return 4 if 4.0 * float(period_s.min(initial=np.inf)) <= 4.0 else 2
