"""Warning times against tracks made by hand, whose answer is known, and against a run taken apart
here.
"""

from typing import ClassVar

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import (
    Ownership,
    RunEvidence,
    WarningRequirement,
    evidence_of_run,
    ownership,
    warning_times,
)
from opir_testing import MetricContract
from scored_scene import SCENE
from study_metrics import figures_of, settings_of
from study_scene import SCENE as UNTRACKED

import opir_core


class TestWarningTime(MetricContract):
    name = "warning_time"
    settings: ClassVar = {"missile_probability": 0.5, "region_km2": None}


@pytest.fixture(scope="module")
def run():
    return opir_core.simulate(
        opir_core.scene_from_mapping({**SCENE, "tracker": {"model": "imm", "cadence_s": 2.0}})
    )


@pytest.fixture(scope="module")
def evidence(run) -> tuple[RunEvidence, Ownership]:
    run_evidence = evidence_of_run(run, run.plan)
    return run_evidence, ownership(run_evidence)


NOTHING = {"missile_probability": None, "region_km2": None, "launch_point_km": None}
IGNITION_S = SCENE["targets"][0]["launch"]["time_s"]


def times(evidence, columns=None, **requirement):
    """Return the warning times of the run, with other columns of tracks if given."""
    run_evidence, owners = evidence
    tracks = evolve(run_evidence.tracks, **columns or {})
    requirement = WarningRequirement(**NOTHING | requirement)
    return warning_times(evolve(run_evidence, tracks=tracks), owners, requirement)


def probabilities(run, *low):
    """Return columns with P(missile) of 0.95, but 0.5 at some rows."""
    probability = np.full(len(run.tracks), 0.95)
    probability[list(low)] = 0.5
    return {"probability_missile": probability}


def test_without_a_requirement_the_first_estimate_warns(run, evidence):
    warned = times(evidence)
    impact_s = run.plan.targets.truth()[0]["impact"]["time_s"]
    available_s = run.tracks.available_s.min()
    assert warned.warned_s[0] == warned.track_s[0] == available_s - IGNITION_S
    assert warned.warning_s[0] == pytest.approx(impact_s - available_s)


def test_a_warning_that_is_lost_again_does_not_count(run, evidence):
    """P(missile) passes the threshold at the 5th estimate, falls once at the 10th and stays from
    the 11th on.
    """
    low = probabilities(run, 0, 1, 2, 3, 9)
    warned = times(evidence, low, missile_probability=0.9)
    assert warned.warned_s[0] == run.tracks.available_s[10] - IGNITION_S


def test_a_requirement_missed_at_the_end_gives_no_warning(run, evidence):
    warned = times(evidence, probabilities(run, -1), missile_probability=0.9)
    assert (warned.warned_s[0], warned.warning_s[0]) == (np.inf, 0.0)
    assert np.isnan(warned.contained[0])


def test_a_tracker_without_hypotheses_never_states_a_missile(run, evidence):
    unknown = {"probability_missile": np.full(len(run.tracks), np.nan)}
    assert times(evidence, unknown, missile_probability=0.0).warning_s[0] == 0.0
    assert times(evidence, unknown).warning_s[0] > 0.0


def test_regions_and_launch_points_are_those_that_are_reported(run, evidence):
    available_s = np.append(run.tracks.available_s, np.inf)
    areas = [
        max((region.area_km2 for region in row if region.containment == 0.95), default=np.nan)
        for row in run.tracks.impact_regions
    ]
    limit_km2 = float(np.nanmedian(areas))
    too_large = max(row for row, area in enumerate(areas) if not area < limit_km2)
    warned = times(evidence, region_km2=limit_km2)
    assert warned.warned_s[0] + IGNITION_S == available_s[too_large + 1]
    first_region = np.flatnonzero(np.isfinite(areas))[0]
    assert warned.region_s[0] == available_s[first_region] - IGNITION_S
    spread_m = [
        np.sqrt(np.linalg.eigvalsh(covariance[:2, :2]).max() * -2.0 * np.log(0.05))
        if np.isfinite(covariance).all()
        else np.nan
        for covariance in run.tracks.launch_covariance
    ]
    limit_m = spread_m[-1]
    small_enough = next(row for row, value in enumerate(spread_m) if value < 1.01 * limit_m)
    warned = times(evidence, launch_point_km=1.01e-3 * limit_m)
    assert warned.warned_s[0] == available_s[small_enough] - IGNITION_S
    assert times(evidence, launch_point_km=0.99e-3 * limit_m).warning_s[0] == 0.0


def test_late_estimates_warn_when_they_are_available(run, evidence):
    warned = times(evidence, {"available_s": run.tracks.tick_s + 7.0})
    assert warned.warned_s[0] == pytest.approx(run.tracks.tick_s.min() + 7.0 - IGNITION_S)


def test_the_metric_counts_launches_without_a_warning_as_zero():
    run = opir_core.simulate(opir_core.scene_from_mapping(UNTRACKED))
    figures = figures_of("warning_time", run)
    expected = {
        "warning_time_s": 0.0,
        "warned": 0.0,
        "share_with_track": 0.0,
        "share_with_region": 0.0,
        "share_with_report": 1.0,
        "time_to_report_s": run.summary["targets"][0]["end_to_end_latency_s"],
    }
    assert {name: figures[name] for name in expected} == expected
    assert np.isnan(figures["time_to_track_s"])


def test_an_unknown_containment_is_refused():
    with pytest.raises(ValueError, match="80 is not 50, 90 or 95"):
        settings_of("warning_time", containment_percent=80.0)
