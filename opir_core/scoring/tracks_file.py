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

from opir_core.errors import Problem, SceneError, unwritable
from opir_core.records import Tracks

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
    """Return the tracks of a file; `SceneError` with file and line where it is none."""
    rows = [_row(line, number, path) for number, line in enumerate(path.read_bytes().splitlines(), start=1)]
    if not rows:
        return Tracks.empty()
    empty = Tracks.empty()
    return Tracks(*(_column(rows, name, getattr(empty, name), path) for name in _NAMES))


_BLANK = {name: np.full(getattr(Tracks.empty(), name).shape[1:], None).tolist() for name in _OPTIONAL}


def _row(line: bytes, number: int, path: Path) -> dict[str, Any]:
    try:
        row = msgspec.json.decode(line, type=dict[str, Any])
        row = _BLANK | row
        missing = [name for name in _NAMES if name not in row]
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise SceneError([Problem(f"line {number}", f"not a track: {error}")], source=str(path)) from error
    if missing:
        raise SceneError([Problem(f"line {number}", f"a track without {', '.join(missing)}")], source=str(path))
    return row


def _column(rows: list[dict[str, Any]], name: str, like: Any, path: Path) -> Any:
    try:
        values = np.array([row[name] for row in rows], dtype=object if like.dtype.kind == "f" else like.dtype)
        # null becomes nan; numbers stay as they are.
        column = values.astype(like.dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError([Problem(name, f"not what opir writes: {error}")], source=str(path)) from error
    if column.shape[1:] != like.shape[1:]:
        shapes = f"{column.shape[1:]} numbers a track, where {like.shape[1:]} are due"
        raise SceneError([Problem(name, f"not what opir writes: {shapes}")], source=str(path))
    return column
