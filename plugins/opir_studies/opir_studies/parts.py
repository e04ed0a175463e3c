"""The finished runs of a study on disk: Parquet files, each written whole, and found again by the
keys of their runs.

After a kill each part is whole or absent. Its name is the SHA-256 of its content, so that damage is
found.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from attrs import frozen

from opir_core.arrays import IntArray
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
_COLUMNS = {"key", "replicate", "seed", "run_time_s"}
#: How the names of columns of launches begin: lists, one value per launch.
LAUNCHES = "launches."


@frozen
class Parts:
    """The parts in a study's folder; `figures` are the names of the columns of values, `launches`
    those of launches with their units.
    """

    folder: Path
    figures: tuple[str, ...]
    launches: Mapping[str, str]

    def found(self) -> Iterator[tuple[Path, list[str], IntArray]]:
        """Yield the path of each part on the disk, and the keys and numbers (n,) of its runs.

        Parts without a column are left out. Raises `SceneError` for a file that is damaged, or is
        not part of a study.
        """
        for path in sorted(self.folder.glob(f"*{_SUFFIX}")):
            part = _undamaged(path)
            if self._columns <= set(part.schema_arrow.names) and part.metadata.num_rows:
                rows = part.read(["key", "replicate"])
                yield path, rows["key"].to_pylist(), rows["replicate"].to_numpy()

    def table(self, path: Path, columns: Sequence[str]) -> pa.Table:
        """Return some columns of a part; raises `SceneError` for one that is damaged."""
        try:
            return pq.ParquetFile(path).read(list(columns))
        except (OSError, pa.ArrowException) as error:
            raise _damaged(path, error) from error

    def write(self, records: Mapping[str, RunRecord]) -> Path:
        """Write the records of a task by their keys, as one part; return its path."""
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
                f"{LAUNCHES}{name}": pa.array(
                    [row.launches[place] for row in rows], pa.list_(launch_type(unit))
                )
                for place, (name, unit) in enumerate(self.launches.items())
            },
        }
        content = parquet_bytes(pa.table(columns).replace_schema_metadata(_MARK))
        path = self.folder / f"{hashlib.sha256(content).hexdigest()}{_SUFFIX}"
        with OutputFiles() as files:
            files.make_folder(self.folder, parents=True, is_made_up=True)
            files.write(path, content, "study's", is_made_up=True)
        return path

    @property
    def _columns(self) -> set[str]:
        return {*self.figures, *(f"{LAUNCHES}{name}" for name in self.launches)}


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


def _undamaged(path: Path) -> pq.ParquetFile:
    """Return a part whose content is what was written; raises `SceneError`."""
    if len(path.stem) != _DIGEST_LENGTH:
        raise _foreign(path)
    try:
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != path.stem:
            raise ValueError("its content is not what was written")
        part = pq.ParquetFile(pa.BufferReader(content))
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _damaged(path, error) from error
    schema = part.schema_arrow
    if (schema.metadata or {}).get(b"opir_study_part") != b"1" or not set(schema.names) >= _COLUMNS:
        raise _foreign(path)
    return part


def _damaged(path: Path, error: Exception) -> SceneError:
    reason = reason_of(error) if isinstance(error, OSError) else str(error).splitlines()[0]
    words = f"is damaged ({reason}); delete it, and its runs are made again"
    return refusal("", words, str(path))


def _foreign(path: Path) -> SceneError:
    words = (
        "is no part of a study of this opir; move it elsewhere, or give another folder with --out"
    )
    return refusal("", words, str(path))
