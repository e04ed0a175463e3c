"""Changes of a running scene: checked as a whole in the thread that asks, applied by the thread of
the run.

Only one change is prepared at a time. Others wait for their turn, for a limited time. Looks and
random numbers of the targets that stay do not change.
"""

import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, wait
from contextlib import contextmanager
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, IndexArray, IntArray
from opir_core.errors import OpirError, Problem, SceneError
from opir_core.flight.burns import joined_burns_s
from opir_core.host.host import Host
from opir_core.interfaces.directors import SensorTask
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.plan import Plan, compile_plan, with_targets
from opir_core.planning.sightlines import Pairs, Sightlines
from opir_core.planning.targets import Targets
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene.plausibility import REMEDY, implausible_values
from opir_core.scene.scene import Choice, Scene
from opir_core.simulation.engine import Engine

#: Columns of targets with a number for each, independent of the others.
_TARGET_COLUMNS = ("type_code", "ignition_s", "burnout_s", "end_s", "glow_end_s", "place")


def with_added_targets(plan: Plan, added: Plan) -> Plan:
    """Return a plan with the targets of another, of the same sensors, after its own."""
    count = len(plan.targets.ids)
    shifted = evolve(added.pairs, target=(added.pairs.target + count).astype(np.int32))
    pairs = Pairs.concatenate([plan.pairs, shifted])
    order = np.lexsort((pairs.target, pairs.sensor))
    sightlines = Sightlines.joined([plan.sightlines, added.sightlines])
    lines = evolve(sightlines, first_point=sightlines.first_point[order])
    scene = evolve(plan.scene, targets=(*plan.scene.targets, *added.scene.targets))
    targets = plan.targets
    added_targets = added.targets
    joined_targets = Targets(
        ids=(*targets.ids, *added_targets.ids),
        trajectories=(*targets.trajectories, *added_targets.trajectories),
        group=np.concatenate(
            [targets.group, added_targets.group + np.int32(len(targets.trajectories))]
        ),
        class_names=(*targets.class_names, *added_targets.class_names),
        burns_s=joined_burns_s([targets.burns_s, added_targets.burns_s]),
        **{
            name: np.concatenate([getattr(targets, name), getattr(added_targets, name)])
            for name in _TARGET_COLUMNS
        },
    )
    return with_targets(evolve(plan, scene=scene), joined_targets, pairs.take(order), lines)


def without_finished_targets(plan: Plan, time_ns: int) -> Plan:
    """Return a plan without the targets that no sensor looks at from a time on."""
    stays = is_active(plan, time_ns)
    if stays.all():
        return plan
    remaining = np.flatnonzero(stays)
    number = np.cumsum(stays) - 1
    rows = np.flatnonzero(stays[plan.pairs.target])
    pairs = plan.pairs.take(rows)
    lines = plan.sightlines.over_looks(pairs, rows)
    pairs = evolve(pairs, target=number[pairs.target].astype(np.int32))
    ids = {plan.targets.ids[row] for row in remaining.tolist()}
    scene = evolve(
        plan.scene, targets=tuple(target for target in plan.scene.targets if target.id in ids)
    )
    return with_targets(
        evolve(plan, scene=scene), _kept_targets(plan.targets, remaining), pairs, lines
    )


def is_active(plan: Plan, time_ns: int) -> BoolArray:
    """Return which targets (n,) are not launched yet, or are still looked at by a sensor, at a
    time.
    """
    stays: BoolArray = plan.targets.ignition_s * 1e9 >= time_ns
    going = (plan.pairs.looks > 0) & ~plan.pairs.is_over(time_ns)
    stays[plan.pairs.target[going]] = True
    return stays


def _kept_targets(targets: Targets, rows: IntArray) -> Targets:
    """Return some of the targets, without trajectories that none of them uses."""
    groups, group = np.unique(targets.group[rows], return_inverse=True)
    return Targets(
        ids=tuple(targets.ids[row] for row in rows.tolist()),
        trajectories=tuple(targets.trajectories[number] for number in groups.tolist()),
        group=group.astype(np.int32),
        class_names=tuple(targets.class_names[row] for row in rows.tolist()),
        burns_s=targets.burns_s[rows],
        **{name: getattr(targets, name)[rows] for name in _TARGET_COLUMNS},
    )


def scan_generations(plan: Plan, former: Plan) -> tuple[int, ...]:
    """Return the generation of each sensor's scans: one more if the scan times have changed.

    Scans of a new generation are numbered anew and must not share random numbers or ids with
    earlier ones. Both plans have the same sensors and targets.
    """
    differs = (plan.pairs.period_ns != former.pairs.period_ns) | (
        plan.pairs.phase_ns != former.pairs.phase_ns
    )
    sensors: IndexArray = plan.pairs.sensor[differs]
    moved = set(sensors.tolist())
    sensors_now = enumerate(zip(plan.sensors, former.sensors, strict=True))
    moved |= {
        row
        for row, (sensor, former_sensor) in sensors_now
        if _periods_ns(sensor) != _periods_ns(former_sensor)
    }
    numbers = former.scan_generations or (0,) * len(plan.sensors)
    return (
        tuple(number + (row in moved) for row, number in enumerate(numbers))
        if moved
        else former.scan_generations
    )


def _periods_ns(sensor: Sensor) -> Mapping[str, int]:
    """Return the scan periods of a sensor, "", and of its modes."""
    return {name: each.scan.period_ns for name, each in {**sensor.modes, "": sensor}.items()}


#: Time, s, that a change may wait in all: for its turn and for the run to apply it.
_CHANGE_S = 8.0
_POLL_S = 0.1
_LOOK_S = 0.005
_WAITING_CHANGES = 16

_RESTART = "needs a restart"

#: Keys of a scene that cannot change while it runs, with the reason.
_FIXED = {
    **dict.fromkeys(
        ("scene", "epoch", "duration_s", "seed", "light_time", "reported_types", "forces"), _RESTART
    ),
    **dict.fromkeys(
        ("tracker", "tracking_order", "tracking_lag_s"), f"{_RESTART}: tracks would be lost"
    ),
    **dict.fromkeys(("sources", "limits", "faults", "links", "director"), _RESTART),
}


class RefusedError(OpirError):
    """A change that the run cannot apply: it has ended, too many changes wait, or its time is
    past.
    """


class BusyError(RefusedError):
    """A change that the run may apply later."""


class PastError(RefusedError):
    """A launch before the earliest time at which the run can add it."""


class RestartError(OpirError):
    """Settings that a running scene cannot change."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, problems)))


@frozen(eq=False)
class Change:
    """An engine with a change, ready to replace the engine of a lap.

    `not_after_ns` is the latest time of the lap at which it may, `reopened` the outputs that
    change, `base` the scene of the laps to come, `record` what was asked for, to repeat it.
    """

    engine: Engine
    lap: int
    record: Mapping[str, Any]
    not_after_ns: int | None = None
    reopened: tuple[Choice, ...] = ()
    base: Scene | None = None


class ChangeQueue:
    """Changes, and tasks of sensors, that the run has not applied yet."""

    def __init__(self, stopping: threading.Event) -> None:
        self._stopping = stopping
        self._queue: queue.Queue[tuple[Change | SensorTask, Future[Any]]] = queue.Queue(
            _WAITING_CHANGES
        )
        self._lock = threading.Lock()
        self._waiting = threading.BoundedSemaphore(_WAITING_CHANGES)

    @contextmanager
    def lock(self) -> Iterator[float]:
        """Hold the lock of changes; yield the time of the monotonic clock at which to give up.

        Raises `BusyError` if too many changes wait, or if the lock is not free in time.
        """
        if not self._waiting.acquire(blocking=False):
            raise BusyError("too many changes are waiting; try again")
        try:
            give_up_s = time.monotonic() + _CHANGE_S
            if not self._lock.acquire(timeout=_CHANGE_S):
                raise BusyError("other changes are not finished; try again")
            try:
                yield give_up_s
            finally:
                self._lock.release()
        finally:
            self._waiting.release()

    def apply(self, change: Change | SensorTask, give_up_s: float) -> Any:
        """Queue a change and return the cycle at whose start the run applied it; of a task what
        became of it.

        A change not begun by `give_up_s` is withdrawn. Raises `BusyError` then, `RefusedError` if
        the run stops.
        """
        answer: Future[Any] = Future()
        self._queue.put_nowait((change, answer))
        while not wait([answer], _POLL_S).done:
            is_late = time.monotonic() >= give_up_s
            # One that the run is applying is waited for, unless the run does not come to its end.
            if self._stopping.is_set() and (answer.cancel() or is_late):
                raise RefusedError("the run is being stopped")
            if is_late and answer.cancel():
                raise BusyError(
                    "the run is behind: it computes slower than its clock, or waits for a sink whose"
                    " queue is full; try again"
                )
        return answer.result()

    def pending(self) -> "Iterator[tuple[Change | SensorTask, Future[Any]]]":
        """Yield the changes that are not withdrawn; the run's thread sets the result of each."""
        while not self._queue.empty():
            change, answer = self._queue.get_nowait()
            if answer.set_running_or_notify_cancel():
                yield change, answer


def wait_until(is_met: Callable[[], bool], stopping: threading.Event, give_up_s: float) -> bool:
    """Return whether a condition is met by `give_up_s`, and before the run is stopped."""
    while not is_met():
        if stopping.wait(_LOOK_S) or time.monotonic() >= give_up_s:
            return False
    return True


def launch_change(plan: Plan, block: Mapping[str, Any], time_ns: int, lap: int) -> Change:
    """Return the change that adds a target to a plan at a time.

    `block` has the layout of a scene's targets. Raises `SceneError`, `PluginError` or `ModelError`
    as a scene with this target does.
    """
    scene = plan.scene
    duplicate = next((target for target in scene.targets if target.id == block.get("id")), None)
    if duplicate is not None:
        raise SceneError(
            [Problem("targets[0].id", f"{duplicate.id} is the id of another target")],
            source="launch",
        )
    mapping = {**scene_mapping(scene), "targets": [dict(block)], "outputs": []}
    read = scene_from_mapping(mapping, host=plan.host, source="launch")
    require_plausible(read, evolve(scene, targets=(), outputs=()), "launch")
    without_sources: dict[str, Any] = {"sources": ()} if getattr(scene, "sources", ()) else {}
    added = compile_plan(evolve(scene, targets=read.targets, **without_sources), plan.host)
    changed_plan = with_added_targets(without_finished_targets(plan, time_ns), added)
    changed_plan.workload.require_run()
    engine = Engine(changed_plan)
    latest_ns = int(added.targets.ignition_s.min() * 1e9)
    return Change(engine, lap, {"launch": dict(block)}, latest_ns)


def settings_change(plan: Plan, mapping: Mapping[str, Any], lap: int, first_scene: Scene) -> Change:
    """Return the change of a plan's settings; `mapping` is that of a scene, without targets and
    sources.

    `first_scene` is the scene of the first lap, whose epoch and seed are in the mapping. Raises
    `SceneError` with all errors of the mapping, and `RestartError` with all settings that cannot
    change while the scene runs.
    """
    former = evolve(plan.scene, epoch_us=first_scene.epoch_us, seed=first_scene.seed)
    former_mapping = scene_mapping(former)
    mapping_after: dict[str, Any] = {
        **mapping,
        **{key: former_mapping[key] for key in ("targets", "sources") if key in former_mapping},
    }
    read = scene_from_mapping(mapping_after, host=plan.host, source="settings")
    problems = _restart_problems(former, read)
    if problems:
        raise RestartError(problems)
    require_plausible(read, former, "settings")
    compiled = compile_plan(
        evolve(read, epoch_us=plan.scene.epoch_us, seed=plan.scene.seed), plan.host
    )
    generations = scan_generations(compiled, plan)
    changed = evolve(compiled, scan_generations=generations)
    base = evolve(read, targets=first_scene.targets)
    outputs = zip(plan.scene.outputs, read.outputs, strict=True)
    reopened = tuple(output for former_output, output in outputs if output != former_output)
    record = {"settings": dict(mapping)}
    return Change(Engine(changed), lap, record, reopened=reopened, base=base)


def require_plausible(scene: Scene, former: Scene, source: str) -> None:
    """Raise `SceneError` for implausible values that the former scene does not have, unless the
    scene allows them.
    """
    former_problems = implausible_values(former)
    new = [problem for problem in implausible_values(scene) if problem not in former_problems]
    if new and not scene.allow_implausible:
        raise SceneError(
            [Problem(problem.path, f"{problem.message}; {REMEDY}") for problem in new],
            source=source,
        )


def _restart_problems(former: Scene, scene: Scene) -> list[Problem]:
    former_mapping = scene_mapping(former)
    mapping = scene_mapping(scene)
    problems = [
        Problem(key, reason)
        for key, reason in _FIXED.items()
        if former_mapping.get(key) != mapping.get(key)
    ]
    former_names, names = (
        [(sensor.id, sensor.constellation, sensor.model.name) for sensor in sensors]
        for sensors in (former.sensors, scene.sensors)
    )
    if names != former_names:
        return [*problems, Problem("sensors", f"{_RESTART}: other sensors, or in another order")]
    problems += [
        Problem(
            f"{sensor.model.path}.{key}",
            f"{_RESTART} (sensor {sensor.id}): outputs are open for sensors as they are",
        )
        for former_sensor, sensor in zip(former.sensors, scene.sensors, strict=True)
        for key in ("bands", "orbit", "orbital_slot_deg")
        if getattr(former_sensor.model.config, key, None) != getattr(sensor.model.config, key, None)
    ]
    return problems + _output_problems(former, scene)


def _output_problems(former: Scene, scene: Scene) -> list[Problem]:
    if [output.name for output in former.outputs] != [output.name for output in scene.outputs]:
        return [Problem("outputs", f"{_RESTART}: other outputs, or in another order")]
    return [
        Problem(
            output.path,
            f"{_RESTART}: opened anew it would overwrite {output.config.path!r}; give another path",
        )
        for former_output, output in zip(former.outputs, scene.outputs, strict=True)
        if output != former_output
        and getattr(output.config, "path", None)
        and output.config.path == former_output.config.path
    ]


def plan_of_lap(base: Scene, host: Host, lap: int, lap_us: int) -> Plan:
    """Return the plan of a lap: the scene with its epoch `lap` durations later, and `lap` added to
    its seed.
    """
    scene = evolve(base, epoch_us=base.epoch_us + lap * lap_us, seed=(base.seed + lap) % 2**63)
    return compile_plan(scene, host)
