"""`imm`'s parts: late detections, near launches, doubles, motion."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import (
    BOOST,
    COAST,
    Motion,
    PredictedMeasurements,
    tangent_axes,
    taylor_positions,
    taylor_weights,
)
from opir_testing.doubles import stub_sensor, stub_window
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.tracker import ImmTracker, imm_tracker
from opir_trackers.track_priors import needed_scans
from position_roots import position_roots

from opir_core.flight.forces import Forces
from opir_core.flight.kepler import propagate_kepler
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.records import TRACK_ENDS, Detections, Tracks

SENSORS = (stub_sensor("WEST", -30.0), stub_sensor("EAST", 40.0), stub_sensor("FAR", 70.0))
KEPLER = Forces(zonal=())


def launches(
    starts: Sequence[tuple[float, float, float]], until_s: float, seed: int = 1
) -> tuple[Detections, np.ndarray]:
    """Return what three sensors see of targets that start at (latitude, longitude, time) and climb,
    and which is which.

    Each rises with 15 m/s² and leans over, in its own direction.
    """
    from opir_core.geometry import geodetic_to_ecef, local_axes

    rng = np.random.default_rng(seed)
    rows = []
    which = []
    for number, (latitude, longitude, start_s) in enumerate(starts):
        site = geodetic_to_ecef(np.radians(latitude), np.radians(longitude), 0.0)
        east, north, up = local_axes(site)
        lean = np.cos(2.1 * number) * east + np.sin(2.1 * number) * north
        for sensor, seer in enumerate(SENSORS):
            scans = np.arange(int(start_s * 10) + 1, int(until_s * 10) + 1)
            scans = scans[rng.random(len(scans)) < 0.8]
            since = (scans * 0.1 - start_s)[:, None]
            place = site + 7.5 * since**2 * up + 0.04 * since**3 * lean
            rows.append(
                (scans, np.full(len(scans), sensor), place, seer.orbit.position_ecef_m(scans * 0.1))
            )
            which.append(np.full(len(scans), number))
    scan, sensor, place, origin = (np.concatenate([row[k] for row in rows]) for k in range(4))
    direction = (place - origin) / np.linalg.norm(place - origin, axis=1)[:, None]
    axes = tangent_axes(direction)
    direction = direction + np.einsum(
        "nk,nkc->nc", 2e-5 * rng.normal(size=(len(scan), 2)), axes[:, :2]
    )
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    order = np.lexsort((sensor, scan))
    blank = stub_window(len(scan)).detections
    detections = evolve(
        blank,
        time_ns=scan[order] * 100_000_000,
        scan=scan[order],
        sensor=sensor[order].astype(np.int32),
        line_of_sight_ecef=direction[order],
        sensor_ecef_m=origin[order],
        line_of_sight_sigma_rad=np.full(len(scan), 2e-5),
    )
    return detections, np.concatenate(which)[order]


def risen(start: tuple[float, float, float], time_s: float) -> np.ndarray:
    """Return where the first target of `launches` is at a time."""
    from opir_core.geometry import geodetic_to_ecef, local_axes

    site = geodetic_to_ecef(np.radians(start[0]), np.radians(start[1]), 0.0)
    east, _, up = local_axes(site)
    since = time_s - start[2]
    place: np.ndarray = site + 7.5 * since**2 * up + 0.04 * since**3 * east
    return place


def tracker(**settings: Any) -> ImmTracker:
    context = TrackerContext(sensors=SENSORS, epoch_us=0, duration_s=100.0, light_time=False)
    return imm_tracker(ImmConfig(**settings), context)


def stepped(one: ImmTracker, parts: list[Detections]) -> Tracks:
    reported = Tracks.empty()
    for number, part in enumerate(parts, start=1):
        reported = one.step(float(number), part)
    return reported


def by_second(detections: Detections, seconds: int) -> list[Detections]:
    cuts = np.searchsorted(detections.time_ns, np.arange(seconds + 1) * 1_000_000_000)
    return [detections.take(slice(cuts[k], cuts[k + 1])) for k in range(seconds)]


@pytest.mark.slow
def test_detections_that_come_late_are_as_if_they_had_come_in_time() -> None:
    parts = by_second(launches([(5.0, 5.0, 2.0), (6.0, 5.0, 4.0)], 20.0)[0], 20)
    in_time = stepped(tracker(late_s=5.0), parts)
    late = [*parts]
    kept = parts[11].sensor != 1
    moved = parts[11].sensor == 1
    late[11] = parts[11].take(np.flatnonzero(kept))
    late[14] = Detections.concatenate([parts[11].take(np.flatnonzero(moved)), parts[14]])
    out_of_order = stepped(tracker(late_s=5.0), late)
    assert np.array_equal(out_of_order.state, in_time.state)
    assert np.array_equal(out_of_order.state_covariance, in_time.state_covariance)
    too_late = stepped(tracker(late_s=1.0), late)
    assert not np.array_equal(too_late.state, in_time.state)
    assert np.allclose(too_late.state[:, :3], in_time.state[:, :3], atol=500.0)


def reported_at_random(parts: list[Detections], settings: dict[str, Any], seed: int) -> Tracks:
    """Return the reports at the end where detections come up to 4 s late, a tenth of them a second
    early, shuffled.

    A third come twice. Those of the last ticks come in time.
    """
    rng = np.random.default_rng(seed)
    every = Detections.concatenate(parts)
    twice = np.concatenate([np.arange(len(every)), np.flatnonzero(rng.random(len(every)) < 0.3)])
    delay = np.where(rng.random(len(twice)) < 0.1, -1.0, rng.uniform(0.0, 4.0, len(twice)))
    when = every.time_s[twice]
    step_s = settings["cadence_s"]
    arrives = np.where(when < len(parts) - 5.0 - step_s, np.maximum(when + delay, 0.0), when)
    one = tracker(**settings)
    reported = Tracks.empty()
    for end_s in np.arange(step_s, len(parts) + 0.5 * step_s, step_s):
        now = rng.permutation(np.flatnonzero((arrives >= end_s - step_s) & (arrives < end_s)))
        reported = one.step(float(end_s), every.take(twice[now]))
    return reported


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [1.0, 5.0])
def test_detections_in_any_order_and_more_than_once_are_as_if_they_had_come_once_and_in_time(
    step_s: float,
) -> None:
    """Two launches that some scans see at one instant: then what was measured orders them."""
    parts = by_second(launches([(5.0, 5.0, 2.0), (5.1, 5.0, 4.0)], 30.0)[0], 30)
    settings = {"late_s": 10.0, "cadence_s": step_s}
    every = Detections.concatenate(parts)
    in_time = tracker(**settings)
    reported = Tracks.empty()
    for end_s in np.arange(step_s, 30.0 + 0.5 * step_s, step_s):
        due = (every.time_s >= end_s - step_s) & (every.time_s < end_s)
        reported = in_time.step(float(end_s), every.take(np.flatnonzero(due)))
    assert len(reported) == 2
    for seed in (1, 2):
        mixed_up = reported_at_random(parts, settings, seed)
        assert np.array_equal(mixed_up.state, reported.state)
        assert np.array_equal(mixed_up.state_covariance, reported.state_covariance)


@pytest.mark.slow
def test_launches_seconds_apart_from_within_the_line_of_sight_error_are_distinguished() -> None:
    """Three from a patch of 300 m, whose directions differ by 8 µrad where one look is off by 20
    µrad.
    """
    detections, which = launches([(5.0, 5.0, 2.0), (5.002, 5.001, 6.0), (5.001, 5.002, 10.0)], 60.0)
    one = tracker()
    parts = by_second(detections, 61)
    reported = Tracks.empty()
    labels = []
    for number, part in enumerate(parts, start=1):
        labels.append(one.associate(part))
        reported = one.step(float(number), part)
    assert len(reported) == 3
    late = detections.time_ns > 50_000_000_000
    label = np.concatenate(labels)[late]
    truth = which[late]
    for number in np.unique(label[label >= 0]):
        assert (
            np.mean(truth[label == number] == np.bincount(truth[label == number]).argmax()) > 0.99
        )


@pytest.mark.slow
def test_a_track_that_is_seen_is_kept_however_little_it_knows_and_a_silent_one_is_not() -> None:
    detections, _ = launches([(30.0, 10.0, 0.0)], 40.0)
    west = detections.take(np.flatnonzero(detections.sensor == 0))
    plain = tracker()
    strict = tracker(lost_sigma_m=3e3)
    reported, kept = (stepped(one, by_second(west, 40)) for one in (plain, strict))
    assert np.sqrt(np.trace(kept.state_covariance[0, :3, :3])) > 3e3
    assert np.array_equal(kept.state, reported.state)
    nothing = west.take(slice(0, 0))
    reported = [strict.step(time_s, nothing) for time_s in (40.3, 45.0, 46.0)]
    # The last record says that the track was lost.
    assert [one.end.tolist() for one in reported] == [[0], [TRACK_ENDS.index("lost")], []]
    assert len(plain.step(45.0, nothing)) == 1


@pytest.mark.slow
def test_biased_sensors_stay_honest() -> None:
    """Six times three sensors with a bias of three times their noise each: one track, and the truth
    within it.
    """
    bias_rad = 6e-5
    reported_square = []
    sensors = tuple(evolve(sensor, line_of_sight_bias_sigma_rad=bias_rad) for sensor in SENSORS)
    context = TrackerContext(sensors=sensors, epoch_us=0, duration_s=100.0, light_time=False)
    for seed in range(6):
        detections, _ = launches([(5.0, 5.0, 2.0)], 30.0, seed=seed)
        shift = bias_rad * np.random.default_rng(100 + seed).normal(size=(3, 2))
        axes = tangent_axes(detections.line_of_sight_ecef)
        turned = detections.line_of_sight_ecef + np.einsum(
            "nk,nkc->nc", shift[detections.sensor], axes[:, :2]
        )
        detections = evolve(
            detections, line_of_sight_ecef=turned / np.linalg.norm(turned, axis=1)[:, None]
        )
        reported = stepped(imm_tracker(ImmConfig(), context), by_second(detections, 30))
        assert len(reported) == 1
        place = risen((5.0, 5.0, 2.0), 30.0)
        covariance = reported.state_covariance[0, :3, :3]
        error = reported.state[0, :3] - place
        reported_square.append(error @ np.linalg.solve(covariance, error))
    # The mean of six χ² of three degrees of freedom, 99.9 %; taken for unbiased, they give 500 and
    # two tracks each.
    assert 0.74 < np.mean(reported_square) < 7.4


@pytest.mark.slow
def test_rays_of_sensors_with_unlucky_biases_still_begin_one_track() -> None:
    """Two standard deviations of the bias up in one sensor, down in the other: averaging scans does
    not lessen it.
    """
    bias_rad = 6e-5
    sensors = tuple(evolve(sensor, line_of_sight_bias_sigma_rad=bias_rad) for sensor in SENSORS[:2])
    context = TrackerContext(sensors=sensors, epoch_us=0, duration_s=100.0, light_time=False)
    detections, _ = launches([(5.0, 5.0, 2.0)], 20.0)
    detections = detections.take(np.flatnonzero(detections.sensor < 2))
    north = 2.0 * bias_rad * np.where(detections.sensor == 0, 1.0, -1.0)
    turned = detections.line_of_sight_ecef + north[:, None] * np.array([0.0, 0.0, 1.0])
    detections = evolve(
        detections, line_of_sight_ecef=turned / np.linalg.norm(turned, axis=1)[:, None]
    )
    one = imm_tracker(ImmConfig(), context)
    reported = stepped(one, by_second(detections, 20))
    assert len(reported) == 1
    late = detections.take(np.flatnonzero(detections.time_ns > 15_000_000_000))
    assert np.mean(one.associate(late) == reported.track[0]) > 0.99


def test_noise_alone_begins_no_track() -> None:
    rng = np.random.default_rng(5)
    detections, _ = launches([(5.0, 5.0, 0.0)], 30.0)
    nadir = -detections.sensor_ecef_m / np.linalg.norm(detections.sensor_ecef_m, axis=1)[:, None]
    stray = nadir + 0.08 * rng.uniform(-1.0, 1.0, nadir.shape)
    noise = evolve(detections, line_of_sight_ecef=stray / np.linalg.norm(stray, axis=1)[:, None])
    one = tracker()
    assert not any(
        len(one.step(float(k), part)) for k, part in enumerate(by_second(noise, 30), start=1)
    )


@pytest.mark.parametrize("step_s", [0.1, 1.0, 30.0, -5.0])
def test_coasting_is_keplers(step_s: float) -> None:
    state = np.array(
        [[6.9e6, 1e5, 2e5, -500.0, 5000.0, 4000.0], [-3e6, 5e6, 4e6, 1000.0, 2000.0, -6500.0]]
    )
    after = Motion(COAST, 0.0, KEPLER).propagated(state, np.full(2, step_s))
    position, velocity = propagate_kepler(state[:, :3], state[:, 3:], np.full(2, step_s))
    assert np.allclose(after[:, :3], position, atol=2e-3, rtol=0.0)
    assert np.allclose(after[:, 3:], velocity, atol=2e-4, rtol=0.0)


@pytest.mark.parametrize("size", [COAST, BOOST])
def test_a_state_moves_the_same_to_the_last_bit_alone_and_among_others(size: int) -> None:
    """Gravity is worked out one by one for a few states, and in columns for many."""
    motion = Motion(size, 0.3, Forces())
    rng = np.random.default_rng(2)
    state = rng.normal(size=(100, size)) * np.repeat([1e6, 3e3, 20.0, 0.3], 3)[:size]
    state[:, 2] += 6.5e6
    steps = rng.uniform(-3.0, 12.0, 100)
    moved = motion.propagated(state, steps / 2)
    paths = motion.taylor(state)
    matrices = motion.transition(state[:, :3], steps)
    for number in range(100):
        one = state[[number]]
        step = steps[[number]]
        assert np.array_equal(motion.propagated(one, step / 2)[0], moved[number])
        assert np.array_equal(motion.taylor(one)[0], paths[number])
        assert np.array_equal(motion.transition(one[:, :3], step)[0], matrices[number])


def test_the_path_is_the_taylor_series_of_the_motion() -> None:
    """The fourth derivative closes the gap that the first three leave, and leaves one of the fifth
    order.
    """
    motion = Motion(BOOST, 1.0, KEPLER)
    state = np.array([[6.6e6, 1e5, 2e5, 500.0, 2000.0, 1000.0, 10.0, 20.0, 5.0, 0.1, -0.2, 0.3]])
    off = []
    for step in (8.0, 4.0):
        end = motion.propagated(state, np.array([step]))[:, :3]
        off.append(
            np.abs(
                taylor_positions(motion.taylor(state), taylor_weights(np.array([step]))) - end
            ).max()
        )
    assert off[0] < 2e-3
    assert off[0] / off[1] > 25.0


@pytest.mark.parametrize("size", [COAST, BOOST])
def test_transition_is_the_slope_of_the_motion(size: int) -> None:
    motion = Motion(size, 1.0, KEPLER)
    step = np.array([2.0])
    state = np.array([[6.6e6, 1e5, 2e5, 500.0, 2000.0, 1000.0, 10.0, 20.0, 5.0, 0.1, -0.2, 0.3]])[
        :, :size
    ]
    middle = 0.5 * (state + motion.propagated(state, step))[:, :3]
    matrix = motion.transition(middle, step)[0]
    scale = np.repeat([1e3, 1e1, 1e0, 1e-1], 3)[:size]
    for column in range(size):
        shift = np.zeros((1, size))
        shift[0, column] = scale[column]
        slope = motion.propagated(state + shift, step) - motion.propagated(state - shift, step)
        assert np.allclose(
            slope[0] / (2.0 * scale[column]), matrix[:, column], rtol=2e-5, atol=1e-7
        )
    assert np.allclose(matrix @ motion.transition(middle, -step)[0], np.eye(size), atol=1e-9)


def test_covariances_of_positions_are_those_of_their_sides() -> None:
    rng = np.random.default_rng(4)
    side = rng.normal(size=(5, 12, 12)) * np.repeat([1e3, 300.0, 10.0, 1.0], 3)[:, None]
    side[1, 6:] = 0.0
    outlook = PredictedMeasurements(30.0, np.zeros((5, 5, 3)), side)
    track = np.arange(40) % 5
    time_s = 30.0 + rng.uniform(-2.0, 1.0, 40)
    reported = position_roots(outlook, track, time_s)
    expected = reported @ reported.transpose(0, 2, 1)
    scale = np.sqrt(np.einsum("nii,njj->nij", expected, expected))
    assert np.all(np.abs(outlook.position_covariances(track, time_s) - expected) < 1e-12 * scale)


def test_sensors_that_scan_four_times_in_four_seconds_begin_tracks_with_four_scans_others_with_two():
    cases = {(1.0,): 4, (1.01,): 2, (10.0, 0.1): 4, (10.0,): 2}
    assert {periods: needed_scans(np.array(periods)) for periods in cases} == cases
