"""Small files with large contents: what is read is bounded by the columns that are used."""

import json
from pathlib import Path

import numpy as np
import pytest
from opir_readers.json_text import table_of_json

from opir_core.plugin import BadFileError

pyarrow = pytest.importorskip("pyarrow")
from opir_readers.parquet_text import text_of_parquet  # noqa: E402
from pyarrow import parquet  # noqa: E402


def content_of(path: Path, **columns: object) -> bytes:
    parquet.write_table(pyarrow.table(columns), path, compression="zstd", row_group_size=20)
    return path.read_bytes()


def test_columns_that_are_no_table_are_not_read(tmp_path: Path) -> None:
    frames = pyarrow.array([[0.0] * 100_000] * 50, pyarrow.list_(pyarrow.float32()))
    indices = pyarrow.array(np.zeros(50, np.int32))
    notes = pyarrow.DictionaryArray.from_arrays(indices, pyarrow.array(["x" * 2_000_000]))
    names = pyarrow.array([f"S{row % 3}" for row in range(50)])
    time_s = np.arange(50.0)
    content = content_of(tmp_path / "a", time_s=time_s, frame=frames, note=notes, name=names)
    assert len(content) < 100_000
    before = pyarrow.total_allocated_bytes()
    lines = text_of_parquet(content).splitlines()
    assert lines[0] == '"time_s","name"'
    assert lines[1:] == [f'{row},"S{row % 3}"' for row in range(50)]
    assert pyarrow.total_allocated_bytes() - before < 1_000_000


def test_too_many_values_are_refused(tmp_path: Path) -> None:
    content = content_of(tmp_path / "a", **{f"c{number}": np.zeros(1) for number in range(2)})
    assert text_of_parquet(content).splitlines() == ['"c0","c1"', "0,0"]
    parquet.write_table(pyarrow.table({"a": np.zeros(5_000_001)}), tmp_path / "b")
    with pytest.raises(BadFileError, match="5000001 rows of 1 columns; at most 5000000 values"):
        text_of_parquet((tmp_path / "b").read_bytes())


def test_records_of_different_keys_are_no_table_of_their_square() -> None:
    records = [{"time_s": row, f"key_{row}": row} for row in range(1000)]
    records[3]["both"] = records[900]["both"] = 1
    table = table_of_json(json.dumps(records))
    assert table is not None
    assert table.splitlines() == ["time_s", *map(str, range(1000))]
    assert table_of_json(json.dumps([{f"key_{row}": row} for row in range(1000)])) is None
    few = table_of_json(json.dumps(records[:2]))
    assert few is not None
    assert few.splitlines() == ["time_s,key_0,key_1", "0,0,", "1,,1"]
