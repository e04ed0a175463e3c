"""`opir run`: simulate a scene; write events, truth, tracks and manifest; print what came of it."""

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from opir_core.cli.scene_arguments import add_scene_arguments, plan_of, scene_of

if TYPE_CHECKING:
    from opir_core.output.delivery import RunOutcome
    from opir_core.scene.scene import Scene

_STANDARD_OUTPUT = "-"
_DEFAULT_OUT = "events.jsonl"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, its settings, and where results go."""
    add_scene_arguments(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--out", metavar="PATH", help="write events here as JSON lines (- for standard output)")
    where.add_argument("--sink", metavar="NAME", help="send events to this sink alone, instead of the scene's outputs")
    parser.add_argument("--truth", metavar="PATH", help="write the truth here (default: beside the events)")
    parser.add_argument("--tracks", metavar="PATH", help="write the tracks here (default: beside the events)")
    parser.add_argument("--manifest", metavar="PATH", help="write the run manifest here (default: beside the events)")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def run(arguments: argparse.Namespace) -> int:
    """Simulate the scene."""
    from opir_core.cli.progress import progress
    from opir_core.output.delivery import deliver
    from opir_core.plugin.host import Host

    host = Host.discover()
    scene = scene_of(arguments, host, first=_outputs(arguments), otherwise=(f"outputs=[{_jsonl(_DEFAULT_OUT)}]",))
    plan = plan_of(arguments, scene, host)
    truth = _beside(scene, arguments.truth, "truth.jsonl")
    tracks = None if plan.make_tracker().cadence_s is None else _beside(scene, arguments.tracks, "tracks.jsonl")
    manifest = _beside(scene, arguments.manifest, "manifest.json")
    files = {"truth": truth, "tracks": tracks, "manifest": manifest}
    _require_own_paths(arguments, scene, files)
    with progress(scene, is_shown=not arguments.quiet and sys.stderr.isatty()) as on_window:
        outcome = deliver(plan, truth_path=truth, tracks_path=tracks, on_window=on_window)
    if manifest is not None:
        _write_manifest(manifest, {**outcome.manifest, **_digests(tracks)})
    _tell(arguments, scene, outcome, {what: path for what, path in files.items() if path is not None})
    outcome.raise_for_failures()
    return 0


def _outputs(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the setting that `--out` or `--sink` stands for."""
    if arguments.out is not None:
        return (f"outputs=[{_jsonl(arguments.out)}]",)
    return (f"outputs=[{{{json.dumps(arguments.sink)}: {{}}}}]",) if arguments.sink is not None else ()


def _jsonl(path: str) -> str:
    return f"{{jsonl: {{path: {json.dumps(path)}}}}}"


def _beside(scene: "Scene", path: str | None, suffix: str) -> Path | None:
    """Return a path given, or one beside the first file of events, or None where there is no such file."""
    if path is not None:
        return Path(path)
    files = [choice.config.path for choice in scene.outputs if choice.name == "jsonl"]
    named = next((Path(file) for file in files if file != _STANDARD_OUTPUT), None)
    return named.with_suffix(f".{suffix}") if named and named.name else None


def _require_own_paths(arguments: argparse.Namespace, scene: "Scene", files: Mapping[str, Path | None]) -> None:
    """Refuse what would write over the scene or over another file of the run, or what is asked for and not written."""
    from opir_core.errors import Problem, SceneError

    problems = []
    if arguments.tracks is not None and files["tracks"] is None:
        words = f"the tracker {scene.tracker.name} makes no tracks; leave this out, or choose another with --tracker"
        problems.append(Problem("--tracks", words))
    events = [Path(choice.config.path) for choice in scene.outputs if choice.name == "jsonl"]
    taken = {Path(arguments.scene).resolve(): "the scene"}
    for what, path in [*(("events", path) for path in events), *files.items()]:
        if path is None or (path.exists() and not path.is_file()):
            continue
        holder = taken.setdefault(path.resolve(), f"the {what}")
        if holder != f"the {what}":
            problems.append(Problem("", f"the {what} would go to {path}, which is for {holder}; give another path"))
    if problems:
        raise SceneError(problems, source="command line")


def _digests(tracks: Path | None) -> Mapping[str, str]:
    """Return what tells the tracks that were written from those of any other run, where they can be read again."""
    if tracks is None or not tracks.is_file():
        return {}
    from opir_core.output.run_files import digest

    return {"tracks_sha256": digest(tracks)}


def _write_manifest(path: Path, manifest: Mapping[str, Any]) -> None:
    from opir_core.errors import unwritable

    try:
        path.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise unwritable("the manifest", path, error) from error


def _tell(arguments: argparse.Namespace, scene: "Scene", outcome: "RunOutcome", files: Mapping[str, Path]) -> None:
    """Print the summary: on standard output, or on standard error where that carries the events."""
    from opir_core.cli.summary_text import as_json, as_text

    if arguments.quiet:
        return
    takes_events = any(getattr(choice.config, "path", "") == _STANDARD_OUTPUT for choice in scene.outputs)
    stream = sys.stderr if takes_events else sys.stdout
    text = as_json(outcome, files) if arguments.json else as_text(scene, outcome, files)
    stream.write(text + "\n")
