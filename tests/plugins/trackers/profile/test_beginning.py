"""Tracks of `boost-profile` begin with the rays from before they were known: as if they had been known all along."""

import numpy as np
import pytest
from class_flights import PRIORS, flights, lines_of_sight, watch_of
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.strain import OffModelFilters
from opir_trackers.profile.tracker import caught_up
from scipy.stats import chi2

import opir_core as opir
from opir_core.planning.plan import compile_plan
from opir_core.scoring.consistency import nees
from opir_core.scoring.evidence import true_states
from opir_core.simulation.run import run_of_plan


def test_a_track_that_catches_up_stands_where_it_would_have_stood() -> None:
    track, rays = lines_of_sight(flights("IRBM", 3, seed=7), 2e-5, seed=7, sensors=1)
    stray = np.zeros(len(rays))
    known = Fitting(PRIORS, watch_of(1), False)
    early = np.flatnonzero(rays.time_s < rays.time_s[0] + 9.0)
    now_s = float(np.ceil(rays.time_s[early[-1]]))
    # Track 1 is known from the first ray on, 0 and 2 begin at the last tick.
    always, late = (np.isin(track[early], which) for which in ([1], [0, 2]))
    along, followed = OffModelFilters.empty(1), OffModelFilters.empty(1)
    for tick_s in np.arange(np.floor(rays.time_s[0]) + 1.0, now_s + 1.0):
        mine = early[(rays.time_s[early] < tick_s) & (rays.time_s[early] >= tick_s - 1.0)]
        along = known.stepped(along, tick_s, track[mine], rays.take(mine), stray[mine])
        one = mine[track[mine] == 1]
        followed = known.stepped(followed, tick_s, track[one], rays.take(one), stray[one])
    assert always.any()
    rows = early[late]
    found = caught_up(known, followed, track[rows], rays.take(rows), stray[rows], 1.0, now_s)
    assert found.seen.track.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(found.ticks, along.ticks)
    np.testing.assert_array_equal(found.seen.hits, along.seen.hits)
    told, wanted = found.hypotheses, along.hypotheses
    np.testing.assert_array_equal([told.track, told.kind], [wanted.track, wanted.kind])
    # Where many tracks are at hand, rays are held against parabolas along their paths: that is all that differs.
    away = (told.parameters - wanted.parameters) / np.sqrt(np.diagonal(wanted.spread, axis1=1, axis2=2))
    assert np.abs(away).max() < 1e-5
    np.testing.assert_allclose(told.evidence, wanted.evidence, rtol=0.0, atol=1e-5)


SELDOM = [
    pytest.param(5000, "SRBM", 0, marks=pytest.mark.slow),
    pytest.param(5000, "SRBM", 3, marks=pytest.mark.slow),
    pytest.param(5000, "SRBM", 9, marks=pytest.mark.slow),
    (10_000, "ICBM", 2),
]


@pytest.mark.parametrize(("period_ms", "type_", "seed"), SELDOM)
def test_what_is_told_of_a_target_that_is_seen_seldom_is_as_sure_as_it_may_be(
    period_ms: int, type_: str, seed: int
) -> None:
    aim = {"SRBM": {"lat_deg": 33.0, "lon_deg": -127.0}, "ICBM": {"lat_deg": 9.0, "lon_deg": 167.7}}[type_]
    scene = {
        "scene": "seldom",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 120,
        "seed": seed,
        "sensors": [
            {"model": "generic-scanner", "id": f"G{k}", "orbital_slot_deg": slot, "scan_period_ms": period_ms}
            for k, slot in enumerate((-150.0, -100.0))
        ],
        "targets": [
            {
                "id": "T",
                "type": type_,
                "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0},
                "aim": aim,
            }
        ],
        "tracker": "boost-profile",
    }
    plan = compile_plan(opir.scene_from_mapping(scene))
    tracks = run_of_plan(plan).tracks
    away = tracks.state - true_states(plan, np.zeros(len(tracks), dtype=np.int32), tracks.tick_s)
    burns = np.isfinite(away).all(axis=1)
    assert np.count_nonzero(burns) >= 5
    assert nees(away[burns], tracks.state_covariance[burns]).max() < chi2.ppf(1.0 - 1e-5, 6)
