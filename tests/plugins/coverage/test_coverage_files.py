"""The files of a coverage as other programs read them, and what a user is warned of."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
import xarray
from opir_coverage import CoverageSettings, computed_coverage, layer_axes
from opir_coverage.difference import difference
from opir_coverage.page import page_of
from opir_coverage.summary import step_note, table_rows
from repository import ROOT

from opir_core import scene_from_mapping

WALKER = {"total": 12, "planes": 3, "phasing": 1, "altitude_km": 1200.0, "inclination_deg": 60.0}
SENSOR = {
    "model": "generic-scanner",
    "field_of_regard_half_angle_deg": 90.0,
    "solar_exclusion_deg": 0.0,
}
CF_UNITS = {"1", "s", "km", "degree", "percent", "m/urad", "W/sr", "m/s"}


def scene(*fleets):
    sensors = [{**SENSOR, "fleet": fleet} for fleet in fleets]
    return scene_from_mapping(
        {
            "scene": "low",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 60,
            "sensors": sensors,
            "targets": [],
        }
    )


@pytest.fixture(scope="module")
def low():
    settings = CoverageSettings(target_class=None, grid_deg=30.0, steps=48, heights_km=(10.0,))
    return computed_coverage(scene({"walker": WALKER}), settings)


@pytest.fixture(scope="module")
def mixed():
    settings = CoverageSettings(target_class="SRBM", grid_deg=30.0, steps=4, launches=2, samples=6)
    return computed_coverage(ROOT / "examples" / "arctic_watch.yaml", settings)


@pytest.fixture
def read(mixed, tmp_path):
    mixed.write_netcdf(tmp_path / "c.nc")
    with xarray.open_dataset(tmp_path / "c.nc") as data:
        yield data.load()


def test_netcdf_is_read_back_with_dates_units_and_names(mixed, read):
    assert read.time.values[0] == np.datetime64("2026-04-01T15:00:00")
    assert read.launch_time.values[1] == np.datetime64("2026-04-02T06:00:00")
    assert read.latitude.attrs["standard_name"] == "latitude"
    assert {each.attrs["units"] for each in read.data_vars.values()} <= CF_UNITS
    assert all(
        each.attrs["long_name"] for each in [*read.data_vars.values(), *read.coords.values()]
    )
    for each in mixed.layers:
        values = np.asarray(each.values, dtype=np.float32)
        np.testing.assert_array_equal(read[each.name].values.astype(np.float32), values)


def test_the_dataset_of_python_has_the_coordinates_of_the_file(mixed, read):
    own = mixed.xarray()
    for name in ("time", "launch_time", "height", "latitude", "longitude"):
        np.testing.assert_array_equal(own[name].values, read[name].values)


def test_columns_of_parquet_have_their_units(mixed, tmp_path):
    mixed.write_parquet(tmp_path / "c.parquet")
    schema = pq.read_schema(tmp_path / "c.parquet")
    assert schema.field("first_report").metadata[b"units"] == b"s"
    assert schema.field("longitude").metadata[b"units"] == b"degrees_east"


def test_a_fleet_that_needs_finer_steps_is_named_so(low, mixed):
    assert "last one step of 1800 s or less" in step_note(low)
    assert "--steps 1440" in step_note(low)
    still = CoverageSettings(target_class=None, grid_deg=30.0, steps=48, heights_km=(10.0,))
    assert not step_note(computed_coverage(scene({"slots": {"count": 4, "first_deg": 0.0}}), still))
    assert not step_note(difference(low, low))


def test_a_gap_that_a_fleet_closes_is_in_the_difference(low):
    settings = CoverageSettings(target_class=None, grid_deg=30.0, steps=48, heights_km=(10.0,))
    more = computed_coverage(
        scene({"walker": WALKER}, {"slots": {"count": 6, "first_deg": 0.0}}), settings
    )
    gain = difference(more, low)["revisit_time_max"].values[0, 0]
    closed = (more["gaps"].values[0, 0] == 0) & (low["gaps"].values[0, 0] > 0)
    assert closed.any()
    np.testing.assert_array_equal(gain[closed], -low["revisit_time_max"].values[0, 0][closed])
    colours = layer_axes(difference(more, low), "revisit_time_max").collections[0]
    assert colours.norm.vmin == -colours.norm.vmax


def test_impacts_that_may_be_anywhere_have_no_bound(mixed):
    bounds_km = mixed["impact_bound"].values
    assert np.nanmax(bounds_km) < 10_926.0


def test_colours_of_the_page_run_over_the_map_that_is_shown(low):
    data = json.loads(
        re.search(r'id="data">(.*?)</script>', page_of(low, table_rows(low)), re.DOTALL)[1]
    )
    (gap,) = [each for each in data["layers"] if each["name"] == "revisit_time_max"]
    assert gap["alone"] == ["assets", "height"]
    for shown, values in zip(
        gap["shown"], low["revisit_time_max"].values.reshape(2, -1), strict=True
    ):
        assert values.min() <= shown[0] < shown[1] <= values.max()
