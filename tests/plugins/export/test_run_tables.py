"""The tables of a run: in memory, as data frames, and read back from files by pandas, polars and
shapely.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest
import shapely
from command_line import run_command
from exported_runs import SCENE, exported, short_run
from opir_export.tabular.columns import instants, nanoseconds
from opir_testing import RunViewContract
from pyarrow import parquet

import opir_core
from opir_core.errors import PluginError
from opir_core.random_streams import uuid_text

NAMES = {"detections", "truth", "tracks", "regions", "targets", "sensors"}


@pytest.fixture(scope="module")
def run() -> opir_core.Run:
    return short_run()


@pytest.fixture(scope="module")
def tables(run: opir_core.Run) -> Any:
    return run.tables()


def test_each_column_has_a_meaning_and_a_unit(tables: Any) -> None:
    assert tables.keys() == NAMES
    endings = {"_deg": b"deg", "_m": b"m", "_urad": b"urad", "_km2": b"km2", "_m_s": b"m/s"}
    for table in tables.values():
        for field in table.schema:
            assert field.metadata[b"description"], field.name
            units = [unit for ending, unit in endings.items() if field.name.endswith(ending)]
            assert not units or field.metadata[b"unit"] in units, field.name


def test_detections_are_those_of_the_run(run: opir_core.Run, tables: Any) -> None:
    rows = run.detections
    table = tables["detections"]
    assert table.num_rows == len(rows) > 1000
    assert table["detection_id"].to_pylist() == uuid_text(rows.detection_id)
    assert table["sensor_id"].to_pylist() == [run.sensors[each].id for each in rows.sensor.tolist()]
    epoch = np.datetime64(run.plan.scene.epoch_us, "us")
    assert np.array_equal(table["time"].to_numpy() - epoch, rows.time_ns.astype("timedelta64[ns]"))
    assert np.array_equal(table["scan"].to_numpy(), rows.scan)
    assert np.allclose(np.radians(table["azimuth_deg"].to_numpy()), rows.azimuth_rad, rtol=1e-15)
    position = np.stack([table[f"sensor_{axis}_m"].to_numpy() for axis in "xyz"], axis=1)
    assert np.array_equal(position, rows.sensor_ecef_m)
    first = run.sensors[int(rows.sensor[0])]
    own = [band.name for place, band in enumerate(first.bands) if int(rows.bands[0]) >> place & 1]
    assert table["bands"][0].as_py() == "+".join(own)


def test_unknown_numbers_and_false_alarms_are_null(run: opir_core.Run, tables: Any) -> None:
    assert tables["detections"]["snr"].null_count == int(np.isnan(run.detections.snr).sum()) > 0
    assert tables["detections"]["track_id"].null_count == int((run.detections.track < 0).sum()) > 0
    assert tables["truth"]["target_id"].to_pylist()[0] in run.target_ids
    assert not any(
        value != value
        for value in tables["tracks"]["impact_lat_deg"].to_pylist()
        if value is not None
    )


def test_tracks_have_states_and_covariances(run: opir_core.Run, tables: Any) -> None:
    rows = run.tracks
    table = tables["tracks"]
    for place, name in enumerate(("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")):
        assert np.array_equal(table[name].to_numpy(), rows.state[:, place], equal_nan=True), name
    row = int(np.flatnonzero(np.isfinite(rows.state_covariance[:, 0, 0]))[0])
    triangle = np.zeros((6, 6))
    triangle[np.tril_indices(6)] = table["state_covariance"][row].as_py()
    assert np.array_equal(triangle, np.tril(rows.state_covariance[row]))


def reach_rad(region: opir_core.ImpactRegion) -> float:
    """Return the largest angle at the Earth's centre between the middle of a region's map and its
    rings.
    """
    latitude, longitude = region.chart().centre
    points = np.concatenate([ring for polygon in region.polygons for ring in polygon])
    cosine = np.sin(latitude) * np.sin(points[:, 0]) + np.cos(latitude) * np.cos(
        points[:, 0]
    ) * np.cos(points[:, 1] - longitude)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())


def test_regions_are_valid_polygons_of_the_right_area(run: opir_core.Run, tables: Any) -> None:
    table = tables["regions"]
    shapes = shapely.from_wkb(table["geometry"].to_pylist())
    assert len(shapes) == sum(map(len, run.tracks.impact_regions.tolist())) > 50
    # Regions that reach round the Earth, of the first ticks of a track, end at the antipode of
    # their centre, where they may touch themselves.
    regions = [region for row in run.tracks.impact_regions.tolist() for region in row]
    usual = np.array([reach_rad(region) < 3.0 for region in regions])
    assert shapely.is_valid(shapes[usual]).all()
    assert usual.sum() > 100
    largest = run.tracks.impact_regions.tolist()[-1][-1]
    assert table["containment"][-1].as_py() == largest.containment == 0.95
    # Lambert's cylinder keeps areas.
    radians = shapely.transform(shapes[-1], np.radians)
    cylinder = shapely.transform(radians, lambda at: np.stack([at[:, 0], np.sin(at[:, 1])], axis=1))
    assert cylinder.area * 6371.0**2 == pytest.approx(largest.area_km2, rel=0.02)


def test_targets_have_launch_impact_and_first_detection(run: opir_core.Run, tables: Any) -> None:
    table = tables["targets"].to_pylist()
    truths = run.plan.targets.truth()
    summaries = run.summary["targets"]
    for row, truth, summary in zip(table, truths, summaries, strict=True):
        assert (row["target_id"], row["launch_lat_deg"]) == (
            truth["id"],
            truth["launch"]["lat_deg"],
        )
        assert row["impact_s"] == truth["impact"]["time_s"]
        assert (row["latency_s"], row["first_sensor_id"]) == (
            summary["latency_s"],
            summary["first_sensor_id"],
        )


def test_frames_of_pandas_and_polars_have_the_same_values(run: opir_core.Run, tables: Any) -> None:
    frames = run.to_pandas()
    lazy = run.to_polars()
    assert frames.keys() == lazy.keys() == NAMES
    for name in ("detections", "truth", "tracks", "targets"):
        assert isinstance(frames[name], pd.DataFrame)
        assert isinstance(lazy[name], pl.DataFrame)
        assert len(frames[name]) == lazy[name].height == tables[name].num_rows
    latency = run.summary["targets"][0]["latency_s"]
    assert frames["targets"]["latency_s"].iloc[0] == lazy["targets"]["latency_s"][0] == latency
    assert str(frames["detections"]["time"].dtype) == "datetime64[ns, UTC]"
    rows = lazy["detections"].join(lazy["truth"], on="detection_id")
    assert (
        rows.filter(pl.col("target_id") == "T1").height == run.summary["targets"][0]["detections"]
    )


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_missing_library_is_an_error_with_its_installation(
    run: opir_core.Run, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr("opir_export.tabular.run_tables.import_module", refuse)
    with pytest.raises(
        PluginError, match=rf"needs {library}.*pip install .*'./plugins/opir_export\[{library}\]'"
    ):
        getattr(run, f"to_{library}")()


def test_parquet_is_read_by_polars_with_the_manifest(
    run: opir_core.Run, tables: Any, tmp_path: Path
) -> None:
    files = exported(run, "parquet", tmp_path / "run")
    assert {file.name for file in files} == {f"{name}.parquet" for name in NAMES}
    read = pl.read_parquet(tmp_path / "run" / "detections.parquet")
    assert read.height == len(run.detections)
    assert np.array_equal(read["confidence"].to_numpy(), run.detections.confidence)
    assert parquet.read_table(tmp_path / "run" / "tracks.parquet").equals(tables["tracks"])
    metadata = parquet.read_schema(tmp_path / "run" / "targets.parquet").metadata
    assert json.loads(metadata[b"opir_manifest"]) == json.loads(json.dumps(run.manifest))
    geo = json.loads(parquet.read_schema(tmp_path / "run" / "regions.parquet").metadata[b"geo"])
    assert geo["primary_column"] == "geometry"


def test_arrow_files_are_read_by_polars(run: opir_core.Run, tmp_path: Path) -> None:
    exported(run, "arrow", tmp_path / "run", "compression=lz4", "tables=tracks,truth")
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "tracks.arrow",
        "truth.arrow",
    ]
    read = pl.read_ipc(tmp_path / "run" / "tracks.arrow")
    assert np.array_equal(read["x_m"].to_numpy(), run.tracks.state[:, 0], equal_nan=True)


@pytest.mark.slow
def test_csv_is_read_by_pandas(run: opir_core.Run, tmp_path: Path) -> None:
    exported(run, "csv", tmp_path / "run", "delimiter=semicolon")
    read = pd.read_csv(tmp_path / "run" / "detections.csv", sep=";", parse_dates=["time"])
    assert np.array_equal(read["elevation_deg"], np.degrees(run.detections.elevation_rad))
    ns = (
        read["time"] - pd.Timestamp(run.plan.scene.epoch_us, unit="us", tz="UTC")
    ).dt.total_seconds()
    assert np.allclose(ns, run.detections.time_s, atol=1e-9)
    tracks = pd.read_csv(tmp_path / "run" / "tracks.csv", sep=";")
    assert np.allclose(
        tracks["state_covariance_2"],
        run.tracks.state_covariance[:, 1, 1],
        rtol=1e-12,
        equal_nan=True,
    )
    shapes = pd.read_csv(tmp_path / "run" / "regions.csv", sep=";")["geometry"]
    assert shapely.equals(
        shapely.from_wkt(shapes.to_list()),
        shapely.from_wkb(run.tables()["regions"]["geometry"].to_pylist()),
    ).all()


@pytest.mark.slow
def test_a_run_of_files_gives_the_same_tables(run: opir_core.Run, tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    run_command("run {} --set duration_s=90 --out {} --quiet", SCENE, events)
    from_files = opir_core.load_run(events).tables()
    in_memory = run.tables()
    for name in ("tracks", "regions", "targets", "sensors"):
        assert from_files[name].num_rows == in_memory[name].num_rows
    columns = ["detection_id", "sensor_id", "target_type", "bands", "track_id"]
    assert from_files["detections"].select(columns).equals(in_memory["detections"].select(columns))
    assert from_files["detections"]["scan"].null_count == len(run.detections)


def test_a_time_that_is_unknown_is_null():
    times = instants(nanoseconds(np.array([1.5, np.nan, np.inf, -2.0])), 1_000_000)
    assert times.is_null().to_pylist() == [False, True, True, False]
    assert times.cast("int64").to_pylist() == [2_500_000_000, None, None, -1_000_000_000]


class TestFramesOfPandas(RunViewContract):
    name = "pandas"


class TestFramesOfPolars(RunViewContract):
    name = "polars"
