"""The command `opir export`: read a run, write it in a format, list the files."""

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from opir_core import load_run
from opir_core.cli import table
from opir_core.errors import ModelError, OpirError, Problem, SceneError
from opir_core.host import described_error, warn
from opir_core.live import is_recorded
from opir_core.plugin import Exporter, ExporterContext, ExporterModel, Host
from opir_core.reading import InvalidNode, Node, class_reader, overridden
from opir_export.formats.scene import RecordedScene

_HERE = "command line"
_SCENES = {".yaml", ".yml"}


def export(arguments: argparse.Namespace) -> int:
    """Write the arguments' run in their format, or list the formats."""
    host = Host.discover()
    if arguments.list:
        sys.stdout.write(f"{_formats(host)}\n")
        return 0
    path = _run_path(arguments)
    exporter = exporter_of(host, arguments.to, arguments.settings)
    if is_recorded(path):
        return _export_recorded(arguments, exporter)
    run = load_run(path)
    out = (
        Path(arguments.out) if arguments.out else _beside(path, run, arguments.to, exporter.suffix)
    )
    files = written(host, arguments.to, exporter, run, out)
    sys.stdout.write("".join(f"{file}\n" for file in files))
    return 0


def _export_recorded(arguments: argparse.Namespace, exporter: Exporter) -> int:
    """Write the scene of a live run; `SceneError` for any other format."""
    path = Path(arguments.path)
    if not isinstance(exporter, RecordedScene):
        words = (
            f"has the changes of a live run: repeat it first, `opir run {path} -o again.jsonl`, or"
            " write its scene, --to scene"
        )
        raise SceneError([Problem("", words)], source=str(path))
    stem = path.name.removesuffix(".jsonl").removesuffix(".changes")
    out = Path(arguments.out) if arguments.out else path.with_name(f"{stem}{exporter.suffix}")
    for words in exporter.write_recorded(path, out):
        warn(f"not in the scene: {words}")
    sys.stdout.write(f"{out}\n")
    return 0


def exporter_of(host: Host, name: str, settings: Sequence[str] = ()) -> Exporter:
    """Return an exporter with the settings of `key=value` words.

    Raises `PluginError` for an unknown name, `SceneError` with every invalid setting.
    """
    component = host.component(ExporterModel, name)
    root = Node({})
    complaints = overridden(root, settings)
    try:
        config = class_reader(component.config)(root)
    except InvalidNode as refused:
        complaints += refused.complaints
    if complaints:
        source = f"--set of {component.kind} {name}"
        raise SceneError(
            [Problem(complaint.path.lstrip("."), complaint.message) for complaint in complaints],
            source=source,
        )
    exporter: Exporter = component.build(config, ExporterContext())
    return exporter


def written(host: Host, name: str, exporter: Exporter, run: Any, out: Path) -> Sequence[Path]:
    """Write a run and return the files; `ModelError` with the owner of an exporter that fails."""
    try:
        return exporter.write(run, out)
    except OpirError:
        raise
    except Exception as error:
        owner = host.provenance(ExporterModel, name)
        words = f"the exporter {name!r} of {owner}: write raised {described_error(error)}"
        raise ModelError(f"{words}; `opir check {name}` shows what is required") from error


def _run_path(arguments: argparse.Namespace) -> Path:
    """Return the path of the run; `SceneError` if it or the format is missing, or for a scene."""
    missing = [
        Problem(word, words)
        for word, is_given, words in (
            ("RUN", arguments.path, "is missing; give the events or the folder of a run"),
            (
                "--to",
                arguments.to,
                "is missing; give a format, as in --to parquet; `opir export --list` lists them",
            ),
        )
        if not is_given
    ]
    if missing:
        raise SceneError(missing, source=_HERE)
    path = Path(arguments.path)
    if path.suffix in _SCENES:
        words = (
            f"is a scene: run it first, `opir run {path}`, then give the events, `opir export"
            f" events.jsonl`"
        )
        raise SceneError([Problem("", words)], source=str(path))
    return path


def _beside(path: Path, run: Any, name: str, suffix: str) -> Path:
    """Return the path of an export without `--out`: beside the run, named after its scene."""
    folder = path if path.is_dir() else path.parent
    stem = re.sub(r"[^\w.-]+", "-", run.plan.scene.name).strip(".") or "run"
    return folder / (f"{stem}{suffix}" if suffix else f"{stem}-{name}")


def _formats(host: Host) -> str:
    rows = [
        (name, host.component(ExporterModel, name).summary) for name in host.names(ExporterModel)
    ]
    return table(("format", "writes"), rows)
