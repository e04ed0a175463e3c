"""The sink `parquet`: the same detections as in memory, in row groups, complete or not there."""

from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import polars as pl
import pytest
from command_line import main
from exported_runs import SCENE, short_run
from opir_export.parquet_sink import ParquetSink
from opir_export.settings import ParquetSinkConfig
from opir_testing import SinkContract
from pyarrow import parquet
from repository import EXAMPLES

import opir_core
from opir_core import plan_windows
from opir_core.plugin import EncoderContext


class TestParquetSink(SinkContract):
    name = "parquet"


def run_into(path: Path, *settings: str, scene: Path = SCENE) -> int:
    words = [f"outputs=[{{parquet: {{path: {path}}}}}]", *settings]
    return main(
        ["run", str(scene), "--quiet", *(word for setting in words for word in ("--set", setting))]
    )


@pytest.mark.slow
def test_detections_are_those_of_the_run(tmp_path: Path) -> None:
    path = tmp_path / "events.parquet"
    assert run_into(path, "duration_s=90", "outputs[0].parquet.row_group_rows=3000") == 0
    read = pl.read_parquet(path)
    expected = short_run().to_polars()["detections"]
    ids = pl.Series("detection_id", [str(UUID(bytes=item)) for item in read["detection_id"]])
    # A file has times as dates alone.
    columns = [name for name in expected.columns if name not in {"time_s", "reported_s"}]
    assert read.with_columns(ids).select(columns).equals(expected.select(columns))
    assert "time_s" not in read.columns
    assert read["probability_ICBM"].null_count() == read.height
    groups = parquet.ParquetFile(path).metadata
    sizes = [groups.row_group(number).num_rows for number in range(groups.num_row_groups)]
    assert sizes == [*[3000] * (read.height // 3000), read.height % 3000]
    beside = [
        "events.manifest.json",
        "events.parquet",
        "events.tracks.jsonl",
        "events.truth.parquet",
    ]
    assert sorted(item.name for item in tmp_path.iterdir()) == beside


@pytest.mark.slow
def test_windows_of_any_size_give_the_same_bytes(tmp_path: Path) -> None:
    plan = opir_core.compile_plan(opir_core.load_scene(SCENE, overrides=["duration_s=70"]))
    paths = {window_s: tmp_path / f"{window_s}.parquet" for window_s in (60.0, 1.7)}
    tables = [written(plan, path, window_s) for window_s, path in paths.items()]
    assert tables[0].equals(tables[1])
    assert tables[0].height > 3000
    assert paths[60.0].read_bytes() == paths[1.7].read_bytes()


def written(plan: Any, path: Path, window_s: float) -> pl.DataFrame:
    origin = EncoderContext(
        sensors=plan.sensors, epoch_us=plan.scene.epoch_us, reported_types=plan.reported_types
    )
    sink = ParquetSink(ParquetSinkConfig(path=str(path), row_group_rows=1000), path, origin)
    for window in plan_windows(plan, window_s):
        sink.write(window)
    sink.close()
    return pl.read_parquet(path)


@pytest.mark.slow
def test_measured_irradiances_are_columns(tmp_path: Path) -> None:
    path = tmp_path / "events.parquet"
    scene = EXAMPLES / "photons.yaml"
    assert run_into(path, "duration_s=120", "tracker=none", scene=scene) == 0
    run = opir_core.simulate(
        opir_core.load_scene(scene, overrides=["duration_s=120", "tracker=none"])
    )
    rows = run.detections
    read = pl.read_parquet(path)
    assert read.height == len(rows) > 0
    number = int(rows.sensor[0])
    band = run.sensors[number].bands[0].name
    is_of_sensor = pl.col("sensor_id") == run.sensors[number].id
    values = read.filter(is_of_sensor)[f"irradiance_{band}_w_m2"].to_numpy()
    assert np.array_equal(
        values, rows.band_irradiance_w_m2[rows.sensor == number, 0], equal_nan=True
    )


def test_a_spool_and_a_missing_folder_are_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spool = f"outputs[0].parquet.spool={{path: {tmp_path / 'spool'}}}"
    assert run_into(tmp_path / "events.parquet", "duration_s=70", spool) == 5
    assert "can have no spool; remove spool, or use jsonl" in capsys.readouterr().err
    assert run_into(tmp_path / "no" / "events.parquet", "duration_s=70") == 5
    assert "cannot be written" in capsys.readouterr().err
