"""The evidence of a run from its files: events, truth, tracks and manifest."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from opir_core.errors import Problem, SceneError
from opir_core.geometry import line_of_sight
from opir_core.plan import Plan, compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.scoring.evidence import Evidence
from opir_core.scoring.tracks_file import read_tracks


class _Told(msgspec.Struct):
    """A line of the truth; what is no detection has other keys."""

    record: str
    detection_id: str = ""
    target_id: str | None = None


class _Event(msgspec.Struct):
    detection_id: str
    timestamp: str
    sensor_id: str
    line_of_sight_sigma_urad: float
    azimuth_deg: float
    elevation_deg: float
    sensor_position_ecef_m: tuple[float, float, float]
    track_id: int | None = None


def evidence_of_files(events: Path, *, truth: Path | None = None) -> Evidence:
    """Return the evidence of a run from its events (forge), the truth, and the tracks and manifest beside the events.

    Raises `SceneError` that names the file, and line, that is missing or is not what it should be.
    """
    if not events.name:
        raise _refused(events, "", "is no file of a run's events; give the path that `opir run` wrote them to")
    plan = _plan(_existing(events.with_suffix(".manifest.json"), "manifest"))
    without = "; a scene whose tracker is none has no tracks"
    tracks = read_tracks(_existing(events.with_suffix(".tracks.jsonl"), "tracks", without))
    targets = _targets(_existing(truth or events.with_suffix(".truth.jsonl"), "truth"), plan)
    rows = list(_events(_existing(events, "events")))
    number = {sensor.id: place for place, sensor in enumerate(plan.sensors)}
    _require_one_run(rows, targets, number, events)
    known = set(tracks.track.tolist())
    origin = np.array([row.sensor_position_ecef_m for row in rows], dtype=np.float64).reshape(-1, 3)
    angles = np.radians([[row.azimuth_deg, row.elevation_deg] for row in rows]).reshape(-1, 2)
    track = np.array([row.track_id if row.track_id in known else -1 for row in rows], dtype=np.int64)
    return Evidence(
        plan=plan,
        tracks=tracks,
        time_s=_times_s(rows, plan, events),
        sensor=np.array([number[row.sensor_id] for row in rows], dtype=np.int32),
        sigma_rad=np.array([row.line_of_sight_sigma_urad for row in rows]) * 1e-6,
        track=track,
        target=np.array([targets[row.detection_id] for row in rows], dtype=np.int32),
        direction_ecef=line_of_sight(origin, angles[:, 0], angles[:, 1]),
        sensor_ecef_m=origin,
    )


def _require_one_run(rows: list[_Event], targets: Mapping[str, int], sensors: Mapping[str, int], path: Path) -> None:
    """Refuse events that the truth or the manifest's scene do not know."""
    for row in rows:
        if row.detection_id not in targets:
            unknown = f"detection {row.detection_id} is not in the truth"
        elif row.sensor_id not in sensors:
            unknown = f"the manifest's scene has no sensor {row.sensor_id}"
        else:
            continue
        raise _refused(path, "", f"{unknown}: the files are of different runs")


def _plan(path: Path) -> Plan:
    try:
        manifest = json.loads(path.read_bytes())
    except ValueError as error:
        raise _refused(path, "", f"not what opir writes: {error}") from error
    if not isinstance(manifest, dict) or "scene" not in manifest:
        raise _refused(path, "", "not what opir writes: a manifest is a block with the scene")
    scene = manifest["scene"]
    return compile_plan(scene_from_mapping(scene, source=f"the scene in {path}"))


def _targets(path: Path, plan: Plan) -> Mapping[str, int]:
    """Return the target of each detection, -1 for noise."""
    number = {id_: place for place, id_ in enumerate(plan.targets.ids)}
    rows = (row for row in _lines(path, _Told) if row.record == "detection")
    return {row.detection_id: -1 if row.target_id is None else number.get(row.target_id, -1) for row in rows}


def _events(path: Path) -> Iterator[_Event]:
    yield from _lines(path, _Event)


def _lines(path: Path, kind: Any) -> Iterator[Any]:
    decoder = msgspec.json.Decoder(kind)
    with path.open("rb") as lines:
        for number, line in enumerate(lines, start=1):
            try:
                yield decoder.decode(line)
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise _refused(path, f"line {number}", f"not what opir writes: {error}") from error


def _times_s(rows: list[_Event], plan: Plan, path: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        stamps = np.array([row.timestamp.removesuffix("Z") for row in rows], dtype="datetime64[us]")
    except ValueError as error:
        raise _refused(path, "timestamp", f"not what opir writes: {error}") from error
    return (stamps.astype(np.int64) - plan.scene.epoch_us).astype(np.float64) * 1e-6


def _existing(path: Path, what: str, more: str = "") -> Path:
    if path.is_file():
        return path
    words = f"there is no file of the {what}; `opir run` writes events, truth, tracks and manifest side by side{more}"
    raise _refused(path, "", words)


def _refused(path: Path, where: str, message: str) -> SceneError:
    return SceneError([Problem(where, message)], source=str(path))
