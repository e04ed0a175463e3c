"""Studies that vary the numbers of a pattern, and the metric of how much it covers."""

import math

import numpy as np
import pytest
from opir_coverage import CoverageSettings, computed_coverage
from opir_studies import Study, sweep
from opir_testing import MetricContract

from opir_core import scene_from_mapping

WALKER = {
    "per_plane": 1,
    "planes": 5,
    "phasing": 1,
    "inclination_deg": 43.66,
    "altitude_km": 13_000.0,
}
SENSOR = {
    "model": "generic-scanner",
    "field_of_regard_half_angle_deg": 90.0,
    "solar_exclusion_deg": 0.0,
}
SCENE = {
    "scene": "rosette",
    "epoch": "2026-04-01T00:00:00Z",
    "duration_s": 1.0,
    "sensors": [{**SENSOR, "fleet": {"walker": WALKER}}],
    "targets": [],
}
PLANES = "sensors[0].fleet.walker.planes"
HEIGHT = "sensors[0].fleet.walker.altitude_km"


class TestCoverage(MetricContract):
    name = "coverage"


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    study = Study(
        scene=SCENE,
        vary={PLANES: [4, 5], HEIGHT: [2000.0, 13_000.0]},
        runs=1,
        metrics=[{"coverage": {"grid_deg": 15.0, "steps": 48}}],
        executor="serial",
    )
    return sweep(study, tmp_path_factory.mktemp("study"))


def figures(result, figure):
    return {(row[PLANES], row[HEIGHT]): row["mean"] for row in result.rows(figure)}


def test_planes_of_a_pattern_vary_its_number_of_sensors(result):
    assert figures(result, "sensors") == {
        (4, 2000.0): 4,
        (4, 13_000.0): 4,
        (5, 2000.0): 5,
        (5, 13_000.0): 5,
    }


def test_only_five_satellites_high_enough_always_cover_the_earth(result):
    """Four cannot from any finite height; five need 11 550 km (Ballard, 1980)."""
    always = figures(result, "always_covered")
    longest_s = figures(result, "longest_gap_s")
    assert [place for place, share in always.items() if share > 1.0 - 1e-9] == [(5, 13_000.0)]
    assert [place for place, gap_s in longest_s.items() if gap_s == 0.0] == [(5, 13_000.0)]


def test_the_mean_share_is_that_of_caps_that_do_not_overlap(result):
    """Four caps of 39.6° about satellites 75° or more apart cover 4 (1 - cos 39.6°) / 2 of a sphere
    at most.
    """
    circle_rad = math.acos(6371.0 / (6371.0 + 2000.0)) + math.acos(6371.0 / 6381.0)
    most = 4 * 0.5 * (1.0 - math.cos(circle_rad))
    assert 0.8 * most < figures(result, "covered")[4, 2000.0] < 1.02 * most


def test_the_metric_has_the_figures_of_the_map(result):
    scene = {
        **SCENE,
        "sensors": [{**SENSOR, "fleet": {"walker": {**WALKER, "altitude_km": 2000.0}}}],
    }
    settings = CoverageSettings(target_class=None, heights_km=(10.0,), grid_deg=15.0, steps=48)
    found = computed_coverage(scene_from_mapping(scene), settings)
    gap_s = float(np.nanmax(found["revisit_time_max"].values[0]))
    assert figures(result, "longest_gap_s")[5, 2000.0] == gap_s
