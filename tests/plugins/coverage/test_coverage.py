"""Coverage of launch places: layers, files, page, requirements, differences."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from opir_coverage import (
    CoverageSettings,
    PlaceGrid,
    Requirement,
    computed_coverage,
    percent_below,
    runs,
)
from opir_coverage.difference import difference
from opir_coverage.grid import SeenPoints
from opir_coverage.summary import as_text, table_rows
from opir_coverage.visibility import Fleet
from repository import ROOT
from scipy.io import netcdf_file

from opir_core import compile_plan, load_scene
from opir_core.cli.main import main
from opir_core.errors import ModelError
from opir_core.planning import visible_now

SCENE = str(ROOT / "examples" / "arctic_watch.yaml")
COARSE = {"grid_deg": 30.0, "steps": 6, "heights_km": (10.0, 100.0), "launches": 1, "samples": 6}


@pytest.fixture(scope="module")
def whole():
    return computed_coverage(
        SCENE, CoverageSettings(**COARSE, requirements=(Requirement.of("in_view>=2"),))
    )


def test_cells_have_the_engines_answer():
    plan = compile_plan(load_scene(SCENE))
    points = SeenPoints.above(PlaceGrid.of(10.0), 50e3)
    fleet = Fleet.of(plan, np.array([0.0, 7000.0]))
    for number, sensor in enumerate(plan.sensors):
        for step in range(2):
            place = np.broadcast_to(fleet.position_m[number, step], (len(points), 3))
            expected = visible_now(sensor, place, points.position_m)
            seen = fleet.seen(number, step, points)
            assert np.array_equal(seen, expected) or fleet.is_blinded[number, step]


def test_layers_have_their_dimensions_and_agree(whole):
    in_view = np.asarray(whole["in_view"].values)
    assert in_view.shape == (2, 6, 6, 12)
    assert np.array_equal(in_view.max(axis=1), whole["in_view_max"].values)
    covered = np.asarray(whole["coverage_time"].values)[0]
    assert np.allclose(covered, 100.0 * (in_view >= 1).mean(axis=1))
    assert np.allclose(np.asarray(whole["share_1"].values), 100.0 * (in_view >= 2).mean(axis=1))
    chance = np.asarray(whole["detection_probability"].values)
    assert np.all((chance >= 0.0) & (chance <= 1.0))
    first, track = (np.asarray(whole[name].values) for name in ("first_report", "track"))
    both = np.isfinite(first) & np.isfinite(track)
    assert both.any()
    assert np.all(first[both] <= track[both])
    assert np.all(np.asarray(whole["launch_point_bound"].values)[both[0:1]] > 0.0)


def test_the_area_of_cells_is_that_of_the_sphere():
    grid = PlaceGrid.of(15.0)
    weights = grid.weights()
    assert weights.sum() == pytest.approx(1.0)
    north = np.repeat(grid.latitude_deg > 30.0, grid.shape[1])
    assert weights[north].sum() == pytest.approx(0.25)
    assert percent_below(np.where(north, 1.0, 3.0), 2.0, weights) == pytest.approx(25.0)
    with pytest.raises(ValueError, match="does not divide 180"):
        PlaceGrid.of(7.0)


def test_runs_are_counted_with_their_ends():
    pattern = np.array([[1, 1, 0, 0, 0, 1, 0, 1], [0] * 8], dtype=np.bool_).T
    result = runs(pattern, 10.0)
    assert result.number.tolist() == [3, 0]
    assert [result.least_s[0], result.mean_s[0], result.most_s[0]] == [
        10.0,
        pytest.approx(40.0 / 3.0),
        20.0,
    ]
    assert np.isnan(result.mean_s[1])
    gaps = runs(~pattern, 10.0)
    assert gaps.square_s2[0] == 30.0**2 + 10.0**2


def test_a_difference_is_of_both(whole):
    none = difference(whole, whole)
    assert np.nanmax(np.abs(np.asarray(none["first_report"].values, dtype=float))) == 0.0
    assert none.attributes["minus"] == whole.attributes["scene"]


def test_requirements_are_read_and_refused():
    assert str(Requirement.of(" first_report <= 60")) == "first_report<=60"
    assert Requirement.of("dilution<5").is_met(np.array([4.0, 5.0, np.nan])).tolist() == [
        True,
        False,
        False,
    ]
    with pytest.raises(ValueError, match="is no requirement"):
        Requirement.of("fast")
    with pytest.raises(ModelError, match="'speed' is not one of in_view"):
        computed_coverage(
            SCENE,
            CoverageSettings(
                **{**COARSE, "target_class": None}, requirements=(Requirement.of("speed<1"),)
            ),
        )
    with pytest.raises(ModelError, match="'BOAT' is not one of"):
        computed_coverage(SCENE, CoverageSettings(**{**COARSE, "target_class": "BOAT"}))


def test_requirement_rows_are_percents_of_area():
    """Cells without a value, never seen, do not meet it; those without a gap meet a limit of
    gaps.
    """
    words = ("age_of_data_mean<=1800", "revisit_time_max<=3600")
    settings = {**COARSE, "target_class": None, "assets": (4,), "heights_km": (10.0,)}
    result = computed_coverage(
        SCENE, CoverageSettings(**settings, requirements=tuple(map(Requirement.of, words)))
    )
    weights = result.grid.weights()
    for number, (name, limit) in enumerate(
        (("age_of_data_mean", 1800.0), ("revisit_time_max", 3600.0)), start=1
    ):
        values = np.asarray(result[name].values, dtype=float).reshape(-1)
        row = next(each for each in table_rows(result) if each["layer"] == f"share_{number}")
        assert row["mean"] == pytest.approx(
            percent_below(values, np.nextafter(limit, np.inf), weights)
        )
        assert row["percent_of_area"] == pytest.approx(100.0)
        assert number == 1 or np.array_equal(values == 0.0, result["gaps"].values.reshape(-1) == 0)
        assert words[number - 1] in as_text([row])


def test_the_command_writes_page_and_data(tmp_path, capsys):
    out = tmp_path / "arctic"
    options = [
        "--grid",
        "30",
        "--steps",
        "4",
        "--launches",
        "1",
        "--height",
        "10",
        "--class",
        "SRBM",
    ]
    assert main(["coverage", SCENE, *options, "-o", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["layers"]
    assert {"coverage_time", "first_report", "impact_bound"} <= {row["layer"] for row in rows}
    table = pq.read_table(out / "coverage.parquet")
    assert {"latitude", "longitude", "assets", "coverage_time", "first_report"} <= set(
        table.column_names
    )
    assert table.num_rows % (6 * 12) == 0
    with netcdf_file(out / "coverage.nc", mmap=False) as file:
        assert file.variables["in_view"].dimensions == ("height", "time", "latitude", "longitude")
        assert file.variables["first_report"].units == b"s"
        own = np.array(file.variables["coverage_time"][:])
    first = np.asarray(table["coverage_time"]).astype(float)
    assert own.min() == pytest.approx(first.min())
    page = (out / "coverage.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert data["layers"][0]["name"] == "in_view"
    assert "http" not in page.replace("http-equiv", "")
    assert main(["coverage", SCENE, *options, "--against", SCENE, "-o", str(out)]) == 0
    assert "minus that of" in (out / "coverage.html").read_text(encoding="utf-8")


def test_impossible_settings_are_refused(tmp_path, capsys):
    for words, reported in (
        (["--grid", "7"], "does not divide 180"),
        (["--chance", "2"], "between 0 and 1"),
    ):
        assert main(["coverage", SCENE, "--geometry", *words, "-o", str(tmp_path / "x")]) != 0
        assert reported in capsys.readouterr().err
