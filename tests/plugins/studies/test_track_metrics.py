"""Metrics of tracks, against truth and tracks of the run taken apart here."""

from typing import ClassVar

import numpy as np
import pytest
from opir_scoring import PHASES
from opir_studies.configs import PHASE_NAMES
from opir_testing import MetricContract
from pyproj import Geod
from scored_scene import SCENE
from study_metrics import figures_of, settings_of
from study_scene import SCENE as UNTRACKED

import opir_core


class TestMilestones(MetricContract):
    name = "milestones"


class TestTracks(MetricContract):
    name = "tracks"


class TestAccuracy(MetricContract):
    name = "accuracy"


class TestLaunchError(MetricContract):
    name = "launch_error"


class TestImpactRegion(MetricContract):
    name = "impact_region"
    settings: ClassVar = {"times_s": [40.0, 120.0]}


@pytest.fixture(scope="module")
def run():
    return opir_core.simulate(
        opir_core.scene_from_mapping({**SCENE, "tracker": {"model": "imm", "cadence_s": 2.0}})
    )


def test_the_launch_error_is_the_geodesic_to_the_true_point(run):
    estimate = run.tracks.launch[-1]
    truth = SCENE["targets"][0]["launch"]
    _, _, distance_m = Geod(ellps="WGS84").inv(
        *np.degrees(estimate[1::-1]), truth["lon_deg"], truth["lat_deg"]
    )
    figures = figures_of("launch_error", run)
    error_s = abs(estimate[2] - truth["time_s"])
    assert figures["launch_error_m"] == pytest.approx(distance_m, rel=1e-3)
    assert figures["launch_time_error_s"] == pytest.approx(error_s, rel=1e-9)


def test_position_errors_are_those_of_the_tracks(run):
    plan = run.plan
    tick_s = run.tracks.tick_s
    has_truth = (tick_s <= plan.targets.end_s[0]) & np.isfinite(run.tracks.state[:, 0])
    true = plan.targets.position_ecef_m(
        np.zeros(has_truth.sum(), dtype=np.int32), tick_s[has_truth]
    )
    error_m = np.linalg.norm(run.tracks.state[has_truth, :3] - true, axis=1)
    assert figures_of("accuracy", run)["position_rmse_m"] == pytest.approx(
        np.sqrt(np.mean(error_m**2)), rel=1e-9
    )


def test_one_launch_has_one_track(run):
    figures = figures_of("tracks", run)
    assert (figures["tracked"], figures["false_tracks"], figures["tracks_a_launch"]) == (
        1.0,
        0.0,
        1.0,
    )
    detected_s = run.detections.time_s.min()
    expected = np.arange(2.0 * np.ceil(detected_s / 2.0), 91.0, 2.0)
    assert figures["completeness"] == pytest.approx(np.isin(expected, run.tracks.tick_s).mean())


def test_impact_figures_are_those_of_the_region_at_the_instant(run):
    def region(row, containment):
        regions = run.tracks.impact_regions[row]
        return next(region for region in regions if region.containment == containment)

    (row,) = np.flatnonzero(run.tracks.tick_s == 60.0)
    aim = np.radians([9.0, 167.7])
    figures = figures_of("impact_region", run, containment_percent=90.0, phases=(), times_s=(50.0,))
    assert figures == {
        "impact_area_at_50_s_km2": region(row, 0.9).area_km2,
        "impact_contained_at_50_s": float(region(row, 0.9).contains(*aim)),
        "impact_predicted_at_50_s": 1.0,
    }
    figures = figures_of("impact_region", run, phases=("last estimate",))
    assert figures["impact_area_last_estimate_km2"] == region(-1, 0.95).area_km2


def test_without_tracks_there_are_no_figures():
    run = opir_core.simulate(opir_core.scene_from_mapping(UNTRACKED))
    assert figures_of("tracks", run)["tracked"] == 0.0
    assert np.isnan(figures_of("accuracy", run)["position_rmse_m"])
    figures = figures_of("impact_region", run, times_s=(10.0,))
    assert figures["impact_predicted_at_10_s"] == 0.0
    assert np.isnan(figures["impact_area_at_10_s_km2"])


def test_phases_are_those_of_the_scores():
    assert PHASE_NAMES == PHASES


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"containment_percent": 80.0}, "80 is not 50, 90 or 95"),
        ({"phases": ("burnout",)}, "'burnout' is no phase"),
        ({"phases": ("last estimate",) * 2}, "a phase is repeated"),
        ({"phases": ()}, "give phases or times_s"),
        ({"times_s": (3.0, 2.0)}, "the times must increase"),
    ],
)
def test_invalid_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        settings_of("impact_region", **settings)


@pytest.mark.parametrize("percent", [50.0, 90.0, 95.0])
def test_each_containment_of_the_tracks_can_be_asked_for(percent):
    assert settings_of("impact_region", containment_percent=percent).containment_percent == percent
