"""The evidence of a run from its files: events, truth, tracks and manifest."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from opir_core.errors import reason_of
from opir_core.geometry import line_of_sight
from opir_core.interfaces.records import Tracks
from opir_core.output.run_files import (
    invalid_file,
    read_manifest,
    read_tracks,
    require_events_of_run,
    require_launches_of_run,
    require_tracks_of_run,
)
from opir_core.planning.plan import Plan, compile_plan
from opir_core.scene.reading import scene_from_mapping
from opir_core.scoring.evidence import RunEvidence


class _TruthLine(msgspec.Struct):
    """A line of the truth; records other than detections have other keys."""

    record: str
    detection_id: str = ""
    target_id: str | None = None
    ignition_s: float | None = None
    burnout_s: float | None = None
    burnout: dict[str, Any] | None = None
    launch: dict[str, Any] | None = None
    impact: dict[str, Any] | None = None


class _Event(msgspec.Struct):
    detection_id: str
    timestamp: str
    sensor_id: str
    line_of_sight_sigma_urad: float
    azimuth_deg: float
    elevation_deg: float
    sensor_position_ecef_m: tuple[float, float, float]
    track_id: int | None = None


def evidence_of_files(
    events: Path, *, truth: Path | None = None, tracks: Path | None = None, manifest: Path | None = None
) -> RunEvidence:
    """Return the evidence of a run from its events (forge), and the truth, tracks and manifest beside them.

    Any of the three may lie elsewhere; such tracks may be those of another tracker from the same events. Raises
    `SceneError` with the file and line that is missing, invalid or of another run.
    """
    if not events.name:
        raise invalid_file(events, "", "is not a file of events; give the path of the events that `opir run` wrote")
    manifest_path = _existing(manifest or events.with_suffix(".manifest.json"), "manifest")
    contents = read_manifest(manifest_path)
    plan = compile_plan(scene_from_mapping(contents["scene"], source=f"the scene in {manifest_path}"))
    without = "; the tracker none makes no tracks: choose another one with --tracker"
    place = _existing(tracks or events.with_suffix(".tracks.jsonl"), "tracks", without)
    estimates = read_tracks(place)
    if tracks is None:
        require_tracks_of_run(place, contents)
    targets = _targets(_existing(truth or events.with_suffix(".truth.jsonl"), "truth"), plan)
    rows = list(_lines(_existing(events, "events"), _Event, "an event of the encoder forge"))
    require_events_of_run(events, [row.detection_id for row in rows], targets, contents)
    return _evidence(plan, estimates, rows, targets, events)


def _evidence(plan: Plan, tracks: Tracks, rows: list[_Event], targets: Mapping[str, int], events: Path) -> RunEvidence:
    time_s = _times_s(rows, plan, events)
    order = np.argsort(time_s, kind="stable")
    rows = [rows[place] for place in order.tolist()]
    numbers = set(tracks.track.tolist())
    origin = np.array([row.sensor_position_ecef_m for row in rows], dtype=np.float64).reshape(-1, 3)
    angles = np.radians([[row.azimuth_deg, row.elevation_deg] for row in rows]).reshape(-1, 2)
    return RunEvidence(
        plan=plan,
        tracks=tracks,
        time_s=time_s[order],
        sensor=_sensors(rows, plan, events),
        sigma_rad=np.array([row.line_of_sight_sigma_urad for row in rows]) * 1e-6,
        track=np.array([row.track_id if row.track_id in numbers else -1 for row in rows], dtype=np.int64),
        target=np.array([targets[row.detection_id] for row in rows], dtype=np.int32),
        direction_ecef=line_of_sight(origin, angles[:, 0], angles[:, 1]),
        sensor_ecef_m=origin,
    )


def _sensors(rows: list[_Event], plan: Plan, path: Path) -> np.ndarray[Any, np.dtype[np.int32]]:
    number = {sensor.id: place for place, sensor in enumerate(plan.sensors)}
    unknown = next((row.sensor_id for row in rows if row.sensor_id not in number), None)
    if unknown is not None:
        raise invalid_file(path, "", f"the manifest's scene has no sensor {unknown}: the files are of different runs")
    return np.array([number[row.sensor_id] for row in rows], dtype=np.int32)


def _targets(path: Path, plan: Plan) -> Mapping[str, int]:
    """Return the target of each detection, -1 for false alarms."""
    number = {id_: place for place, id_ in enumerate(plan.targets.ids)}
    owners: dict[str, int] = {}
    launches = []
    for row in _lines(path, _TruthLine, "a line of opir's truth"):
        if row.record == "target":
            launches.append(msgspec.structs.asdict(row))
        elif row.record == "detection":
            owners[row.detection_id] = -1 if row.target_id is None else number.get(row.target_id, -1)
    require_launches_of_run(path, launches, plan)
    return owners


def _lines(path: Path, kind: Any, due: str) -> Iterator[Any]:
    decoder = msgspec.json.Decoder(kind)
    try:
        lines = path.open("rb")
    except OSError as error:
        raise invalid_file(path, "", f"cannot be read: {reason_of(error)}") from error
    with lines:
        for number, line in enumerate(lines, start=1):
            try:
                yield decoder.decode(line)
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise invalid_file(path, f"line {number}", f"is not {due}: {error}") from error


def _times_s(rows: list[_Event], plan: Plan, path: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        stamps = np.array([row.timestamp.removesuffix("Z") for row in rows], dtype="datetime64[us]")
    except ValueError as error:
        raise invalid_file(path, "timestamp", f"is not a timestamp of opir: {error}") from error
    return (stamps.astype(np.int64) - plan.scene.epoch_us).astype(np.float64) * 1e-6


def _existing(path: Path, what: str, more: str = "") -> Path:
    if path.is_file():
        return path
    words = f"there is no {what} file; `opir run` writes events, truth, tracks and manifest side by side{more}"
    raise invalid_file(path, "", words)
