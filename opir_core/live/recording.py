"""What changed a live run, in a file with which `opir run` repeats it: its scene, each launch,
setting and task of a sensor with the scene time at which it was applied, and its end.
"""

import json
import math
from collections.abc import Mapping
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.errors import Problem, SceneError, unwritable
from opir_core.host.host import Host
from opir_core.interfaces.directors import SensorTask
from opir_core.live.changes import Change, launch_change, settings_change
from opir_core.live.running import LiveRun, LiveSettings
from opir_core.output.temporary_files import write_all
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.reading.format_versions import CHANGE_FORMAT, CHANGES_KEY
from opir_core.scene.scene import Scene


class ChangesFile:
    """A file of a live run's changes, written anew; each line is in the file before the change has
    an effect.
    """

    def __init__(self, path: Path, scene: Scene, *, loop: bool) -> None:
        self._path = path
        head = {CHANGES_KEY: CHANGE_FORMAT.version, "loop": loop, "scene": scene_mapping(scene)}
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise unwritable("the changes file", path, error) from error
        self._write(head)

    def change(self, lap: int, time_ns: int, record: Mapping[str, Any]) -> None:
        """Write a change that is applied at a time of a lap."""
        self._write({"lap": lap, "time_ns": time_ns, **record})

    def end(self, time_ns: int) -> None:
        """Write up to which scene time, over all laps, the run came, and close the file."""
        if not self._file.closed:
            self._write({"end_ns": time_ns})
            self._file.close()

    def _write(self, line: Mapping[str, Any]) -> None:
        try:
            text = json.dumps(line, default=np.ndarray.tolist)
            write_all(self._file.fileno(), text.encode() + b"\n")
        except OSError as error:
            raise unwritable("the changes file", self._path, error) from error


@frozen
class RecordedRun:
    """A live run as its file has it; `end_ns` is None for one that was killed."""

    path: Path
    scene: Mapping[str, Any]
    loop: bool
    changes: tuple[Mapping[str, Any], ...]
    end_ns: int | None


def recorded_run(path: Path) -> RecordedRun:
    """Return the run of a file; `SceneError` with its line if it is invalid.

    An incomplete last line, as a kill leaves it, is left out.
    """
    rows = list[dict[str, Any]]()
    lines = path.read_bytes().split(b"\n")
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(dict(json.loads(line)))
        except (ValueError, TypeError, RecursionError) as error:
            if number == len(lines):
                break
            raise _invalid(path, number, f"not a change: {error}") from error
        if number == 1:
            version = rows[0].get(CHANGES_KEY)
            CHANGE_FORMAT.require_readable(version, path, f"line 1: {CHANGES_KEY}")
    if not rows or not isinstance(rows[0].get("scene"), dict):
        raise _invalid(path, 1, "a scene is missing")
    head, *others = rows
    for number, row in enumerate(others, start=2):
        if type(row.get("end_ns")) is not int and not _is_change(row):
            words = "no launch, settings or task with lap and time_ns, and no end_ns"
            raise _invalid(path, number, words)
    end_ns = next((row["end_ns"] for row in others if "end_ns" in row), None)
    changes = [row for row in others if "end_ns" not in row]
    if changes != sorted(changes, key=itemgetter("lap", "time_ns")):
        problem = Problem("", "its changes are not in the order of lap and time_ns")
        raise SceneError([problem], source=str(path))
    return RecordedRun(path, head["scene"], head.get("loop") is True, tuple(changes), end_ns)


def _is_change(row: Mapping[str, Any]) -> bool:
    has_place = all(type(row.get(key)) is int and row[key] >= 0 for key in ("lap", "time_ns"))
    return has_place and any(
        isinstance(row.get(key), dict) for key in ("launch", "settings", "task")
    )


def _invalid(path: Path, number: int, words: str) -> SceneError:
    return SceneError([Problem(f"line {number}", words)], source=str(path))


class RepeatedRun(LiveRun):
    """A recorded run, again and unpaced: its changes are applied at the times at which they were,
    into outputs of the scene given.
    """

    def __init__(self, recorded: RecordedRun, scene: Scene, host: Host) -> None:
        super().__init__(scene, host, LiveSettings(speed=None, loop=recorded.loop))
        self._recorded = recorded
        self._remaining = list(recorded.changes)
        end_ns = recorded.end_ns
        if end_ns is None and recorded.loop:
            problem = Problem("", 'the run was killed in a loop without an end; add {"end_ns": …}')
            raise SceneError([problem], source=str(recorded.path))
        self._end_ns = math.inf if end_ns is None else end_ns

    def join(self) -> None:
        """Wait for the end of the run."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def _cycle(self) -> bool:
        return self._counts.time_ns < self._end_ns and super()._cycle()

    def _apply_changes(self) -> None:
        while self._remaining:
            row = self._remaining[0]
            position = self._position
            if (row["lap"], row["time_ns"]) != (position.lap, position.engine.time_ns):
                return
            self._apply(self._change(row))
            self._remaining.pop(0)

    def _change(self, row: Mapping[str, Any]) -> Change | SensorTask:
        if "task" in row:
            return SensorTask(**row["task"])
        position = self._position
        plan = position.engine.plan
        if "launch" in row:
            self._launch_count += 1
            return launch_change(plan, row["launch"], position.engine.time_ns, position.lap)
        outputs = scene_mapping(self.scene)["outputs"]
        settings = {**row["settings"], "outputs": outputs}
        return settings_change(plan, settings, position.lap, self.scene)

    def _due_ns(self) -> int:
        offset_ns = self._position.offset.time_ns
        due_ns = min(super()._due_ns(), self._end_ns)
        if self._remaining and self._remaining[0]["lap"] == self._position.lap:
            due_ns = min(due_ns, self._remaining[0]["time_ns"] + offset_ns)
        return int(due_ns)


def repeated_run(path: Path, outputs: Any, host: Host) -> RepeatedRun:
    """Return the run of a file, not started, into outputs laid out as those of a scene."""
    recorded = recorded_run(path)
    mapping = {**recorded.scene, "outputs": outputs}
    scene = scene_from_mapping(mapping, host=host, source=str(path))
    return RepeatedRun(recorded, scene, host)
