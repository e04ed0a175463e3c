"""The tracker `kepler-arc` in whole scenes: the paper's law of sigma, thrust, and what events
carry.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.arc.ends import expected_looks
from opir_trackers.sensors import SensorSchedule

from opir_core import simulate
from opir_core.planning.plan import compile_plan
from opir_core.plugin import TARGET_TYPES
from opir_core.reading import scene_from_mapping
from opir_core.simulation.run import run_of_plan


def scene(**settings):
    return scene_from_mapping(
        {
            "scene": "arcs",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 50.0,
            "seed": 5,
            "sensors": [
                {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -150.0},
                {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": -90.0},
            ],
            "targets": [
                {
                    "id": "T1",
                    "type": "IRBM",
                    "launch": {"lat_deg": 36.73, "lon_deg": -120.57, "time_s": 2.0},
                    "aim": {"lat_deg": 20.0, "lon_deg": -155.0},
                }
            ],
            "tracker": "kepler-arc",
            **settings,
        }
    )


def sigmas_and_looks(kind, **settings):
    """Return ticks, stated sigmas, m, and numbers of detections before the ticks of a boost seen by
    two sensors.

    Of the ticks at which it is probably a launch: before, no impact is predicted.
    """
    plan = compile_plan(scene(tracker={"model": "kepler-arc", **settings}, **LONGER[kind]))
    run = run_of_plan(plan)
    tracks = run.tracks
    assert len(np.unique(tracks.track)) == 1
    tracks = tracks.take(np.flatnonzero(tracks.probability_launch > 0.5))
    sigma = np.sqrt(tracks.impact_covariance[:, 0, 0])
    assert sigma == pytest.approx(np.sqrt(tracks.impact_covariance[:, 1, 1]))
    looks = np.array([np.count_nonzero(run.detections.time_s < tick) for tick in tracks.tick_s])
    return tracks.tick_s, sigma, looks, plan


LAUNCH = {"lat_deg": 36.73, "lon_deg": -120.57, "time_s": 2.0}
LONGER = {
    "SRBM": {
        "duration_s": 90.0,
        "targets": [
            {
                "id": "T1",
                "type": "SRBM",
                "launch": LAUNCH,
                "aim": {"lat_deg": 33.0, "lon_deg": -121.0},
            }
        ],
    },
    "ICBM": {
        "duration_s": 120.0,
        "targets": [
            {
                "id": "T1",
                "type": "ICBM",
                "launch": LAUNCH,
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
            }
        ],
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(LONGER))
def test_sigma_is_the_papers_law(kind):
    """At half of the boost the law says sigma_0 exp(-k / 2): tens of kilometres, whatever the range
    of the arc.
    """
    tick_s, sigma, looks, plan = sigmas_and_looks(kind, sigma_0_m=2e5, convergence=3.0)
    chance = plan.sensors[0].detection_probability[kind]
    burn_s = {"SRBM": 65.0, "ICBM": 210.0}[kind]
    half = int(np.argmin(np.abs(tick_s - 2.0 - 0.5 * burn_s)))
    law = 2e5 * np.exp(-3.0 * looks[half] / (2 * burn_s / 0.1 * chance))
    assert law == pytest.approx(2e5 * np.exp(-1.5), rel=0.1)
    # Types of which boosts of this length are as likely share the expected number.
    assert 0.5 * law < sigma[half] < 2.2 * law
    assert np.all(np.diff(sigma[: half + 1]) < 0.0)


@pytest.mark.slow
def test_after_the_boost_all_detections_are_in():
    _, sigma, _, _ = sigmas_and_looks("SRBM", sigma_0_m=2e5, convergence=3.0)
    assert sigma[-1] == pytest.approx(2e5 * np.exp(-3.0), rel=1e-9)


def test_expected_detections_are_those_of_the_boost_so_far_and_the_reported_types():
    """Ten detections a second: a boost of 130 s is no short-range one, one of 250 s lasts as long
    as any.
    """
    schedule = SensorSchedule(np.array([0.1]), np.ones((1, 3)))
    seen = np.ones((4, 1), dtype=bool)
    elapsed = np.array([1.0, 130.0, 250.0, 30.0])
    share = np.array([[1.0, 1.0, 1.0]] * 3 + [[float(kind == "SRBM") for kind in TARGET_TYPES]])
    expected = expected_looks(schedule, seen, elapsed, share)
    assert expected[0] == pytest.approx(10.0 * (65.0 + 120.0 + 210.0) / 3.0, rel=1e-6)
    assert 1800.0 < expected[1] < 2100.0
    assert expected[2] == pytest.approx(2500.0, rel=0.01)
    assert expected[3] == pytest.approx(650.0)


@pytest.mark.slow
def test_a_thrusting_target_is_on_no_arc():
    """The paper's arc through a boost falls far short of where the target goes; what is recent
    falls less short.
    """
    found = {}
    for name, memory_s in (("paper", None), ("recent", 5.0)):
        run = simulate(scene(tracker={"model": "kepler-arc", "memory_s": memory_s}))
        last = run.tracks.take(slice(-1, None))
        found[name] = float(np.linalg.norm(last.state[0, 3:]))
        assert np.degrees(last.launch[0, :2]) == pytest.approx([36.73, -120.57], abs=0.02)
    plan = compile_plan(scene())
    target = np.zeros(2, dtype=np.int32)
    after, before = plan.targets.position_ecef_m(target, np.array([50.0, 49.9]))
    true = np.linalg.norm(after - before) / 0.1
    assert found["paper"] < 0.75 * true
    assert found["paper"] < found["recent"] < true


@pytest.mark.slow
@pytest.mark.parametrize(
    "apart_deg", [0.0, *(pytest.param(each, marks=pytest.mark.slow) for each in (1e-3, 0.1))]
)
def test_sensors_at_one_place_tell_no_distance(apart_deg):
    """Their lines meet anywhere: without the heights of one sensor's arc the target was thousands
    of kilometres off.
    """
    pair = [
        {"model": "SBIRS-GEO", "id": name, "orbital_slot_deg": slot}
        for name, slot in (("A", -135.0), ("B", apart_deg - 135.0))
    ]
    plan = compile_plan(scene(sensors=pair))
    tracks = run_of_plan(plan).tracks
    assert len(tracks) > 30
    off = tracks.state[:, :3] - plan.targets.position_ecef_m(
        np.zeros(len(tracks), dtype=np.int32), tracks.tick_s
    )
    assert np.linalg.norm(off, axis=1).max() < 20e3
    assert np.isfinite(tracks.state_covariance).all()


@pytest.mark.slow
def test_events_carry_the_launch_and_the_impact():
    run = simulate(scene())
    known = run.detections.estimate >= 0
    assert known.mean() > 0.9
    assert np.isfinite(run.estimates.impact[run.detections.estimate[known]][-1]).all()


@pytest.mark.slow
def test_a_track_is_reported_after_eight_detections():
    slow = {"model": "SBIRS-GEO", "orbital_slot_deg": -150.0, "scan_period_ms": 500.0}
    run = simulate(
        scene(sensors=[{**slow, "id": "A"}, {**slow, "id": "B", "orbital_slot_deg": -90.0}])
    )
    counts = [
        np.count_nonzero(run.detections.time_s < run.tracks.tick_s[0] - early_s)
        for early_s in (0.0, 1.0)
    ]
    assert counts[0] >= 8 > counts[1]


@pytest.mark.slow
def test_an_unstated_bias_takes_no_detections_from_the_arcs() -> None:
    """Three launches before two sensors, one of which is turned by 200 µrad, ten times a look's
    error.
    """
    three = [
        {
            "id": f"T{row}",
            "type": "IRBM",
            "launch": {**LAUNCH, "lat_deg": lat},
            "aim": {"lat_deg": lat - 10.0, "lon_deg": -140.0},
        }
        for row, lat in enumerate((36.73, 10.0, -15.0))
    ]
    plan = compile_plan(scene(targets=three))
    right = run_of_plan(plan).detections
    moved = right.line_of_sight_ecef + 2e-4 * np.cross([0.6, 0.0, 0.8], right.line_of_sight_ecef)
    moved /= np.linalg.norm(moved, axis=1)[:, None]
    biased = evolve(
        right,
        line_of_sight_ecef=np.where((right.sensor == 1)[:, None], moved, right.line_of_sight_ecef),
    )
    sigma_m = []
    for detections in (right, biased):
        tracker = plan.make_tracker()
        cut = 0
        for tick in range(1, 51):
            end = int(np.searchsorted(detections.time_ns, tick * 1_000_000_000))
            tracks = tracker.step(float(tick), detections.take(slice(cut, end)))
            cut = end
        # Tracks may begin in another order.
        sigma_m.append(np.sort(np.sqrt(tracks.impact_covariance[:, 0, 0])))
    assert len(sigma_m[0]) == 3
    assert sigma_m[1] == pytest.approx(sigma_m[0], rel=0.05)
