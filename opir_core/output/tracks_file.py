"""The tracks file: what a tracker told at every tick, for scores and plots. JSON lines, one a track and tick.

Unknown numbers are null. States are ECEF, m and m/s relative to the turning Earth; points are latitude and longitude
in rad and the scene time in s; covariances are row by row.
"""

from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import msgspec
import numpy as np
from attrs import NOTHING, fields

from opir_core.errors import unwritable
from opir_core.interfaces.records import Tracks
from opir_core.output.run_files import content, refused

_NAMES = tuple(attribute.name for attribute in fields(Tracks))
#: What a tracker may leave out, a file may: unknown.
_OPTIONAL = tuple(attribute.name for attribute in fields(Tracks) if attribute.default is not NOTHING)


class TracksFile:
    """Writes tracks to a file, tick by tick; use it as a context."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._encoder = msgspec.json.Encoder()
        try:
            self._file: BinaryIO = path.open("wb")
        except OSError as error:
            raise unwritable("the tracks file", path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise unwritable("the tracks file", self._path, error) from error

    def write(self, tracks: Tracks) -> None:
        """Write a window's rows."""
        columns = [getattr(tracks, name).tolist() for name in _NAMES]
        rows = [dict(zip(_NAMES, row, strict=True)) for row in zip(*columns, strict=True)]
        try:
            # msgspec writes nan as null.
            self._file.write(self._encoder.encode_lines(rows))
        except OSError as error:
            raise unwritable("the tracks file", self._path, error) from error


def read_tracks(path: Path) -> Tracks:
    """Return the tracks of a file, by tick and then by track; `SceneError` with file and line where it is none."""
    rows = [_row(line, number, path) for number, line in enumerate(content(path).splitlines(), start=1)]
    if not rows:
        return Tracks.empty()
    empty = Tracks.empty()
    tracks = Tracks(*(_column(rows, name, getattr(empty, name), path) for name in _NAMES))
    order = np.lexsort((tracks.track, tracks.tick_s))
    tracks = tracks.take(order)
    again = np.flatnonzero((np.diff(tracks.tick_s) == 0.0) & (np.diff(tracks.track) == 0))
    if len(again):
        first = int(again[np.argmin(order[again + 1])])
        words = f"track {tracks.track[first]} is told twice at {tracks.tick_s[first]:g} s"
        raise refused(path, f"line {order[first + 1] + 1}", f"{words}; give one row a track and tick")
    return tracks


_BLANK = {name: np.full(getattr(Tracks.empty(), name).shape[1:], None).tolist() for name in _OPTIONAL}


def _row(line: bytes, number: int, path: Path) -> dict[str, Any]:
    try:
        row = msgspec.json.decode(line, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise refused(path, f"line {number}", f"not a track: {error}") from error
    row = _BLANK | row
    missing = [name for name in _NAMES if name not in row]
    if missing:
        raise refused(path, f"line {number}", f"a track without {', '.join(missing)}")
    for name, kinds, due in (("track", (int,), "a whole number of 64 bits"), ("tick_s", (int, float), "a time, s")):
        if type(row[name]) not in kinds or abs(row[name]) >= 2**63:
            raise refused(path, f"line {number}: {name}", f"{row[name]!r} is not {due}")
    return row


def _column(rows: list[dict[str, Any]], name: str, like: Any, path: Path) -> Any:
    due = like.shape[1:]
    try:
        values = np.array([row[name] for row in rows], dtype=object if like.dtype.kind == "f" else like.dtype)
        # null becomes nan; numbers stay as they are.
        column = values.astype(like.dtype)
    except (TypeError, ValueError, OverflowError):
        column = None
    if column is None or column.shape[1:] != due:
        words = f"not what opir writes: {' by '.join(map(str, due)) or '1'} numbers, or nulls, are due"
        raise refused(path, _first_wrong(rows, name, due), words)
    return column


def _first_wrong(rows: list[dict[str, Any]], name: str, due: tuple[int, ...]) -> str:
    """Return the place of the first row in which a column is not what it should be."""
    for number, row in enumerate(rows, start=1):
        try:
            if np.array(row[name], dtype=object).astype(np.float64).shape != due:
                return f"line {number}: {name}"
        except (TypeError, ValueError, OverflowError):
            return f"line {number}: {name}"
    return name
