"""The engine: a plan in, windows of detections and tracks out.

All data of a window are columns over its looks; stages fill them in turn
(`Engine._planned_stages`). Each look is drawn against its P_d with the random numbers of its pair;
detections are measured, classified, and get a confidence and an id. Nothing depends on the windows'
edges.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, NamedTuple

from attrs import evolve

from opir_core.arrays import IndexArray, IntArray
from opir_core.host.boundary import PluginErrors
from opir_core.interfaces.records import CommandRecord, Window
from opir_core.planning.looks import LookGeometry
from opir_core.planning.plan import Plan
from opir_core.random_streams.pair_streams import PairStreams
from opir_core.scene.scene import BY_REPORT
from opir_core.simulation.building import BuildDetections
from opir_core.simulation.hit_stages import (
    CountDetections,
    DrawDirections,
    FindLooks,
    OrderByTime,
    draw_detections,
)
from opir_core.simulation.measurement import with_tracks
from opir_core.simulation.observation import Observation, Stage, joined_windows
from opir_core.simulation.probability import (
    EvaluatedProbability,
    InterpolatedProbability,
    PointingTest,
    VisibilityTest,
    WatchTest,
    interpolant_of,
)
from opir_core.simulation.tracker_clock import ScheduledTracker, checked_tracker

if TYPE_CHECKING:
    from opir_core.interfaces.directors import SensorTask
    from opir_core.planning.sensor_modes import SensorModes
    from opir_core.simulation.directing import Directing
    from opir_core.simulation.merging import MergeModes
    from opir_core.simulation.pointing import NarrowField, PointedFields
    from opir_core.simulation.reporting import ReportingDelays


class Engine:
    """Runs a plan, window by window; scene time only increases."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.time_ns = 0
        #: Made at the first window: an engine that takes over continues with another's tracker.
        self._scheduled: ScheduledTracker | None = None
        self._plugin_errors = PluginErrors(plan.host, plan.scene)
        self._directed = _directed(plan)
        modes = self._directed.modes
        look_plan = plan if modes is None else modes.plan
        names = look_plan.pair_names(), look_plan.scan_names()
        self._streams = PairStreams(plan.scene.seed, *names)
        self._fields = self._directed.fields
        self._directing = self._directed.directing
        self._links = None if plan.links is None else plan.links.queues(len(plan.sensors))
        with self._plugin_errors:
            self._count = CountDetections(look_plan, modes)
            self._stages = self._planned_stages(look_plan)

    def _planned_stages(self, plan: Plan) -> Sequence[Stage]:
        """Return the stages of a window, in order. What does not happen in the scene is not among
        them.
        """
        pairs = plan.pairs
        geometry = plan.look_geometry()
        find_looks = FindLooks(pairs, self._streams, self._fields if self._directed.modes else None)
        curves = interpolant_of(plan, geometry)
        build = BuildDetections.of(plan, geometry, self._streams)
        draw_false_alarms, insert_false_alarms = _false_alarms(plan, geometry, self._fields)
        stages: list[Stage | None] = [
            find_looks,
            InterpolatedProbability(curves)
            if curves
            else EvaluatedProbability(plan.detection, geometry),
            VisibilityTest(geometry) if pairs.is_checked.any() else None,
            WatchTest.of(plan, self._fields),
            PointingTest(self._fields, geometry) if self._fields else None,
            draw_detections,
            self._count,
            DrawDirections(pairs),
            _measuring(pairs.sensor, build) if curves else None,
            OrderByTime.of(pairs),
            draw_false_alarms,
            build,
            insert_false_alarms,
            _reporting_delays(plan),
            self._directed.merge,
            find_looks.forget,
        ]
        return [stage for stage in stages if stage]

    def take_over(self, former: "Engine") -> None:
        """Continue the run of another engine with the same sensors: its time, tracker, counts and
        last detections.
        """
        self.time_ns = former.time_ns
        self._scheduled = former._tracker
        self._count.take_over(former._count)
        if former._links is not None and self._links is not None:
            self._links.take_over(former._links)
        if former._directing is not None and self._fields is not None:
            self._fields.take_over(former._directing.fields)
            former._directing.use(self.plan, self._fields)
            self._directing = former._directing
        if self.plan.sensors is not former.plan.sensors:
            directing = self._directing
            self._tracker.set_sensors(
                self.plan.tracker_sensors() if directing is None else directing.tracker_sensors
            )

    @property
    def _tracker(self) -> ScheduledTracker:
        """The tracker of this run; none of its own in the order of report, in which `ReportOrder`
        steps it.
        """
        if self._scheduled is None:
            is_here = self.plan.scene.tracking_order != BY_REPORT
            self._scheduled = ScheduledTracker(
                checked_tracker(self.plan) if is_here else None,
                self.plan.end_ns,
                self.plan.paper_codes(),
            )
        return self._scheduled

    @property
    def carried(self) -> Sequence[IntArray]:
        """The state passed on to the next window, changed in place: each pair's count and last
        detections.
        """
        return self._count.carried

    def advance(self, end_ns: int) -> Window:
        """Return the window of observations from the end of the last one to `end_ns`, whenever they
        are reported.

        Raises `ModelError` if a component raises or returns invalid values.
        """
        directing = self._directing
        if directing is None:
            return self._advanced(end_ns)
        windows = []
        commands: tuple[CommandRecord, ...] = ()
        time_ns = self.time_ns
        while time_ns < end_ns:
            decided = directing.decided(time_ns)
            if directing.steers(decided):
                if self.time_ns < time_ns:
                    windows.append(directing.take(self._advanced(time_ns)))
                self._tracker.set_sensors(directing.tracker_sensors)
            commands += decided
            time_ns = directing.next_edge_ns(time_ns, end_ns)
            # Looks wait for a decision that can depend on them: fields keep where they pointed.
            if (
                time_ns == end_ns
                or directing.needs_detections
                or self._tracker.has_tick(self.time_ns, time_ns)
            ):
                windows.append(directing.take(self._advanced(time_ns)))
        return evolve(joined_windows(windows), commands=commands)

    def task(self, task: "SensorTask") -> CommandRecord | None:
        """Have a sensor do a task from the present time on; return what became of it, None without
        a director.
        """
        return None if self._directing is None else self._directing.task(task, self.time_ns)

    def narrow_fields(self, time_ns: int) -> "dict[int, NarrowField]":
        """Return where narrow fields are at a time since the last decision, by the numbers of the
        sensors.
        """
        fields = self._fields
        if fields is None:
            return {}
        field_at = (self._directing or fields).field_at
        return {number: field_at(number, time_ns * 1e-9) for number in fields.numbers}

    def _advanced(self, end_ns: int) -> Window:
        start_ns = self.time_ns
        self.time_ns = end_ns
        return self._tracked(self.observe(start_ns, end_ns), start_ns, end_ns)

    def observe(
        self, start_ns: int, end_ns: int, turn: AbstractContextManager[None] | None = None
    ) -> Window:
        """Return the window of observations in [start, end), without tracks; raises as `advance`
        does.

        `turn` is entered while `carried` is used and changed: another engine's may be put there,
        and taken from there.
        """
        window = Observation(start_ns=start_ns, end_ns=end_ns, turn=turn or nullcontext())
        with self._plugin_errors:
            for stage in self._stages:
                stage(window)
        return window.window()

    def track(self, window: Window, end_ns: int) -> Window:
        """Return a window of observations up to `end_ns` with its tracks; windows follow each
        other.
        """
        start_ns = self.time_ns
        self.time_ns = end_ns
        return self._tracked(window, start_ns, end_ns)

    def _tracked(self, window: Window, start_ns: int, end_ns: int) -> Window:
        """Return a window of observations with the tracks of its ticks, and what these change in
        its detections.
        """
        if self._links is not None:
            window = self._links.passed_on(window)
        with self._plugin_errors:
            tracked = self._tracker.absorb(window.detections, start_ns, end_ns)
            detections = with_tracks(
                self.plan.classifier, self.plan.confidence, tracked.detections, tracked.estimates
            )
        if detections is window.detections:
            return window
        window = evolve(
            window, detections=detections.freeze(), tracks=tracked.tracks, health=tracked.health
        )
        return evolve(window, estimates=tracked.estimates)


class _Directed(NamedTuple):
    """The narrow fields of a plan's sensors, what asks its director, and the sensors' modes with
    the stage that gives their detections to the sensors; None for none.
    """

    fields: "PointedFields | None" = None
    directing: "Directing | None" = None
    modes: "SensorModes | None" = None
    merge: "MergeModes | None" = None


def _directed(plan: Plan) -> _Directed:
    """Return what a plan has of narrow fields, a director and modes."""
    if not any(sensor.pointing for sensor in plan.sensors):
        return _Directed()
    from opir_core.simulation.directing import directed

    return _Directed(*directed(plan))


def _measuring(sensor: IndexArray, build: BuildDetections) -> Stage:
    """Return the stage that measures all hits at once, of scenes with interpolated P_d."""
    from opir_core.simulation.measuring import MeasureResponses

    return MeasureResponses(sensor, build.most_bands, build.pair_type is None)


def _false_alarms(
    plan: Plan, geometry: LookGeometry, fields: "PointedFields | None"
) -> tuple[Stage | None, Stage | None]:
    """Return the stages before and after the building of detections, None if the model has no false
    alarms.
    """
    if plan.detection.rate_per_scan is None:
        return None, None
    from opir_core.simulation.insertion import DrawFalseAlarms, insert_false_alarms

    return DrawFalseAlarms(plan, plan.detection, geometry, fields), insert_false_alarms


def _reporting_delays(plan: Plan) -> "ReportingDelays | None":
    """Return the stage that delays reports, if any sensor has latencies."""
    if not any(sensor.reporting for sensor in plan.sensors):
        return None
    from opir_core.simulation.reporting import ReportingDelays

    return ReportingDelays(plan.scene.seed, plan.sensors, plan.sensor_names())
