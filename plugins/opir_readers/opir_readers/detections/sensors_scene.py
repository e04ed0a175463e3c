"""The scene that foreign detections are tracked in: that of a file of sensors, completed by the
detections.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from opir_core import Scene, load_scene, scene_from_mapping
from opir_core.errors import Problem, SceneError
from opir_core.output import timestamp_text
from opir_core.plugin import BadFileError, Host
from opir_core.reading import InvalidNode, epoch_us_of_text, node_of_yaml
from opir_core.scene import file_bytes, text_of
from opir_readers.detections.columns_of_run import Row, times_ns

_DEFAULT_TRACKER = "imm"

#: How long before the first detection a scene starts that names no epoch, s: the launch may be
#: earlier.
_LEAD_S = 60

_NS = 1_000_000_000


def scene_of_sensors(arguments: argparse.Namespace, rows: Sequence[Row], host: Host) -> Scene:
    """Return the scene of `--sensors`: of a file, completed by what it lacks, or of constellations
    by name.

    Raises `SceneError` with all problems of the file.
    """
    is_file = Path(arguments.sensors).suffix != "" or Path(arguments.sensors).exists()
    keys = _keys(arguments.sensors) if is_file else {"sensors": None}
    own = [
        f"outputs=[{{jsonl: {{path: {json.dumps(arguments.out)}}}}}]",
        *_missing(arguments, rows, keys),
    ]
    given = [] if arguments.tracker is None else [f"tracker={arguments.tracker}"]
    overrides = [*own, *given, *arguments.overrides]
    if is_file:
        return load_scene(arguments.sensors, overrides=overrides, host=host)
    sensors = [{"constellation": name.strip()} for name in arguments.sensors.split(",")]
    return scene_from_mapping(
        {"sensors": sensors}, overrides=overrides, host=host, source="--sensors"
    )


def _keys(path: str) -> Mapping[str, Any]:
    """Return the nodes of a scene file by key; none for one whose problems are reported when the
    scene is read.
    """
    try:
        block = node_of_yaml(text_of(file_bytes(path))).value
    except (OSError, ValueError, InvalidNode):
        return {}
    return block if isinstance(block, dict) else {}


def _missing(
    arguments: argparse.Namespace, rows: Sequence[Row], keys: Mapping[str, Any]
) -> list[str]:
    """Return as overrides what a file of sensors alone lacks: name, epoch, length and tracker."""
    changed = dict(override.split("=", 1) for override in arguments.overrides if "=" in override)
    lacking: dict[str, str] = {"scene": json.dumps(Path(arguments.file).name or "detections")}
    epoch = changed.get("epoch", "").strip("\"'") or _text_of(keys.get("epoch"))
    if not epoch:
        epoch = _epoch(arguments.file, rows)
        lacking["epoch"] = json.dumps(epoch)
    if "duration_s" not in keys:
        lacking["duration_s"] = repr(_duration_s(arguments.file, rows, epoch))
    if "tracker" not in keys:
        lacking["tracker"] = _DEFAULT_TRACKER
    return [f"{key}={value}" for key, value in lacking.items() if key not in keys]


def _text_of(node: Any) -> str:
    value = getattr(node, "value", None)
    return value if isinstance(value, str) else ""


def _epoch(path: str, rows: Sequence[Row]) -> str:
    """Return an epoch before the first detection; raises `SceneError` where none has a date."""
    dated = [row for row in rows if "timestamp" in row]
    if len(dated) < len(rows):
        words = (
            "has times in seconds, and --sensors names no epoch that they count from: --set"
            " epoch=2026-04-01T12:00:00Z"
        )
        raise SceneError([Problem("", words)], source=path)
    first_s = int(_times(path, dated, 0).min()) // _NS
    return timestamp_text(np.array([(first_s - _LEAD_S) * 1_000_000]))[0].replace(".000000", "")


def _duration_s(path: str, rows: Sequence[Row], epoch: str) -> float:
    """Return the time of the last detection since an epoch; 1 s where the epoch or all times are
    refused elsewhere.

    Looks after it would have seen nothing, and the end of a file is not the end of a burn.
    """
    with suppress(ValueError):
        last_ns = int(_times(path, rows, epoch_us_of_text(epoch)).max())
        return last_ns / _NS if last_ns > 0 else 1.0
    return 1.0


def _times(path: str, rows: Sequence[Row], epoch_us: int) -> Any:
    try:
        return times_ns(rows, epoch_us)
    except BadFileError as error:
        raise SceneError([Problem("", str(error))], source=path) from error
