"""A run read back from its files: events (forge and its kin), truth, tracks and manifest.

Files round: times to a microsecond, angles to 1e-9 degree, sensor positions to a millimetre.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray, WordArray
from opir_core.errors import BAD_DATA, reason_of
from opir_core.geometry import line_of_sight
from opir_core.host.components import SinkModel
from opir_core.host.host import Host
from opir_core.interfaces.records import (
    CommandRecord,
    Detections,
    DetectionTruth,
    Tracks,
    Window,
)
from opir_core.interfaces.sensors import Sensor
from opir_core.output.delivery import columns_sink, has_columns
from opir_core.output.run_files import (
    invalid_file,
    read_commands,
    read_manifest,
    require_events_of_run,
    require_file_of_run,
    require_launches_of_run,
)
from opir_core.output.track_records import FiniteNumber, Share
from opir_core.output.tracks_file import read_tracks
from opir_core.output.transaction import FILES_KEY, finish_interrupted
from opir_core.planning.plan import Plan, compile_plan
from opir_core.random_streams.detection_ids import uuid_words
from opir_core.reading import scene_from_mapping
from opir_core.reading.format_versions import EVENT_FORMAT, StatedVersions
from opir_core.simulation.run import Run
from opir_core.simulation.summary import Tally

#: In the lines of heartbeats, which no event is.
HEARTBEAT = b'"record":"heartbeat"'
_MANIFEST = ".manifest.json"
_TRUTH = ".truth.jsonl"
_TRACKS = ".tracks.jsonl"
_COMMANDS = ".commands.jsonl"
_PARQUET_TRUTH = ".truth.parquet"
_BESIDE = (_MANIFEST, _TRUTH, _PARQUET_TRUTH, _TRACKS, _COMMANDS)
#: What 64 bits hold in nanoseconds, µs: 292 years.
_LONGEST_US = (1 << 63) // 1_000


class _TruthLine(msgspec.Struct, gc=False):
    """A line of the truth; records other than detections have other keys."""

    record: str
    detection_id: str = ""
    target_id: str | None = None
    ignition_s: FiniteNumber | None = None
    burnout_s: FiniteNumber | None = None
    burnout: dict[str, Any] | None = None
    launch: dict[str, Any] | None = None
    impact: dict[str, Any] | None = None
    emission_s: FiniteNumber | None = None
    range_m: FiniteNumber | None = None
    target_elevation_rad: FiniteNumber | None = None
    probability: Share | None = None


class _Event(msgspec.Struct, gc=False):
    detection_id: str
    timestamp: str
    sensor_id: str
    line_of_sight_sigma_urad: FiniteNumber
    azimuth_deg: FiniteNumber
    elevation_deg: FiniteNumber
    sensor_position_ecef_m: tuple[FiniteNumber, FiniteNumber, FiniteNumber]
    target_type: str = "UNKNOWN"
    confidence: Share | None = None
    reported_at: str | None = None
    path: tuple[str, ...] | None = None
    bands: tuple[str, ...] = ()
    snr: FiniteNumber | None = None
    scan: int | None = None
    track_id: int | None = None
    band_irradiance_w_m2: dict[str, FiniteNumber | None] | None = None
    type_probability: dict[str, Share | None] | None = None
    schema_version: Any = None


class _Version(msgspec.Struct, gc=False):
    """The version that a line states."""

    schema_version: Any = None


def load_run(path: str | Path, host: Host | None = None) -> Run:
    """Return a run from the files that `opir run` wrote.

    `path` is the folder of one run, its events (JSON lines, or what the sink `parquet` wrote), or
    any file beside them. A column that files do not have is empty or unknown: `estimate` is -1, and
    `scan` of JSON lines; irradiances and type probabilities are those of encoders that write them.
    Raises `SceneError` with the file and line that is missing, invalid or of another run.
    """
    return read_run(_events_at(Path(path)), host=host)


def read_run(
    events: Path,
    *,
    truth: Path | None = None,
    tracks: Path | None = None,
    manifest: Path | None = None,
    host: Host | None = None,
) -> Run:
    """Return a run from its events and from the truth, tracks and manifest beside them, or from
    elsewhere.

    Tracks from elsewhere may be those of another tracker from the same events. Raises `SceneError`
    as `load_run` does.
    """
    if not events.name:
        raise invalid_file(
            events, "", "is not a file of events; give the path of the events that `opir run` wrote"
        )
    finish_interrupted(manifest or events.with_suffix(_MANIFEST))
    manifest_path = _existing(manifest or events.with_suffix(_MANIFEST), "manifest")
    contents = read_manifest(manifest_path)
    plan = compile_plan(
        scene_from_mapping(contents["scene"], source=f"the scene in {manifest_path}", host=host),
        host,
    )
    estimates = _tracks_of(events, tracks, contents, plan)
    truth_path = _existing(truth or _truth_beside(events), "truth")
    truths = _truth_lines(truth_path, plan)
    rows = list(_events_of(_existing(events, "events"), plan))
    require_events_of_run(events, [row.detection_id for row in rows], truths, contents)
    detection_truth = _truth_columns([truths[row.detection_id] for row in rows], plan)
    detections = _Columns(rows, plan, events).detections(detection_truth.target)
    require_file_of_run("events", events, contents)
    require_file_of_run("truth", truth_path, contents)
    tally = _tally(plan, detections, detection_truth, estimates, contents, manifest_path)
    return Run(
        detections=detections.freeze(),
        truth=detection_truth.freeze(),
        tracks=estimates,
        estimates=Tracks.empty(),
        commands=_commands_of(events.with_suffix(_COMMANDS), contents),
        sensors=plan.sensors,
        target_ids=plan.targets.ids,
        sightings=tally.sightings(),
        make_summary=tally.summary_with_types,
        make_manifest=lambda: contents,
        reported_types=plan.reported_types,
        plan=plan,
    )


def _events_at(path: Path) -> Path:
    """Return the events of the run at a path."""
    if path.is_dir():
        manifests = sorted(path.glob(f"*{_MANIFEST}"))
        if len(manifests) != 1:
            count = ", ".join(file.name for file in manifests) or "none"
            words = (
                f"is no folder of one run (manifests in it: {count}); give the events that `opir"
                f" run` wrote"
            )
            raise invalid_file(path, "", words)
        path = manifests[0]
    ending = next((suffix for suffix in _BESIDE if path.name.endswith(suffix)), None)
    if ending is None:
        return path
    stem = path.name.removesuffix(ending)
    beside = sorted(path.parent.glob(f"{stem}.*")) if path.parent.is_dir() else []
    events = [file for file in beside if not file.name.endswith(_BESIDE) and file.stem == stem]
    return events[0] if len(events) == 1 else path.parent / f"{stem}.jsonl"


def _tracks_of(
    events: Path, tracks: Path | None, manifest: Mapping[str, Any], plan: Plan
) -> Tracks:
    """Return the run's tracks, or those from elsewhere; none if the scene's tracker makes none."""
    place = tracks or events.with_suffix(_TRACKS)
    if tracks is None and not place.exists() and plan.make_tracker().cadence_s is None:
        return Tracks.empty()
    estimates = read_tracks(_existing(place, "tracks"), plan.hypothesis_names)
    if tracks is None:
        require_file_of_run("tracks", place, manifest)
    return estimates


def _commands_of(path: Path, manifest: Mapping[str, Any]) -> Sequence[CommandRecord]:
    """Return what became of a director's commands, from the file beside the events if there is
    one.
    """
    entries = manifest.get(FILES_KEY)
    is_left_over = entries and all(entry["kind"] != "commands" for entry in entries)
    if is_left_over or not path.is_file():
        return ()
    require_file_of_run("commands", path, manifest)
    return read_commands(path)


def _truth_beside(events: Path) -> Path:
    """Return the truth of the same kind as the events if there is one, else the other."""
    kinds = (_PARQUET_TRUTH, _TRUTH) if has_columns(events) else (_TRUTH, _PARQUET_TRUTH)
    preferred, alternative = (events.with_suffix(kind) for kind in kinds)
    return alternative if alternative.exists() and not preferred.exists() else preferred


def _truth_rows(path: Path, host: Host) -> Iterator[_TruthLine]:
    """Yield the records of a truth file: columns or JSON lines."""
    if has_columns(path):
        return _converted(
            path, columns_sink(host, "read_truth", "a truth file of columns"), _TruthLine
        )
    return _lines(path, _TruthLine, "a line of opir's truth")


def _converted(path: Path, read: Callable[[Path], Iterable[Any]], kind: Any) -> Iterator[Any]:
    """Yield the rows that a function reads from a file, as a kind of record."""
    try:
        for row in read(path):
            yield msgspec.convert(row, kind)
    except (OSError, *BAD_DATA) as error:
        words = reason_of(error) if isinstance(error, OSError) else str(error)
        raise invalid_file(path, "", f"cannot be read: {words}") from error


def _truth_lines(path: Path, plan: Plan) -> Mapping[str, _TruthLine]:
    """Return the truth of each detection by its id."""
    truths: dict[str, _TruthLine] = {}
    launches = []
    for row in _truth_rows(path, plan.host):
        if row.record == "target":
            launches.append(msgspec.structs.asdict(row))
        elif row.record == "detection":
            truths[row.detection_id] = row
    require_launches_of_run(path, launches, plan)
    return truths


def _truth_columns(rows: Sequence[_TruthLine], plan: Plan) -> DetectionTruth:
    number = {id_: place for place, id_ in enumerate(plan.targets.ids)}
    return DetectionTruth(
        target=np.array([number.get(row.target_id or "", -1) for row in rows], dtype=np.int32),
        emission_time_s=_numbers([row.emission_s for row in rows]),
        range_m=_numbers([row.range_m for row in rows]),
        target_elevation_sine=np.sin(_numbers([row.target_elevation_rad for row in rows])),
        probability=_numbers([row.probability for row in rows]),
    )


@frozen
class _Columns:
    """The columns of a file's events, in the order of the file: that of the reports."""

    rows: Sequence[_Event]
    plan: Plan
    path: Path

    def detections(self, target: IndexArray) -> Detections:
        sensor = np.array(self._sensors(), dtype=np.int32)
        origin = np.array(self._values("sensor_position_ecef_m"), dtype=np.float64).reshape(-1, 3)
        azimuth_rad = np.radians(self._values("azimuth_deg"))
        elevation_rad = np.radians(self._values("elevation_deg"))
        detections = Detections(
            time_ns=self._times_ns(self._values("timestamp")),
            sensor=sensor,
            scan=_integers(self._values("scan")),
            detection_id=self._ids(),
            reported_type=np.array(self._types(), dtype=np.uint8),
            bands=self._bands(sensor),
            detection_count=_running_counts(sensor, target),
            confidence=_numbers(self._values("confidence")),
            line_of_sight_ecef=line_of_sight(origin, azimuth_rad, elevation_rad),
            sensor_ecef_m=origin,
            snr=_numbers(self._values("snr")),
            track=_integers(self._values("track_id")),
            estimate=np.full(len(self.rows), -1, dtype=np.int64),
            line_of_sight_sigma_rad=_numbers(self._values("line_of_sight_sigma_urad")) * 1e-6,
            band_irradiance_w_m2=self._irradiances(sensor),
            type_log_probability=self._type_probabilities(),
            path=self._paths(sensor),
        )
        return self._with_reports(detections)

    def _with_reports(self, detections: Detections) -> Detections:
        """Return detections with the times of their reports; rejects times outside the scene."""
        time_ns = detections.time_ns
        self._require(time_ns >= 0, "before the scene")
        self._require(time_ns <= self.plan.end_ns + 1_000, "after the end of the scene")
        if all(row.reported_at in (None, row.timestamp) for row in self.rows):
            return detections
        reported_ns = self._times_ns([row.reported_at or row.timestamp for row in self.rows])
        self._require(reported_ns >= time_ns, "reported before it was detected")
        return evolve(detections, reported_ns=reported_ns)

    def _values(self, key: str) -> list[Any]:
        return [getattr(row, key) for row in self.rows]

    def _require(self, is_due: BoolArray, words: str) -> None:
        wrong = np.flatnonzero(~is_due)
        if len(wrong):
            row = self.rows[int(wrong[0])]
            raise invalid_file(
                self.path,
                "timestamp",
                f"detection {row.detection_id} at {row.timestamp} is {words}",
            )

    def _ids(self) -> WordArray:
        try:
            return uuid_words([row.detection_id for row in self.rows])
        except ValueError as error:
            raise invalid_file(self.path, "detection_id", str(error)) from error

    def _sensors(self) -> list[int]:
        names = [sensor.id for sensor in self.plan.sensors]
        words = "the manifest's scene has no sensor {}: the files are of different runs"
        return self._codes("sensor_id", names, "", words)

    def _types(self) -> list[int]:
        words = "{} is no type that the manifest's scene reports"
        return self._codes("target_type", self.plan.reported_types, "target_type", words)

    def _codes(self, key: str, names: Sequence[str], place: str, words: str) -> list[int]:
        """Return the place of each event's value among the names; an unknown one is an error."""
        codes = {name: code for code, name in enumerate(names)}
        values = self._values(key)
        unknown = next((value for value in values if value not in codes), None)
        if unknown is not None:
            raise invalid_file(self.path, place, words.format(unknown))
        return [codes[value] for value in values]

    def _bands(self, sensor: IndexArray) -> ByteArray:
        rows = zip(sensor.tolist(), self._values("bands"), strict=True)
        mask = cache(lambda number, bands: _mask(self.plan.sensors[number], bands))
        return np.array([mask(number, bands) for number, bands in rows], dtype=np.uint8)

    def _times_ns(self, texts: Sequence[str]) -> IntArray:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # of numpy, at another time zone
                texts = [text.removesuffix("Z") for text in texts]
                stamps = np.array(texts, dtype="datetime64[us]")
        except (ValueError, Warning) as error:
            words = f"is not a timestamp of opir, in UTC with Z: {error}"
            raise invalid_file(self.path, "timestamp", words) from error
        since_us = stamps.astype(np.int64) - self.plan.scene.epoch_us
        return np.clip(since_us, -_LONGEST_US, _LONGEST_US) * 1_000

    def _irradiances(self, sensor: IndexArray) -> FloatArray:
        if not any(row.band_irradiance_w_m2 for row in self.rows):
            return np.empty((len(self.rows), 0))
        names = [
            [band.name for band in sensor_of_plan.bands] for sensor_of_plan in self.plan.sensors
        ]
        values = np.full((len(self.rows), max(map(len, names))), np.nan)
        for place, row in enumerate(self.rows):
            band_names = names[sensor[place]]
            values[place, : len(band_names)] = _numbers(
                [(row.band_irradiance_w_m2 or {}).get(name) for name in band_names]
            )
        return values

    def _paths(self, sensor: IndexArray) -> IntArray:
        """Return the ways to the ground (n, 1), -1 for what is none of the scene; (n, 0) without
        links.
        """
        links = self.plan.links
        if links is None:
            return np.empty((len(self.rows), 0), dtype=np.int64)
        numbers = {path.nodes: number for number, path in enumerate(links.paths)}
        ids = [self.plan.sensors[number].id for number in sensor.tolist()]
        nodes = ((id_, *(row.path or ())) for id_, row in zip(ids, self.rows, strict=True))
        return np.array([[numbers.get(way, -1)] for way in nodes], dtype=np.int64).reshape(-1, 1)

    def _type_probabilities(self) -> FloatArray:
        if not any(row.type_probability for row in self.rows):
            return np.empty((len(self.rows), 0))
        names = next(list(row.type_probability) for row in self.rows if row.type_probability)
        chances = _numbers(
            [(row.type_probability or {}).get(name) for row in self.rows for name in names]
        )
        with np.errstate(divide="ignore"):
            return np.log(chances.reshape(-1, len(names)))


def _mask(sensor: Sensor, bands: Sequence[str]) -> int:
    return sum(1 << place for place, band in enumerate(sensor.bands) if band.name in bands)


def _running_counts(sensor: IndexArray, target: IndexArray) -> IndexArray:
    """Return the count of detections of each row's target by its sensor up to the row; 1 for false
    alarms.
    """
    counts = np.ones(len(target), dtype=np.int32)
    pair = sensor.astype(np.int64) << 32 | target.astype(np.int64) & 0xFFFFFFFF
    order = np.argsort(pair, kind="stable")
    group_start = np.flatnonzero(np.diff(pair[order], prepend=-1) != 0)
    lengths = np.diff(np.append(group_start, len(order)))
    counts[order] = np.arange(len(order)) - np.repeat(group_start, lengths) + 1
    return np.where(target < 0, 1, counts).astype(np.int32)


def _numbers(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _integers(values: Sequence[int | None]) -> IntArray:
    return np.array([-1 if value is None else value for value in values], dtype=np.int64)


def _tally(
    plan: Plan,
    detections: Detections,
    truth: DetectionTruth,
    tracks: Tracks,
    manifest: Mapping[str, Any],
    path: Path,
) -> Tally:
    """Return the tally of the whole run, counted as one window, without its types."""
    tally = Tally(plan)
    looks = int(manifest.get("counts", {}).get("looks", 0))
    end_s = plan.end_ns * 1e-9
    tally.count_sightings(Window(0.0, end_s, looks, detections, truth, tracks, Tracks.empty()))
    tally.health = manifest.get("sensor_health") or None
    if tally.health is not None and len(tally.health) != len(plan.sensors):
        words = f"not what opir writes: {len(tally.health)} of {len(plan.sensors)} sensors"
        raise invalid_file(path, "sensor_health", words)
    return tally


def _lines(
    path: Path,
    kind: Any,
    description: str,
    judge: Callable[[bytes, int], None] = lambda _line, _number: None,
) -> Iterator[Any]:
    """Yield the lines of a file as records of a kind; `judge` may refuse one that is none first."""
    decoder = msgspec.json.Decoder(kind)
    try:
        lines = path.open("rb")
    except OSError as error:
        raise invalid_file(path, "", f"cannot be read: {reason_of(error)}") from error
    with lines:
        for number, line in enumerate(lines, start=1):
            if HEARTBEAT in line:
                continue
            try:
                yield decoder.decode(line)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                judge(line, number)
                raise invalid_file(
                    path, f"line {number}", f"is not {description}: {error}"
                ) from error


def _event_lines(path: Path) -> Iterator[_Event]:
    """Yield the events of JSON lines; an unreadable version is named, whatever else a line has."""
    versions = StatedVersions(EVENT_FORMAT, path)
    place = "line {}: schema_version"

    def judge(line: bytes, number: int) -> None:
        with suppress(msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            version = msgspec.json.decode(line, type=_Version).schema_version
            versions.judge(version, place.format(number))

    rows = _lines(path, _Event, "an event of the encoder forge", judge)
    for number, row in enumerate(rows, start=1):
        versions.judge(row.schema_version, place.format(number))
        yield row


def _events_of(path: Path, plan: Plan) -> Iterator[_Event]:
    """Yield the events of a file: read by the sink of this file name or ending, if it can, else
    JSON lines.
    """
    names = [
        choice.name
        for choice in plan.scene.outputs
        if Path(getattr(choice.config, "path", "")).name == path.name
    ]
    if not names and has_columns(path):
        names = ["parquet"]
    read = plan.host.component(SinkModel, names[0]).read if names else None
    if read is None:
        yield from _event_lines(path)
        return
    yield from _converted(path, read, _Event)


def _existing(path: Path, kind: str) -> Path:
    if path.is_file():
        return path
    words = (
        f"there is no {kind} file; `opir run` writes events, truth, tracks and manifest side by"
        f" side"
    )
    raise invalid_file(path, "", words)
