"""The tracker `imm`: ticks, late detections, and the forecast of impacts."""

from collections import deque

import numpy as np
from attrs import evolve
from opir_estimation import LinesOfSight, sensor_health
from opir_forecast import Forecaster

from opir_core.arrays import IntArray
from opir_core.plugin import (
    AssumedRate,
    Detections,
    Sensor,
    SensorHealth,
    Tracker,
    TrackerContext,
    Tracks,
)
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.report import boost_estimates, tracks_of, with_glides
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.tracking import ImmTracking
from opir_trackers.onset.assumed_rates import assumed_rates
from opir_trackers.onset.composition import Composition
from opir_trackers.onset.motion_statistics import LAUNCH
from opir_trackers.parts import PartContext, made_part, maker_of, require_shape
from opir_trackers.sensors import LineOfSightCache, expected_detection_rate


class ImmTracker(Tracker):
    """The tracker `imm`."""

    def __init__(self, tracking: ImmTracking, context: TrackerContext) -> None:
        self.cadence_s: float | None = tracking.config.cadence_s
        self._tracking = tracking
        self._context = context
        self._state = tracking.start()
        self._past: deque[tuple[TrackerState, float, Detections]] = deque()
        self._waiting = Detections.empty()
        self._rays = LineOfSightCache(LinesOfSight.of)
        self._composition = Composition.of(context.hypotheses)
        self._glides = np.array(
            [hypothesis.group == "glide" for hypothesis in context.hypotheses], dtype=np.bool_
        )
        part = PartContext(tracker=context, settings=tracking.config, forces=tracking.forces)
        self._forecaster = made_part(Forecaster, "forecast", part)
        self._forecast_owner = maker_of("forecast", part).owner

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, by the tracks as of the last tick; the state is
        unchanged.
        """
        return self._tracking.track_numbers(self._state, self._rays.of(detections))

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at this tick, after the detections since the last one and late ones.

        With `late_s` above 0, detections may come in any order, repeatedly, and before the tick to
        which they belong.
        """
        if self._tracking.config.late_s:
            detections = self._waited(tick_s, detections)
        lines = self._rays.of(detections)
        is_late = lines.time_s < self._state.time_s
        if True in is_late:
            self._go_back(detections.take(is_late.nonzero()[0]))
            detections = detections.take((~is_late).nonzero()[0])
            lines = self._rays.of(detections)
        self._advance(tick_s, detections, lines)
        return self._reported()

    def _reported(self) -> Tracks:
        """Return the tracks with forecasts and probabilities of hypotheses."""
        reported = self._tracking.reported_tracks(self._state)
        table = reported.table
        groups = table.motion.probability
        launch_probability = groups[:, LAUNCH]
        launched = launch_probability >= self._tracking.config.least_launch_probability
        launched &= ~reported.is_brief
        estimates = boost_estimates(reported, launched)
        forecasts = self._forecaster.forecasts(estimates, self._state.time_s)
        shape = estimates.log_likelihood.shape
        require_shape(
            self._forecaster,
            self._forecast_owner,
            f"forecasts of {shape[0]} tracks over {shape[1]} hypotheses",
            is_right=forecasts.given_launch.shape == shape,
        )
        given_glide = np.add.reduce(forecasts.given_launch[:, self._glides], axis=1)
        hypotheses = self._composition.columns(groups, forecasts.given_launch)
        tracks = tracks_of(reported, forecasts, launched, hypotheses)
        tracks = with_glides(tracks, table.estimates, launch_probability * given_glide)
        is_over = forecasts.end > 0
        if True in is_over:
            # Nothing new can come of them.
            ended = table.number[is_over]
            self._state = self._state.without(np.isin(self._state.table.number, ended))
        return tracks

    def is_idle(self) -> bool:
        """Return whether there is neither a track nor a line of sight that may begin one."""
        return self._state.is_empty and not len(self._waiting)

    def assumed_rates(self) -> list[AssumedRate]:
        """Return the prior rates of what a track may be."""
        return assumed_rates(self._tracking.config.hypotheses)

    def sensor_health(self) -> SensorHealth:
        """Return the sensors' biases, clocks and noise as far as their lines of sight show them."""
        return sensor_health(
            self._state.registration, tuple(sensor.id for sensor in self._context.sensors)
        )

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Set the sensors from the last tick on: the same number, with other settings.

        The detection rate of burning targets scales with the expected one.
        """
        share = expected_detection_rate(sensors) / expected_detection_rate(self._context.sensors)
        self._context = evolve(self._context, sensors=sensors)
        self._tracking = ImmTracking.of(self._tracking.config, self._context)
        self._rays = LineOfSightCache(LinesOfSight.of)
        table = self._state.table
        pace = table.estimates.detection_rate * [share, 1.0, 1.0]
        estimates = evolve(table.estimates, detection_rate=pace)
        self._state = self._state._replace(table=table.with_estimates(estimates))

    def _waited(self, tick_s: float, detections: Detections) -> Detections:
        """Return the detections before a tick, once each and in order, of these and the waiting
        ones.
        """
        waiting = _once_in_order(Detections.concatenate([self._waiting, detections]))
        count = int(np.searchsorted(waiting.time_s, tick_s))
        self._waiting = waiting.take(slice(count, None))
        return waiting.take(slice(count))

    def _advance(self, tick_s: float, detections: Detections, lines: LinesOfSight) -> None:
        late_s = self._tracking.config.late_s
        if late_s:
            self._past.append((self._state, tick_s, detections))
            while self._past and self._past[0][1] <= tick_s - late_s:
                self._past.popleft()
        self._state = self._tracking.stepped(self._state, tick_s, detections, lines)

    def _go_back(self, late_detections: Detections) -> None:
        """Step again from before the late detections; those older than the stored states are
        dropped.
        """
        steps = [
            (state, tick_s, _with_late(before_late, late_detections, state.time_s, tick_s))
            for state, tick_s, before_late in self._past
        ]
        first_step = next(
            (
                number
                for number, (step, past) in enumerate(zip(steps, self._past, strict=True))
                if len(step[2].time_ns) > len(past[2].time_ns)
            ),
            None,
        )
        if first_step is None:
            return
        while len(self._past) > first_step:
            self._past.pop()
        self._state = steps[first_step][0]
        for _, tick_s, detections in steps[first_step:]:
            self._advance(tick_s, detections, self._rays.of(detections))


def _with_late(
    before_late: Detections, late_detections: Detections, start_s: float, end_s: float
) -> Detections:
    """Return a tick's detections with the late ones of its time."""
    rows = ((late_detections.time_s >= start_s) & (late_detections.time_s < end_s)).nonzero()[0]
    return (
        _once_in_order(Detections.concatenate([before_late, late_detections.take(rows)]))
        if len(rows)
        else before_late
    )


def _once_in_order(detections: Detections) -> Detections:
    """Return detections once each, ordered by time, sensor and measurement, independent of their
    arrival.

    Two detections of one sensor and instant in exactly the same direction are duplicates.
    """
    line = detections.line_of_sight_ecef
    keys = (*line.T, detections.scan, detections.sensor, detections.time_ns)
    order = np.lexsort(keys)
    once = np.ones(len(order), dtype=np.bool_)
    once[1:] = np.any([key[order[1:]] != key[order[:-1]] for key in keys], axis=0)
    return detections.take(order[once])


def imm_tracker(config: ImmConfig, context: TrackerContext) -> ImmTracker:
    """Return the tracker `imm`."""
    return ImmTracker(ImmTracking.of(config, context), context)
