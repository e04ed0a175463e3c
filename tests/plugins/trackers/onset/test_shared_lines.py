"""Groups of sources that share lines: labels by places, rounds of young groups, and whole runs of
flares side by side, with and without a launch among them.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import GatedPairs, LinesOfSight, SharedLooks, gated
from opir_trackers.configs import HypothesesConfig
from opir_trackers.onset.motion_statistics import GROUND, LAUNCH, MotionStatistics
from opir_trackers.onset.posterior import GroupPosterior
from opir_trackers.onset.shared_lines import (
    LAW,
    OwnedLines,
    path_of_places,
    settled,
    shared_lines,
)

import opir_core as opir
from opir_core.geometry import geodetic_to_ecef

SIGMA_RAD = 20e-6
SENSOR_M = np.array([42164e3, 0.0, 0.0])
#: Metres of a degree of latitude.
DEGREE_M = 111.2e3


def places_m(apart_m):
    """Return two places (2, 3) in ECEF on the equator below the sensor, some distance apart."""
    latitude = np.array([0.0, np.radians(apart_m / DEGREE_M)])
    return geodetic_to_ecef(latitude, np.zeros(2), np.zeros(2))


def lines_to(points_m):
    """Return one exact line of sight to each point (n, 3), each of a scan of its own source."""
    along = points_m - SENSOR_M
    count = len(points_m)
    return LinesOfSight(
        np.zeros(count),
        np.zeros(count, dtype=np.int32),
        np.zeros(count, dtype=np.int64),
        np.tile(SENSOR_M, (count, 1)),
        along / np.linalg.norm(along, axis=1)[:, None],
        np.full(count, SIGMA_RAD),
    )


def explained(place_m, lines, owner):
    """Return the lines with owners 3 and 5 that places (2, 3) share."""
    path = path_of_places(place_m, np.tile(100.0**2 * np.eye(3), (2, 1, 1)), 0.0)
    pairs: GatedPairs = gated(
        path, lines, *np.divmod(np.arange(2 * len(lines)), len(lines)), 6.0, False
    )
    looks = SharedLooks(
        pairs, pairs.track, np.full(len(pairs), 15.0), lines.sensor.take(pairs.line), 1e-3
    )
    owned = OwnedLines(lines, np.array(owner), np.ones(len(lines)))
    return shared_lines(looks, path, np.array([3, 5]), owned, light_time=False)


def weight_of(shared, lines):
    """Return the weight (rows, lines) of each line at each owner."""
    number = [
        int(np.argmin(np.linalg.norm(lines.direction_ecef - one, axis=1)))
        for one in shared.lines.direction_ecef
    ]
    weight = np.zeros((6, len(lines)))
    np.add.at(weight, (shared.owner, np.array(number)), shared.probability)
    return weight


def test_far_places_take_their_lines_whatever_the_association_says():
    place_m = places_m(8e3)
    lines = lines_to(place_m)
    weight = weight_of(explained(place_m, lines, [5, 3]), lines)
    assert weight[3] == pytest.approx([1.0, 0.0], abs=0.02)
    assert weight[5] == pytest.approx([0.0, 1.0], abs=0.02)


def test_places_in_one_another_share_each_line():
    place_m = places_m(1.0)
    lines = lines_to(places_m(300.0))
    weight = weight_of(explained(place_m, lines, [3, 5]), lines)
    assert weight[3] == pytest.approx([0.5, 0.5], abs=0.02)
    assert weight.sum(axis=0) == pytest.approx([1.0, 1.0], abs=0.02)


def test_a_line_that_no_place_explains_stays_with_its_owner():
    place_m = places_m(2e3)
    away_m = np.concatenate([place_m, places_m(30e3)[1:]])
    lines = lines_to(away_m)
    weight = weight_of(explained(place_m, lines, [3, 5, 5]), lines)
    assert weight[5, 2] == pytest.approx(1.0)
    assert weight[3, 2] == 0.0


def test_a_round_of_a_young_group_is_over_after_its_lines():
    place_m = places_m(1e3)
    statistics = MotionStatistics.fresh(place_m, 0.0, np.zeros(2), np.full(5, 0.2))
    lines = lines_to(np.repeat(place_m[:1], int(LAW.round_lines), axis=0))
    statistics = statistics.with_lines(
        np.zeros(len(lines), dtype=np.int64), lines, np.full(1, -np.inf)
    )
    rows = np.array([0, 1])
    after = settled(statistics, rows, np.zeros(2), 2.0)
    assert after.has_shared.all()
    assert after.lines.tolist() == [0.0, 0.0]
    assert after.epoch_s.tolist() == [2.0, 0.0]
    assert np.array_equal(after.of_labels().static_pull, statistics.static_pull)
    old = settled(statistics, rows, np.full(2, -2.0 * LAW.young_s), 2.0)
    assert np.array_equal(old.lines, statistics.lines)


def test_what_has_begun_anew_is_no_noise_until_its_next_line():
    posterior = GroupPosterior.of(HypothesesConfig(), np.full(1, 1e-9), np.full(1, 0.9))
    blank = MotionStatistics.fresh(places_m(1e3)[:1], 0.0, np.zeros(1), posterior.prior)
    lines = lines_to(np.repeat(places_m(1e3)[:1], 3, axis=0))
    statistics = blank.with_lines(np.zeros(3, dtype=np.int64), lines, posterior.log_clutter)
    begun = statistics.restarted(np.zeros(1, dtype=np.int64), 2.0, adds_up=False)
    for time_s in (2.0, 9.0):
        times = np.zeros(1), np.array([1.9]), np.array([10.0])
        assessed = posterior.assessed(begun, time_s, *times)
        assert assessed.probability.tolist() == begun.probability.tolist()


def test_launches_side_by_side_have_tracks_at_each_tick():
    targets = [
        {
            "id": f"T{number}",
            "type": "SRBM",
            "launch": {"lat_deg": 10.0 + 0.003 * number, "lon_deg": 45.0, "time_s": 1.0},
            "aim": {"lat_deg": 12.5, "lon_deg": 46.0},
        }
        for number in range(2)
    ]
    tracks = opir.simulate(scene_of([], targets, 15.0, 1)).tracks
    for number in np.unique(tracks.track):
        assert set(np.diff(tracks.tick_s[tracks.track == number])) == {1.0}


def scene_of(flares, targets, duration_s, seed):
    """Return a scene of flares and targets before two sensors."""
    return opir.scene_from_mapping(
        {
            "scene": "group",
            "epoch": "2026-04-01T20:00:00Z",
            "duration_s": duration_s,
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{slot}", "orbital_slot_deg": slot}
                for slot in (10.0, 80.0)
            ],
            "targets": targets,
            "detection": "snr",
            "tracker": "imm",
            "sources": [{"id": "flares", "model": "flares", "at": flares}] if flares else [],
        }
    )


def group_of(count, half_m, seed):
    """Return flares within a square about 10° N 45° E."""
    offsets = np.random.default_rng([53, seed]).uniform(-half_m, half_m, (count, 2)) / DEGREE_M
    return [
        {"lat_deg": 10.0 + float(north), "lon_deg": 45.0 + float(east), "area_m2": 200.0}
        for north, east in offsets
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("half_m", "seed"), [(500.0, 1), (900.0, 2), (2000.0, 3)])
def test_flares_side_by_side_are_no_launches(half_m, seed):
    tracks = opir.simulate(scene_of(group_of(6, half_m, seed), [], 60.0, seed)).tracks
    assert len(np.unique(tracks.track)) >= 3
    assert tracks.probability_launch.max() < 0.05
    assert np.isnan(tracks.launch).all()


@pytest.mark.slow
def test_a_launch_from_the_middle_of_flares_is_found_soon():
    """Alone it is known 13 s after ignition."""
    target = {
        "id": "T1",
        "type": "SRBM",
        "launch": {"lat_deg": 10.0, "lon_deg": 45.0, "time_s": 20.0},
        "aim": {"lat_deg": 12.5, "lon_deg": 46.0},
    }
    tracks = opir.simulate(scene_of(group_of(10, 3000.0, 4), [target], 70.0, 4)).tracks
    launched = np.unique(tracks.track[tracks.probability_launch > 0.95])
    assert len(launched) == 1
    rows = tracks.track == launched[0]
    known_s = tracks.tick_s[rows & (tracks.probability_launch > 0.95)]
    assert known_s.min() - 20.0 <= 13.0 + 10.0
    assert np.all(tracks.probability_launch[rows & (tracks.tick_s >= known_s.min())] > 0.9)


def test_what_stood_carries_that_on_when_its_sums_begin_anew():
    posterior = GroupPosterior.of(HypothesesConfig(), np.full(1, 1e-9), np.full(1, 0.9))
    place_m = places_m(1e3)
    fresh = MotionStatistics.fresh(place_m[:1], 0.0, np.zeros(1), posterior.prior)
    lines = lines_to(np.repeat(place_m[:1], 3, axis=0))
    lines = evolve(lines, time_s=np.array([0.0, 10.0, 20.0]), scan=np.arange(3))
    owner = np.zeros(3, dtype=np.int64)
    statistics = fresh.with_lines(owner, lines, posterior.log_clutter)
    # Three lines exclude no launch, and what is still seen after two horizons is asked again.
    late_s = 2.5 * float(statistics.horizon_s()[0])
    times = np.zeros(1), np.array([late_s]), np.array([10.0])
    after = posterior.assessed(statistics, late_s, *times, step_s=10.0)
    assert after.probability[0].argmax() == GROUND
    assert not after.is_decided[0]
    assert after.epoch_s[0] == late_s
    assert after.carried[0, LAUNCH] < 0.0
    asked = posterior.probabilities(after, np.zeros(1), np.array([10.0]), np.array([False]))
    assert asked[0, LAUNCH] < posterior.prior[LAUNCH]
