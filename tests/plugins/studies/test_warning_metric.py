"""Warning times against tracks made by hand, whose answer is known, and against a run taken apart
here.
"""

from typing import ClassVar

import numpy as np
import opir_studies.metrics.warning_metric as subject
import pytest
from opir_scoring import (
    Ownership,
    RunEvidence,
    WarningRequirement,
    evidence_of_run,
    ownership,
    warning_times,
)
from opir_studies.configs import WarningConfig
from opir_testing import MetricContract
from scored_scene import SCENE
from study_scene import SCENE as UNTRACKED

import opir_core
from opir_core.plugin import MetricContext


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
    found = evidence_of_run(run, run.plan)
    return found, ownership(found)


NOTHING = {"missile_probability": None, "region_km2": None, "launch_point_km": None}
IGNITION_S = SCENE["targets"][0]["launch"]["time_s"]


def times(evidence, probability=None, **requirement):
    """Return the warning times of the run, with other probabilities of a missile if given."""
    import attrs

    found, owners = evidence
    tracks = (
        found.tracks
        if probability is None
        else attrs.evolve(found.tracks, probability_missile=probability)
    )
    return warning_times(
        attrs.evolve(found, tracks=tracks), owners, WarningRequirement(**NOTHING | requirement)
    )


def test_without_a_requirement_the_first_estimate_warns(run, evidence):
    found = times(evidence)
    impact_s = run.plan.targets.truth()[0]["impact"]["time_s"]
    assert found.warned_s[0] == found.track_s[0] == run.tracks.available_s.min() - IGNITION_S
    assert found.warning_s[0] == pytest.approx(impact_s - run.tracks.available_s.min())


def test_what_is_lost_again_is_no_warning(run, evidence):
    """P(missile) passes the threshold at the 5th estimate, falls once at the 10th and stays from
    the 11th on.
    """
    probability = np.full(len(run.tracks), 0.95)
    probability[:4] = 0.5
    probability[9] = 0.5
    found = times(evidence, probability, missile_probability=0.9)
    assert found.warned_s[0] == run.tracks.available_s[10] - IGNITION_S


def test_a_requirement_missed_at_the_end_gives_no_warning(run, evidence):
    probability = np.full(len(run.tracks), 0.95)
    probability[-1] = 0.5
    found = times(evidence, probability, missile_probability=0.9)
    assert (found.warned_s[0], found.warning_s[0]) == (np.inf, 0.0)
    assert np.isnan(found.contained[0])


def test_a_tracker_without_hypotheses_never_states_a_missile(run, evidence):
    unknown = np.full(len(run.tracks), np.nan)
    assert times(evidence, unknown, missile_probability=0.0).warning_s[0] == 0.0
    assert times(evidence, unknown).warning_s[0] > 0.0


def test_regions_and_launch_points_are_those_that_are_reported(run, evidence):
    areas = [
        max((each.area_km2 for each in row if each.containment == 0.95), default=np.nan)
        for row in run.tracks.impact_regions
    ]
    limit_km2 = float(np.nanmedian(areas))
    failed = [row for row, area in enumerate(areas) if not area < limit_km2]
    found = times(evidence, region_km2=limit_km2)
    expected = run.tracks.available_s[failed[-1] + 1] if failed[-1] + 1 < len(areas) else np.inf
    assert found.warned_s[0] + IGNITION_S == expected
    known = np.flatnonzero(np.isfinite(areas))
    assert found.region_s[0] == run.tracks.available_s[known[0]] - IGNITION_S
    spread_m = [
        np.sqrt(np.linalg.eigvalsh(each[:2, :2]).max() * -2.0 * np.log(0.05))
        if np.isfinite(each).all()
        else np.nan
        for each in run.tracks.launch_covariance
    ]
    first = next(row for row, each in enumerate(spread_m) if each < 1.01 * spread_m[-1])
    found = times(evidence, launch_point_km=1.01e-3 * spread_m[-1])
    assert found.warned_s[0] == run.tracks.available_s[first] - IGNITION_S
    assert times(evidence, launch_point_km=0.99e-3 * spread_m[-1]).warning_s[0] == 0.0


def test_late_estimates_warn_when_they_are_available(run, evidence):
    import attrs

    found, owners = evidence
    late = attrs.evolve(
        found, tracks=attrs.evolve(found.tracks, available_s=found.tracks.tick_s + 7.0)
    )
    warned = warning_times(late, owners, WarningRequirement(**NOTHING))
    assert warned.warned_s[0] == pytest.approx(run.tracks.tick_s.min() + 7.0 - IGNITION_S)


def test_the_metric_counts_launches_without_a_warning_as_zero():
    run = opir_core.simulate(opir_core.scene_from_mapping(UNTRACKED))
    found = subject.warning_time_metric(WarningConfig(), MetricContext()).values(run)
    assert (found["warning_time_s"], found["warned"]) == (0.0, 0.0)
    assert np.isnan(found["time_to_track_s"])
    assert (found["share_with_track"], found["share_with_region"], found["share_with_report"]) == (
        0.0,
        0.0,
        1.0,
    )
    assert found["time_to_report_s"] == run.summary["targets"][0]["end_to_end_latency_s"]


def test_an_unknown_containment_is_refused():
    with pytest.raises(ValueError, match="80 is not 50, 90 or 95"):
        WarningConfig(containment_percent=80.0)
