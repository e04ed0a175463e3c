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
from attrs import evolve

from opir_core import Scene, load_scene, scene_from_mapping
from opir_core.arrays import IntArray
from opir_core.errors import Problem, SceneError
from opir_core.output import timestamp_text
from opir_core.plugin import BadFileError, Host
from opir_core.reading import InvalidNode, epoch_us_of_text, node_of_yaml
from opir_core.scene import file_bytes, text_of
from opir_readers.detections.columns_of_run import times_ns
from opir_readers.detections.numbers import Rows
from opir_readers.detections.times import NS_PER_S
from opir_readers.detections.watched import Watched


def scene_of_sensors(arguments: argparse.Namespace, rows: Rows, host: Host) -> Scene:
    """Return the scene of `--sensors`: of a file, completed by the detections, or of constellations
    by name.

    Raises `SceneError` with all problems of the file.
    """
    is_file = Path(arguments.sensors).suffix != "" or Path(arguments.sensors).exists()
    keys = _keys(arguments.sensors) if is_file else {"sensors": None}
    overrides = [
        f"outputs=[{{jsonl: {{path: {json.dumps(arguments.out)}}}}}]",
        *_missing(arguments, rows, keys),
        *([] if arguments.tracker is None else [f"tracker={arguments.tracker}"]),
        *arguments.overrides,
    ]
    if is_file:
        return load_scene(arguments.sensors, overrides=overrides, host=host)
    sensors = [{"constellation": name.strip()} for name in arguments.sensors.split(",")]
    return scene_from_mapping(
        {"sensors": sensors}, overrides=overrides, host=host, source="--sensors"
    )


def watched_scene(
    arguments: argparse.Namespace, scene: Scene, watched: Watched, last_s: float
) -> Scene:
    """Return the scene in which sensors look as they did, and that ends with their last looks, not
    before the last detection at `last_s`.

    A length that `--set` gives stays; one that a file of sensors lacks may grow.
    """
    is_set = any(override.startswith("duration_s=") for override in arguments.overrides)
    is_file = Path(arguments.sensors).exists() and "duration_s" in _keys(arguments.sensors)
    end_s = scene.duration_s
    if not is_set and watched.end_s > 0.0:
        looked_s = max(watched.end_s, last_s)
        end_s = min(looked_s, end_s) if is_file else looked_s
    parts = {
        name: spans
        for name, spans in watched.spans.items()
        if not any(start_s <= 0.0 and stop_s >= end_s for start_s, stop_s in spans)
    }
    return evolve(scene, duration_s=end_s, watched_s=parts)


def _keys(path: str) -> Mapping[str, Any]:
    """Return the nodes of a scene file by key; none for one whose problems are reported when the
    scene is read.
    """
    try:
        block = node_of_yaml(text_of(file_bytes(path))).value
    except (OSError, ValueError, InvalidNode):
        return {}
    return block if isinstance(block, dict) else {}


def _missing(arguments: argparse.Namespace, rows: Rows, keys: Mapping[str, Any]) -> list[str]:
    """Return as overrides what a file of sensors alone lacks: name, epoch, length and tracker."""
    path = arguments.file
    lacking = {"scene": json.dumps(Path(path).name or "detections")}
    epoch = _set_epoch(arguments.overrides, keys)
    if not epoch:
        epoch = _epoch(path, rows)
        lacking["epoch"] = json.dumps(epoch)
    if "duration_s" not in keys:
        lacking["duration_s"] = repr(_duration_s(path, rows, epoch))
    lacking["tracker"] = "imm"
    return [f"{key}={value}" for key, value in lacking.items() if key not in keys]


def _set_epoch(overrides: Sequence[str], keys: Mapping[str, Any]) -> str:
    """Return the epoch of the overrides, else of the file; "" without one."""
    changed = dict(override.split("=", 1) for override in overrides if "=" in override)
    epoch = getattr(keys.get("epoch"), "value", None)
    return changed.get("epoch", "").strip("\"'") or (epoch if isinstance(epoch, str) else "")


def _epoch(path: str, rows: Rows) -> str:
    """Return an epoch a minute before the first detection: the launch may be earlier. Raises
    `SceneError` for detections without dates.
    """
    if not all("timestamp" in row for row in rows):
        words = (
            "has times in seconds, and --sensors names no epoch that they count from: --set"
            " epoch=2026-04-01T12:00:00Z"
        )
        raise SceneError([Problem("", words)], source=path)
    first_s = int(_times_ns(path, rows, 0).min()) // NS_PER_S
    return timestamp_text(np.array([(first_s - 60) * 1_000_000]))[0].replace(".000000", "")


def _duration_s(path: str, rows: Rows, epoch: str) -> float:
    """Return the time of the last detection since an epoch; 1 s where the epoch or all times are
    refused elsewhere.

    Looks after it would have seen nothing, and the end of a file is not the end of a burn.
    """
    with suppress(ValueError):
        last_ns = int(_times_ns(path, rows, epoch_us_of_text(epoch)).max())
        return last_ns / NS_PER_S if last_ns > 0 else 1.0
    return 1.0


def _times_ns(path: str, rows: Rows, epoch_us: int) -> IntArray:
    try:
        return times_ns(rows, epoch_us)
    except BadFileError as error:
        raise SceneError([Problem("", str(error))], source=path) from error
