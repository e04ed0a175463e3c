"""`opir track`: the detections of another program through opir's trackers, to files as `opir run`
writes them.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from opir_core import Engine, Plan, Tracks, Window, compile_plan
from opir_core.cli import answers, grouped, prints_on_standard_error, reported_tables, table
from opir_core.errors import Problem, SceneError
from opir_core.output import RunOutcome, deliver, timestamp_text
from opir_core.plugin import BadFileError, FileReader, Host
from opir_core.simulation import ReportOrder
from opir_readers.column_maps import columns_of_text
from opir_readers.detections.checks import warnings_of, within_scene
from opir_readers.detections.columns_of_run import Row, RunColumns, columns_of, times_ns
from opir_readers.detections.no_tracks import reason_of_no_track
from opir_readers.detections.sensors_scene import scene_of_sensors
from opir_readers.reading import FileText, content_of, file_text, reader_of

#: The files beside the events.
_BESIDE = ("truth", "tracks", "manifest")

_MS = 1_000_000
_NS = 1_000_000_000


def track_file(arguments: argparse.Namespace) -> int:
    """Track the detections of a file, write them with their tracks, and print what was found.

    Raises `SceneError` for a file that cannot be taken.
    """
    host = Host.discover()
    with prints_on_standard_error():
        file, reader, rows = _read(arguments, host)
        scene = scene_of_sensors(arguments, rows, host)
        plan = compile_plan(scene, host)
        try:
            given = within_scene(rows, times_ns(rows, scene.epoch_us), scene)
            columns = columns_of(given, plan, renamed(arguments.rename))
        except BadFileError as error:
            raise _refused(arguments.file, error) from error
    if not arguments.quiet:
        left_out = [
            (
                f"{len(rows) - len(given)} of {len(rows)} detections are outside of the scene and left"
                f" out"
            )
        ]
        for words in [*(left_out if len(given) < len(rows) else ()), *warnings_of(columns, plan)]:
            sys.stderr.write(f"warning: {arguments.file}: {words}\n")
    with prints_on_standard_error():
        outcome, files = _tracked(arguments, plan, columns, file)
    if not arguments.quiet:
        sys.stdout.write(_text(arguments, plan, reader, columns, outcome, files) + "\n")
    outcome.raise_for_failures()
    return 0


def _read(arguments: argparse.Namespace, host: Host) -> tuple[FileText, FileReader, Sequence[Row]]:
    """Return the file, its reader, and the detections; times in seconds of a scene wait for its
    epoch.
    """
    columns = columns_of_text(arguments.columns) if arguments.columns else {}
    settings = {"columns": columns, "start_s": arguments.start_s}
    try:
        file = file_text(arguments.file)
        readers = [reader for reader in host.readers() if reader.yields == "detections"]
        reader = reader_of(file.text, readers, arguments.format)
        return file, reader, content_of(file.text, reader, settings, 0)
    except BadFileError as error:
        raise _refused(arguments.file, error) from error


def _refused(path: str, error: BadFileError) -> SceneError:
    return SceneError([Problem("", str(error))], source=path)


def renamed(pairs: Sequence[str]) -> Mapping[str, str]:
    """Return the ids of `THEIRS=OURS` pairs; raises `SceneError` for what is none."""
    wrong = [pair for pair in pairs if "=" not in pair]
    if wrong:
        raise SceneError(
            [Problem("--rename", f"{wrong[0]!r} is not THEIRS=OURS")], source="command line"
        )
    return {theirs: ours for theirs, _, ours in (pair.partition("=") for pair in pairs)}


def _tracked(
    arguments: argparse.Namespace, plan: Plan, columns: RunColumns, file: FileText
) -> tuple[RunOutcome, Mapping[str, Path]]:
    """Write the detections with their tracks; return the outcome and the files beside the
    events.
    """
    events = Path(arguments.out)
    files = {
        what: events.with_suffix(f".{what}.{'json' if what == 'manifest' else 'jsonl'}")
        for what in _BESIDE
    }
    for what, path in [("events", events), *files.items()]:
        if path.resolve() in (Path(arguments.file).resolve(), Path(arguments.sensors).resolve()):
            raise SceneError(
                [Problem("--out", f"the {what} would overwrite {path}; give another path")],
                source="track",
            )
    if plan.make_tracker().cadence_s is None:
        raise SceneError(
            [
                Problem(
                    "tracker",
                    f"{plan.scene.tracker.name} makes no tracks; set another with --tracker",
                )
            ]
        )
    outcome = deliver(
        plan,
        truth_path=files["truth"],
        tracks_path=files["tracks"],
        manifest_path=files["manifest"],
        made_up=list(files.values()),
        windows=tracked_windows(plan, columns),
        inputs=[{"path": arguments.file, "sha256": file.sha256}],
    )
    return outcome, files


def tracked_windows(plan: Plan, columns: RunColumns) -> Iterator[Window]:
    """Yield the windows of a run whose detections are given: with the tracks of the plan's
    tracker.
    """
    engine = Engine(plan)
    reports = ReportOrder(plan)
    empty = Tracks.empty()
    seen = Window(0.0, plan.scene.duration_s, 0, columns.detections, columns.truth, empty, empty)
    yield reports.take(engine.track(seen, plan.end_ns), plan.end_ns)
    rest = reports.rest()
    if rest is not None:
        yield rest


def _darkness(plan: Plan, columns: RunColumns) -> Iterator[str]:
    """Yield how long the scene goes on after the last detection, if longer than a scan of any
    sensor takes.
    """
    last_ns = int(columns.detections.time_ns[-1])
    silent_ns = plan.end_ns - last_ns
    if silent_ns > max(sensor.scan.period_ns for sensor in plan.sensors):
        end_s = -(-last_ns // _MS) * _MS / _NS
        yield (
            f"nothing is detected in the last {silent_ns / _NS:.1f} s of the scene, as after a"
            f" burn;"
            f" if the file is an excerpt, end the scene with it: --set duration_s={end_s:.3f}"
        )


def _text(
    arguments: argparse.Namespace,
    plan: Plan,
    reader: FileReader,
    columns: RunColumns,
    outcome: RunOutcome,
    files: Mapping[str, Path],
) -> str:
    """Return what was read and found, as sentences and tables."""
    scene = plan.scene
    found = columns.detections
    epoch = timestamp_text(np.array([scene.epoch_us]))[0]
    head = (
        f"{arguments.file}: {grouped(len(found))} detections ({reader.name}),"
        f" {found.time_ns[0] / _NS:.3f} to"
        f" {found.time_ns[-1] / _NS:.3f} s of a scene of {scene.duration_s:g} s from {epoch},"
        f" tracker {scene.tracker.name}, as of {scene.duration_s:.1f} s"
    )
    count = np.bincount(found.sensor, minlength=len(plan.sensors))
    rows = [
        (sensor.id, sensor.type, grouped(int(number)))
        for sensor, number in zip(plan.sensors, count, strict=True)
    ]
    parts = [
        "\n".join([head, *_darkness(plan, columns)]),
        table(("sensor", "type", "detections"), rows, numbers=(2,)),
        "\n".join(answers(outcome.summary)),
        "" if outcome.summary["tracks"] else reason_of_no_track(found, plan),
        *reported_tables(outcome.summary),
        "\n".join(
            [f"{arguments.out}: events", *(f"{path}: {what}" for what, path in files.items())]
        ),
    ]
    return "\n\n".join(part for part in parts if part)
