"""The finished runs of a study on disk: Parquet files, each written whole, and found again by the keys of their runs.

A part is written beside its place, flushed to the disk and renamed: after a kill each part is whole or absent.
"""

import hashlib
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from attrs import frozen

from opir_core.errors import Problem, SceneError, unwritable
from opir_studies.runs import RunRecord

#: The folder of the parts in that of the study.
PARTS = "parts"
_SUFFIX, _UNFINISHED = ".parquet", ".unfinished"
_MARK = {b"opir_study_part": b"1"}
_COLUMNS = ("key", "replicate", "seed", "run_time_s")


@frozen
class Parts:
    """The parts in a study's folder; `figures` are the names of the columns of values."""

    folder: Path
    figures: tuple[str, ...]

    def found(self, wanted: Collection[str]) -> dict[str, RunRecord]:
        """Return the records of the wanted keys that are on the disk.

        Runs of other definitions of the study are left alone. Raises `SceneError` for a file that is damaged, or is no
        part of a study.
        """
        records: dict[str, RunRecord] = {}
        for path in sorted(self.folder.glob(f"*{_SUFFIX}")):
            rows = _rows(path, wanted)
            records.update({str(row["key"]): _record(row, self.figures) for row in rows})
        return records

    def write(self, records: Mapping[str, RunRecord]) -> None:
        """Write the records of a task by their keys, as one part."""
        keys = list(records)
        rows = list(records.values())
        columns: dict[str, Any] = {
            "key": pa.array(keys, pa.string()),
            "replicate": pa.array([row.replicate for row in rows], pa.int64()),
            "seed": pa.array([row.seed for row in rows], pa.int64()),
            "run_time_s": pa.array([row.run_time_s for row in rows], pa.float64()),
            **{
                name: pa.array([row.values[place] for row in rows], pa.float64())
                for place, name in enumerate(self.figures)
            },
        }
        name = hashlib.sha256("".join(keys).encode()).hexdigest()[:24]
        write_table(pa.table(columns).replace_schema_metadata(_MARK), self.folder / f"{name}{_SUFFIX}")


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table as a Parquet file: whole, or not at all."""
    write_whole(path, lambda unfinished: pq.write_table(table, unfinished, compression="zstd"))


def write_whole(path: Path, write: Any) -> None:
    """Let `write` fill a file beside the path, flush it to the disk, and put it in place."""
    unfinished = path.with_name(f"{path.name}.{os.getpid()}{_UNFINISHED}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(unfinished)
        with unfinished.open("rb") as file:
            os.fsync(file.fileno())
        unfinished.replace(path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise unwritable("the result of the study", path, error) from error


def remove_unfinished(folder: Path) -> None:
    """Remove what a killed study left half written."""
    for path in (*folder.glob(f"*{_UNFINISHED}"), *(folder / PARTS).glob(f"*{_UNFINISHED}")):
        path.unlink(missing_ok=True)


def _rows(path: Path, wanted: Collection[str]) -> Sequence[Mapping[str, Any]]:
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        words = f"is damaged ({str(error).splitlines()[0]}); delete it, and its runs are made again"
        raise SceneError([Problem("", words)], source=str(path)) from error
    if (table.schema.metadata or {}).get(b"opir_study_part") != b"1" or not set(_COLUMNS) <= set(table.column_names):
        words = "is no part of a study; move it elsewhere, or give another folder with --out"
        raise SceneError([Problem("", words)], source=str(path))
    is_wanted = [str(key) in wanted for key in table["key"].to_pylist()]
    rows: list[Mapping[str, Any]] = table.filter(pa.array(is_wanted, pa.bool_())).to_pylist()
    return rows


def _record(row: Mapping[str, Any], figures: Sequence[str]) -> RunRecord:
    values = tuple(float(row[name]) for name in figures)
    return RunRecord(int(row["replicate"]), int(row["seed"]), float(row["run_time_s"]), values)
