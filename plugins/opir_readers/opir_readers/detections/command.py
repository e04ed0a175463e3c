"""`opir track`: the detections of another program through opir's trackers, to files as `opir run`
writes them.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from opir_core import Detections, Engine, Plan, Tracks, Window, compile_plan
from opir_core.cli import answers, grouped, prints_on_standard_error, reported_tables, table
from opir_core.errors import Problem, SceneError
from opir_core.output import RunOutcome, deliver, timestamp_text
from opir_core.plugin import BadFileError, FileReader, Host
from opir_core.simulation import ReportOrder
from opir_readers.column_maps import columns_of_text
from opir_readers.detections.checks import warnings_of, within_scene
from opir_readers.detections.columns_of_run import RunColumns, columns_of, sensor_ids, times_ns
from opir_readers.detections.no_tracks import reason_of_no_track
from opir_readers.detections.numbers import NOTES, Rows
from opir_readers.detections.repeats import repeats_text, without_repeats
from opir_readers.detections.sensors_scene import scene_of_sensors, watched_scene
from opir_readers.detections.times import NS_PER_S
from opir_readers.detections.watched import Watched, spans_text, watched_lines, watched_of
from opir_readers.reading import FileText, content_of, file_text, reader_of, refused


class _Source(NamedTuple):
    """A file, its reader, and its detections; times in seconds of a scene wait for its epoch.

    `words` are warnings about its lines, whatever the scene.
    """

    file: FileText
    reader: FileReader
    rows: Rows
    words: Sequence[str]


def track_file(arguments: argparse.Namespace) -> int:
    """Track the detections of a file, write them with their tracks, and print the answers.

    Raises `SceneError` for a file that cannot be taken.
    """
    host = Host.discover()
    with prints_on_standard_error():
        source = _source(arguments, host)
        scene = scene_of_sensors(arguments, source.rows, host)
        names = renamed(arguments.rename)
        try:
            rows = within_scene(source.rows, times_ns(source.rows, scene.epoch_us), scene)
            ids = sensor_ids(rows, [sensor.id for sensor in scene.sensors], names)
            times = times_ns(rows, scene.epoch_us)
            watched = watched_of(arguments, source.rows, ids, times, scene, names)
            last_s = int(times.max()) / NS_PER_S
            plan = compile_plan(watched_scene(arguments, scene, watched, last_s), host)
            columns = columns_of(rows, plan, names)
        except BadFileError as error:
            raise refused(arguments.file, error) from error
    if not arguments.quiet:
        for words in (*watched.doubts, *_warnings(source, columns, plan)):
            sys.stderr.write(f"warning: {arguments.file}: {words}\n")
        for words in source.rows[0].get(NOTES, ()):
            sys.stderr.write(f"note: {arguments.file}: {words}\n")
    paths = _paths(arguments)
    with prints_on_standard_error():
        outcome = _tracked(arguments, plan, columns, source.file, paths)
    if not arguments.quiet:
        read = _read_text(arguments, plan, source.reader, columns, watched)
        paths["events"] = arguments.out
        written = [f"{path}: {kind}" for kind, path in paths.items()]
        parts = [
            *read,
            "\n".join(answers(outcome.summary)),
            "" if outcome.summary["tracks"] else reason_of_no_track(columns.detections, plan),
            *reported_tables(outcome.summary),
            "\n".join(written),
        ]
        sys.stdout.write("\n\n".join(part for part in parts if part) + "\n")
    outcome.raise_for_failures()
    return 0


def _source(arguments: argparse.Namespace, host: Host) -> _Source:
    columns = columns_of_text(arguments.columns) if arguments.columns else {}
    settings = {"columns": columns, "start_s": arguments.start_s}
    try:
        file = file_text(arguments.file)
        readers = [reader for reader in host.readers() if reader.yields == "detections"]
        reader = reader_of(file.text, readers, arguments.format, columns)
        rows = content_of(file.text, reader, settings, 0)
        unique = without_repeats(rows)
        return _Source(file, reader, unique, tuple(repeats_text(rows, unique)))
    except BadFileError as error:
        raise refused(arguments.file, error) from error


def renamed(pairs: Sequence[str]) -> Mapping[str, str]:
    """Return the ids of `THEIRS=OURS` pairs; raises `SceneError` for another text."""
    for pair in pairs:
        if "=" not in pair:
            raise SceneError(
                [Problem("--rename", f"{pair!r} is not THEIRS=OURS")], source="command line"
            )
    return dict(pair.split("=", 1) for pair in pairs)


def _warnings(source: _Source, columns: RunColumns, plan: Plan) -> Iterator[str]:
    yield from source.words
    count = len(source.rows)
    outside = count - len(columns.rows)
    if outside:
        yield f"{outside} of {count} detections are outside of the scene and left out"
    yield from warnings_of(columns, plan)


def _paths(arguments: argparse.Namespace) -> dict[str, Path]:
    """Return the files that are written, the events first; raises `SceneError` for one that is
    read.
    """
    events = Path(arguments.out)
    paths = {
        "events": events,
        "truth": events.with_suffix(".truth.jsonl"),
        "tracks": events.with_suffix(".tracks.jsonl"),
        "manifest": events.with_suffix(".manifest.json"),
    }
    sources = [Path(name).resolve() for name in (arguments.file, arguments.sensors)]
    for kind, path in paths.items():
        if path.resolve() in sources:
            words = f"the {kind} would overwrite {path}; give another path"
            raise SceneError([Problem("--out", words)], source="track")
    return paths


def _tracked(
    arguments: argparse.Namespace,
    plan: Plan,
    columns: RunColumns,
    file: FileText,
    paths: Mapping[str, Path],
) -> RunOutcome:
    """Write the detections with their tracks."""
    if plan.make_tracker().cadence_s is None:
        words = f"{plan.scene.tracker.name} makes no tracks; set another with --tracker"
        raise SceneError([Problem("tracker", words)])
    return deliver(
        plan,
        truth_path=paths["truth"],
        tracks_path=paths["tracks"],
        manifest_path=paths["manifest"],
        made_up=[paths["truth"], paths["tracks"], paths["manifest"]],
        windows=tracked_windows(plan, columns),
        inputs=[{"path": arguments.file, "sha256": file.sha256}],
    )


def tracked_windows(plan: Plan, columns: RunColumns) -> Iterator[Window]:
    """Yield the windows of a run whose detections are given: with the tracks of the plan's
    tracker.
    """
    reports = ReportOrder(plan)
    empty = Tracks.empty()
    looks = Window(0.0, plan.scene.duration_s, 0, columns.detections, columns.truth, empty, empty)
    yield reports.take(Engine(plan).track(looks, plan.end_ns), plan.end_ns)
    late = reports.rest()
    if late is not None:
        yield late


def _counted(count: int) -> str:
    """Return a number of detections in words."""
    return f"{grouped(count)} detection{'' if count == 1 else 's'}"


def _read_text(
    arguments: argparse.Namespace,
    plan: Plan,
    reader: FileReader,
    columns: RunColumns,
    watched: Watched,
) -> Iterator[str]:
    """Yield the sentences on the detections that were read, and their number by sensor."""
    head = _head_text(arguments.file, plan, reader, columns.detections)
    yield "\n".join([head, *watched_lines(watched), *_report_lines(plan)])
    count = np.bincount(columns.detections.sensor, minlength=len(plan.sensors)).tolist()
    rows = [
        (sensor.id, sensor.type, grouped(number), spans_text(watched.spans[sensor.id]))
        for sensor, number in zip(plan.sensors, count, strict=True)
    ]
    yield table(("sensor", "type", "detections", "watched s"), rows, numbers=(2,))


def _report_lines(plan: Plan) -> Iterator[str]:
    """Yield sentences on when a sensor reports a launch that it sees, which dates launches."""
    rules = plan.detection.confirmation
    if rules is None:
        yield (
            "assumed: each look that detects is a line, without confirmation over scans (--set"
            " detection=snr: by confirmation_detections and confirmation_scans of each sensor)"
        )
        return
    for needed, scans in np.unique(rules, axis=0).tolist():
        ids = [
            sensor.id
            for sensor, rule in zip(plan.sensors, rules.tolist(), strict=True)
            if rule == [needed, scans]
        ]
        rule_text = f"{needed} of {scans} looks detect (detection: {plan.scene.detection.name})"
        yield f"{', '.join(ids)}: a line once {rule_text}"


def _head_text(path: str, plan: Plan, reader: FileReader, detections: Detections) -> str:
    """Return what was read, and of which scene, in a sentence."""
    scene = plan.scene
    start_s, end_s = (detections.time_ns[[0, -1]] / NS_PER_S).tolist()
    epoch = timestamp_text(np.array([scene.epoch_us]))[0]
    return (
        f"{path}: {_counted(len(detections))} ({reader.name}), {start_s:.3f} to"
        f" {end_s:.3f} s of a scene of {scene.duration_s:g} s from {epoch}, tracker"
        f" {scene.tracker.name}, as of {scene.duration_s:.1f} s"
    )
