"""A run paced by the clock, in a thread of its own: window by window, with changes let in between two windows.

What a live run tells of itself while it runs.
"""

import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from attrs import define, evolve, field, frozen

from opir_core.arrays import IntArray
from opir_core.errors import OpirError
from opir_core.interfaces.records import Window
from opir_core.live.change_lock import BusyError, Changes, PastError, RefusedError, waited_for
from opir_core.live.change_validation import Draft, drafted_launch, drafted_settings
from opir_core.live.laps import Laps, Launched, Place, Shift, past, timed
from opir_core.live.pace import Pace
from opir_core.live.plan_updates import looked_at
from opir_core.output.delivery import opened_sink
from opir_core.output.sink_thread import SinkStatus, SinkThread
from opir_core.planning.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.scene.reading import scene_mapping
from opir_core.scene.scene import Scene
from opir_core.simulation.engine import Engine

#: Upper edges of the classes in which late cycles are counted, s; the last class has all that are later.
LATE_EDGES_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)


@frozen(eq=False)
class LiveWindow:
    """A window of a live run: as sinks get it, with the cycle it ended, its lap, and the plan it came from."""

    window: Window
    cycle: int
    lap: int
    plan: Plan


@frozen
class SensorStatus:
    """What a sensor has done; times are of the scene."""

    id: str
    type: str
    detections: int
    last_detection_s: float | None


@frozen
class LiveStatus:
    """A live run at a moment. States: starting, running, ended, stopped, failed."""

    state: str
    error: str | None
    time_ns: int
    cycle: int
    lap: int
    speed: float | None
    late_s: float
    latest_s: float
    late_cycles: int
    late_counts: tuple[int, ...]
    late_total_s: float
    looks: int
    detections: int
    targets: int
    targets_launched: int
    sensors: tuple[SensorStatus, ...]
    sinks: tuple[SinkStatus, ...]


@define(eq=False)
class Counts:
    """What has happened so far; written by the run's thread alone."""

    detections_by_sensor: IntArray
    last_ns: IntArray
    time_ns: int = 0
    cycle: int = 0
    looks: int = 0
    detections: int = 0
    late_s: float = 0.0
    latest_s: float = 0.0
    late_total_s: float = 0.0
    late_cycles: int = 0
    late_counts: list[int] = field(factory=lambda: [0] * (len(LATE_EDGES_S) + 1))

    @classmethod
    def of(cls, sensors: int) -> "Counts":
        """Return counts of nothing yet."""
        return cls(np.zeros(sensors, dtype=np.int64), np.full(sensors, -1, dtype=np.int64))

    def take(self, window: Window) -> None:
        """Count a window's looks and detections."""
        found = window.detections
        self.looks += window.looks
        self.detections += len(found)
        self.detections_by_sensor += np.bincount(found.sensor, minlength=len(self.last_ns))
        self.last_ns[found.sensor] = found.time_ns

    def ended(self, time_ns: int, late_s: float, allowed_s: float) -> None:
        """Count a cycle that came up to `time_ns`, and how late it was done; `allowed_s` is how late it may be."""
        self.time_ns = time_ns
        self.cycle += 1
        self.late_s = max(late_s, 0.0)
        self.latest_s = max(self.latest_s, self.late_s)
        self.late_total_s += self.late_s
        self.late_cycles += late_s > allowed_s
        self.late_counts[int(np.searchsorted(LATE_EDGES_S, self.late_s))] += 1

    def sensors(self, plan: Plan) -> tuple[SensorStatus, ...]:
        """Return what each sensor has done."""
        rows = zip(plan.sensors, self.detections_by_sensor.tolist(), self.last_ns.tolist(), strict=True)
        return tuple(
            SensorStatus(sensor.id, sensor.type, count, last * 1e-9 if last >= 0 else None)
            for sensor, count, last in rows
        )


_NS = 1_000_000_000


@frozen(kw_only=True)
class LiveSettings:
    """How a run goes: scene time per real time (None: as fast as it goes), real time of a cycle, again and again."""

    speed: float | None = 1.0
    cycle_ns: int = 50_000_000
    loop: bool = False
    maximum_targets: int = 1_000


class LiveRun:
    """Runs a scene in its own thread; every public method may be called from any other."""

    def __init__(
        self,
        scene: Scene,
        host: Host,
        settings: LiveSettings,
        on_window: Callable[[LiveWindow], None] = lambda _window: None,
    ) -> None:
        self.scene, self.host, self.settings = scene, host, settings
        #: Called with each window, by the thread of the run; must not wait.
        self.on_window = on_window
        #: Replaced as a whole, by the run's thread alone, so that a plan, its lap and its time are read as one.
        self._place = Place(Engine(compile_plan(scene, host)), 0, Shift())
        self._laps = Laps(scene, host, self.plan.end_ns) if settings.loop else None
        self._pace = Pace(settings.speed, settings.cycle_ns)
        self._counts = Counts.of(len(scene.sensors))
        self._launched = len(scene.targets)
        self._tracks = 0
        self._outlets: tuple[SinkThread, ...] = ()
        self._stopping = threading.Event()
        self._changes = Changes(self._stopping)
        self._state = "starting"
        self._error: str | None = None
        self._thread = threading.Thread(target=self._work, name="opir-engine", daemon=True)

    def start(self) -> None:
        """Open the sinks and begin; raises `SinkError` where a sink cannot be opened."""
        plan, outlets = self.plan, list[SinkThread]()
        try:
            for choice in plan.scene.outputs:
                is_spooled = choice.spool is not None
                outlets.append(SinkThread(choice.path, choice.name, opened_sink(plan, choice), is_spooled=is_spooled))
        except BaseException:
            for outlet in outlets:
                outlet.close(time.monotonic() + 1.0)
            raise
        self._outlets, self._state = tuple(outlets), "running"
        if self._laps is not None:
            self._laps.prepare(1)
        self._pace.start()
        self._thread.start()

    def halt(self) -> None:
        """Let the run end after the cycle at hand, and refuse changes; does not wait."""
        self._stopping.set()

    def stop(self, within_s: float = 4.0) -> LiveStatus:
        """End the run, let the sinks take what is queued, close them, and return how things stand."""
        deadline_s = time.monotonic() + within_s
        self._stopping.set()
        for outlet in self._outlets:
            outlet.close_by(deadline_s)
        if self._thread.is_alive():
            self._thread.join(within_s / 2)
        closings = [threading.Thread(target=outlet.close, args=(deadline_s,)) for outlet in self._outlets]
        for closing in closings:
            closing.start()
        for closing in closings:
            closing.join()
        if self._state != "failed":
            self._state = "stopped"
        return self.status()

    @property
    def plan(self) -> Plan:
        """The plan in force."""
        return self._place.engine.plan

    @property
    def time_ns(self) -> int:
        """Scene time, all laps, up to which the run has come."""
        return self._place.time_ns

    @property
    def state(self) -> str:
        """The run's state, as its status has it."""
        return self._state

    def status(self) -> LiveStatus:
        """Return how things stand."""
        counts, place = self._counts, self._place
        plan = place.engine.plan
        return LiveStatus(
            state=self._state,
            error=self._error,
            time_ns=counts.time_ns,
            cycle=counts.cycle,
            lap=place.lap,
            speed=self.settings.speed,
            late_s=counts.late_s,
            latest_s=counts.latest_s,
            late_cycles=counts.late_cycles,
            late_counts=tuple(counts.late_counts),
            late_total_s=counts.late_total_s,
            looks=counts.looks,
            detections=counts.detections,
            targets=int(looked_at(plan, place.engine.time_ns).sum()),
            targets_launched=self._launched,
            sensors=counts.sensors(plan),
            sinks=tuple(outlet.status() for outlet in self._outlets),
        )

    def settings_mapping(self) -> dict[str, Any]:
        """Return the scene's settings in force, as plain data: its mapping without targets and sources."""
        told = scene_mapping(evolve(self.plan.scene, epoch_us=self.scene.epoch_us, seed=self.scene.seed))
        return {key: value for key, value in told.items() if key not in ("targets", "sources")}

    def launch(self, block: Mapping[str, Any]) -> Launched:
        """Add a target; `block` is as in a scene's `targets`, its `id` and its `launch.time_s` may be left out.

        The time counts from the scene's epoch; left out, it is as soon as can be. Raises `SceneError`, `PluginError` or
        `ModelError` for what is wrong with it, `RefusedError` where the run cannot take it.
        """
        with self._changes.turn() as give_up_s:
            if self.status().targets >= self.settings.maximum_targets:
                raise BusyError(f"{self.settings.maximum_targets} targets are in the run, the most it takes at a time")
            self._launched += 1
            lead_ns = 3 * self._pace.step_ns(self.time_ns)
            while time.monotonic() < give_up_s:
                place, asked_ns = self._place, self.time_ns
                whole, is_ours = timed(block, f"live-{self._launched}", place, place.engine.time_ns + lead_ns)
                duration_s = place.engine.plan.scene.duration_s
                if is_ours and whole["launch"]["time_s"] >= duration_s:
                    self._await_lap_after(place.lap, give_up_s)
                    continue
                draft = drafted_launch(place.engine.plan, whole, place.engine.time_ns, place.lap)
                try:
                    cycle = self._taken(draft, give_up_s)
                except PastError:
                    if not is_ours:
                        raise
                    # Half a lap at most: later than that, a lap may never have time for it.
                    lead_ns = min(2 * max(lead_ns, self.time_ns - asked_ns), int(duration_s * _NS) // 2)
                else:
                    return Launched(whole["id"], whole["launch"]["time_s"] + place.shift.time_ns / _NS, cycle)
            raise BusyError("the run is too fast for a launch without a time; give launch.time_s")

    def configure(self, mapping: Mapping[str, Any]) -> int:
        """Change the scene's settings, all or none, at the start of a cycle; return the cycle.

        `mapping` is laid out as `settings_mapping` gives it. Raises `SceneError`, `PluginError`, `ModelError` for what
        is wrong with it, `RestartError` for what a running scene cannot change, `RefusedError` where the run has ended.
        """
        with self._changes.turn() as give_up_s:
            while time.monotonic() < give_up_s:
                place = self._place
                draft = drafted_settings(place.engine.plan, mapping, place.lap, self.scene)
                try:
                    return self._taken(draft, give_up_s)
                except PastError:
                    continue
            raise BusyError("the run's laps are too short to change it")

    def _await_lap_after(self, lap: int, give_up_s: float) -> None:
        """Wait for the lap after one that is all but over; raises `RefusedError` where there is none."""
        if self._laps is None:
            raise RefusedError("the scene ends before it could go up: start it again, or start it with --loop")
        if not waited_for(lambda: self._place.lap != lap or self._state != "running", self._stopping, give_up_s):
            raise BusyError("the run is held up; try again")

    def _taken(self, draft: Draft, give_up_s: float) -> int:
        """Return the cycle at whose start a draft took over."""
        if self._state != "running":
            raise RefusedError(f"the run has {self._state}: start it again, or start it with --loop")
        return self._changes.taken(draft, give_up_s)

    def _work(self) -> None:
        try:
            while not self._stopping.is_set() and self._cycle():
                pass
            self._state = "stopped" if self._stopping.is_set() else "ended"
        except Exception as error:  # told by status and health, and by the exit code
            self._error = str(error) if isinstance(error, OpirError) else f"{type(error).__name__}: {error}"
            self._state = "failed"
        for _, answer in self._changes.asked():
            answer.set_exception(RefusedError(f"the run has {self._state}"))

    def _cycle(self) -> bool:
        """Go one window on; return whether there is another."""
        self._take_over()
        place = self._place
        if place.engine.time_ns >= place.engine.plan.end_ns:
            if self._laps is None:
                return False
            place = self._next_lap(self._laps)
        engine, shift = place.engine, place.shift
        edge_ns = min(engine.time_ns + self._pace.step_ns(place.time_ns), engine.plan.end_ns)
        due_ns = edge_ns + shift.time_ns
        if not self._pace.wait(due_ns, self._stopping):
            return False
        window = shift.shifted(engine.advance(edge_ns))
        self._tracks = max(self._tracks, int(window.tracks.track.max(initial=-1)) + 1)
        self._hand_over(window)
        self.on_window(LiveWindow(window, self._counts.cycle, place.lap, engine.plan))
        allowed_s = min(sensor.scan.period_ns for sensor in engine.plan.sensors) / _NS
        self._counts.ended(due_ns, self._pace.late_ns(due_ns) / _NS, allowed_s)
        return True

    def _hand_over(self, window: Window) -> None:
        """Give a window to the outlets, to those with a spool first: nobody hears of an event that may yet be lost."""
        outlets = self._outlets if len(window.detections) else ()
        for outlet in outlets:
            if outlet.is_spooled:
                outlet.write(window, self._stopping)
        self._counts.take(window)
        for outlet in outlets:
            if not outlet.is_spooled:
                outlet.write(window, self._stopping)

    def _next_lap(self, laps: Laps) -> Place:
        lap = self._place.lap + 1
        plan = laps.plan(lap)
        self._place = Place(Engine(plan), lap, Shift(lap * laps.lap_ns, self._tracks))
        self._launched += len(plan.targets.ids)
        laps.prepare(lap + 1)
        return self._place

    def _take_over(self) -> None:
        """Let in what was asked for since the last window."""
        for draft, answer in self._changes.asked():
            place = self._place
            is_late = draft.not_after_ns is not None and draft.not_after_ns < place.engine.time_ns
            if is_late or draft.lap != place.lap:
                answer.set_exception(past(self.time_ns))
                continue
            draft.engine.take_over(place.engine)
            self._place = evolve(place, engine=draft.engine)
            if self._laps is not None and draft.base is not None:
                self._laps.prepare(place.lap + 1, draft.base)
            for choice in draft.reopened:
                outlet = next(outlet for outlet in self._outlets if outlet.path == choice.path)
                outlet.replace(partial(opened_sink, draft.engine.plan, choice), is_spooled=choice.spool is not None)
            answer.set_result(self._counts.cycle)
