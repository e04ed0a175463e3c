"""The tracks file of a run: one JSON line per track and tick, with the keys of `TrackRecord`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from opir_core.arrays import FloatArray, ObjectArray
from opir_core.errors import BAD_DATA
from opir_core.interfaces.impact_regions import ImpactRegion
from opir_core.interfaces.records import IMPACT_METHODS, TRACK_CONTAINMENTS, TRACK_ENDS, Tracks
from opir_core.output.geojson import region_from_document
from opir_core.output.run_files import LinesFile, content, invalid_file
from opir_core.output.track_records import (
    Changes,
    LaunchRecord,
    TrackRecord,
)
from opir_core.reading.format_versions import TRACK_FORMAT, StatedVersions
from opir_core.scene.scene import REPORTED_TYPES

#: Columns of one number a row, which have the name of their key.
_NUMBERS = (
    *(
        "probability_burning",
        "probability_relights",
        "probability_launch",
        "probability_missile",
        "probability_orbit",
    ),
    "seen_s",
)

#: Tracks in a block, as regions take memory while they are text.
_BLOCK_ROWS = 512


class TracksFile(LinesFile):
    """Writes tracks to a file, tick by tick; use it as a context. `hypotheses` are the names of a
    run's hypotheses.
    """

    _kind = "the tracks file"

    def __init__(self, path: Path, hypotheses: Sequence[str] = ()) -> None:
        super().__init__(path)
        self._hypotheses = hypotheses
        self._changes = Changes()

    def write(self, tracks: Tracks) -> None:
        """Write the tracks of a window."""
        for start in range(0, len(tracks), _BLOCK_ROWS):
            block = tracks.take(slice(start, start + _BLOCK_ROWS))
            self._write(self._changes.records(block, self._hypotheses))


def read_tracks(path: Path, hypotheses: Sequence[str] | None = None) -> Tracks:
    """Return the tracks of a file, by tick and then by track; `SceneError` with file and line if it
    is invalid.

    Of a line only `time_s` and `track_id` are required. `hypotheses` are the names of the columns
    of `hypothesis_probability`, by default those of the file in its order; others in the file are
    an error.
    """
    rows, regions = _TrackLines(path).rows()
    tracks = _tracks(rows, regions, _weighed(rows, hypotheses, path))
    order = np.lexsort((tracks.track, tracks.tick_s))
    tracks = tracks.take(order)
    duplicates = np.flatnonzero((np.diff(tracks.tick_s) == 0.0) & (np.diff(tracks.track) == 0))
    if len(duplicates):
        duplicate = int(duplicates[np.argmin(order[duplicates + 1])])
        words = f"track {tracks.track[duplicate]} has two rows at {tracks.tick_s[duplicate]:g} s"
        raise invalid_file(
            path, f"line {order[duplicate + 1] + 1}", f"{words}; give one row a track and tick"
        )
    return tracks


class _TrackLines:
    """The lines of a file, in any order, each completed by those of its track before."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._versions = StatedVersions(TRACK_FORMAT, path)
        self._completed: dict[tuple[int, float], dict[str, Any]] = {}
        #: The latest regions of tracks with their documents, and those of earlier files by number.
        self._latest: dict[int, tuple[Any, tuple[ImpactRegion, ...]]] = {}
        self._numbered: dict[int, tuple[ImpactRegion, ...]] = {}

    def rows(self) -> tuple[list[TrackRecord], ObjectArray]:
        """Return the records of the lines and their regions, in the order of the file."""
        documents = [
            self._document(line, number)
            for number, line in enumerate(content(self._path).splitlines(), start=1)
        ]
        rows = dict[int, TrackRecord]()
        regions = np.empty(len(documents), dtype=np.object_)
        for place in sorted(range(len(documents)), key=lambda place: _time_of(documents[place])):
            rows[place] = self._row(documents[place], place + 1)
            regions[place] = self._regions_of(rows[place], place + 1)
        return [rows[place] for place in range(len(documents))], regions

    def _document(self, line: bytes, number: int) -> Any:
        try:
            document = msgspec.json.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise invalid_file(self._path, f"line {number}", f"not a track: {error}") from error
        if isinstance(document, dict):
            version = document.get("schema_version")
            self._versions.judge(version, f"line {number}: schema_version")
        return document

    def _row(self, document: Any, number: int) -> TrackRecord:
        try:
            if isinstance(document, dict) and "since_s" in document:
                document = self._whole(document, number)
            row = msgspec.convert(document, TrackRecord)
        except msgspec.ValidationError as error:
            reason, _, place = str(error).partition(" - at `$")
            key = place.removeprefix(".").removesuffix("`")
            words = f"not what opir writes: {reason[:1].lower()}{reason[1:]}"
            place = f"line {number}{f': {key}' if key else ''}"
            raise invalid_file(self._path, place, words) from error
        self._completed[row.track_id, row.time_s] = document
        return row

    def _whole(self, document: dict[str, Any], number: int) -> dict[str, Any]:
        """Return a line's document with what it leaves out."""
        changes = dict(document)
        since_s: Any = changes.pop("since_s")
        own = msgspec.convert(changes, TrackRecord)
        is_number = isinstance(since_s, int | float)
        before = self._completed.get((own.track_id, since_s)) if is_number else None
        if before is None:
            words = f"no line has track {own.track_id} at {since_s} s; give the whole file"
            raise invalid_file(self._path, f"line {number}: since_s", words)
        return {**before, **changes}

    def _regions_of(self, row: TrackRecord, number: int) -> tuple[ImpactRegion, ...]:
        """Return the regions of a row, its own or those that it refers to."""
        name = row.impact_regions_id
        if row.impact_regions is not UNSET:
            document, regions = self._latest.get(row.track_id, (None, ()))
            if document is not row.impact_regions:
                regions = _own_regions(row, number, self._path)
                self._latest[row.track_id] = row.impact_regions, regions
            if name is not UNSET:
                self._numbered[name] = regions
            return regions
        if name is UNSET:
            return ()
        if name not in self._numbered:
            words = f"no line before has regions {name}; give the whole file"
            raise invalid_file(self._path, f"line {number}: impact_regions_id", words)
        return self._numbered[name]


def _time_of(document: Any) -> float:
    """Return the time of a line, the earliest where it has none."""
    time_s = document.get("time_s") if isinstance(document, dict) else None
    return time_s if isinstance(time_s, int | float) else -np.inf


def _own_regions(row: TrackRecord, number: int, path: Path) -> tuple[ImpactRegion, ...]:
    try:
        return tuple(region_from_document(region) for region in row.impact_regions or ())
    except BAD_DATA as error:
        words = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise invalid_file(
            path, f"line {number}: impact_regions", f"not what opir writes: {words}"
        ) from error


def _weighed(
    rows: Sequence[TrackRecord], hypotheses: Sequence[str] | None, path: Path
) -> FloatArray:
    """Return the probabilities of hypotheses (n, H); (n, 0) if no row has any."""
    first_line = dict[str, int]()
    for number, row in enumerate(rows, start=1):
        for name in row.hypotheses or ():
            first_line.setdefault(name, number)
    names = tuple(first_line if hypotheses is None or not first_line else hypotheses)
    unknown = next((name for name in first_line if name not in names), None)
    if unknown is not None:
        words = (
            f"the scene has no hypothesis {unknown!r} with the plugins installed:"
            f" {', '.join(names)}"
        )
        raise invalid_file(path, f"line {first_line[unknown]}: hypotheses", words)
    return _column([row.hypotheses and _shares(row.hypotheses, names) for row in rows], len(names))


def _tracks(rows: Sequence[TrackRecord], regions: ObjectArray, weighed: FloatArray) -> Tracks:
    available = [row.time_s if row.available_s is None else row.available_s for row in rows]
    types = [row.type_probability and _shares(row.type_probability, REPORTED_TYPES) for row in rows]
    return Tracks(
        tick_s=np.array([row.time_s for row in rows], dtype=np.float64),
        track=np.array([row.track_id for row in rows], dtype=np.int64),
        type_probability=_column(types, len(REPORTED_TYPES)),
        available_s=np.array(available, dtype=np.float64),
        impact_regions=regions,
        hypothesis_probability=weighed,
        end=np.array([TRACK_ENDS.index(row.end or "") for row in rows], dtype=np.uint8),
        is_brief=np.array([row.is_brief for row in rows], dtype=np.bool_),
        **_state_columns(rows),
        **_point_columns(rows),
    )


def _state_columns(rows: Sequence[TrackRecord]) -> dict[str, Any]:
    """Return the columns of numbers, of states at the ticks and at burnout."""
    position = _column([row.position_ecef_m for row in rows], 3)
    velocity = _column([row.velocity_ecef_m_s for row in rows], 3)
    burnouts = [
        row.burnout
        and (*row.burnout.position_ecef_m, *row.burnout.velocity_ecef_m_s, row.burnout.time_s)
        for row in rows
    ]
    return {
        **{name: _column([getattr(row, name) for row in rows]) for name in _NUMBERS},
        "state": np.concatenate([position, velocity], axis=1),
        "state_covariance": _column([row.covariance for row in rows], 6, 6),
        "state_sigmas": _column([row.ellipsoid_sigmas for row in rows], len(TRACK_CONTAINMENTS)),
        "burnout": _column(burnouts, 7),
        "burnout_covariance": _column(
            [row.burnout and row.burnout.covariance for row in rows], 7, 7
        ),
    }


def _point_columns(rows: Sequence[TrackRecord]) -> dict[str, Any]:
    """Return the columns of launch points and impacts."""
    launches = [row.launch for row in rows]
    impacts = [row.impact for row in rows]
    methods = [IMPACT_METHODS.index(impact.method) if impact else 0 for impact in impacts]
    sigmas = [impact and impact.ellipse_sigmas for impact in impacts]
    return {
        "launch": _column(list(map(_place, launches)), 3),
        "launch_covariance": _spread(launches),
        "impact": _column(list(map(_place, impacts)), 3),
        "impact_covariance": _spread(impacts),
        "impact_sigmas": _column(sigmas, len(TRACK_CONTAINMENTS)),
        "impact_method": np.array(methods, dtype=np.uint8),
    }


def _column(rows: Sequence[Any], *shape: int) -> FloatArray:
    """Return rows of numbers as a column (n, *shape), nan for None."""
    column = np.full((len(rows), *shape), np.nan)
    present = [number for number, row in enumerate(rows) if row is not None]
    if present:
        column[present] = [rows[number] for number in present]
    return column


def _shares(chances: dict[str, float], names: Sequence[str]) -> list[float]:
    return [chances.get(name, 0.0) for name in names]


def _place(point: LaunchRecord | None) -> tuple[float, float, float] | None:
    if point is None:
        return None
    latitude, longitude = np.radians([point.lat_deg, point.lon_deg]).tolist()
    return latitude, longitude, np.nan if point.time_s is None else point.time_s


def _spread(points: Sequence[LaunchRecord | None]) -> FloatArray:
    """Return covariances (n, 3, 3) of points over east, north and time."""

    def column(read: Callable[[Any], Any], *shape: int) -> FloatArray:
        return _column([None if point is None else read(point) for point in points], *shape)

    covariance = np.full((len(points), 3, 3), np.nan)
    covariance[:, :2, :2] = column(_ground, 2, 2)
    covariance[:, 2, 2] = column(lambda point: point.time_variance_s2)
    covariance[:, :2, 2] = covariance[:, 2, :2] = column(lambda point: point.time_covariance_m_s, 2)
    return covariance


def _ground(point: Any) -> Any:
    """Return the covariance of east and north of a point: its own, or that of its `sigma_m`."""
    sigma_m = getattr(point, "sigma_m", None)
    if point.covariance_m2 is not None or sigma_m is None:
        return point.covariance_m2
    return ((sigma_m**2, 0.0), (0.0, sigma_m**2))
