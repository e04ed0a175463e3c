"""Impact regions are scored by phase: made-up regions whose containment and area are known."""

import json
from functools import cache

import numpy as np
import pytest
from attrs import evolve
from geographiclib.geodesic import Geodesic
from opir_scoring import (
    PHASES,
    RunEvidence,
    impact_scores,
    ownership,
    region_energy_m,
    scorecard,
    scorecard_text,
)
from opir_scoring.containments import FARTHEST_M, energy, rms
from opir_testing import stub_estimates
from scipy.stats import chi2

from opir_core import ImpactRegion, compile_plan
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.reading import scene_from_mapping

LANDS = {
    "id": "LANDS",
    "type": "IRBM",
    "launch": {"lat_deg": 22.0, "lon_deg": -160.0, "time_s": 10.25},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
ORBITS = {
    "id": "ORBITS",
    "type": "SLV",
    "azimuth_deg": 90.0,
    "launch": {"lat_deg": 28.5, "lon_deg": -140.6, "time_s": 12.0},
}
SCENE = {
    "scene": "impacts",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 900.0,
    "sensors": [
        {"model": "generic-scanner", "id": name, "orbital_slot_deg": slot}
        for name, slot in (("A", -150.0), ("B", -170.0))
    ],
    "targets": [LANDS, ORBITS],
    "tracker": "none",
}


@cache
def plan(**changes):
    return compile_plan(scene_from_mapping({**SCENE, **changes}))


def true_impact(target=0):
    place = plan().targets.truth()[target]["impact"]
    return place["lat_deg"], place["lon_deg"]


def beyond(distance_m, bearing_deg=90.0):
    """Return latitude and longitude, rad, of a point at a distance from the true impact."""
    end = Geodesic.WGS84.Direct(*true_impact(), bearing_deg, distance_m)
    return np.radians([end["lat2"], end["lon2"]])


def disc(centre_rad, radius_m, containment, area_km2):
    """Return a region of a round ring of geodesics, and a made-up area."""
    ends = [
        Geodesic.WGS84.Direct(*np.degrees(centre_rad), bearing, radius_m)
        for bearing in np.linspace(0.0, 360.0, 73)
    ]
    ring = np.radians([[end["lat2"], end["lon2"]] for end in ends])
    return ImpactRegion(containment, area_km2, ((ring,),))


def evidence_of(tick_s, track, **columns):
    """Return a run in which tracks 0 and 1 are of the two targets and see them with both
    sensors.
    """
    regions = columns.pop("impact_regions", None)
    estimates = stub_estimates(len(tick_s), tick_s=tick_s, **columns)
    changes = {"track": np.asarray(track, dtype=np.int64)}
    if regions is not None:
        changes["impact_regions"] = np.empty(len(tick_s), dtype=object)
        changes["impact_regions"][:] = regions
    seen = np.array([0, 0, 1, 1])
    return RunEvidence(
        plan=plan(),
        tracks=evolve(estimates, **changes),
        time_s=np.array([11.0, 12.0, 13.0, 14.0]),
        sensor=np.array([0, 1, 0, 1], dtype=np.int32),
        sigma_rad=np.full(4, 1e-5),
        track=np.where(np.isin(seen, track), seen, -1),
        target=seen.astype(np.int32),
        direction_ecef=np.zeros((4, 3)),
        sensor_ecef_m=np.zeros((4, 3)),
    )


def burn_s():
    targets = plan().targets
    return float(targets.ignition_s[0]), float(targets.burnout_s[0])


def regions_at(tick_s, offset_m=20e3, radii_m=(10e3, 30e3, 40e3)):
    """Return discs about a point beside the true impact; the area of the smallest is the time of
    the tick.
    """
    centre = beyond(offset_m)
    areas = (tick_s, 2.0 * tick_s, 4.0 * tick_s)
    return tuple(disc(centre, *row) for row in zip(radii_m, TRACK_CONTAINMENTS, areas, strict=True))


def test_regions_are_tested_at_each_tick():
    ticks = np.array([20.0, 21.0, 22.0, 20.0, 21.0])
    reported = [regions_at(20.0), regions_at(21.0, 35e3), (), regions_at(20.0), ()]
    evidence = evidence_of(ticks, [0, 0, 0, 1, 1], impact_regions=reported)
    scores = impact_scores(evidence, ownership(evidence))
    assert scores.target.tolist() == [0, 0, 0, 1, 1]
    assert scores.tick_s.tolist() == ticks.tolist()
    assert scores.has_impact.tolist() == [True, True, True, False, False]
    assert scores.is_predicted.tolist() == [True, True, False, True, False]
    assert scores.is_stereo.all()
    assert scores.contained[:2].tolist() == [[0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]
    assert np.isnan(scores.contained[2:]).all()
    assert scores.area_km2[[0, 1, 3]].tolist() == [
        [20.0, 40.0, 80.0],
        [21.0, 42.0, 84.0],
        [20.0, 40.0, 80.0],
    ]
    assert np.isnan(scores.area_km2[[2, 4]]).all()


def test_a_region_that_is_missing_is_not_scored():
    evidence = evidence_of(np.array([20.0]), [0], impact_regions=[regions_at(20.0)[1:2]])
    scores = impact_scores(evidence, ownership(evidence))
    assert np.isnan(scores.contained[0]).tolist() == [True, False, True]
    assert scores.area_km2[0, 1] == 40.0


def test_without_regions_ellipses_are_scored():
    # 3 km east and 1 km north of the truth; the ellipse is turned by 30 degrees.
    turn = np.radians(30.0)
    sigma = np.array([4000.0, 500.0])
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    covariance = np.full((1, 3, 3), 0.0)
    covariance[0, :2, :2] = axes @ np.diag(sigma**2) @ axes.T
    bearing = np.degrees(np.arctan2(3.0, 1.0))
    place = beyond(np.hypot(3000.0, 1000.0), bearing)
    east_north = axes.T @ np.array([3000.0, 1000.0])
    radius = np.sqrt(np.sum((east_north / sigma) ** 2))
    for sigmas in (np.full(3, np.nan), radius * np.array([0.99, 1.01, 1.5])):
        evidence = evidence_of(
            np.array([20.0]),
            [0],
            impact=np.array([[*place, 700.0]]),
            impact_covariance=covariance,
            impact_sigmas=sigmas[None],
        )
        scores = impact_scores(evidence, ownership(evidence))
        radii = np.sqrt(chi2.ppf(TRACK_CONTAINMENTS, 2)) if np.isnan(sigmas).all() else sigmas
        assert scores.contained[0].tolist() == (radius <= radii).astype(float).tolist()
        np.testing.assert_allclose(scores.area_km2[0], np.pi * 4.0 * 0.5 * radii**2, rtol=1e-12)
        assert scores.impact_m[0] == pytest.approx(np.hypot(3000.0, 1000.0), rel=1e-3)


def test_a_point_alone_is_a_prediction_without_containment():
    evidence = evidence_of(np.array([20.0]), [0], impact=np.array([[*beyond(5e3), 700.0]]))
    scores = impact_scores(evidence, ownership(evidence))
    assert scores.is_predicted.all()
    assert np.isnan(scores.contained).all()


def instants_s():
    ignition_s, burnout_s = burn_s()
    length_s = burnout_s - ignition_s
    shares = [ignition_s + part * length_s for part in (0.25, 0.5, 0.75, 0.95)]
    return [*shares, burnout_s + 5.0, burnout_s + 20.0]


@pytest.mark.slow
def test_phases_take_the_last_recent_estimate():
    ticks = np.arange(15.0, burn_s()[1] + 40.0, 2.0)
    half = instants_s()[1]
    # A track that pauses for 20 s before half of the burn.
    ticks = ticks[(ticks < half - 20.0) | (ticks > half)]
    card = scorecard([evidence_of(ticks, 0 * ticks, impact_regions=list(map(regions_at, ticks)))])
    phases = card.figures["stereo"]["impact_by_phase"]
    assert [phase["phase"] for phase in phases] == list(PHASES)
    assert (
        *("25 % of burn", "50 % of burn", "75 % of burn", "95 % of burn"),
        *("5 s after burnout", "20 s after burnout", "last estimate"),
    ) == PHASES
    expected = [ticks[ticks <= instant].max() for instant in instants_s()]
    areas = [phase["regions"][0]["median_area_km2"] for phase in phases]
    assert [phase["targets"] for phase in phases] == [1, 0, 1, 1, 1, 1, 1]
    assert np.isnan(areas[1])
    assert areas[:1] + areas[2:6] == [expected[0], *expected[2:]]
    assert areas[6] == ticks[-1]
    assert [region["value"] for region in phases[0]["regions"]] == [0.0, 1.0, 1.0]


def test_runs_are_taken_together():
    tick = np.array([instants_s()[0] - 1.0])
    cases = [(20e3, 10.0), (35e3, 30.0), (70e3, 50.0), (20e3, 70.0)]
    runs = [
        evidence_of(tick, [0], impact_regions=[regions_at(area, offset)]) for offset, area in cases
    ]
    phase = scorecard([*runs, evidence_of(tick, [0])]).figures["stereo"]["impact_by_phase"][0]
    assert phase["targets"] == 5
    assert phase["predicted"]["value"] == 0.8
    assert [region["value"] for region in phase["regions"]] == [0.0, 0.5, 0.75]
    assert [region["median_area_km2"] for region in phase["regions"]] == [40.0, 80.0, 160.0]
    low, high = phase["regions"][1]["interval_95"]
    assert 0.0 < low < 0.5 < high < 1.0


def test_predictions_for_a_target_in_orbit_count_as_such():
    ignition_s, burnout_s = (
        float(getattr(plan().targets, name)[1]) for name in ("ignition_s", "burnout_s")
    )
    quarter = ignition_s + 0.25 * (burnout_s - ignition_s)
    runs = [
        evidence_of(np.array([quarter]), [1], impact_regions=[reported])
        for reported in (regions_at(20.0), (), regions_at(9.0))
    ]
    phase = scorecard(runs).figures["stereo"]["impact_by_phase"][0]
    assert (
        phase["targets"],
        phase["targets_without_impact"],
        phase["predicted_without_impact"],
    ) == (0, 3, 2)
    assert all(np.isnan(region["value"]) for region in phase["regions"])
    assert "2 of 3" in scorecard_text({"mine": scorecard(runs)})


def with_condition(regions, condition, probability, effective_samples=500.0):
    return tuple(
        evolve(
            each, condition=condition, probability=probability, effective_samples=effective_samples
        )
        for each in regions
    )


def test_regions_are_scored_under_the_condition_that_is_true():
    # Regions for a burn that is over miss by 100 km; those for one that goes on hold the impact,
    # with 90 and 95 %.
    over = with_condition(regions_at(20.0, 100e3), "burn over", 0.7)
    on = with_condition(regions_at(20.0), "relights", 0.3, 40.0)
    before = burn_s()[1] - 10.0
    after = burn_s()[1] + 10.0
    reported = [(*over, *on), (*over, *on), regions_at(20.0)]
    evidence = evidence_of(
        np.array([before, after, after + 1.0]), [0, 0, 0], impact_regions=reported
    )
    scores = impact_scores(evidence, ownership(evidence))
    assert scores.contained.tolist() == [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
    assert scores.contained_given.tolist() == [[0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
    np.testing.assert_allclose(scores.condition_brier, [2 * 0.7**2, 2 * 0.3**2, np.nan])
    np.testing.assert_array_equal(scores.effective_samples, [40.0, 40.0, np.nan])
    phase = scorecard([evolve(evidence, tracks=evidence.tracks.take(np.array([1])))])
    figures = phase.figures["stereo"]["impact_by_phase"][-1]
    assert figures["regions_given_condition"][1]["value"] == 0.0
    assert (figures["effective_samples"], figures["thin"]["value"]) == (40.0, 1.0)


def test_the_energy_of_regions_is_that_of_the_area_they_state():
    # Uniform over a disc about the truth: 2/3 R from its centre, 128 R / 45 pi between two points
    # of it.
    radius_m = 50e3
    total = disc(beyond(0.0), radius_m, 0.95, 0.0)
    parts = tuple(disc(beyond(0.0), radius_m * np.sqrt(share), share, 0.0) for share in (0.5, 0.9))
    expected = radius_m * (2.0 / 3.0 - 64.0 / (45.0 * np.pi))
    place = np.array([*beyond(0.0), 0.0])
    assert region_energy_m((total,), place) == pytest.approx(expected, rel=0.02)
    assert region_energy_m((*parts, total), place) == pytest.approx(expected, rel=0.02)
    # Two conditions: half of the weight lies around a place that is far away.
    far_m = 2000e3
    away = disc(beyond(far_m), radius_m, 0.95, 0.0)
    both = (*with_condition((total,), "burn over", 0.4), *with_condition((away,), "relights", 0.4))
    within = 128.0 * radius_m / (45.0 * np.pi)
    mixed = 0.5 * (2.0 / 3.0 * radius_m + far_m) - 0.5 * (0.5 * within + 0.5 * far_m)
    assert region_energy_m(both, place) == pytest.approx(mixed, rel=0.01)


def test_energy_of_an_area_with_a_hole_across_the_pole():
    ring_of = lambda radius_m: disc(np.radians([89.9, 10.0]), radius_m, 0.95, 0.0).polygons[0][0]  # noqa: E731
    ring = ImpactRegion(0.95, 0.0, ((ring_of(80e3), ring_of(60e3)),))
    place = np.append(np.radians([89.9, 10.0]), 0.0)
    rng = np.random.default_rng(3)
    radius = np.sqrt(rng.uniform(60e3**2, 80e3**2, 1500))
    angle = rng.uniform(0.0, 2.0 * np.pi, 1500)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    assert region_energy_m((ring,), place) == pytest.approx(
        radius.mean() - 0.5 * apart.mean(), rel=0.03
    )


@pytest.mark.slow
def test_cards_show_the_phases_of_all_trackers_side_by_side():
    ticks = np.arange(15.0, burn_s()[1] + 40.0, 1.0)
    one, other = (
        scorecard(
            [
                evidence_of(
                    ticks, 0 * ticks, impact_regions=[regions_at(tick, offset) for tick in ticks]
                )
            ]
        )
        for offset in (20e3, 70e3)
    )
    text = scorecard_text({"near": one, "far": other})
    rows = [line.split() for line in text[text.index("predicted impact regions") :].splitlines()]
    quarter = [row for row in rows if row[:4] == ["25", "%", "of", "burn"]]
    # A table of the main regions, and one of those whose condition is true.
    assert [row[4] for row in quarter] == ["near", "far", "near", "far"]
    assert "in 50 %" in text
    assert "median areas" in text
    json.dumps(one.as_plain(), allow_nan=False)


def test_a_target_of_unknown_impact_is_not_scored(tmp_path):
    path = tmp_path / "table.csv"
    rows = [f"{t},{-5.6e6 - 2e3 * t},-2.6e6,{2.9e6 + 1e3 * t}" for t in range(60)]
    path.write_text("\n".join(["time_s,x_ecef_m,y_ecef_m,z_ecef_m", *rows]), encoding="utf-8")
    scene = {
        **SCENE,
        "targets": [{"id": "T", "model": "table", "type": "IRBM", "file": str(path)}, ORBITS],
    }
    reported = evidence_of(np.array([20.0, 20.0]), [0, 1], impact_regions=[regions_at(20.0)] * 2)
    evidence = evolve(reported, plan=compile_plan(scene_from_mapping(scene)))
    assert impact_scores(evidence, ownership(evidence)).target.tolist() == [1]


def test_impact_intervals_end_at_half_the_equator() -> None:
    two = np.array([5e3, 4.6e6])
    low, high = rms(two)["interval_95"]
    assert (low < 1e3, high > 1e9) == (True, True)
    assert rms(two, limit=FARTHEST_M)["interval_95"] == [low, pytest.approx(20_037_508.3)]
    assert energy(two)["interval_95"][1] > 1e9
    assert energy(two, limit=FARTHEST_M)["interval_95"][1] == pytest.approx(20_037_508.3)
    few = np.array([1e3, 1.1e3, 0.9e3])
    assert rms(few, limit=FARTHEST_M) == rms(few)
