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

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import Problem, SceneError, nearest_names

DESCRIPTION = "set.json"
STATE = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
#: The upper triangle of a covariance, row by row: `c12` is that of x and y.
COVARIANCE = tuple(f"c{row}{column}" for row in range(1, 7) for column in range(row, 7))
#: Tracks are scored where they are at most this far from a tick, s.
TICK_ROUNDING_S = 1e-3
#: A row with a smaller probability of being a launch is none.
LEAST_PROBABILITY = 0.5

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
        return np.flatnonzero(
            np.array([each == scene for each in self.scene], dtype=np.bool_)
        ).astype(np.int64)


def read_tracks(path: Path, tick_s: float, scenes: Iterable[str]) -> SetTracks:
    """Return the tracks of a file at whole multiples of `tick_s`; raises `SceneError` with what is
    wrong in it.
    """
    table = read_table(path)
    _require(path, table, ("scene", "track", "time_s", *STATE))
    scene = [str(each) for each in table["scene"]]
    if unknown := sorted(set(scene) - set(scenes)):
        raise _error(
            path, "scene", f"no scene {unknown[0]!r} in the set{nearest_names(unknown[0], scenes)}"
        )
    time_s = numbers(path, table, "time_s")
    state = np.stack([numbers(path, table, name) for name in STATE], axis=1)
    if not np.isfinite(state).all() or not np.isfinite(time_s).all():
        row = int(np.flatnonzero(~np.isfinite(state).all(axis=1) | ~np.isfinite(time_s))[0])
        raise _error(path, f"row {row + 1}", "a time, position or velocity is not finite")
    tick = np.round(time_s / tick_s)
    chance = numbers(path, table, "probability") if "probability" in table else np.ones(len(time_s))
    kept = np.flatnonzero(
        (np.abs(time_s - tick * tick_s) <= TICK_ROUNDING_S) & (chance > LEAST_PROBABILITY)
    )
    found = SetTracks(
        name=path.name,
        scene=[scene[row] for row in kept.tolist()],
        track=[str(table["track"][row]) for row in kept.tolist()],
        time_s=tick[kept] * tick_s,
        state=state[kept],
        covariance=_covariances(path, table, len(time_s))[kept],
        left_out=len(time_s) - len(kept),
    )
    _require_unique(path, found)
    return found


def _require_unique(path: Path, tracks: SetTracks) -> None:
    """Raise `SceneError` for a track with two rows at a tick."""
    seen: set[tuple[str, str, float]] = set()
    for key in zip(tracks.scene, tracks.track, tracks.time_s.tolist(), strict=True):
        if key in seen:
            raise _error(
                path, "track", f"track {key[1]} of scene {key[0]} has two rows at {key[2]:g} s"
            )
        seen.add(key)


def _covariances(path: Path, table: Table, count: int) -> FloatArray:
    """Return the covariances (n, 6, 6); nan where the file has none."""
    matrix = np.full((count, 6, 6), np.nan)
    if not any(name in table for name in COVARIANCE):
        return matrix
    _require(path, table, COVARIANCE)
    upper = np.triu_indices(6)
    for name, row, column in zip(COVARIANCE, *upper, strict=True):
        matrix[:, row, column] = matrix[:, column, row] = numbers(path, table, name)
    known = np.isfinite(matrix).all(axis=(1, 2))
    variance = np.diagonal(matrix[known], axis1=1, axis2=2)
    if np.any(variance <= 0.0):
        raise _error(
            path,
            "c11 … c66",
            "a variance is not positive; are these standard deviations or correlations?",
        )
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
    except (json.JSONDecodeError, TypeError, KeyError) as error:
        raise _error(
            path, "", f"is no table, a list of objects with the same names: {error}"
        ) from error


def _csv(path: Path, text: str) -> Table:
    head, *rows = csv.reader(text.splitlines())
    wrong = next((number for number, row in enumerate(rows, 2) if len(row) != len(head)), None)
    if wrong is not None:
        raise _error(
            path, f"line {wrong}", f"has another number of cells than the header ({len(head)})"
        )
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
        cells = table[name]
        return np.array(
            [np.nan if cell in ("", None) else float(cell) for cell in cells], dtype=np.float64
        )
    except ValueError as error:
        raise _error(path, name, str(error)) from error


def _require(path: Path, table: Table, names: Iterable[str]) -> None:
    missing = [name for name in names if name not in table]
    if missing:
        raise _error(path, "", f"has no column {', '.join(missing)}")


def _error(path: Path, place: str, message: str) -> SceneError:
    return SceneError([Problem(place, message)], source=str(path))
