"""What every exporter writes, read back without opir: places, times and axes are those of the run.

Launches, impacts and regions are planted where latitude and longitude differ, and in each row
others.
"""

import csv
import json
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from attrs import evolve, fields_dict, frozen
from exported_runs import exported
from symmetric_scenes import scene, simulated

import opir_core as opir
from opir_core.plugin import ExporterModel, Host, ImpactRegion

EXPORTERS = sorted(Host.discover().names(ExporterModel))
EPOCH = datetime.fromisoformat("2026-04-01T12:00:00+00:00")
KML = "{http://www.opengis.net/kml/2.2}"
#: Half the height and half the width of planted regions, deg.
HIGH_DEG = 0.3
WIDE_DEG = 0.4


@frozen
class Point:
    """A launch or impact of a track as estimated at a time; `of_s` is its own time, None where the
    format has none.
    """

    kind: str
    track: int
    tick_s: float
    latitude_deg: float
    longitude_deg: float
    of_s: float | None


@frozen
class Area:
    """A region of a track as estimated at a time, by its extremes, deg."""

    track: int
    tick_s: float
    south: float
    north: float
    west: float
    east: float


@pytest.fixture(scope="module")
def run() -> opir.Run:
    """A run of two tracks whose predictions are planted."""
    plain = simulated(scene("kepler-arc", duration_s=12))
    rows = np.arange(len(plain.tracks))
    launch = np.stack(
        [np.radians(51.0 - 0.2 * rows), np.radians(12.0 + 0.3 * rows), 2.0 + 0.25 * rows], axis=1
    )
    impact = np.stack(
        [np.radians(-33.0 + 0.1 * rows), np.radians(143.0 - 0.4 * rows), 1500.0 + 7.0 * rows],
        axis=1,
    )
    regions = np.empty(len(rows), dtype=np.object_)
    regions[:] = [(region_about(*place[:2]),) for place in np.degrees(impact)]
    spread = np.array([[9e6, 2e5, 30.0], [2e5, 4e6, -20.0], [30.0, -20.0, 25.0]])
    spreads = spread * (1.0 + rows[:, None, None])
    state = np.array([1.1e6, 2.2e6, 3.3e6, 444.0, 555.0, 666.0]) + rows[:, None]
    covariance = np.diag(np.arange(1.0, 7.0)) + 0.01 * np.add.outer(np.arange(6.0), np.arange(6.0))
    planted = {
        "launch": launch,
        "launch_covariance": spreads,
        "impact": impact,
        "impact_covariance": 2.0 * spreads,
    }
    planted |= {"state": state, "state_covariance": covariance * (1.0 + rows[:, None, None])}
    assert len(np.unique(plain.tracks.track)) == 2
    return evolve(plain, tracks=evolve(plain.tracks, **planted, impact_regions=regions))


def region_about(latitude_deg: float, longitude_deg: float) -> ImpactRegion:
    """Return a region that is wider than high."""
    corners = [(-1, -1), (-1, 1), (1, 1), (1, -1), (-1, -1)]
    ring = np.array(
        [[latitude_deg + HIGH_DEG * y, longitude_deg + WIDE_DEG * x] for y, x in corners]
    )
    return ImpactRegion(containment=0.95, area_km2=5000.0, polygons=((np.radians(ring),),))


def since_epoch_s(text: str) -> float:
    return (datetime.fromisoformat(text) - EPOCH).total_seconds()


def area_of(track: int, tick_s: float, positions: Sequence[Sequence[float]]) -> Area:
    """Return the area of positions (longitude, latitude, ...)."""
    longitude, latitude = np.array(positions, dtype=np.float64)[:, :2].T
    return Area(track, tick_s, latitude.min(), latitude.max(), longitude.min(), longitude.max())


Read = Iterator[Point | Area]


def from_geojson(path: Path) -> Read:
    kinds = {"estimated launch": "launch", "predicted impact": "impact"}
    for feature in json.loads(path.read_text(encoding="utf-8"))["features"]:
        properties = feature["properties"]
        positions = feature["geometry"]["coordinates"]
        if properties["kind"] in kinds:
            tick_s = since_epoch_s(properties["start"])
            of_s = since_epoch_s(properties["time"])
            longitude, latitude = positions
            yield Point(
                kinds[properties["kind"]], properties["track_id"], tick_s, latitude, longitude, of_s
            )
        if properties["kind"] == "impact region":
            yield area_of(properties["track_id"], since_epoch_s(properties["start"]), positions[0])


def from_kml(path: Path) -> Read:
    for mark in ElementTree.parse(path).iter(f"{KML}Placemark"):
        words = re.match(r"Track (\d+): (.*)", mark.findtext(f"{KML}name", ""))
        if words is None:
            continue
        text = next(mark.iter(f"{KML}coordinates")).text or ""
        positions = [[float(number) for number in place.split(",")] for place in text.split()]
        track = int(words[1])
        tick_s = since_epoch_s(next(mark.iter(f"{KML}begin")).text or "")
        if words[2] == "predicted impact":
            yield Point("impact", track, tick_s, positions[0][1], positions[0][0], None)
        else:
            yield area_of(track, tick_s, positions)


def from_czml(path: Path) -> Read:
    for packet in json.loads(path.read_text(encoding="utf-8")):
        kind, *names = packet["id"].split("/")
        if kind != "prediction":
            continue
        track = int(names[0])
        tick_s = since_epoch_s(packet["availability"].split("/")[0])
        if "position" in packet:
            longitude, latitude, _ = np.degrees(packet["position"]["cartographicRadians"])
            yield Point("impact", track, tick_s, latitude, longitude, None)
        else:
            flat = np.degrees(packet["polygon"]["positions"]["cartographicRadians"])
            yield area_of(track, tick_s, flat.reshape(-1, 3).tolist())


def from_rows(name: str, rows: Sequence[dict[str, Any]]) -> Read:
    """Yield what rows of a table have; cells are texts or numbers."""
    for row in rows:
        if name == "regions":
            yield area_of(int(row["track_id"]), float(row["time_s"]), positions_of(row["geometry"]))
        elif name == "tracks":
            for kind in ("launch", "impact"):
                where = [float(row[f"{kind}_{column}"]) for column in ("lat_deg", "lon_deg", "s")]
                yield Point(kind, int(row["track_id"]), float(row["time_s"]), *where)


def positions_of(shape: bytes | str) -> list[list[float]]:
    """Return the positions of the outer ring of a polygon, as text or binary."""
    if isinstance(shape, str):
        inside = re.findall(r"\(\(([^)]*)", shape)[0]
        return [[float(number) for number in place.split()] for place in inside.split(",")]
    kind, rings, count = struct.unpack_from("<III", shape, 1)
    assert (kind, rings) == (3, 1)
    return np.frombuffer(shape, "<f8", 2 * count, 13).reshape(-1, 2).tolist()


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table."""
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as lines:
            return list(csv.DictReader(lines))
    table = pq.read_table(path) if path.suffix == ".parquet" else pa.ipc.open_file(path).read_all()
    return table.cast(in_microseconds(table.schema), safe=False).to_pylist()


def in_microseconds(schema: pa.Schema) -> pa.Schema:
    """Return a schema with times in microseconds: Python has none in nanoseconds."""
    times = pa.timestamp("us", "UTC")
    return pa.schema(
        [field.with_type(times) if pa.types.is_timestamp(field.type) else field for field in schema]
    )


def from_table(path: Path) -> Read:
    return from_rows(path.stem, rows_of(path))


def of_truth(_path: Path) -> Read:
    """CCSDS messages have true states and measured angles; cues have neither launch nor impact, scenes
    nothing of tracks.
    """
    return iter(())


READERS: dict[str, Callable[[Path], Read]] = {
    ".geojson": from_geojson,
    ".kml": from_kml,
    ".czml": from_czml,
    ".csv": from_table,
    ".parquet": from_table,
    ".arrow": from_table,
    ".oem": of_truth,
    ".tdm": of_truth,
    ".cues": of_truth,
    ".scene": of_truth,
}


def files_of(run: opir.Run, name: str, folder: Path) -> list[Path]:
    """Return the files of an exporter, with all predictions where it may leave some out."""
    config = Host.discover().component(ExporterModel, name).config
    settings = ["regions=all"] if "regions" in fields_dict(config) else []
    settings += ["lat_deg=9.4", "lon_deg=167.5"] if name == "cues" else []
    return exported(run, name, folder / f"run.{name}", *settings)


def read_back(files: Sequence[Path]) -> list[Point | Area]:
    """Return what files have; a format without a reader here is not tested: add one."""
    without = {path.suffix for path in files} - READERS.keys() - {".json"}
    assert not without, f"add readers for {without}"
    return [item for path in files if path.suffix in READERS for item in READERS[path.suffix](path)]


@pytest.mark.parametrize("name", EXPORTERS)
def test_predictions_are_where_and_when_the_run_has_them(
    run: opir.Run, name: str, tmp_path: Path
) -> None:
    files = files_of(run, name, tmp_path)
    tracks = run.tracks
    predictions = read_back(files)
    if READERS[files[0].suffix] is of_truth:
        assert not predictions
        return
    row_of = {
        (int(track), round(tick, 3)): row
        for row, (track, tick) in enumerate(zip(tracks.track, tracks.tick_s, strict=True))
    }
    for prediction in predictions:
        row = row_of[prediction.track, round(prediction.tick_s, 3)]
        if isinstance(prediction, Point):
            latitude, longitude, of_s = getattr(tracks, prediction.kind)[row]
            where = np.degrees([latitude, longitude])
            assert (prediction.latitude_deg, prediction.longitude_deg) == pytest.approx(
                where, abs=2e-6
            )
            assert prediction.of_s is None or prediction.of_s == pytest.approx(of_s, abs=2e-6)
        else:
            latitude, longitude = np.degrees(tracks.impact[row, :2])
            edges = (
                latitude - HIGH_DEG,
                latitude + HIGH_DEG,
                longitude - WIDE_DEG,
                longitude + WIDE_DEG,
            )
            assert (
                prediction.south,
                prediction.north,
                prediction.west,
                prediction.east,
            ) == pytest.approx(edges, abs=2e-6)
    counts = [
        sum(
            isinstance(prediction, Point) and prediction.kind == "impact"
            for prediction in predictions
        )
    ]
    counts.append(sum(isinstance(prediction, Area) for prediction in predictions))
    assert counts == [len(tracks), len(tracks)]


@pytest.mark.parametrize("name", EXPORTERS)
def test_tables_have_states_and_covariances_by_their_axes(
    run: opir.Run, name: str, tmp_path: Path
) -> None:
    tables = {path.stem: path for path in files_of(run, name, tmp_path)}
    if "tracks" not in tables:
        return
    tracks = run.tracks
    axes = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
    for place, row in enumerate(rows_of(tables["tracks"])):
        assert [float(row[axis]) for axis in axes] == pytest.approx(tracks.state[place], rel=1e-12)
        for name_of, size in (
            ("launch_covariance", 3),
            ("impact_covariance", 3),
            ("state_covariance", 6),
        ):
            triangle = getattr(tracks, name_of)[place][np.tril_indices(size)]
            assert numbers_of(row, name_of, len(triangle)) == pytest.approx(triangle, rel=1e-12)


def numbers_of(row: dict[str, Any], name: str, size: int) -> list[float]:
    """Return the numbers of a cell, or of as many cells."""
    return row[name] if name in row else [float(row[f"{name}_{place}"]) for place in range(size)]


@pytest.mark.parametrize("name", EXPORTERS)
def test_true_flights_are_where_and_when_they_are(run: opir.Run, name: str, tmp_path: Path) -> None:
    """Each format that has the flight of a target as ECEF or geodetic positions."""
    files = {path.stem: path for path in files_of(run, name, tmp_path)}
    flights = TRUE_FLIGHTS.get(next(iter(files.values())).suffix)
    if flights is None:
        return
    time_s, position_m = flights(files)
    row = np.full(len(time_s), run.target_ids.index("T1"), dtype=np.int32)
    expected = run.plan.targets.position_ecef_m(row, time_s)
    burns = np.isfinite(expected).all(axis=1)
    assert np.count_nonzero(burns) > 5
    assert np.abs(position_m - expected)[burns].max() < 0.2


def from_oem(files: dict[str, Path]) -> tuple[np.ndarray, np.ndarray]:
    text = next(path for stem, path in files.items() if stem.endswith("T1")).read_text(
        encoding="ascii"
    )
    rows = re.findall(r"^(\d{4}-\S+) (\S+) (\S+) (\S+)", text, re.MULTILINE)
    time_s = np.array([since_epoch_s(f"{row[0]}+00:00") for row in rows])
    return time_s, 1e3 * np.array([row[1:] for row in rows], dtype=np.float64)


def czml_flight(files: dict[str, Path]) -> tuple[np.ndarray, np.ndarray]:
    packets = json.loads(next(iter(files.values())).read_text(encoding="utf-8"))
    position = next(packet["position"] for packet in packets if packet["id"] == "target/T1")
    samples = np.array(position["cartesian"]).reshape(-1, 4)
    return since_epoch_s(position["epoch"]) + samples[:, 0], samples[:, 1:]


TRUE_FLIGHTS: dict[str, Callable[[dict[str, Path]], tuple[np.ndarray, np.ndarray]]] = {
    ".oem": from_oem,
    ".czml": czml_flight,
}
