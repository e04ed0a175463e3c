"""Live runs: a scene paced by the clock, in a thread of its own; changes apply between windows."""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from attrs import asdict, evolve, frozen

from opir_core.errors import OpirError, Problem, SceneError, SinkError, number_of
from opir_core.host.error_messages import described_error
from opir_core.host.host import Host
from opir_core.host.registry import warn
from opir_core.interfaces.directors import SensorTask
from opir_core.interfaces.records import CommandRecord, Window
from opir_core.live.changes import (
    BusyError,
    Change,
    ChangeQueue,
    PastError,
    RefusedError,
    is_active,
    launch_change,
    settings_change,
    wait_until,
)
from opir_core.live.commands import RefusalWarnings, file_after
from opir_core.live.loops import (
    LapOffset,
    LapPlans,
    Launched,
    Pace,
    RunPosition,
    launch_in_lap,
    past_error,
)
from opir_core.live.progress import Progress, RunningCall, progress_of
from opir_core.live.status import Counts, LiveStatus
from opir_core.output.delivery import counter_of, opened_sink
from opir_core.output.sink_thread import WITHOUT_SPOOL, SinkThread
from opir_core.planning.plan import Plan, compile_plan
from opir_core.reading import scene_mapping
from opir_core.scene.scene import WAIT, Scene
from opir_core.simulation.engine import Engine
from opir_core.simulation.report_order import ReportOrder, quiet_window
from opir_core.simulation.run import LOOKS_PER_WINDOW

if TYPE_CHECKING:
    from opir_core.output.run_files import CommandsFile


@frozen(eq=False)
class LiveWindow:
    """A window of a live run as written to sinks, with its cycle, lap and plan; its computation
    began at `begun_ns` of `time.monotonic_ns`.

    Targets in the truth of late reports are numbered as in the plan of their observation.
    """

    window: Window
    cycle: int
    lap: int
    plan: Plan
    begun_ns: int = 0


#: Largest share of real time that a run may take with a further target: the rest is for its launch,
#: which is compiled in another thread, and for targets that are not burning yet.
_MOST_LOAD = 0.9


@frozen(kw_only=True)
class LiveSettings:
    """Settings of a live run: scene time per real time (None: unpaced), real time of a cycle,
    looping.

    A run is unready if no cycle ends for `unready_after_s`, and stuck after `dead_after_s`. One
    that is more than `late_after_s` late is unready and refuses launches and settings; with `slows`
    its scene takes longer instead.
    """

    speed: float | None = 1.0
    cycle_ns: int = 50_000_000
    loop: bool = False
    maximum_targets: int = 1_000
    unready_after_s: float = 5.0
    dead_after_s: float = 120.0
    late_after_s: float = 5.0
    slows: bool = False


class ChangesRecord(Protocol):
    """Where a run records what changes it: a change with its lap and time of the lap, and its
    end.
    """

    def change(self, lap: int, time_ns: int, record: Mapping[str, Any]) -> None:
        """Record a change that is applied now."""

    def end(self, time_ns: int) -> None:
        """Record the scene time, over all laps, at which the run ends."""


class LiveRun:
    """A scene that runs in its own thread; public methods may be called from any other thread."""

    def __init__(
        self,
        scene: Scene,
        host: Host,
        settings: LiveSettings,
        on_window: Callable[[LiveWindow], None] = lambda _window: None,
    ) -> None:
        self.scene = scene
        self.host = host
        self.settings = settings
        #: Called with each window by the thread of the run; must not block.
        self.on_window = on_window
        #: Where its changes are recorded, if they are: set before the start.
        self.changes_file: ChangesRecord | None = None
        #: Where what became of commands to sensors is written, if it is: set before the start.
        self.commands_file: CommandsFile | None = None
        self._refusals = RefusalWarnings()
        #: Replaced as a whole, only by the run's thread, so that engine, lap and offset always
        #: belong together.
        plan = evolve(compile_plan(scene, host), on_tracker_error=self._end_tracker)
        self._pace = Pace(settings.speed, settings.cycle_ns)
        plan.workload.require_cycle(self._pace.cycle_ns)
        self._position = RunPosition(Engine(plan), 0, LapOffset())
        #: An engine and the looks a second of its plan, at most.
        self._most_looks = self._position.engine, self.plan.workload.looks_per_s()
        self._reports = ReportOrder(self.plan)
        self._lap_plans = LapPlans(scene, host, self.plan.end_ns) if settings.loop else None
        self._counts = Counts.of(len(scene.sensors))
        self._launch_count = len(scene.targets)
        self._name_number = self._launch_count
        self._tracks = 0
        self._sinks: tuple[SinkThread, ...] = ()
        self._stopping = threading.Event()
        self._changes = ChangeQueue(self._stopping)
        self._state = "starting"
        self._error: str | None = None
        #: Why the tracker has ended, until the next lap.
        self._tracker_error: str | None = None
        #: Time of the monotonic clock at which the last cycle ended.
        self._beat_s = time.monotonic()
        self._thread = threading.Thread(target=self._work, name="opir-engine", daemon=True)

    def start(self) -> None:
        """Open the sinks and start the thread; raises `SinkError` if a sink cannot be opened."""
        plan = self.plan
        sinks = list[SinkThread]()
        try:
            for choice in plan.scene.outputs:
                sink = SinkThread(
                    choice.path,
                    choice.name,
                    opened_sink(plan, choice),
                    is_spooled=choice.spool is not None,
                    count=counter_of(plan, choice),
                )
                sinks.append(sink)
        except BaseException:
            for sink in sinks:
                sink.close(time.monotonic() + 1.0)
            raise
        for sink in sinks:
            if sink.has_waiting_in_memory:
                warn(f"{sink.path} ({sink.name}): {WITHOUT_SPOOL}")
        self._sinks = tuple(sinks)
        self._state = "running"
        if self._lap_plans is not None:
            self._lap_plans.prepare(1)
        self._pace.start()
        self._beat_s = time.monotonic()
        self._thread.start()

    def halt(self) -> None:
        """End the run after the present cycle and refuse changes; returns at once."""
        self._stopping.set()

    def stop(self, within_s: float = 4.0) -> LiveStatus:
        """End the run, empty the queues of the sinks, close them, and return the status."""
        deadline_s = time.monotonic() + within_s
        self._stopping.set()
        for sink in self._sinks:
            sink.close_by(deadline_s)
        if self._thread.is_alive():
            self._thread.join(within_s / 2)
        closings = [threading.Thread(target=sink.close, args=(deadline_s,)) for sink in self._sinks]
        for closing in closings:
            closing.start()
        for closing in closings:
            closing.join()
        if self._state != "failed":
            self._state = "stopped"
        return self.status()

    def retry_output(self, output: str) -> bool:
        """Let a parked output try again at once, by its path or the name of its sink; return
        whether it was parked.

        Raises `SceneError` if there is no such output, or several.
        """
        named = [sink for sink in self._sinks if output in (sink.path, sink.name)]
        if len(named) != 1:
            names = ", ".join(sink.path for sink in self._sinks) or "none"
            problem = Problem(
                "", f"there is no one output {output!r}; give the path of one of these: {names}"
            )
            raise SceneError([problem], source="outputs")
        return named[0].retry()

    @property
    def plan(self) -> Plan:
        """The plan in force."""
        return self._position.engine.plan

    @property
    def time_ns(self) -> int:
        """Scene time, over all laps, that the run has reached."""
        return self._position.time_ns

    @property
    def state(self) -> str:
        """The state, as in `LiveStatus`."""
        return self._state

    @property
    def late_s(self) -> float:
        """How late the last cycle ended, s."""
        return self._counts.late_s

    def status(self) -> LiveStatus:
        """Return state and counts."""
        counts = self._counts
        position = self._position
        plan = position.engine.plan
        return LiveStatus(
            state=self._state,
            error=self._error,
            tracker_error=self._tracker_error,
            time_ns=counts.time_ns,
            cycle=counts.cycle,
            lap=position.lap,
            speed=self.settings.speed,
            late_s=counts.late_s,
            latest_s=counts.latest_s,
            late_cycles=counts.late_cycles,
            late_counts=tuple(counts.late_counts),
            late_total_s=counts.late_total_s,
            cycle_age_s=self._cycle_age_s(),
            looks=counts.looks,
            detections=counts.detections,
            targets=int((is_active(plan, position.engine.time_ns) & plan.targets.is_launch).sum()),
            targets_launched=self._launch_count,
            sensors=counts.sensors(plan, position.narrow_fields(counts.time_ns)),
            sinks=tuple(sink.status() for sink in self._sinks),
        )

    def progress(self) -> Progress:
        """Return the age of the last finished cycle, and the calls that take too long; never
        waits.
        """
        age_s = self._cycle_age_s()
        settings = self.settings
        calls = [RunningCall("no cycle has ended", age_s, self._thread.ident)] if age_s else []
        complaints = [self._lateness()] if self._is_late else []
        complaints += (
            [f"the tracker has ended: {self._tracker_error}"] if self._tracker_error else []
        )
        calls += [
            RunningCall(f"the sink {sink.path} has not returned", sink.busy_s, sink.thread)
            for sink in self._sinks
        ]
        dead_after_s = max(settings.dead_after_s, self._longest_wait_s())
        progress = progress_of(calls, age_s, settings.unready_after_s, dead_after_s)
        return evolve(progress, delays=(*progress.delays, *complaints))

    @property
    def _is_late(self) -> bool:
        return self._state == "running" and self._counts.late_s > self.settings.late_after_s

    def _lateness(self) -> str:
        return f"the run is {self._counts.late_s:.1f} s late"

    def _require_pace(self, targets: int = 0) -> None:
        """Raise `BusyError` if the run is late, or if one more than some targets would make it
        so.
        """
        if self._is_late:
            raise BusyError(f"{self._lateness()}; try again later")
        if targets and not self.settings.slows and self._pace.load_with(targets) > _MOST_LOAD:
            words = (
                f"the run takes {self._pace.load:.0%} of real time with"
                f" {number_of('target', targets)}"
            )
            raise BusyError(f"{words}: one more would make it late; try again later")

    def _cycle_age_s(self) -> float:
        """Return the time since the last cycle ended, s; 0 if the run is not running."""
        return max(0.0, time.monotonic() - self._beat_s) if self._state == "running" else 0.0

    def _longest_wait_s(self) -> float:
        """Return the time, s, for which a full spool may hold the run, with a margin: such a run is
        not stuck.
        """
        spools = [choice.spool for choice in self.plan.scene.outputs if choice.spool is not None]
        waits_s = [spool.wait_s for spool in spools if spool.when_full == WAIT]
        return max(waits_s) + 10.0 if waits_s else 0.0

    def settings_mapping(self) -> dict[str, Any]:
        """Return the present settings of the scene as plain data: its mapping without targets and
        sources.
        """
        settings = scene_mapping(
            evolve(self.plan.scene, epoch_us=self.scene.epoch_us, seed=self.scene.seed)
        )
        return {key: value for key, value in settings.items() if key not in ("targets", "sources")}

    def launch(self, block: Mapping[str, Any]) -> Launched:
        """Add a target; `block` has the layout of a scene's targets, `id` and `launch.time_s` are
        optional.

        `time_s` counts from the scene's epoch; by default it is the earliest possible. Raises
        `SceneError`, `PluginError` or `ModelError` for an invalid block, `RefusedError` if the run
        cannot add the target.
        """
        with self._changes.lock() as give_up_s:
            targets = self.status().targets
            self._require_pace(targets)
            if targets >= self.settings.maximum_targets:
                raise BusyError(
                    f"the run has {self.settings.maximum_targets} targets, its maximum; try again"
                    f" later"
                )
            self._name_number += 1
            lead_ns = 3 * self._pace.step_ns(self.time_ns)
            while time.monotonic() < give_up_s:
                position = self._position
                asked_ns = self.time_ns
                earliest_ns = position.engine.time_ns + lead_ns
                target_block, is_chosen = launch_in_lap(
                    block, f"live-{self._name_number}", position, earliest_ns
                )
                duration_s = position.engine.plan.scene.duration_s
                if is_chosen and target_block["launch"]["time_s"] >= duration_s:
                    self._await_lap_after(position.lap, give_up_s)
                    continue
                change = launch_change(
                    position.engine.plan, target_block, position.engine.time_ns, position.lap
                )
                try:
                    cycle = self._applied(change, give_up_s)
                except PastError:
                    if not is_chosen:
                        raise
                    # Half a lap at most: with a longer lead, a lap may never have time for it.
                    lead_ns = min(
                        2 * max(lead_ns, self.time_ns - asked_ns), int(duration_s * 1e9) // 2
                    )
                else:
                    self._launch_count += 1
                    return Launched(
                        target_block["id"],
                        target_block["launch"]["time_s"] + position.offset.time_ns / 1_000_000_000,
                        cycle,
                    )
            raise BusyError("the run is too fast for a launch without a time; give launch.time_s")

    def configure(self, mapping: Mapping[str, Any]) -> int:
        """Change the scene's settings, all or none, at the start of a cycle; return the cycle.

        `mapping` has the layout of `settings_mapping`. Raises `SceneError`, `PluginError` or
        `ModelError` for an invalid mapping, `RestartError` for settings that a running scene cannot
        change, `RefusedError` if the run has ended.
        """
        with self._changes.lock() as give_up_s:
            self._require_pace()
            while time.monotonic() < give_up_s:
                position = self._position
                change = settings_change(position.engine.plan, mapping, position.lap, self.scene)
                try:
                    return self._applied(change, give_up_s)
                except PastError:
                    continue
            raise BusyError("the run's laps are too short to change it")

    def task(self, task: SensorTask) -> CommandRecord:
        """Have a sensor do a task, until another one or the end of the lap; return what became of
        it.

        Tracks and times are those of the whole run. Raises `RefusedError` if the run has ended or
        its scene has no director.
        """
        with self._changes.lock() as give_up_s:
            self._require_running()
            record: CommandRecord | None = self._changes.apply(task, give_up_s)
        if record is None:
            raise RefusedError(
                "the scene has no director, and so nothing points its sensors: start it with"
                " director: operator"
            )
        return record

    def _await_lap_after(self, lap: int, give_up_s: float) -> None:
        """Wait for the lap after one that is nearly over; raises `RefusedError` if there is
        none.
        """
        if self._lap_plans is None:
            raise RefusedError(
                "the scene ends before the launch: start it again, or start it with --loop"
            )
        if not wait_until(
            lambda: self._position.lap != lap or self._state != "running", self._stopping, give_up_s
        ):
            raise BusyError("the run waits for a sink; try again")

    def _applied(self, change: Change, give_up_s: float) -> int:
        """Return the cycle at whose start a change was applied; raises `SceneError` if cycles had
        too much work.
        """
        change.engine.plan.workload.require_cycle(self._pace.cycle_ns)
        self._require_running()
        return int(self._changes.apply(change, give_up_s))

    def _require_running(self) -> None:
        if self._state != "running":
            raise RefusedError(
                f"the run has {self._state}: start it again, or start it with --loop"
            )

    def _work(self) -> None:
        try:
            while not self._stopping.is_set() and self._cycle():
                pass
            self._state = "stopped" if self._stopping.is_set() else "ended"
        except (
            BaseException
        ) as error:  # also SystemExit of a plugin; reported by status, health and exit code
            self._error = str(error) if isinstance(error, OpirError) else described_error(error)
            self._state = "failed"
        for _, answer in self._changes.pending():
            answer.set_exception(RefusedError(f"the run has {self._state}"))
        try:
            if self.changes_file is not None:
                self.changes_file.end(self._counts.time_ns)
            with self.commands_file or nullcontext():
                pass
        except SinkError as error:
            warn(f"{error}; the end of the run is not in it")

    def _record_commands(self, commands: Sequence[CommandRecord]) -> None:
        """Write what became of commands; a file that takes no more is left as it is."""
        self._refusals.warn_of(commands)
        self.commands_file = file_after(self.commands_file, commands)

    def _cycle(self) -> bool:
        """Run one cycle; return whether there is another."""
        self._apply_changes()
        if self._is_over and self._lap_plans is not None:
            self._next_lap(self._lap_plans)
        if self._is_over and self._counts.time_ns >= self._reports.end_ns:
            return False
        due_ns = self._due_ns()
        if not self._pace.wait(due_ns, self._stopping):
            return False
        begun_ns = time.monotonic_ns()
        former_ns = self._counts.time_ns
        for edge_ns in self._slices_ns(due_ns):
            window_ns = time.monotonic_ns()
            window = self._reports.take(self._observed(edge_ns), edge_ns)
            self._tracks = max(self._tracks, int(window.tracks.track.max(initial=-1)) + 1)
            self._write(window)
            self._record_commands(window.commands)
            lap = self._position.lap
            self.on_window(LiveWindow(window, self._counts.cycle, lap, self.plan, window_ns))
        allowed_s = min(sensor.scan.period_ns for sensor in self.plan.sensors) / 1_000_000_000
        if self.settings.slows:
            self._pace.slip(self._pace.late_ns(due_ns) - round(self.settings.late_after_s * 1e9))
        self._pace.worked(time.monotonic_ns() - begun_ns, due_ns - former_ns)
        self._counts.ended(due_ns, self._pace.late_ns(due_ns) / 1_000_000_000, allowed_s)
        self._beat_s = time.monotonic()
        return True

    @property
    def _is_over(self) -> bool:
        """Whether the engine has reached the end of its lap; reports may still be on their way."""
        return self._position.engine.time_ns >= self.plan.end_ns

    def _due_ns(self) -> int:
        """Return the scene time, over all laps, at which the next cycle ends."""
        position = self._position
        if self._is_over:
            return self._counts.time_ns + self._pace.step_ns(self._counts.time_ns)
        edge_ns = min(
            position.engine.time_ns + self._pace.step_ns(position.time_ns), self.plan.end_ns
        )
        return edge_ns + position.offset.time_ns

    def _slices_ns(self, due_ns: int) -> Sequence[int]:
        """Return the ends of the windows of a cycle: one, unless it has more looks than fit into a
        window.
        """
        start_ns = self.time_ns
        if self._is_over:
            return (due_ns,)
        if self._most_looks[0] is not self._position.engine:
            self._most_looks = self._position.engine, self.plan.workload.looks_per_s()
        looks = self._most_looks[1] * (due_ns - start_ns) / 1_000_000_000
        count = max(1, min(math.ceil(looks / LOOKS_PER_WINDOW), due_ns - start_ns))
        return [start_ns + (due_ns - start_ns) * number // count for number in range(1, count + 1)]

    def _observed(self, due_ns: int) -> Window:
        """Return the window of observations up to a scene time; none after the scene's end."""
        position = self._position
        if self._is_over:
            return quiet_window(self._counts.time_ns, due_ns)
        return position.offset.shifted(position.engine.advance(due_ns - position.offset.time_ns))

    def _write(self, window: Window) -> None:
        """Write a window to the sinks, first to those with a spool: no event is visible before it
        is safe from loss.
        """
        sinks = [sink for sink in self._sinks if sink.takes(window)]
        for sink in sinks:
            if sink.is_spooled:
                sink.write(window, self._stopping)
        self._counts.take(window)
        for sink in sinks:
            if not sink.is_spooled:
                sink.write(window, self._stopping)

    def _end_tracker(self, reason: str) -> None:
        self._tracker_error = reason
        warn(f"{reason}; detections go on without tracks")

    def _next_lap(self, lap_plans: LapPlans) -> None:
        lap = self._position.lap + 1
        plan = evolve(lap_plans.plan(lap), on_tracker_error=self._end_tracker)
        self._tracker_error = None
        self._position = RunPosition(
            Engine(plan), lap, LapOffset(lap * lap_plans.lap_ns, self._tracks)
        )
        self._launch_count += len(plan.scene.targets)
        self._reports.use(plan)
        lap_plans.prepare(lap + 1)

    def _apply_changes(self) -> None:
        """Apply the changes queued since the last window."""
        for change, answer in self._changes.pending():
            try:
                answer.set_result(self._apply(change))
            except PastError as error:
                answer.set_exception(error)
            except BaseException as error:  # who asked must not wait for ever
                answer.set_exception(RefusedError(f"the run has failed: {described_error(error)}"))
                raise

    def _apply(self, change: Change | SensorTask) -> Any:
        """Have a sensor do a task and return what became of it; or replace the engine, the laps to
        come and the outputs that change, and return the cycle.
        """
        position = self._position
        if isinstance(change, SensorTask):
            task = asdict(change)
            self._record({"task": {key: task[key] for key in task if key != "mode" or task[key]}})
            return position.task(change)
        latest_ns = change.not_after_ns
        is_late = latest_ns is not None and latest_ns < position.engine.time_ns
        if is_late or change.lap != position.lap:
            raise past_error(self.time_ns)
        self._record(change.record)
        change.engine.take_over(position.engine)
        self._reports.use(change.engine.plan)
        self._position = evolve(position, engine=change.engine)
        if self._lap_plans is not None and change.base is not None:
            self._lap_plans.prepare(position.lap + 1, change.base)
        for choice in change.reopened:
            sink = next(sink for sink in self._sinks if sink.path == choice.path)
            plan = change.engine.plan
            sink.replace(
                partial(opened_sink, plan, choice),
                self._stopping,
                is_spooled=choice.spool is not None,
                count=counter_of(plan, choice),
            )
        return self._counts.cycle

    def _record(self, record: Mapping[str, Any]) -> None:
        """Write what is applied now into the file of changes, if there is one."""
        if self.changes_file is not None:
            position = self._position
            self.changes_file.change(position.lap, position.engine.time_ns, record)
