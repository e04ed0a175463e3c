"""Bodies that break up on their way through the air."""

import numpy as np
import pytest

import opir_core as opir

PLACE = {"lat_deg": 0.0, "lon_deg": 20.0, "height_m": 85e3, "heading_deg": 90.0, "area_m2": 8.0}


def plan_of(**settings):
    return opir.compile_plan(
        opir.scene_from_mapping(
            {
                "scene": "break-up",
                "epoch": "2026-04-01T20:00:00Z",
                "duration_s": 150.0,
                "seed": 3,
                "sensors": [
                    {"model": "SBIRS-GEO", "id": f"S{slot:g}", "orbital_slot_deg": slot}
                    for slot in (-10.0, 60.0)
                ],
                "targets": [],
                "sources": [{"id": "D", "model": "reentries", "at": [PLACE], **settings}],
                "detection": "snr",
                "background": "earth",
                "tracker": "imm",
                "outputs": [],
            }
        )
    )


def test_one_fragment_without_spread_is_the_body_itself():
    whole, broken = (
        plan_of(**changes).sources[0] for changes in ({}, {"fragments": 1, "fragment_spread": 1.0})
    )
    break_up_s = broken.trajectories.burnout_s[0]
    assert broken.trajectories.ignition_s[1] == break_up_s
    time_s = np.linspace(break_up_s + 0.1, broken.trajectories.burnout_s[1] - 0.1, 20)
    first = np.zeros(20, dtype=np.int32)
    places = [
        source.trajectories.position_ecef_m(row, time_s)
        for source, row in ((whole, first), (broken, first + 1))
    ]
    assert np.linalg.norm(places[1] - places[0], axis=1).max() < 5.0
    height_m = np.full(20, 60e3)
    light = [
        source.signatures.intensity_w_sr(0, row, time_s - start_s, height_m, np.zeros(20))
        for source, row, start_s in ((whole, first, 0.0), (broken, first + 1, break_up_s))
    ]
    assert light[1] == pytest.approx(light[0], rel=1e-3)


def test_fragments_keep_mass_and_the_lightest_fall_behind():
    source = plan_of(fragments=27).sources[0]
    rows = source.trajectories.truth()
    body, *pieces = rows
    assert len(pieces) == 27
    # A third as large each: a ninth of the area, three times as much of it together.
    assert sum(piece["area_m2"] for piece in pieces) == pytest.approx(3.0 * body["area_m2"])
    coefficient = np.array([piece["ballistic_coefficient_kg_m2"] for piece in pieces])
    share = np.abs(np.log(coefficient * 3.0 / body["ballistic_coefficient_kg_m2"])) < np.log(3.0)
    assert 0.7 < share.mean() < 1.0
    later_s = np.full(27, source.trajectories.burnout_s[0] + 20.0)
    place_m = source.trajectories.position_ecef_m(np.arange(1, 28, dtype=np.int32), later_s)
    start_m = source.trajectories.position_ecef_m(np.zeros(1, dtype=np.int32), np.zeros(1))
    way_m = np.linalg.norm(place_m - start_m, axis=1)
    assert np.all(np.diff(way_m[np.argsort(coefficient)]) > 0.0)


def test_a_break_up_below_the_end_of_the_fall_is_refused():
    with pytest.raises(opir.SceneError, match="break_up_m 10000 is not above lowest_m 15000"):
        plan_of(fragments=3, break_up_m=10e3)


@pytest.mark.slow
def test_what_breaks_up_is_no_launch_and_no_missile():
    run = opir.run_of_plan(plan_of(fragments=12))
    assert len(np.unique(run.truth.target)) >= 13
    assert np.count_nonzero(run.tracks.probability_launch > 0.5) == 0
    assert np.mean(run.detections.reported_type != 3) < 0.05
