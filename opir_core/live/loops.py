"""The pace of a live run, and looped scenes: each lap is a run of its own, scene time continues
from lap to lap.

Scene time counts from the scene's epoch; the plan of a lap counts from its own.
"""

import gc
import sys
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from attrs import evolve, frozen

from opir_core.errors import Problem, SceneError
from opir_core.host.host import Host
from opir_core.interfaces.directors import SensorTask
from opir_core.interfaces.records import CommandRecord, Window
from opir_core.live.changes import PastError, plan_of_lap
from opir_core.planning.plan import Plan
from opir_core.scene.scene import BY_REPORT, Scene
from opir_core.simulation.engine import Engine
from opir_core.simulation.shifting import shifted, shifted_command

if TYPE_CHECKING:
    from opir_core.simulation.pointing import NarrowField

#: Interval, s, after which another thread releases the interpreter to the run; Python's default is
#: 5 ms.
SWITCH_S = 0.001


def limit_pauses() -> None:
    """Prepare this process for a live run; call it between construction and start of the run.

    All objects alive now live as long as the run. They are excluded from garbage collection, which
    would otherwise traverse them every 15 s, for about 20 ms.
    """
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_S)


#: Scene time of a cycle of an unpaced run, ns.
UNPACED_STEP_NS = 1_000_000_000

#: Maximum number of cycles that a late run processes as one.
_CATCHING_UP = 20

#: Time over which the load of a run is averaged, ns.
_LOAD_NS = 2_000_000_000


class Pace:
    """Scene time against the monotonic clock, which is independent of changes of the wall clock.

    `speed` is scene time per real time, None for unpaced; `cycle_ns` the real time of a cycle.
    `load` is the work of the last seconds over the real time that it may take: above 1 the run
    falls behind; `least_load` the least so far.
    """

    def __init__(self, speed: float | None, cycle_ns: int) -> None:
        self.speed = speed
        self._step_ns = UNPACED_STEP_NS if speed is None else max(1, round(cycle_ns * speed))
        self._start_ns = time.monotonic_ns()
        self.load = 0.0
        self.least_load = 0.0
        self._measured_ns = 0.0

    @property
    def cycle_ns(self) -> int:
        """Scene time of a cycle that is not late, ns."""
        return self._step_ns

    def start(self) -> None:
        """Make scene time 0 due now."""
        self._start_ns = time.monotonic_ns()

    def step_ns(self, scene_ns: int) -> int:
        """Return the scene time of the next cycle, ns: several cycles' if the run is late."""
        late_ns = self.late_ns(scene_ns)
        if self.speed is None or late_ns <= 0:
            return self._step_ns
        owed = int(late_ns * self.speed) // self._step_ns
        return self._step_ns * max(1, min(owed, _CATCHING_UP))

    def late_ns(self, scene_ns: int) -> int:
        """Return the time since a scene time was due, ns; negative before it is due; 0 if
        unpaced.
        """
        if self.speed is None:
            return 0
        return time.monotonic_ns() - self._start_ns - int(scene_ns / self.speed)

    def worked(self, busy_ns: int, scene_ns: int) -> None:
        """Count the work of a cycle of some scene time, averaged over `_LOAD_NS` of real time."""
        if self.speed is not None and scene_ns > 0:
            due_ns = scene_ns / self.speed
            self.load += min(1.0, due_ns / _LOAD_NS) * (busy_ns / due_ns - self.load)
            self._measured_ns += due_ns
            if self._measured_ns < 2 * _LOAD_NS or self.load < self.least_load:
                self.least_load = self.load

    def load_with(self, targets: int) -> float:
        """Return the load with one target more than some: all but the least load is taken to be
        theirs.
        """
        return self.least_load + (self.load - self.least_load) * (targets + 1) / max(targets, 1)

    def slip(self, late_ns: int) -> None:
        """Make all scene times due later: the scene takes longer."""
        self._start_ns += max(late_ns, 0)

    def wait(self, scene_ns: int, stopping: threading.Event) -> bool:
        """Wait until a scene time is due; return whether to continue: False if `stopping` is
        set.
        """
        ahead_ns = -self.late_ns(scene_ns)
        if ahead_ns > 0:
            return not stopping.wait(ahead_ns * 1e-9)
        return not stopping.is_set()


@frozen(eq=False)
class LapOffset:
    """Offset of a lap's windows: in time, and in track numbers."""

    time_ns: int = 0
    tracks: int = 0

    def shifted(self, window: Window) -> Window:
        """Return a window of a lap with the times and track numbers of the whole run."""
        return shifted(window, self.time_ns, self.tracks) if self.time_ns else window


#: A number that no track has.
_NO_TRACK = 1 << 62


@frozen(eq=False)
class RunPosition:
    """The engine of a run, its lap, and the offset of the lap's windows."""

    engine: Engine
    lap: int
    offset: LapOffset

    @property
    def time_ns(self) -> int:
        """Scene time, over all laps, that the engine has reached."""
        return self.engine.time_ns + self.offset.time_ns

    def narrow_fields(self, time_ns: int) -> "dict[int, NarrowField]":
        """Return where narrow fields are at a time of the whole run, by the numbers of the sensors;
        times and tracks are those of the whole run.
        """
        fields = self.engine.narrow_fields(time_ns - self.offset.time_ns)
        return {number: self._of_run(field) for number, field in fields.items()}

    def _of_run(self, field: "NarrowField") -> "NarrowField":
        aim = field.aim
        track = aim.track if aim.track < 0 else aim.track + self.offset.tracks
        from_s = aim.from_s + self.offset.time_ns * 1e-9
        return evolve(field, aim=evolve(aim, track=track, from_s=from_s))

    def task(self, task: SensorTask) -> CommandRecord | None:
        """Return what became of a task, whose track is numbered as in the whole run; None without a
        director.
        """
        track = task.track
        if track >= 0:
            # A track of an earlier lap has no estimate, as one that is not there yet.
            track = track - self.offset.tracks if track >= self.offset.tracks else _NO_TRACK
        record = self.engine.task(evolve(task, track=track))
        if record is None:
            return None
        shifted_record = shifted_command(record, self.offset.time_ns * 1e-9, 0)
        return shifted_record._replace(track=task.track)


_NO_LOOP = (
    "a looped scene cannot track in the order of report; set observation, or run the scene without"
    " --loop"
)


class LapPlans:
    """Plans of the laps to come; the next is compiled in a thread of its own while one runs."""

    def __init__(self, base: Scene, host: Host, lap_ns: int) -> None:
        if lap_ns % 1000:
            raise SceneError(
                [Problem("duration_s", "the duration of a looped scene must be whole microseconds")]
            )
        if base.tracking_order == BY_REPORT:
            raise SceneError([Problem("tracking_order", _NO_LOOP)])
        self.lap_ns = lap_ns
        self._base = base
        self._host = host
        self._next: tuple[int, Future[Plan]] | None = None

    def prepare(self, lap: int, base: Scene | None = None) -> None:
        """Start compiling the plan of a lap; `base` is the scene from then on."""
        self._base = base or self._base
        plan: Future[Plan] = Future()
        self._next = lap, plan
        # A daemon thread does not keep the process from ending.
        threading.Thread(
            target=self._compile, args=(self._base, lap, plan), name="opir-lap", daemon=True
        ).start()

    def plan(self, lap: int) -> Plan:
        """Return the plan of a lap, as last prepared."""
        if self._next is None or self._next[0] != lap:
            self.prepare(lap)
        assert self._next is not None
        return self._next[1].result()

    def _compile(self, base: Scene, lap: int, plan: "Future[Plan]") -> None:
        try:
            plan.set_result(plan_of_lap(base, self._host, lap, self.lap_ns // 1000))
        except BaseException as error:  # raised by `plan`
            plan.set_exception(error)


@frozen
class Launched:
    """An added launch: target id, scene time of ignition, s, and the first cycle that may detect
    it.
    """

    target_id: str
    time_s: float
    cycle: int


def launch_in_lap(
    block: Mapping[str, Any], target_id: str, position: RunPosition, earliest_ns: int
) -> tuple[dict[str, Any], bool]:
    """Return a launch's block with an id and a time of the lap, and whether the time was chosen
    here.

    A block without an id gets `target_id`; one without a time gets `earliest_ns` of the lap,
    rounded up to a millisecond. Raises `PastError` for a time before the lap.
    """
    target_block = {"id": target_id, **block}
    before_ns = position.offset.time_ns
    launch = target_block.get("launch")
    if not isinstance(launch, Mapping):
        return target_block, False
    if launch.get("time_s") is None:
        return {
            **target_block,
            "launch": {**launch, "time_s": -(-earliest_ns // 1_000_000) / 1000},
        }, True
    time_s = launch["time_s"]
    if isinstance(time_s, int | float) and not isinstance(time_s, bool) and before_ns:
        if time_s < before_ns / 1_000_000_000:
            raise past_error(position.time_ns)
        target_block["launch"] = {**launch, "time_s": time_s - before_ns / 1_000_000_000}
    return target_block, False


def past_error(time_ns: int) -> PastError:
    """Return the error of a launch that is too late at a scene time."""
    return PastError(
        f"launch.time_s is past: scene time is {time_ns / 1_000_000_000:.3f} s; leave it out to launch now"
    )
