"""`opir run`: simulate a scene; write events, truth, tracks and manifest; print the summary.

The summary has the totals, a sentence per target, tables of sensors, targets and tracks, and the
files written.
"""

import argparse
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from attrs import asdict

from opir_core.cli.scene_arguments import add_dead_after, add_scene_arguments, plan_of, scene_of
from opir_core.cli.terminal import (
    ending_signals,
    grouped,
    listed,
    prints_on_standard_error,
    table,
)
from opir_core.errors import ModelError, Problem, SceneError, SinkError
from opir_core.host.boundary import PluginErrors
from opir_core.host.host import Host
from opir_core.host.registry import warn
from opir_core.host.watchdog import ended_if_stuck
from opir_core.notebook import progress
from opir_core.output.delivery import CALL_S, PARQUET, RunOutcome, deliver, has_columns
from opir_core.output.pump import SinkReport
from opir_core.planning.plan import Plan
from opir_core.reading.format_versions import is_recorded
from opir_core.scene.scene import Scene
from opir_core.simulation.plan_checks import plan_warnings
from opir_core.simulation.undetected import undetected_text

_STANDARD_OUTPUT = "-"
_DEFAULT_OUT = "events.jsonl"
#: Sinks with one file of events, beside which truth, tracks and manifest are written.
_FILES_OF_EVENTS = ("jsonl", "parquet")


def run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, its overrides, and the outputs."""
    add_scene_arguments(parser)
    where = parser.add_mutually_exclusive_group()
    where_events = (
        "write events here as JSON lines, or columns if PATH ends in .parquet (- for standard"
        " output)"
    )
    where.add_argument("-o", "--out", metavar="PATH", help=where_events)
    where.add_argument(
        "--sink",
        metavar="NAME",
        help="send events only to this sink, instead of the scene's outputs",
    )
    where_truth = (
        "write the truth here, as columns if PATH ends in .parquet (default: beside the events, in"
        " their format)"
    )
    parser.add_argument("--truth", metavar="PATH", help=where_truth)
    parser.add_argument(
        "--tracks", metavar="PATH", help="write the tracks here (default: beside the events)"
    )
    parser.add_argument(
        "--commands",
        metavar="PATH",
        help="write the director's commands here (default: beside the events)",
    )
    parser.add_argument(
        "--manifest",
        metavar="PATH",
        help="write the run manifest here (default: beside the events)",
    )
    parser.add_argument(
        "--workers",
        metavar="N",
        type=int,
        default=1,
        help="processes that compute the run; the files are the same",
    )
    add_dead_after(
        parser, None, f"; a call of a sink fails its output alone (default {CALL_S:g} s)"
    )
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")


def run(arguments: argparse.Namespace) -> int:
    """Simulate the scene, or repeat a live run from its changes; what plugins print goes to standard
    error.
    """
    if is_recorded(Path(arguments.scene)):
        return _repeated(arguments)
    with prints_on_standard_error(), ended_if_stuck(arguments.dead_after):
        scene, outcome, files = _simulated(arguments)
    written = (
        {}
        if outcome.incomplete
        else {kind: path for kind, path in files.items() if path is not None}
    )
    _print_summary(arguments, scene, outcome, written)
    outcome.raise_for_failures()
    return 0


def _repeated(arguments: argparse.Namespace) -> int:
    """Repeat a live run into the output that the arguments give."""
    from opir_core.live.recording import repeated_run  # a run of a scene does not load it

    options = ("truth", "tracks", "commands", "manifest", "overrides", "seed", "tracker")
    unread = [f"--{name}" for name in options if getattr(arguments, name, None)]
    if unread or (arguments.out is None and arguments.sink is None):
        words = "a live run is repeated into one output: give -o PATH or --sink NAME, and no others"
        raise SceneError([Problem(", ".join(unread), words)], source=arguments.scene)
    sink = "parquet" if arguments.out and has_columns(Path(arguments.out)) else "jsonl"
    output = {sink: {"path": arguments.out}} if arguments.out else {arguments.sink: {}}
    with prints_on_standard_error(), ended_if_stuck(arguments.dead_after):
        repeated = repeated_run(Path(arguments.scene), [output], Host.discover())
        repeated.start()
        with _ended_by_signals():
            repeated.join()
        status = repeated.stop(CALL_S)
    if status.error is not None:
        raise ModelError(f"the run failed: {status.error}")
    if failures := [f"{sink.path}: {sink.error}" for sink in status.sinks if sink.error]:
        raise SinkError("\n".join(failures))
    if not arguments.quiet:
        words = f"{repeated.scene.name}: {grouped(status.detections)} detections"
        sys.stdout.write(f"{words}, as a live run made them, {status.time_ns * 1e-9:g} s\n")
    return 0


def _simulated(arguments: argparse.Namespace) -> tuple[Scene, RunOutcome, dict[str, Path | None]]:
    """Return the scene, the outcome of its run, and the paths of its files."""
    host = Host.discover()
    scene = scene_of(
        arguments,
        host,
        first=_outputs(arguments),
        otherwise=(f"outputs=[{_output_to(_DEFAULT_OUT)}]",),
    )
    plan = plan_of(arguments, scene, host)
    events = _first_file(scene)
    truth = _beside(
        events, arguments.truth, f".truth{PARQUET if events and has_columns(events) else '.jsonl'}"
    )
    tracks = (
        None
        if plan.make_tracker().cadence_s is None
        else _beside(events, arguments.tracks, ".tracks.jsonl")
    )
    commands = (
        None if scene.director is None else _beside(events, arguments.commands, ".commands.jsonl")
    )
    manifest = _beside(events, arguments.manifest, ".manifest.json")
    files = {"truth": truth, "tracks": tracks, "commands": commands, "manifest": manifest}
    _require_own_paths(arguments, scene, files)
    if not arguments.quiet:
        for warning in plan_warnings(plan):
            warn(warning)
    is_shown = not arguments.quiet and sys.stderr.isatty()
    with _ended_by_signals(), progress(is_shown=is_shown) as update:
        outcome = deliver(
            plan,
            truth_path=truth,
            tracks_path=tracks,
            commands_path=commands,
            manifest_path=manifest,
            made_up=[path for kind, path in files.items() if getattr(arguments, kind) is None],
            on_window=(lambda window: update(scene.name, window.end_s, scene.duration_s))
            if is_shown
            else None,
            workers=arguments.workers,
        )
    if not arguments.quiet:
        _add_reasons(plan, outcome.summary)
    return scene, outcome, files


def _add_reasons(plan: Plan, summary: Mapping[str, Any]) -> None:
    """Add to the rows of targets and sources why they were never detected, None if they were."""
    number = {name: target for target, name in enumerate(plan.targets.ids)}
    rows = [
        (row, row[f"{kind}_id"]) for kind in ("target", "source") for row in summary[f"{kind}s"]
    ]
    with PluginErrors(plan.host, plan.scene):
        for row, name in rows:
            row["undetected_because"] = (
                None if row["detections"] else undetected_text(plan, number[name])
            )


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let SIGTERM, and SIGHUP of a closed terminal, end the run as Ctrl-C does, so that temporary
    files are removed, and then end the process.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived = []

    def end(number: int, _frame: object) -> None:
        arrived.append(number)
        raise KeyboardInterrupt

    former = {number: signal.signal(number, end) for number in ending_signals()}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        if arrived:
            os.kill(os.getpid(), arrived[0])


def _outputs(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the override of `--out` or `--sink`."""
    if arguments.out is not None:
        return (f"outputs=[{_output_to(arguments.out)}]",)
    return (
        (f"outputs=[{{{json.dumps(arguments.sink)}: {{}}}}]",) if arguments.sink is not None else ()
    )


def _output_to(path: str) -> str:
    """Return the output that writes events to a path."""
    sink = "parquet" if has_columns(Path(path)) else "jsonl"
    return f"{{{sink}: {{path: {json.dumps(path)}}}}}"


def _first_file(scene: Scene) -> Path | None:
    """Return the first file of events, of JSON lines if there is one, beside which the other files
    are written.
    """
    files = [
        choice.config.path
        for name in _FILES_OF_EVENTS
        for choice in scene.outputs
        if choice.name == name
    ]
    named = next((Path(file) for file in files if file != _STANDARD_OUTPUT), None)
    if named is None or not named.name or (named.exists() and not named.is_file()):
        return None  # beside a device or a pipe there is no place for files
    return named


def _beside(events: Path | None, path: str | None, suffix: str) -> Path | None:
    """Return the given path, else one beside the events, else None."""
    if path is not None:
        return Path(path)
    return None if events is None else events.with_suffix(suffix)


def _require_own_paths(
    arguments: argparse.Namespace, scene: Scene, files: Mapping[str, Path | None]
) -> None:
    """Reject paths that overwrite the scene or another file of the run, and tracks that are not
    computed.
    """
    problems = []
    if arguments.tracks is not None and files["tracks"] is None:
        words = (
            f"the tracker {scene.tracker.name} makes no tracks; omit this option, or set another"
            f" with --tracker"
        )
        problems.append(Problem("--tracks", words))
    if arguments.commands is not None and files["commands"] is None:
        words = "the scene has no director; omit this option, or set one with --set director=NAME"
        problems.append(Problem("--commands", words))
    events = [
        Path(choice.config.path) for choice in scene.outputs if choice.name in _FILES_OF_EVENTS
    ]
    taken = {Path(arguments.scene).resolve(): "the scene"}
    for kind, path in [*(("events", path) for path in events), *files.items()]:
        if path is None or (path.exists() and not path.is_file()):
            continue
        holder = taken.setdefault(path.resolve(), f"the {kind}")
        if holder != f"the {kind}":
            problems.append(
                Problem(
                    "",
                    f"the {kind} would overwrite {path}, the path of {holder}; give another path",
                )
            )
    if problems:
        raise SceneError(problems, source="command line")


def _print_summary(
    arguments: argparse.Namespace, scene: Scene, outcome: RunOutcome, files: Mapping[str, Path]
) -> None:
    """Print the summary on standard output, or on standard error if standard output carries the
    events.
    """
    if arguments.quiet:
        return
    takes_events = any(
        getattr(choice.config, "path", "") == _STANDARD_OUTPUT for choice in scene.outputs
    )
    stream = sys.stderr if takes_events else sys.stdout
    text = as_json(outcome, files) if arguments.json else as_text(scene, outcome, files)
    stream.write(text + "\n")


def as_json(outcome: RunOutcome, files: Mapping[str, Path]) -> str:
    """Return the summary, the counts of each sink and the files as one JSON document."""
    outputs = {result.name: asdict(result) for result in outcome.report.sinks}
    document = {
        **outcome.summary,
        "outputs": outputs,
        "files": {kind: str(path) for kind, path in files.items()},
    }
    return json.dumps(document, indent=2)


def as_text(scene: Scene, outcome: RunOutcome, files: Mapping[str, Path]) -> str:
    """Return the summary as sentences and tables."""
    from opir_core.cli.answer_lines import (
        answers,
        reported_cells,
        reported_tables,
    )  # a quiet run has no answers

    counts = outcome.summary["counts"]
    lost = counts.get("lost_reports")
    is_delayed = lost is not None or any(
        row["reporting_mean_s"] for row in outcome.summary["sensors"]
    )
    head = (
        f"{scene.name}: {grouped(counts['detections'])} detections in {grouped(counts['looks'])}"
        f" looks, "
        f"{scene.duration_s:g} s, seed {scene.seed}"
    )
    notes = [*([] if lost is None else [_lost(counts)]), *_refused(counts, files), *scene.automatic]
    sections = [
        "\n".join([head, *notes]),
        "\n".join(answers(outcome.summary)),
        _sensor_table(outcome.summary),
        _health(outcome.summary),
        _target_table(
            outcome.summary["targets"], reported_cells(outcome.summary), is_delayed=is_delayed
        ),
        *reported_tables(outcome.summary),
        "\n".join(
            [*_delivered(scene, outcome), *(f"{path}: {kind}" for kind, path in files.items())]
        ),
    ]
    return "\n\n".join(section for section in sections if section)


def _lost(counts: Mapping[str, int]) -> str:
    """Return how many reports the links lose, in words."""
    sent = counts["detections"] + counts["lost_reports"]
    return f"links: {grouped(counts['lost_reports'])} of {grouped(sent)} reports do not arrive"


def _refused(counts: Mapping[str, int], files: Mapping[str, Path]) -> list[str]:
    """Return how many commands sensors refuse, and which file says why; nothing if none."""
    refused = counts.get("refused_commands", 0)
    words = f"director: {grouped(refused)} of {grouped(counts.get('commands', 0))} commands refused"
    why = f"; {files['commands']} says why" if "commands" in files else ""
    return [words + why] if refused else []


_SENSOR_HEAD = ("sensor", "type", "looks", "detections", "targets", "sources")
_TARGET_HEAD = (
    "target",
    "type",
    "ignition s",
    "latency s",
    "first detected by",
    "detections",
    "sensors",
    "reported",
)


def _sensor_table(summary: Mapping[str, Any]) -> str:
    """Return the table of sensors; where there are other hot sources, with how many of them each
    detected.
    """
    names = ("looks", "detections", "targets_detected", "sources_detected")[
        : 4 if summary["sources"] else 3
    ]
    cells = [
        (row["sensor_id"], row["sensor_type"], *(grouped(row[name]) for name in names))
        for row in summary["sensors"]
    ]
    return table(_SENSOR_HEAD[: 2 + len(names)], cells, numbers=range(2, 2 + len(names)))


def _health(summary: Mapping[str, Any]) -> str:
    """Return a line for each sensor with detections: its biases, clock and noise, as far as the
    tracker knows them.
    """
    rows = [row for row in summary["sensors"] if row["health"] and row["detections"]]
    return "\n".join(f"{row['sensor_id']}: {row['health']['text']}" for row in rows)


def _target_cells(row: Mapping[str, Any], says: str) -> tuple[str, ...]:
    is_detected = row["latency_s"] is not None
    return (
        row["target_id"],
        row["target_type"],
        f"{row['ignition_s']:.3f}",
        f"{row['latency_s']:.3f}" if is_detected else "-",
        row["first_sensor_id"] if is_detected else "not detected",
        grouped(row["detections"]),
        str(row["sensors"]),
        says,
    )


def _target_table(
    targets: Sequence[Mapping[str, Any]], says: Sequence[str], *, is_delayed: bool
) -> str:
    """Return the table of targets, with the latency up to the first report if some sensor's reports
    are late.
    """
    cells = [list(_target_cells(row, text)) for row, text in zip(targets, says, strict=True)]
    head = list(_TARGET_HEAD)
    if not is_delayed:
        return listed(head, cells, numbers=(2, 3, 5, 6))
    head.insert(4, "end to end s")
    for row, target_cells in zip(targets, cells, strict=True):
        latency_s = row["end_to_end_latency_s"]
        target_cells.insert(4, "-" if latency_s is None else f"{latency_s:.3f}")
    return listed(head, cells, numbers=(2, 3, 4, 6, 7))


def _delivered(scene: Scene, outcome: RunOutcome) -> list[str]:
    places = {choice.path: getattr(choice.config, "path", choice.name) for choice in scene.outputs}
    return [
        f"{places[sink.name]}: {grouped(sink.delivered)} events{_undelivered(sink)}"
        for sink in outcome.report.sinks
    ]


def _undelivered(sink: SinkReport) -> str:
    """Return the counts of a sink's events that were not delivered."""
    fates = ("spooled", sink.spooled), ("dropped", sink.dropped), ("withheld", sink.withheld)
    counts = [f"{grouped(number)} {fate}" for fate, number in fates if number]
    if sink.recovered:
        counts.append(f"{grouped(sink.recovered)} of them from the spool of an earlier run")
    return "".join(f", {count}" for count in counts)
