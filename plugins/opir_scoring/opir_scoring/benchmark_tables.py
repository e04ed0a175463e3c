"""Tables of a benchmark set and of tracks on it, from CSV, JSON or Parquet files, by columns.

The columns of tracks are documented in docs/how-to/enter-the-tracking-benchmark.md.
"""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.errors import BAD_DATA, Problem, SceneError, nearest_names

DESCRIPTION = "set.json"
#: The largest number of a table: its square is finite too.
_LARGEST = 1e100
STATE = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
#: The upper triangle of a covariance, row by row: `c12` is that of x and y.
COVARIANCE = tuple(f"c{row}{column}" for row in range(1, 7) for column in range(row, 7))
Table = Mapping[str, Sequence[Any]]


@frozen(eq=False)
class SetTracks:
    """Tracks on a benchmark set, one row per scene, track and tick: `state` (n, 6), `covariance`
    (n, 6, 6) or nan.

    `name` is that of their file, `left_out` counts the rows that are at no tick or are probably no
    launch.
    """

    name: str
    scene: Sequence[str]
    track: Sequence[str]
    time_s: FloatArray
    state: FloatArray
    covariance: FloatArray
    left_out: int

    def rows_of(self, scene: str) -> IntArray:
        """Return the rows of a scene."""
        is_of_scene = [name == scene for name in self.scene]
        return np.flatnonzero(np.array(is_of_scene, dtype=np.bool_)).astype(np.int64)


def read_tracks(path: Path, tick_s: float, scenes: Iterable[str]) -> SetTracks:
    """Return the tracks of a file at whole multiples of `tick_s`; raises `SceneError` with its
    error.
    """
    table = read_table(path)
    _require(path, table, ("scene", "track", "time_s", *STATE))
    scene = list(map(str, table["scene"]))
    _require_scenes(path, scene, scenes)
    time_s = numbers(path, table, "time_s")
    state = np.stack([numbers(path, table, name) for name in STATE], axis=1)
    is_finite = np.isfinite(np.column_stack([time_s, state])).all(axis=1)
    if not is_finite.all():
        row = int(np.argmin(is_finite))
        raise _error(path, f"row {row + 1}", "a time, position or velocity is not finite")
    tick = np.round(time_s / tick_s)
    is_at_tick = np.abs(time_s - tick * tick_s) <= 1e-3
    rows = np.flatnonzero(is_at_tick & _is_launch(path, table))
    tracks = SetTracks(
        name=path.name,
        scene=[scene[row] for row in rows.tolist()],
        track=[str(table["track"][row]) for row in rows.tolist()],
        time_s=tick[rows] * tick_s,
        state=state[rows],
        covariance=_covariances(path, table, len(time_s))[rows],
        left_out=len(time_s) - len(rows),
    )
    _require_unique(path, tracks)
    return tracks


def _is_launch(path: Path, table: Table) -> BoolArray:
    """Whether rows (n,) are probably launches."""
    if "probability" not in table:
        return np.ones(len(table["time_s"]), dtype=np.bool_)
    return numbers(path, table, "probability") > 0.5


def _require_scenes(path: Path, names: Sequence[str], scenes: Iterable[str]) -> None:
    if unknown := sorted(set(names) - set(scenes)):
        hint = nearest_names(unknown[0], scenes)
        raise _error(path, "scene", f"no scene {unknown[0]!r} in the set{hint}")


def _require_unique(path: Path, tracks: SetTracks) -> None:
    """Raise `SceneError` for a track with two rows at a tick."""
    rows: set[tuple[str, str, float]] = set()
    for row in zip(tracks.scene, tracks.track, tracks.time_s.tolist(), strict=True):
        if row in rows:
            scene, track, time_s = row
            words = f"track {track} of scene {scene} has two rows at {time_s:g} s"
            raise _error(path, "track", words)
        rows.add(row)


def _covariances(path: Path, table: Table, count: int) -> FloatArray:
    """Return the covariances (n, 6, 6); nan where the file has none."""
    matrix = np.full((count, 6, 6), np.nan)
    if not any(name in table for name in COVARIANCE):
        return matrix
    _require(path, table, COVARIANCE)
    upper = np.triu_indices(6)
    for name, row, column in zip(COVARIANCE, *upper, strict=True):
        values = numbers(path, table, name)
        matrix[:, row, column] = values
        matrix[:, column, row] = values
    is_known = np.isfinite(matrix).all(axis=(1, 2))
    variance = np.diagonal(matrix[is_known], axis1=1, axis2=2)
    if np.any(variance <= 0.0):
        words = "a variance is not positive; are these standard deviations or correlations?"
        raise _error(path, "c11 … c66", words)
    return matrix


def read_table(path: Path) -> Table:
    """Return the columns of a CSV, JSON or Parquet file; raises `SceneError` where it cannot be
    read.
    """
    try:
        if path.suffix == ".parquet":
            return _parquet(path)
        text = path.read_text(encoding="utf-8-sig")
        return _columns(json.loads(text)) if path.suffix == ".json" else _csv(path, text)
    except (OSError, UnicodeDecodeError) as error:
        raise _error(path, "", f"cannot be read: {error}") from error
    except (*BAD_DATA, csv.Error) as error:
        words = f"is no table, a list of objects with the same names: {error}"
        raise _error(path, "", words) from error


def _csv(path: Path, text: str) -> Table:
    head, *rows = csv.reader(text.splitlines())
    wrong = next((number for number, row in enumerate(rows, 2) if len(row) != len(head)), None)
    if wrong is not None:
        words = f"has another number of cells than the header ({len(head)})"
        raise _error(path, f"line {wrong}", words)
    columns = list(zip(*rows, strict=True)) or [()] * len(head)
    return dict(zip((name.strip() for name in head), columns, strict=True))


def _columns(rows: Sequence[Mapping[str, Any]]) -> Table:
    names = list(rows[0]) if rows else []
    return {name: [row[name] for row in rows] for name in names}


def _parquet(path: Path) -> Table:
    try:
        parquet = import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise _error(path, "", "Parquet needs pyarrow: pip install pyarrow; or give CSV") from None
    table: Table = parquet.read_table(path).to_pydict()
    return table


def numbers(path: Path, table: Table, name: str) -> FloatArray:
    """Return a column (n,) of numbers, nan where a cell is empty; raises `SceneError` for other
    text.
    """
    try:
        cells = [np.nan if cell in ("", None) else float(cell) for cell in table[name]]
        column = np.array(cells, dtype=np.float64)
        if np.any(np.abs(column) > _LARGEST):
            raise ValueError(f"a number is beyond {_LARGEST:g}")
        return column
    except (ValueError, TypeError, OverflowError) as error:
        raise _error(path, name, str(error)) from error


def _require(path: Path, table: Table, names: Iterable[str]) -> None:
    missing = [name for name in names if name not in table]
    if missing:
        raise _error(path, "", f"has no column {', '.join(missing)}")


def _error(path: Path, place: str, message: str) -> SceneError:
    return SceneError([Problem(place, message)], source=str(path))
