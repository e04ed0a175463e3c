"""Parquet as tables of states and of lines of sight: what the same table as text gives."""

import random
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from opir_readers.reading import file_text
from pyarrow import parquet
from read_files import read, recognised

from opir_core.plugin import BadFileError


def written(path, columns):
    parquet.write_table(pa.table(columns), path)
    return path


def content_of(path):
    text = file_text(str(path)).text
    (name,) = recognised(text)
    return read(name, text)


def moments(*seconds):
    return pa.array(
        [datetime(2026, 4, 1, 12, 0, second, tzinfo=UTC) for second in seconds],
        pa.timestamp("ms", "UTC"),
    )


PLACE_KM = {
    "x_ecef_km": [-2643.9, -2644.5],
    "y_ecef_km": [-4579.3, -4580.4],
    "z_ecef_km": [3566.6, 3567.6],
}


@pytest.mark.parametrize(
    "times",
    [
        {"time_s": [1.0, 11.0]},
        {"time": moments(1, 11)},
        {"timestamp": ["2026-04-01T12:00:01", "2026-04-01T12:00:11"]},
    ],
)
def test_states_have_their_places_and_times(tmp_path, times):
    table = content_of(written(tmp_path / "a", {**times, **PLACE_KM, "is_burning": [True, False]}))
    np.testing.assert_allclose(table.time_s, [1.0, 11.0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(table.position_m, np.array(list(PLACE_KM.values())).T * 1e3)
    np.testing.assert_allclose(table.burns_s, [[1.0, 11.0]], rtol=0.0, atol=1e-6)


def test_lines_of_sight_keep_every_digit(tmp_path):
    columns = {
        "time": moments(1, 2),
        "sensor_id": pa.array(["A", "B"]).dictionary_encode(),
        "line_of_sight_ecef": [[-0.1 - 1e-16, 0.2, 1 / 3], [1.0, 2.0, 3.0]],
        "sensor_position_ecef_m": [[4e7 + 1e-8, 1.0, 0.0], [1.0, 2.0, 4e7]],
        "snr": [float("nan"), 7.5],
        "bands": [["SWIR"], ["SWIR"]],
    }
    initial, second = content_of(written(tmp_path / "a", columns))
    assert initial["line_of_sight_ecef"] == columns["line_of_sight_ecef"][0]
    assert initial["sensor_position_ecef_m"] == columns["sensor_position_ecef_m"][0]
    assert (initial["sensor_id"], second["sensor_id"]) == ("A", "B")
    assert "snr" not in initial
    assert second["snr"] == 7.5


def test_dates_in_a_column_time_of_a_text_are_dates(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "time,azimuth_deg,elevation_deg\n2026-04-01 12:00:01.5Z,10,-80\n2026-04-01"
        " 12:00:02.5Z,10,-80\n"
    )
    assert [row["timestamp"] for row in content_of(path)] == [
        "2026-04-01 12:00:01.5Z",
        "2026-04-01 12:00:02.5Z",
    ]


@pytest.mark.parametrize("content", [b"PAR1", b"PAR1" + bytes(40) + b"PAR1"])
def test_what_is_no_parquet_is_refused(imported, content):
    Path("file").write_bytes(content)
    assert "is no whole Parquet file" in imported("file", code=2)


def test_two_columns_of_a_name_are_refused(imported):
    table = pa.table([pa.array([1.0, 2.0])] * 3, names=["time_s", "lon_deg", "lon_deg"])
    parquet.write_table(table, "file")
    assert "has several columns 'lon_deg': rename or drop the others" in imported("file", code=2)


def test_endless_repetitions_are_refused(tmp_path):
    path = written(tmp_path / "a", {"time_s": pa.array(np.zeros(30_000_000, dtype=np.int8))})
    assert path.stat().st_size < 1_000_000
    with pytest.raises(BadFileError, match="has 30000000 rows of 1 columns"):
        file_text(str(path))


def test_broken_parquet_is_refused_whatever_is_broken(tmp_path):
    content = written(tmp_path / "a", {"time_s": [1.0, 11.0], **PLACE_KM}).read_bytes()
    rng = random.Random(7)
    refused = 0
    for _ in range(300):
        broken = bytearray(content)
        for _ in range(rng.randint(1, 4)):
            broken[rng.randrange(4, len(broken))] = rng.randrange(256)
        length = rng.choice((len(broken), rng.randrange(4, len(broken))))
        (tmp_path / "b").write_bytes(broken[:length])
        try:
            file_text(str(tmp_path / "b"))
        except BadFileError:
            refused += 1
    assert refused > 100
