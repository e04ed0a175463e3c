"""A run in memory written to files, those of `opir run`."""

from pathlib import Path

from attrs import evolve

from opir_core.errors import SinkError
from opir_core.host.components import SinkModel
from opir_core.interfaces.records import Window
from opir_core.interfaces.sensor_health import SensorHealth
from opir_core.output.delivery import PARQUET, deliver, has_columns
from opir_core.output.transaction import FILES_KEY
from opir_core.scene.scene import Choice
from opir_core.simulation.run import Run


def saved(run: Run, path: str | Path = "events.jsonl") -> Path:
    """Write events, and beside them truth, tracks, commands and manifest; return the path of the events.

    Events are columns where the path ends in `.parquet`, else lines. Raises `SinkError` where a
    file cannot be written, for which no file of an earlier run is replaced, and for a run that was
    read from files: these lack some columns.
    """
    if FILES_KEY in run.manifest:
        raise SinkError(
            f"{path}: the run was read from files, which round numbers and lack columns; copy the"
            f" files, or `opir rerun` their manifest"
        )
    events = Path(path)
    plan = run.plan
    sink = PARQUET.removeprefix(".") if has_columns(events) else "jsonl"
    component = plan.host.component(SinkModel, sink, f"run.save({str(path)!r})")
    output = Choice(SinkModel.hook, sink, component.config(path=str(events)), f"outputs[0].{sink}")
    health = [row["health"] for row in run.summary["sensors"]]
    window = Window(
        0.0,
        plan.end_ns * 1e-9,
        run.manifest["counts"]["looks"],
        run.detections,
        run.truth,
        run.tracks,
        run.estimates,
        SensorHealth.of_documents(health) if all(health) else None,
        tuple(run.commands),
    )
    truth = events.with_suffix(f".truth{events.suffix if has_columns(events) else '.jsonl'}")
    has_tracks = plan.make_tracker().cadence_s is not None
    tracks = events.with_suffix(".tracks.jsonl") if has_tracks else None
    commands = events.with_suffix(".commands.jsonl") if plan.scene.director else None
    manifest = events.with_suffix(".manifest.json")
    deliver(
        evolve(plan, scene=evolve(plan.scene, outputs=(output,))),
        truth_path=truth,
        tracks_path=tracks,
        commands_path=commands,
        manifest_path=manifest,
        made_up=(truth, tracks, commands, manifest),
        windows=[window],
    ).raise_for_failures()
    return events
