"""A director in a run: what has arrived by each of its decisions, and its commands to sensors."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from attrs import evolve
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import ModelError, nearest_names
from opir_core.host.boundary import blamed_call, check_hint, owner_text
from opir_core.interfaces.directors import (
    Command,
    Director,
    SensorTask,
    Situation,
    command_fault,
)
from opir_core.interfaces.records import OPERATOR, CommandRecord, Detections, Tracks, Window
from opir_core.planning.keep_out import sun_refusal
from opir_core.planning.partial_looks import SteeringCommands
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_modes import SensorModes
from opir_core.planning.solar_exclusion import SolarExclusion
from opir_core.planning.visibility import visible_now
from opir_core.simulation.merging import MergeModes
from opir_core.simulation.pointing import NarrowField, PointedFields


class Directing:
    """Asks a plan's director at its decisions, and points the sensors' fields.

    Decisions depend on scene time and on what has arrived, not on windows.
    """

    def __init__(self, plan: Plan, director: Director, fields: PointedFields) -> None:
        self._director = director
        self._step_ns = max(round(director.interval_s * 1e9), 1)
        self._next_ns = 0
        #: Whether decisions depend on detections, not on tracks alone.
        self.needs_detections = bool(director.needs_detections)
        self._detections: list[Detections] = []
        self._tracks: list[Tracks] = []
        self._latest = Tracks.empty()
        self._refused: tuple[CommandRecord, ...] = ()
        #: By sensor what an operator has it do, and what became of tasks since the last window.
        self._tasks: dict[str, SensorTask] = {}
        self._tasked: tuple[CommandRecord, ...] = ()
        self._steering = SteeringCommands(plan.sensors)
        #: By sensor why it did not take its last command, "" if it did.
        self._refusals: dict[str, str] = {}
        #: By sensor the time, the positions (n, 3) and the answers (n,) of the last question whether
        #: it reaches them at once.
        self._reached: dict[int, tuple[float, FloatArray, BoolArray]] = {}
        self.use(plan, fields)

    def use(self, plan: Plan, fields: PointedFields) -> None:
        """Go on with a plan of the same sensors, and point these fields."""
        self._plan = plan
        self.fields = fields
        self._numbers = {
            sensor.id: number
            for number, sensor in enumerate(plan.sensors)
            if sensor.pointing is not None
        }
        self.tracker_sensors = plan.tracker_sensors(self._steering.commands)

    def steers(self, commands: Sequence[CommandRecord]) -> bool:
        """Take what became of commands; return whether they change when sensors look at their whole
        field of regard, which `tracker_sensors` then say.
        """
        if not self._steering.take(commands):
            return False
        self.tracker_sensors = self._plan.tracker_sensors(self._steering.commands)
        return True

    def next_edge_ns(self, time_ns: int, end_ns: int) -> int:
        """Return the next decision after a time, at most an end."""
        return min((time_ns // self._step_ns + 1) * self._step_ns, end_ns)

    def decided(self, time_ns: int) -> tuple[CommandRecord, ...]:
        """Decide, if a decision is due at a time, and return what became of the commands, and of
        tasks since the last window.
        """
        tasked = self._tasked
        self._tasked = ()
        if time_ns < self._next_ns:
            return tasked
        self._next_ns = time_ns + self._step_ns
        time_s = time_ns / 1_000_000_000
        situation = self._situation(time_s)
        commands = self._called(situation)
        latest = {
            command.sensor: command for command in commands if command.sensor not in self._tasks
        }
        records = tuple(self._obeyed(command, time_s) for command in latest.values())
        self._refused = tuple(record for record in records if record.refusal)
        return (*tasked, *records, *self._followed(time_s))

    def task(self, task: SensorTask, time_ns: int) -> CommandRecord:
        """Have a sensor do a task from a time on; return what became of it.

        A task that the sensor refuses changes nothing. After one without point, track and mode the
        director commands the sensor again, at its next decision.
        """
        time_s = time_ns / 1_000_000_000
        if task.position_ecef_m is None and task.track < 0 and not task.mode:
            record = CommandRecord(time_s, task.sensor, -1, "the director's again", np.nan, np.nan)
            self._refusals.pop(task.sensor, None)
            if self._tasks.pop(task.sensor, None):
                self._refused = (*self._refused, record._replace(refusal="an operator had it"))
        else:
            record = self._obeyed(self._command(task, time_s), time_s)
            if not record.refusal:
                self._tasks[task.sensor] = task
        self._tasked = (*self._tasked, record)
        return record

    def field_at(self, number: int, time_s: float) -> NarrowField:
        """Return where the field of a sensor, by its number, is at a time, and who points it."""
        sensor = self._plan.sensors[number].id
        refusal = self._refusals.get(sensor, "")
        field = self.fields.field_at(number, time_s)
        return evolve(field, is_tasked=sensor in self._tasks, refusal=refusal)

    def _followed(self, time_s: float) -> Sequence[CommandRecord]:
        """Return what became of the commands to sensors that follow an operator's track, as long as
        it is there.
        """
        numbers = set(self._latest.track.tolist())
        tasks = [task for task in self._tasks.values() if task.track in numbers]
        return [self._obeyed(self._command(task, time_s), time_s) for task in tasks]

    def _command(self, task: SensorTask, time_s: float) -> Command:
        """Return the command of a task; its position is nan for a track without an estimate."""
        if task.position_ecef_m is not None or task.track < 0:
            return Command(
                sensor=task.sensor,
                position_ecef_m=task.position_ecef_m,
                reason=OPERATOR,
                mode=task.mode,
            )
        rows = np.flatnonzero(self._latest.track == task.track)
        state = np.append(self._latest.state[rows], np.full((1, 6), np.nan), axis=0)[0]
        since_s = time_s - float(np.append(self._latest.tick_s[rows], time_s)[0])
        return Command(
            sensor=task.sensor,
            position_ecef_m=state[:3] + state[3:] * since_s,
            velocity_m_s=state[3:],
            track=task.track,
            reason=OPERATOR,
            mode=task.mode,
        )

    def take(self, window: Window) -> Window:
        """Take what a window has, and return it; the director gets it as soon as it has been
        reported.
        """
        self.fields.observed_s = window.end_s
        if len(window.detections) and self.needs_detections:
            self._detections.append(window.detections)
        if len(window.tracks):
            self._tracks.append(window.tracks)
        return window

    def _arrived(self, time_s: float) -> Detections:
        """Return the detections that have been reported since the last decision."""
        if not self._detections:
            return Detections.empty()
        detections = Detections.concatenate(self._detections)
        has_come = detections.reported_ns <= time_s * 1e9
        self._detections = [] if has_come.all() else [detections.take(np.flatnonzero(~has_come))]
        return detections.take(np.flatnonzero(has_come))

    def _latest_tracks(self, time_s: float) -> Tracks:
        """Return the tracks of the last tick that is available."""
        if not self._tracks:
            return self._latest
        tracks = Tracks.concatenate(self._tracks)
        is_there = tracks.available_s <= time_s
        self._tracks = [] if is_there.all() else [tracks.take(np.flatnonzero(~is_there))]
        arrived = tracks.take(np.flatnonzero(is_there))
        if len(arrived):
            self._latest = arrived.take(np.flatnonzero(arrived.tick_s == arrived.tick_s.max()))
        return self._latest

    def _situation(self, time_s: float) -> Situation:
        return Situation(
            time_s=time_s,
            detections=self._arrived(time_s),
            tracks=self._latest_tracks(time_s),
            sensors=tuple(self._plan.sensors[number] for number in self._numbers.values()),
            refused=self._refused,
            in_reach=partial(self._in_reach, time_s),
        )

    def _called(self, situation: Situation) -> Sequence[Command]:
        """Return the director's commands; raises `ModelError` where it raises or returns none."""
        plan = self._plan
        choice = plan.scene.director
        assert choice is not None
        owner = partial(owner_text, plan.host, choice)
        hint = check_hint(choice.name)
        method = f"commands at {situation.time_s:g} s"
        commands = blamed_call(owner, hint, method, lambda: self._director.commands(situation))
        fault = command_fault(commands)
        if fault:
            raise ModelError(f"{owner()}: {method} {fault}; {hint}")
        return commands

    def _in_reach(
        self, time_s: float, sensor: str, position_ecef_m: ArrayLike, after_s: float = 0.0
    ) -> BoolArray:
        """Return which positions (n, 3) a sensor can be pointed at, so long after a time, if it
        looks then and its reports arrive.
        """
        number = self._numbers[sensor]
        position_m = np.array(position_ecef_m, dtype=np.float64)
        end_s = self._plan.end_ns / 1e9
        # A span ends with the time from which on it looks no longer; the last one with the scene.
        from_s = min(np.nextafter(time_s + after_s, np.inf), end_s)
        sensor_looks = self._plan.sensors[number].stated(end_s)
        if not sensor_looks.is_watching(np.array([from_s]))[0]:
            return np.zeros(len(position_m), dtype=np.bool_)
        reach = self._can_point(number, position_m, time_s + after_s)
        if not after_s:
            # A command to one of these positions need not be tested again.
            self._reached[number] = time_s, position_m, reach.copy()
        return reach

    def _can_point(self, number: int, position_m: FloatArray, time_s: float) -> BoolArray:
        """Return which positions (n, 3) the field of a sensor, by its number, can be pointed at."""
        at_s = np.full(len(position_m), time_s)
        here_m = self._plan.sensors[number].orbit.position_ecef_m(np.array([time_s]))
        sensor_m = np.broadcast_to(here_m, position_m.shape)
        reach = visible_now(self._plan.sensors[number], sensor_m, position_m)
        for limit in (self._exclusion(number), self.fields.keep_out(number)):
            if limit is not None:
                reach &= limit.is_clear(sensor_m, position_m, at_s)
        return reach

    def _is_reached(self, time_s: float, number: int, position_m: FloatArray) -> bool:
        """Return whether the field of a sensor can be pointed at a position (3,) at a time."""
        last = self._reached.get(number)
        if last is not None and last[0] == time_s:
            rows = np.flatnonzero((last[1] == position_m).all(axis=1))
            if len(rows):
                return bool(last[2][rows[0]])
        return bool(self._can_point(number, position_m[None], time_s)[0])

    def _exclusion(self, number: int) -> SolarExclusion | None:
        return self._plan.exclusions[number] if self._plan.exclusions else None

    def _obeyed(self, command: Command, time_s: float) -> CommandRecord:
        """Point the sensor of a command; return what became of it."""
        refusal = self._refusal(command, time_s)
        self._refusals[command.sensor] = refusal
        record = CommandRecord(
            time_s=time_s,
            sensor=command.sensor,
            track=command.track,
            reason=command.reason,
            start_s=np.nan,
            from_s=np.nan,
            refusal=refusal,
            mode=command.mode,
        )
        if refusal:
            return record
        aim = self.fields.point(self._numbers[command.sensor], command, time_s)
        return record._replace(
            start_s=aim.start_s,
            from_s=aim.from_s,
            position_ecef_m=aim.point_in_axis(aim.from_s),
        )

    def _refusal(self, command: Command, time_s: float) -> str:
        """Return why a sensor does not take a command, "" if it does."""
        if command.sensor not in self._numbers:
            return f"{command.sensor} is no sensor with a narrow field"
        number = self._numbers[command.sensor]
        sensor = self._plan.sensors[number]
        delay_s = 0.0 if sensor.pointing is None else sensor.pointing.delay_s
        faults = self._plan.faults
        failure = "" if faults is None else faults.refusal(number, time_s + delay_s)
        if failure:
            return failure
        modes = sensor.modes
        if command.mode and command.mode not in modes:
            names = ", ".join(nearest_names(command.mode, modes) or modes) or "none"
            return f"{command.sensor} has no mode {command.mode!r}; the nearest: {names}"
        return self._pointing_refusal(command, time_s)

    def _pointing_refusal(self, command: Command, time_s: float) -> str:
        """Return why a sensor cannot be pointed as a command says, "" if it can."""
        position_m = command.position_ecef_m
        if position_m is None:
            return ""
        vectors = np.concatenate([position_m, command.velocity_m_s])
        if not np.isfinite(vectors).all():
            without = "its position or velocity is not finite"
            return without if command.track < 0 else "its track has no estimate"
        number = self._numbers[command.sensor]
        if self._is_reached(time_s, number, position_m):
            return ""
        at_s = np.array([time_s])
        axis = self._plan.sensors[number].orbit.position_ecef_m(at_s), position_m[None], at_s
        exclusion = self._exclusion(number)
        keep_out = self.fields.keep_out(number)
        return (
            (keep_out is not None and keep_out.refusal(*axis))
            or (exclusion is not None and sun_refusal(exclusion, *axis))
            or "out of its field of regard, or behind the Earth"
        )


def directed(
    plan: Plan,
) -> tuple[PointedFields, Directing | None, SensorModes | None, MergeModes | None]:
    """Return the narrow fields of a plan's sensors, what asks its director, the modes that this
    names and the stage that merges them; None without one.
    """
    if plan.make_director is None:
        return PointedFields(plan), None, None, None
    modes = SensorModes.of(plan) if any(sensor.modes for sensor in plan.sensors) else None
    fields = PointedFields(plan, modes)
    merge = None if modes is None else MergeModes(modes, fields)
    return fields, Directing(plan, plan.make_director(), fields), modes, merge
