"""The finished runs of a study on disk: Parquet files, each written whole, and found again by the
keys of their runs.

After a kill each part is whole or absent. Its name is the SHA-256 of its content, so that damage is
found.
"""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from attrs import frozen

from opir_core.errors import SceneError, reason_of
from opir_core.output import OutputFiles
from opir_studies.launches import NAMES
from opir_studies.refusals import refusal
from opir_studies.runs import RunRecord

#: The folder of the parts in that of the study.
PARTS = "parts"
_SUFFIX = ".parquet"
_UNFINISHED = ".parquet.part"
_DIGEST_LENGTH = 64
_MARK = {b"opir_study_part": b"1"}
_COLUMNS = ("key", "replicate", "seed", "run_time_s")
#: How the names of columns of launches begin: lists, one value per launch.
_LAUNCHES = "launches."


@frozen
class Parts:
    """The parts in a study's folder; `figures` are the names of the columns of values, `launches`
    those of launches with their units.
    """

    folder: Path
    figures: tuple[str, ...]
    launches: Mapping[str, str]

    def found(self, keys: Collection[str]) -> dict[str, RunRecord]:
        """Return the records of the wanted keys that are on the disk.

        Runs of other definitions of the study, or without a column, are left alone. Raises
        `SceneError` for a file that is damaged, or is not part of a study.
        """
        records: dict[str, RunRecord] = {}
        for path in sorted(self.folder.glob(f"*{_SUFFIX}")):
            rows = [row for row in _rows(path, keys) if self._columns <= row.keys()]
            records.update({str(row["key"]): self._record(row) for row in rows})
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
            **{
                f"{_LAUNCHES}{name}": pa.array(
                    [row.launches[place] for row in rows], pa.list_(launch_type(unit))
                )
                for place, (name, unit) in enumerate(self.launches.items())
            },
        }
        content = parquet_bytes(pa.table(columns).replace_schema_metadata(_MARK))
        name = hashlib.sha256(content).hexdigest()
        with OutputFiles() as files:
            files.make_folder(self.folder, parents=True, is_made_up=True)
            files.write(self.folder / f"{name}{_SUFFIX}", content, "study's", is_made_up=True)

    @property
    def _columns(self) -> set[str]:
        return {*self.figures, *(f"{_LAUNCHES}{name}" for name in self.launches)}

    def _record(self, row: Mapping[str, Any]) -> RunRecord:
        return RunRecord(
            int(row["replicate"]),
            int(row["seed"]),
            float(row["run_time_s"]),
            tuple(float(row[name]) for name in self.figures),
            launches=tuple(tuple(row[f"{_LAUNCHES}{name}"]) for name in self.launches),
        )


def launch_type(unit: str) -> pa.DataType:
    """Return the type of a column of launches with a unit."""
    return pa.string() if unit == NAMES else pa.float64()


def parquet_bytes(table: pa.Table) -> bytes:
    """Return a table as a Parquet file."""
    content = pa.BufferOutputStream()
    pq.write_table(table, content, compression="zstd")
    return bytes(content.getvalue())


def copy_parts(folder: Path, target: Path) -> None:
    """Copy the parts of a study's folder into that of another one."""
    with OutputFiles() as files:
        files.make_folder(target / PARTS, parents=True, is_made_up=True)
        for path in sorted((folder / PARTS).glob(f"*{_SUFFIX}")):
            files.write(target / PARTS / path.name, path.read_bytes(), "study's", is_made_up=True)


def remove_unfinished(folder: Path) -> None:
    """Remove the parts that a killed study left half written."""
    for path in (folder / PARTS).glob(f"*{_UNFINISHED}"):
        path.unlink(missing_ok=True)


def _rows(path: Path, keys: Collection[str]) -> Sequence[Mapping[str, Any]]:
    if len(path.stem) != _DIGEST_LENGTH:
        raise _foreign(path)
    try:
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != path.stem:
            raise ValueError("its content is not what was written")
        table = pq.read_table(pa.BufferReader(content))
    except (OSError, ValueError, pa.ArrowException) as error:
        reason = reason_of(error) if isinstance(error, OSError) else str(error).splitlines()[0]
        words = f"is damaged ({reason}); delete it, and its runs are made again"
        raise refusal("", words, str(path)) from error
    if (table.schema.metadata or {}).get(b"opir_study_part") != b"1" or not set(_COLUMNS) <= set(
        table.column_names
    ):
        raise _foreign(path)
    is_wanted = [str(key) in keys for key in table["key"].to_pylist()]
    return table.filter(pa.array(is_wanted, pa.bool_())).to_pylist()


def _foreign(path: Path) -> SceneError:
    words = (
        "is no part of a study of this opir; move it elsewhere, or give another folder with --out"
    )
    return refusal("", words, str(path))
