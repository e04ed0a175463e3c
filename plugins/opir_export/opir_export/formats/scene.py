"""The exporter `scene`: the scene of a run, or of a live run with what was launched while it ran."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import yaml
from attrs import frozen

from opir_core.errors import BAD_DATA, Problem, SceneError
from opir_core.live import recorded_run
from opir_core.output import OutputFiles
from opir_core.reading import scene_mapping
from opir_export.settings import SceneConfig

Change = Mapping[str, Any]


@frozen
class RecordedScene:
    """Writes a scene as YAML, into a file of events of its own."""

    config: SceneConfig

    suffix = ".scene.yaml"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the scene of a saved run to a file, and return it."""
        _write_scene(scene_mapping(run.plan.scene), ["The scene of a saved run."], path)
        return [path]

    def write_recorded(self, changes_path: Path, path: Path) -> Sequence[str]:
        """Write the scene of a lap of a live run, from its changes; return what the scene lacks.

        Raises `SceneError` if the file of changes is invalid.
        """
        recorded = recorded_run(changes_path)
        lap = self.config.lap
        try:
            scene = _lap_scene(recorded.scene, recorded.changes, lap)
            lacks = [
                *_unsaid_changes(recorded.changes, lap),
                *_other_end(recorded.end_ns, scene["duration_s"], lap),
            ]
        except BAD_DATA as error:
            problem = Problem("scene", f"lacks or has damaged settings: {error}")
            raise SceneError([problem], source=str(changes_path)) from error
        heading = f"A live run with its launches, from {changes_path.name}, lap {lap}."
        _write_scene(scene, [heading, *(f"Not in this scene: {words}" for words in lacks)], path)
        return lacks


def _lap_scene(base: Change, changes: Sequence[Change], lap: int) -> dict[str, Any]:
    """Return the scene of a lap: its epoch and seed, settings of laps before it, its launches."""
    former = [row["settings"] for row in changes if "settings" in row and row["lap"] < lap]
    scene = {**base, **(former[-1] if former else {})}
    epoch = datetime.fromisoformat(scene["epoch"]) + lap * timedelta(seconds=scene["duration_s"])
    launches = [row["launch"] for row in changes if "launch" in row and row["lap"] == lap]
    return {
        **scene,
        "epoch": epoch.isoformat().replace("+00:00", "Z"),
        "seed": scene["seed"] + lap,
        "targets": [*scene.get("targets", ()), *launches],
    }


def _unsaid_changes(changes: Sequence[Change], lap: int) -> Iterator[str]:
    """Yield what was changed in a lap and is no launch, and how many launches other laps have."""
    for row in changes:
        if row["lap"] == lap and "launch" not in row:
            words = _task_words(row["task"]) if "task" in row else "settings changed"
            yield f"at {row['time_ns'] * 1e-9:.3f} s {words}"
    others = sorted({row["lap"] for row in changes if "launch" in row} - {lap})
    if others:
        yield f"launches of the laps {', '.join(map(str, others))}: --set lap={others[0]}"


def _task_words(task: Change) -> str:
    if task.get("position_ecef_m") is not None:
        return f"{task['sensor']} was pointed at a place"
    if task.get("track", -1) >= 0:
        return f"{task['sensor']} was pointed at track {task['track']}"
    return f"{task['sensor']} was given back to the director"


def _other_end(end_ns: int | None, duration_s: float, lap: int) -> Iterator[str]:
    if end_ns is None:
        yield "the kill of the run; the scene goes on to its end"
    elif end_ns < (lap + 1) * duration_s * 1e9:
        yield f"the stop at {end_ns * 1e-9 - lap * duration_s:.3f} s; the scene goes on to its end"


def _write_scene(scene: Mapping[str, Any], comments: Sequence[str], path: Path) -> None:
    """Write a scene whose one output is a file beside no other: none of the run's is overwritten."""
    files = (each["jsonl"] for each in scene.get("outputs", ()) if "jsonl" in each)
    events = {**next(files, {}), "path": f"{path.name.removesuffix('.yaml')}.events.jsonl"}
    text = yaml.safe_dump(
        {**scene, "outputs": [{"jsonl": events}]}, sort_keys=False, allow_unicode=True, width=120
    )
    head = "".join(f"# {words}\n" for words in comments)
    with OutputFiles() as output:
        output.write(path, f"{head}{text}".encode(), "scene")
