"""Files of a run beside its events: the truth, and the checks that files belong to the same run.

The truth file has JSON lines: a `sensor` record per sensor with a line-of-sight bias, a `target`
per launch or other hot source, a `detection` per event with its `detection_id`; `target_id` is null
for noise alone. The tracks file is in `opir_core.output.tracks_file`.
"""

import json
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np

from opir_core.errors import Problem, SceneError, SinkError, reason_of, unwritable
from opir_core.interfaces.records import CommandRecord, Window
from opir_core.output.events.encoder_input import window_blocks
from opir_core.output.events.rendering import Decimal, Ids, Looked, chosen_renderer
from opir_core.output.temporary_files import GrowingFile, write_all
from opir_core.output.transaction import FILES_KEY
from opir_core.planning.plan import Plan
from opir_core.reading.format_versions import MANIFEST_FORMAT, RUN_FORMATS

_RERUN = (
    "the files are of different runs, or one of them is cut off; `opir run` writes all of them anew"
)
_ELSEWHERE = {"tracks": ", and --tracks scores tracks from elsewhere"}
#: Largest difference between the launches of truth and plan, in degrees or seconds.
_TOLERANCE = 1e-6

#: Decimals of a detection's truth: nanoseconds, millimetres, nanoradians, 1e-9 of a probability.
TRUTH_DECIMALS = {"emission_s": 9, "range_m": 3, "target_elevation_rad": 9, "probability": 9}

_ID = b'{"record":"detection","detection_id":"'
_TARGET = b',"target_id":%b,"emission_s":'


class _Health(msgspec.Struct):
    bias_rad: tuple[float, float]
    bias_sigma_rad: tuple[float, float]
    clock_s: float | None
    text: str


class _ComponentVersion(msgspec.Struct):
    distribution: str
    version: str


class _Manifest(msgspec.Struct):
    """What is read of a manifest, besides its scene."""

    counts: dict[str, int] = {}
    versions: dict[str, str] = {}
    components: list[_ComponentVersion] = []
    sensor_health: list[_Health | None] | None = None
    watched_s: dict[str, list[tuple[float, float]]] = {}


class LinesFile:
    """A file of JSON lines; a context that closes it."""

    _kind: str

    def __init__(self, path: Path) -> None:
        self._path = path
        self._encoder = msgspec.json.Encoder()
        try:
            # Always at the end: what another process cuts off shows, as nothing fills the hole.
            opening = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            self._descriptor = os.open(path, opening, 0o666)
            self._growing = GrowingFile(self._descriptor)
        except OSError as error:
            raise unwritable(self._kind, path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, raised: object, _trace: TracebackType | None
    ) -> None:
        fault = self._growing.fault()
        try:
            os.close(self._descriptor)
        except OSError as error:
            raise unwritable(self._kind, self._path, error) from error
        if raised is None:
            self._require(fault)

    def _write(self, lines: Sequence[object]) -> None:
        self.write_bytes(self._encoder.encode_lines(list(lines)))  # msgspec writes nan as null

    def write_bytes(self, lines: bytes | memoryview) -> None:
        """Write encoded lines."""
        try:
            self._require(self._growing.fault())
            write_all(self._descriptor, lines)
            self._growing.size += len(lines)
        except OSError as error:
            raise unwritable(self._kind, self._path, error) from error

    def _require(self, fault: str) -> None:
        """Raise `SinkError` if something became of the file."""
        if fault:
            raise SinkError(f"{self._kind} {self._path}: {fault}; run again")


def truth_records(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the records of the sensors with a line-of-sight bias and of the targets, with which a
    truth begins.
    """
    biases = () if plan.bias is None else plan.bias.by_sensor(plan.sensors)
    targets = zip(plan.targets.ids, plan.targets.truth(), strict=True)
    return [
        *({"record": "sensor", **bias} for bias in biases),
        *({"record": "target", "target_id": id_, **launch} for id_, launch in targets),
    ]


class TruthFile(LinesFile):
    """Writes the truth of a run to a file, window by window; use it as a context."""

    _kind = "the truth file"

    def __init__(self, path: Path, plan: Plan) -> None:
        super().__init__(path)
        _, self._render = chosen_renderer(plan.host)
        self._ids = plan.targets.ids
        self._targets = [_TARGET % self._encoder.encode(id_) for id_ in (*self._ids, None)]
        self._write(truth_records(plan))

    def write(self, window: Window) -> None:
        """Write the truth of a window's detections."""
        for lines in self.encoded(window):
            self.write_bytes(lines)

    def encoded(self, window: Window) -> Iterator[bytes]:
        """Yield the truth of a window's detections as lines, block by block."""
        for block in window_blocks(window):
            truth = block.truth
            yield self._render(
                len(truth),
                [
                    *(_ID, Ids(block.detections.detection_id), b'"'),
                    Looked(self._targets, np.where(truth.target < 0, len(self._ids), truth.target)),
                    Decimal(truth.emission_time_s, TRUTH_DECIMALS["emission_s"]),
                    b',"range_m":',
                    Decimal(truth.range_m, TRUTH_DECIMALS["range_m"]),
                    b',"target_elevation_rad":',
                    Decimal(truth.target_elevation_rad, TRUTH_DECIMALS["target_elevation_rad"]),
                    b',"probability":',
                    Decimal(truth.probability, TRUTH_DECIMALS["probability"]),
                    b"}\n",
                ],
            )


class CommandsFile(LinesFile):
    """Writes what became of a director's commands, one to a line; use it as a context."""

    _kind = "the commands file"

    def write(self, commands: Iterable[CommandRecord]) -> None:
        """Write what became of commands."""
        self._write([_command_row(record) for record in commands])


class _CommandLine(msgspec.Struct, gc=False):
    """A line of the commands file."""

    time_s: float
    sensor_id: str
    track_id: int | None = None
    reason: str = ""
    start_s: float | None = None
    from_s: float | None = None
    refusal: str = ""
    mode: str = ""
    position_ecef_m: tuple[float, float, float] | None = None


def read_commands(path: Path) -> list[CommandRecord]:
    """Return the commands of a file; `SceneError` with file and line if it is invalid."""
    return [
        _command_of_line(line, number, path)
        for number, line in enumerate(content(path).splitlines(), start=1)
    ]


def _command_of_line(text: bytes, number: int, path: Path) -> CommandRecord:
    try:
        line = msgspec.json.decode(text, type=_CommandLine)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise invalid_file(path, f"line {number}", f"not a command: {error}") from error
    time_s, sensor, track, reason, start_s, from_s, *effect = msgspec.structs.astuple(line)
    start_s, from_s = (np.nan if at_s is None else at_s for at_s in (start_s, from_s))
    track = -1 if track is None else track
    return CommandRecord(time_s, sensor, track, reason, start_s, from_s, *effect)


def _command_row(record: CommandRecord) -> Mapping[str, Any]:
    """Return the keys and values of a command's line."""
    values = record._asdict()
    track = values.pop("track")
    ids = {"sensor_id": values.pop("sensor"), "track_id": None if track < 0 else track}
    for name in ("mode", "position_ecef_m"):
        if not values[name]:
            del values[name]
    return {"time_s": values.pop("time_s"), **ids, **values}


def invalid_file(path: Path, where: str, message: str) -> SceneError:
    """Return the error for a place in a file."""
    return SceneError([Problem(where, message)], source=str(path))


def content(path: Path) -> bytes:
    """Return the content of a file; `SceneError` if the system does not permit to read it."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise invalid_file(path, "", f"cannot be read: {reason_of(error)}") from error


def read_manifest(path: Path) -> Mapping[str, Any]:
    """Return a run's manifest; `SceneError` if the file is none."""
    try:
        manifest = json.loads(content(path))
    except (ValueError, RecursionError) as error:
        raise invalid_file(path, "", f"not what opir writes: {error}") from error
    if not isinstance(manifest, dict) or "scene" not in manifest:
        raise invalid_file(path, "", "not what opir writes: a manifest has a block scene")
    MANIFEST_FORMAT.require_readable(manifest.get("manifest_version"), path, "manifest_version")
    formats = manifest.get("formats", {})
    if not isinstance(formats, dict):
        raise invalid_file(path, "formats", "not what opir writes: formats must be a block")
    for known in RUN_FORMATS:
        if known.name in formats:
            known.require_readable(formats[known.name], path, f"formats.{known.name}")
    if not _are_entries(manifest.get(FILES_KEY, [])):
        raise invalid_file(
            path, FILES_KEY, "not what opir writes: a list of blocks with kind, name and sha256"
        )
    if not isinstance(manifest.get("counts", {}), dict):
        raise invalid_file(path, "counts", "not what opir writes: counts must be a block")
    try:
        msgspec.convert(manifest, _Manifest)
    except msgspec.ValidationError as error:
        raise invalid_file(path, "", f"not what opir writes: {error}") from error
    return manifest


def _are_entries(value: object) -> bool:
    return isinstance(value, list) and all(
        isinstance(entry, dict)
        and all(isinstance(entry.get(key), str) for key in ("kind", "name", "sha256"))
        for entry in value
    )


def digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    return sha256(content(path)).hexdigest()


def require_file_of_run(kind: str, path: Path, manifest: Mapping[str, Any]) -> None:
    """Raise `SceneError` if a file of events, truth or tracks is not one that the manifest's run
    wrote.

    A manifest of a run whose file went through a spool, or of an earlier opir, has no SHA-256 of
    it: nothing is raised.
    """
    entries = [entry for entry in manifest.get(FILES_KEY, ()) if entry["kind"] == kind]
    named = [entry for entry in entries if Path(entry["name"]).name == path.name] or entries
    if named and digest(path) not in {entry["sha256"] for entry in named}:
        words = f"not the {kind} of the manifest's run (the SHA-256 differs): {_RERUN}"
        raise invalid_file(path, "", f"{words}{_ELSEWHERE.get(kind, '')}")


def require_events_of_run(
    events: Path, ids: Sequence[str], truths: Collection[str], manifest: Mapping[str, Any]
) -> None:
    """Raise `SceneError` if the ids of events are not those of the truth or of the manifest's
    count.
    """
    unique = set(ids)
    unknown = next((detection_id for detection_id in ids if detection_id not in truths), None)
    lacking = next((detection_id for detection_id in truths if detection_id not in unique), None)
    reported_count = manifest.get("counts", {}).get("detections", len(ids))
    if unknown is not None:
        raise invalid_file(events, "", f"detection {unknown} is not in the truth: {_RERUN}")
    if lacking is not None:
        raise invalid_file(
            events, "", f"detection {lacking} of the truth is not among the events: {_RERUN}"
        )
    if len(unique) < len(ids):
        duplicates = len(ids) - len(unique)
        raise invalid_file(
            events, "", f"{duplicates} detections appear twice; score the events of one run"
        )
    if reported_count != len(ids):
        raise invalid_file(
            events,
            "",
            f"has {len(ids)} detections, where the manifest's run made {reported_count}: {_RERUN}",
        )


def require_launches_of_run(truth: Path, targets: Sequence[Mapping[str, Any]], plan: Plan) -> None:
    """Raise `SceneError` if the targets of a truth are not those of the manifest's scene."""
    launches = dict(zip(plan.targets.ids, plan.targets.truth(), strict=True))
    for target in targets:
        name = target.get("target_id")
        if name not in launches:
            raise invalid_file(truth, "", f"the manifest's scene has no target {name}: {_RERUN}")
        if _differ(target, launches[name]):
            words = (
                f"{name} has another trajectory in the manifest's scene, with the plugins installed"
            )
            raise invalid_file(truth, "", f"{words}: {_RERUN}")


def _differ(target: Mapping[str, Any], launch: Mapping[str, Any]) -> bool:
    pairs = [(target.get(name), launch.get(name)) for name in ("ignition_s", "burnout_s")]
    for name in ("launch", "burnout", "impact"):
        value = target.get(name)
        launch_value = launch.get(name)
        if isinstance(value, dict) and isinstance(launch_value, Mapping):
            pairs += [
                (value.get(angle), launch_value.get(angle)) for angle in ("lat_deg", "lon_deg")
            ]
    numbers = [
        (value, launch_value)
        for value, launch_value in pairs
        if isinstance(value, float) and isinstance(launch_value, float)
    ]
    return any(abs(value - launch_value) > _TOLERANCE for value, launch_value in numbers)
