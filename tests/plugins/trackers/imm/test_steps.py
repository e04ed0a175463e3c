"""Steps of `imm`: whatever portions, order and delay detections come in, whatever is asked of it
between.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import LinesOfSight
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.predict import predict
from opir_trackers.imm.tracker import imm_tracker
from opir_trackers.imm.tracking import ImmTracking
from stepped_trackers import context_of, last, portions, stepped
from symmetric_scenes import scene, simulated
from tracks_alike import DRAWN, assert_alike, assert_states_alike, moved

import opir_core as opir
from opir_core.planning.plan import Plan, compile_plan
from opir_core.plugin import REPORTED_TYPES, Detections, Sensor, Tracker, Tracks

UNTIL_S = 28
#: Iterations of the update may end one later, at 0.01 standard deviations.
ITERATED_SIGMAS = 0.05


@cache
def seen() -> Detections:
    """Return the detections of the scene, in order."""
    return simulated(scene("none", duration_s=UNTIL_S)).detections


@cache
def edges_s() -> tuple[float, ...]:
    """Return ticks exactly at detections: each belongs to the tick after."""
    return (*seen().time_s[4::9].tolist(), float(UNTIL_S))


def plan(**settings: Any) -> Plan:
    """Return the plan of the scene with a tracker of some settings."""
    return compile_plan(
        opir.scene_from_mapping(scene({"model": "imm", **settings}, duration_s=UNTIL_S))
    )


def tracker(**settings: Any) -> Tracker:
    return plan(**settings).make_tracker()


@cache
def in_time(**settings: Any) -> Tracks:
    """Return the tracks of all ticks, after detections in order and in time."""
    return stepped(tracker(**settings), edges_s(), portions(seen(), edges_s()))


def test_detections_at_the_edge_of_a_tick_are_those_of_the_next() -> None:
    """Given a tick early, they wait for theirs."""
    until = [min(np.nextafter(tick_s, np.inf), UNTIL_S) for tick_s in edges_s()]
    early = stepped(tracker(late_s=5.0), edges_s(), portions(seen(), until))
    assert_alike(in_time(), early, 0.0)


def test_waiting_for_late_detections_changes_nothing_where_none_is_late() -> None:
    assert_alike(in_time(), in_time(late_s=5.0), 0.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_late_and_shuffled_detections_are_as_if_ordered(seed: int) -> None:
    """Each comes up to three ticks late, some twice, in any order; those of the last tick at
    once.
    """
    rng = np.random.default_rng(seed)
    parts = portions(seen(), edges_s())
    of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    arrives = np.minimum(of + rng.integers(0, 4, len(of)), len(parts) - 1)
    again = np.minimum(arrives + 1, len(parts) - 1)
    rows = np.concatenate([np.arange(len(of)), np.flatnonzero(rng.random(len(of)) < 0.3)])
    when = np.concatenate([arrives, again[rows[len(of) :]]])
    late = [seen().take(rng.permutation(rows[when == tick])) for tick in range(len(parts))]
    expected = last(in_time())
    tracks = last(stepped(tracker(late_s=UNTIL_S), edges_s(), late))
    # Forecasts are renewed every few seconds by what had come by then, and the dark track's gliders
    # are theirs.
    burning = [
        each.take(np.flatnonzero(each.probability_burning > 0.5)) for each in (expected, tracks)
    ]
    assert len(burning[0]) == 3
    assert_alike(*burning, 0.0, apart=DRAWN)
    assert_states_alike(expected, tracks, 0.3)


def test_a_tick_may_have_many_slices() -> None:
    """Ticks of 4 s in slices of 1 s leave the tracks, and the types that sensors report, of ticks
    of 1 s.
    """
    detections = evolve(
        seen(), reported_type=(7 * np.arange(len(seen())) % len(REPORTED_TYPES)).astype(np.uint8)
    )
    states = []
    for cadence_s in (1.0, 4.0):
        tracking = ImmTracking.of(
            ImmConfig(cadence_s=cadence_s, slice_s=1.0),
            context_of(plan(), plan().tracker_sensors()),
        )
        ticks_s = np.arange(cadence_s, UNTIL_S + 1.0, cadence_s).tolist()
        state = tracking.start()
        for tick_s, part in zip(ticks_s, portions(detections, ticks_s), strict=True):
            state = tracking.stepped(state, tick_s, part)
        states.append(state)
    short, long = states
    assert len(np.unique(short.table.reports)) > 3
    assert np.array_equal(long.table.reports, short.table.reports)
    for name in ("number", "first_s", "seen_s", "hits"):
        assert np.array_equal(getattr(long.table, name), getattr(short.table, name)), name
    assert np.allclose(
        long.table.estimates.likelier_state,
        short.table.estimates.likelier_state,
        rtol=1e-9,
        atol=0.1,
    )


@pytest.mark.parametrize("later_s", [600.0])
def test_a_scene_that_begins_later_has_the_same_tracks_later(later_s: float) -> None:
    """Inertial axes are those of scene time 0, so forecasts are of other draws."""
    later = evolve(seen(), time_ns=seen().time_ns + round(later_s * 1e9), scan=seen().scan + 7)
    ticks_s = [tick_s + later_s for tick_s in edges_s()]
    tracks = stepped(tracker(), ticks_s, portions(later, ticks_s))
    expected = moved(in_time(), later_s=later_s)
    assert_alike(expected, tracks, 1e-6, apart=(*DRAWN, "state", "state_covariance"))
    assert_states_alike(expected, tracks, ITERATED_SIGMAS)


def test_asking_which_track_a_detection_has_changes_nothing() -> None:
    """Not even if it is asked of others, seen at the same instants in other directions."""
    one = tracker()
    parts = portions(seen(), edges_s())
    tracks = []
    for tick_s, part in zip(edges_s(), parts, strict=True):
        away = part.line_of_sight_ecef + np.array([0.0, 0.0, 1e-3])
        other = evolve(part, line_of_sight_ecef=away / np.linalg.norm(away, axis=1)[:, None])
        one.associate(other)
        tracks.append(one.step(tick_s, part))
    assert_alike(in_time(), Tracks.concatenate(tracks), 0.0)


def test_settings_changed_and_changed_back_change_nothing() -> None:
    """Between any two ticks: to other scans, other detection probabilities and other biases, and
    back.
    """
    one = tracker()
    sensors = plan().tracker_sensors()
    other = tuple(evolve(sensor, **CHANGES) for sensor in sensors)
    tracks = []
    for tick_s, part in zip(edges_s(), portions(seen(), edges_s()), strict=True):
        one.set_sensors(other)
        one.set_sensors(sensors)
        tracks.append(one.step(tick_s, part))
    assert_alike(in_time(), Tracks.concatenate(tracks), 1e-9)


CHANGES = {
    "detection_probability": {"ICBM": 0.3, "IRBM": 0.2, "SRBM": 0.1},
    "line_of_sight_bias_sigma_rad": 0.0,
}


def test_settings_changed_before_the_first_detection_are_those_of_a_scene_that_has_them() -> None:
    """Of a sensor that confuses types, detects little, and tells that it does."""
    sensors = plan().tracker_sensors()
    confusion = {"ICBM": {"SRBM": 1.0}, "IRBM": {"SRBM": 1.0}, "SRBM": {"ICBM": 1.0}}
    chance = {"ICBM": 0.3, "IRBM": 0.2, "SRBM": 0.1}
    changed = tuple(
        evolve(sensor, detection_probability=chance, confusion=confusion) for sensor in sensors
    )
    one = tracker()
    one.set_sensors(changed)
    tracks = stepped(one, edges_s(), portions(seen(), edges_s()))
    assert_alike(stepped(built_with(changed), edges_s(), portions(seen(), edges_s())), tracks, 0.0)
    with pytest.raises(AssertionError):
        assert_alike(in_time(), tracks, 1e-6)


def built_with(sensors: tuple[Sensor, ...]) -> Tracker:
    """Return the tracker of a scene whose sensors have other settings."""
    return imm_tracker(ImmConfig(), context_of(plan(), sensors))


def test_silence_says_less_of_sensors_that_scan_more_seldom() -> None:
    """The rate at which a track is detected scales with the expected one: a burn is less probably
    over.
    """
    shares = []
    for factor in (1, 3):
        one = tracker()
        stepped(one, edges_s(), portions(seen(), edges_s()))
        one.set_sensors(tuple(slower(sensor, factor) for sensor in plan().tracker_sensors()))
        tracks = one.step(UNTIL_S + 2.0, seen().take(slice(0, 0)))
        shares.append(
            dict(zip(tracks.track.tolist(), tracks.probability_burning.tolist(), strict=True))
        )
    both = shares[0].keys() & shares[1].keys()
    assert len(both) >= 3
    assert all(shares[1][track] > shares[0][track] + 1e-3 for track in both)


def slower(sensor: Sensor, factor: int) -> Sensor:
    """Return a sensor whose scans take several times as long."""
    return evolve(sensor, scan=evolve(sensor.scan, period_ns=factor * sensor.scan.period_ns))


def test_each_line_of_a_track_counts_once_for_what_it_is() -> None:
    """As many lines as detections, each with the clutter and the noise of its sensor."""
    sensors = plan().tracker_sensors()
    config = ImmConfig()
    assumed = evolve(context_of(plan(), sensors), false_alarms_per_scan=None)
    tracking = ImmTracking.of(config, assumed)
    ticks_s = [float(number) for number in range(1, 19)]
    state = tracking.start()
    for tick_s, part in zip(ticks_s, portions(seen(), ticks_s), strict=True):
        state = tracking.stepped(state, tick_s, part)
    hits = state.table.hits
    motion = state.table.motion
    # The lines of a track weigh less the longer it is seen: no cubic describes a boost for long.
    assert (motion.lines <= hits + 1e-9).all()
    assert (motion.lines > 0.9 * hits).all()
    (alone,) = np.flatnonzero((state.table.reports >= 0).sum(axis=1) == 1)
    (east,) = np.flatnonzero(state.table.reports[alone] >= 0)
    sensor = sensors[east]
    chance = np.mean(list(sensor.detection_probability.values()))
    each = np.log(
        config.false_alarms_per_sr / chance * 2.0 * np.pi * sensor.line_of_sight_sigma_rad**2
    )
    assert motion.noise_log[alone] == pytest.approx(motion.lines[alone] * each, rel=1e-6)


def test_a_track_has_the_types_that_its_own_target_is_reported_as() -> None:
    """From the first tick on: of lines that begin it, too."""
    run = simulated(scene("none", duration_s=UNTIL_S))
    detections = evolve(seen(), reported_type=run.truth.target.astype(np.uint8))
    tracking = ImmTracking.of(ImmConfig(), context_of(plan(), plan().tracker_sensors()))
    state = tracking.start()
    ticks_s = [2.0 * number for number in range(1, UNTIL_S // 2 + 1)]
    begun = set()
    for tick_s, part in zip(ticks_s, portions(detections, ticks_s), strict=True):
        state = tracking.stepped(state, tick_s, part)
        for number, reports in zip(state.table.number.tolist(), state.table.reports, strict=True):
            assert len(np.unique(reports[reports >= 0])) == 1, (tick_s, number)
            begun.add((number, int(reports.max())))
    assert sorted(target for _, target in begun) == [0, 1, 2, 3]


def test_lines_are_predicted_where_tracks_are_at_the_end_of_a_slice() -> None:
    tracking = ImmTracking.of(ImmConfig(), context_of(plan(), plan().tracker_sensors()))
    parts = portions(seen(), [18.0, 20.0])
    state = tracking.start()
    state = tracking.stepped(state, 18.0, parts[0])
    ahead = predict(tracking.models, state, 20.0, LinesOfSight.of(parts[1]))
    rows = np.arange(len(state.table))
    there = ahead.path.positions(rows, np.full(len(rows), 20.0))
    assert there == pytest.approx(ahead.estimates.likelier_position_m, abs=1e-3)
    before = ahead.path.positions(rows, np.full(len(rows), 18.0))
    assert before == pytest.approx(state.table.estimates.likelier_position_m, abs=50.0)
    assert np.linalg.norm(there - before, axis=1).min() > 500.0
