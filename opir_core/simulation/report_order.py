"""Windows in the order of report: detections wait until they are reported, and the tracker may wait
with them.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve

from opir_core.arrays import IntArray
from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
from opir_core.interfaces.sensors import Spans
from opir_core.interfaces.trackers import Tracker
from opir_core.planning.plan import Plan
from opir_core.scene.scene import BY_REPORT
from opir_core.simulation.measurement import with_tracks
from opir_core.simulation.observation import joined_detections
from opir_core.simulation.tracker_clock import ScheduledTracker, Tracked, checked_tracker, rows_of

if TYPE_CHECKING:
    from opir_core.planning.links import UnheardLooks

#: Later than any report.
_NEVER_NS = np.iinfo(np.int64).max


class ReportOrder:
    """Turns windows of observations into windows of reports; nothing depends on the windows' edges.

    Without latency a window stays as it is. If the scene tracks in the order of report, the tracker
    is stepped here.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._tracker = _reported_tracker(plan)
        self._time_ns = 0
        #: Reports on their way, sorted; and windows to merge with them, with the time of their
        #: first report.
        self._held = quiet_window(0, 0)
        self._incoming: list[Window] = []
        self._first_incoming_ns = _NEVER_NS

    @property
    def end_ns(self) -> int:
        """The scene time, ns, at which all has been reported that is held, and the tracker has made
        its last step.
        """
        latest = [
            window.detections.reported_ns.max(initial=-1)
            for window in (self._held, *self._incoming)
        ]
        return max(int(max(latest)) + 1, 0 if self._tracker is None else self._tracker.last_ns)

    def use(self, plan: Plan) -> None:
        """Continue with another plan of the run: its classifier, and the settings of its
        sensors.
        """
        if self._tracker is not None and plan.sensors is not self._plan.sensors:
            self._tracker.use(plan)
        self._plan = plan

    def take(self, window: Window, end_ns: int) -> Window:
        """Return the window of the reports in the slice of scene time of a window of observations.

        Windows follow each other; `end_ns` is the end of this one.
        """
        start_ns = self._time_ns
        self._time_ns = end_ns
        is_waiting = len(self._held.detections) > 0 or bool(self._incoming)
        if self._tracker is None and not is_waiting and not window.detections.is_delayed:
            return window
        self._hold(window)
        reported = self._due(end_ns)
        if self._tracker is None:
            return evolve(
                window,
                detections=reported.detections.freeze(),
                truth=reported.truth.freeze(),
                estimates=reported.estimates,
            )
        self._tracker.note(window.detections)
        tracked = self._tracker.absorb(reported.detections, start_ns, end_ns)
        return evolve(
            window,
            detections=with_tracks(
                self._plan.classifier, self._plan.confidence, tracked.detections, tracked.estimates
            ).freeze(),
            truth=reported.truth.freeze(),
            tracks=tracked.tracks,
            estimates=tracked.estimates,
            health=tracked.health,
        )

    def rest(self) -> Window | None:
        """Return the window of all that is reported after the last one, or None if there is
        nothing.
        """
        end_ns = self.end_ns
        return (
            None
            if end_ns <= self._time_ns
            else self.take(quiet_window(self._time_ns, end_ns), end_ns)
        )

    def _hold(self, window: Window) -> None:
        if len(window.detections):
            self._incoming.append(window)
            self._first_incoming_ns = min(
                self._first_incoming_ns, int(window.detections.reported_ns.min())
            )

    def _due(self, end_ns: int) -> Window:
        """Return the reports before a time, in order; the others stay held."""
        if self._first_incoming_ns < end_ns:
            self._held = _merged([self._held, *self._incoming])
            self._incoming = []
            self._first_incoming_ns = _NEVER_NS
        cut = int(np.searchsorted(self._held.detections.reported_ns, end_ns))
        reported = _part(self._held, slice(0, cut))
        self._held = _part(self._held, slice(cut, None))
        return reported


def quiet_window(start_ns: int, end_ns: int) -> Window:
    """Return a window without looks, detections and tracks."""
    return Window(
        start_s=start_ns * 1e-9,
        end_s=end_ns * 1e-9,
        looks=0,
        detections=Detections.empty(),
        truth=DetectionTruth.empty(),
        tracks=Tracks.empty(),
        estimates=Tracks.empty(),
    )


def with_own_estimates(window: Window) -> Window:
    """Return a window with only those estimates that its detections refer to."""
    if not len(window.estimates):
        return window
    rows, index = np.unique(window.detections.estimate, return_inverse=True)
    is_row = rows >= 0
    estimate: IntArray = index.astype(np.int64) - np.count_nonzero(~is_row)
    detections = window.detections.replaced(estimate=estimate)
    return evolve(window, detections=detections, estimates=window.estimates.take(rows[is_row]))


def _merged(windows: Sequence[Window]) -> Window:
    """Return windows as one, in the order of report; of equal times those of earlier windows come
    first.
    """
    detections = joined_detections(windows)
    order = np.argsort(detections.reported_ns, kind="stable")
    return evolve(
        windows[0],
        detections=detections.take(order),
        truth=DetectionTruth.concatenate(window.truth for window in windows).take(order),
        estimates=Tracks.concatenate(window.estimates for window in windows),
    )


def _part(window: Window, rows: slice) -> Window:
    window_rows = evolve(
        window, detections=window.detections.take(rows), truth=window.truth.take(rows)
    )
    return with_own_estimates(window_rows)


class ReportedTracker(ScheduledTracker):
    """Steps a tracker in the order of report, by a fixed lag.

    The step valid at a tick is made a lag later, with the detections from before the tick that are
    reported by then, in the order of observation. Later reports of these looks are not tracked: of
    sensors with links the tracker knows that it has not heard of them. Detections are associated
    when they are reported, by the tracks of the last step.
    """

    def __init__(self, tracker: Tracker, plan: Plan, lag_ns: int) -> None:
        super().__init__(tracker, plan.end_ns, plan.paper_codes())
        self._lag_ns = lag_ns
        self._stepped_ns = 0
        self._unheard: UnheardLooks | None = None
        if plan.links is not None and self._cadence_ns is not None:
            self._unheard = plan.links.unheard(len(plan.sensors), lag_ns)
            self.use(plan)

    def use(self, plan: Plan) -> None:
        """Go on with the sensors of another plan of the run."""
        self._sensors = plan.tracker_sensors()
        self._end_s = plan.end_ns * 1e-9
        if self._unheard is not None and plan.links is not None:
            wait_s = max(self._lag_ns - usual_lag_ns(plan), 0) * 1e-9
            for number, late_s in enumerate(self._unheard.late_s):
                self._leave_out(number, (*plan.links.unheard_s(number, wait_s), *late_s))
        self.set_sensors(self._sensors)

    def _leave_out(self, number: int, spans: Spans) -> None:
        """Tell that a sensor, by its number, is not heard in spans."""
        sensors = list(self._sensors)
        sensors[number] = evolve(sensors[number], partial_s=spans).stated(self._end_s)
        self._sensors = tuple(sensors)

    def note(self, detections: Detections) -> None:
        """Take detections that were observed, whenever they are reported."""
        if self._unheard is not None:
            self._unheard.note(detections)

    @property
    def last_ns(self) -> int:
        """The scene time of the last step, ns; 0 for a tracker that never steps."""
        return 0 if self._cadence_ns is None else self._end_ns + self._lag_ns

    def absorb(self, detections: Detections, start_ns: int, end_ns: int) -> Tracked:
        """Process the detections reported in [start, end), sorted by report."""
        if self._cadence_ns is None:
            return Tracked(detections, Tracks.empty(), Tracks.empty())
        detections = detections.computed()
        ticks = self._ticks(start_ns - self._lag_ns, end_ns - self._lag_ns, self._cadence_ns)
        ends = np.searchsorted(
            detections.reported_ns, np.array([*ticks, _NEVER_NS - self._lag_ns]) + self._lag_ns
        )
        associated = []
        estimates = []
        in_force = []
        rows = 0
        start = 0
        for number, end in enumerate(ends.tolist()):
            associated.append(self._associated(detections.take(slice(start, end)), rows))
            in_force.append(self._in_force)
            rows = rows + len(self._in_force)
            start = end
            estimates += [self._step(tick) for tick in ticks[number : number + 1]]
        return Tracked(
            Detections.concatenate(associated),
            Tracks.concatenate(estimates),
            Tracks.concatenate(in_force),
        )

    def _ticks(self, after_ns: int, until_ns: int, cadence_ns: int) -> list[int]:
        """Return the ticks in (after, until], the scene's end among them."""
        first_tick_ns = (max(after_ns, 0) // cadence_ns + 1) * cadence_ns
        ticks = [*range(first_tick_ns, min(until_ns, self._end_ns) + 1, cadence_ns)]
        is_last = after_ns < self._end_ns <= until_ns and self._end_ns % cadence_ns
        return [*ticks, self._end_ns] if is_last else ticks

    def _associated(self, detections: Detections, offset: int) -> Detections:
        in_time = np.flatnonzero(detections.time_ns >= self._stepped_ns)
        rows = in_time.take(_observation_order(detections.take(in_time)))
        visible = self._visible(detections.take(rows))
        track: IntArray = np.full(len(detections), -1, dtype=np.int64)
        if len(rows):
            track[rows] = self._tracker_in_use.associate(visible)
            self._pending.append(visible.replaced(track=track[rows]))
        return detections.replaced(
            track=track, estimate=rows_of(self._in_force.track, track, offset)
        )

    def _step(self, tick_ns: int) -> Tracks:
        pending = Detections.concatenate(self._pending)
        pending = pending.take(_observation_order(pending))
        cut = int(np.searchsorted(pending.time_ns, tick_ns))
        pending_rows = pending.take(slice(cut, None))
        self._stepped_ns = tick_ns
        if self._unheard is not None and (unheard := self._unheard.step(tick_ns)):
            for number in unheard:
                self._leave_out(number, self._unheard.late_s[number][-1:])
            self.set_sensors(self._sensors)
        self._pending = [pending_rows] if len(pending_rows) else []
        tracks = self._tracker_in_use.step(tick_ns / 1_000_000_000, pending.take(slice(0, cut)))
        if self._lag_ns:
            tracks = evolve(
                tracks, available_s=np.full(len(tracks), (tick_ns + self._lag_ns) / 1_000_000_000)
            )
        self._in_force = tracks
        return tracks


def _observation_order(detections: Detections) -> IntArray:
    """Return the order by time, then sensor; rows of one look time of a sensor keep theirs."""
    return np.lexsort((detections.sensor, detections.time_ns))


def _reported_tracker(plan: Plan) -> ReportedTracker | None:
    """Return the tracker of a scene that tracks in the order of report."""
    if plan.scene.tracking_order != BY_REPORT:
        return None
    return ReportedTracker(checked_tracker(plan), plan, tracking_lag_ns(plan))


def tracking_lag_ns(plan: Plan) -> int:
    """Return the lag, ns, between a tick and its step in the order of report."""
    if plan.scene.tracking_lag_s is not None:
        return round(plan.scene.tracking_lag_s * 1e9)
    return usual_lag_ns(plan)


def usual_lag_ns(plan: Plan) -> int:
    """Return the time, ns, in which nearly all reports come that wait for no queue and no contact."""
    link_ns = 0 if plan.links is None else plan.links.slowest_ns
    if not any(sensor.reporting for sensor in plan.sensors):
        return link_ns
    from opir_core.simulation.reporting import release_lag_ns

    return release_lag_ns(plan.sensors) + link_ns
