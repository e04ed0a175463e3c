"""Sensors with a narrow field that a director points, against what the mechanism promises."""

import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from directed_spot import (
    ELSEWHERE_M,
    LAUNCH_M,
    columns,
    host_of,
    point_at,
    run,
    scene,
    spot_times_s,
    stay,
)
from repository import ROOT
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.plugin import Command, Situation
from opir_core.reading import scene_hash, scene_mapping


def test_a_narrow_field_sees_nothing_where_it_is_not_pointed() -> None:
    assert not len(spot_times_s(run(stay)))
    assert not len(spot_times_s(run(point_at(ELSEWHERE_M))))
    wide = [
        of.detections.take(np.flatnonzero(of.detections.sensor == 0))
        for of in (run(stay), run(point_at(LAUNCH_M)))
    ]
    assert wide[0].time_ns.tolist() == wide[1].time_ns.tolist()
    np.testing.assert_array_equal(wide[0].line_of_sight_ecef, wide[1].line_of_sight_ecef)


def test_it_looks_after_delay_turn_and_settling() -> None:
    """From nadir the launch is 6 deg away: after 2 s, 6 s at 1 deg/s and 3 s."""
    pointed = run(point_at(LAUNCH_M))
    (record,) = pointed.commands
    (sensor_m,) = pointed.sensors[1].orbit.position_ecef_m(np.zeros(1))
    towards = LAUNCH_M - sensor_m
    cosine = towards @ -sensor_m / np.linalg.norm(towards) / np.linalg.norm(sensor_m)
    turn_s = np.degrees(np.arccos(cosine))
    assert record.start_s == 2.0
    assert record.from_s == pytest.approx(2.0 + turn_s + 3.0, abs=1e-9)
    times_s = spot_times_s(pointed)
    assert record.from_s <= times_s[0] < record.from_s + 0.2
    # The target leaves the field of 0.5 deg, which is 0.0087 * 37 800 km wide.
    target = pointed.plan.targets.position_ecef_m
    position_m = target(np.zeros(1, dtype=np.int32), times_s[-1:])[0]
    aside = np.cross(towards / np.linalg.norm(towards), position_m - sensor_m)
    assert np.linalg.norm(aside) / np.linalg.norm(position_m - sensor_m) <= np.sin(np.radians(0.5))
    assert len(times_s) > 300


def test_a_correction_within_the_field_costs_no_look() -> None:
    def decide(situation: Situation) -> Sequence[Command]:
        moved_m = LAUNCH_M + 1000.0 * situation.time_s
        return [Command(sensor="SPOT", position_ecef_m=moved_m)]

    pointed = run(decide, duration_s=60.0)
    times_s = spot_times_s(pointed)
    assert np.diff(times_s).max() < 0.15
    assert all(record.start_s == record.from_s for record in pointed.commands[1:])


def test_commands_that_a_sensor_cannot_take_are_refused_and_reported() -> None:
    reported = []

    def decide(situation: Situation) -> Sequence[Command]:
        reported.append([record.refusal for record in situation.refused])
        behind_m, lost_m = -LAUNCH_M, np.full(3, np.nan)
        commands = {0.0: ("SPOT", behind_m), 10.0: ("SPOT", lost_m), 20.0: ("WIDE", LAUNCH_M)}
        if situation.time_s not in commands:
            return []
        sensor, position_m = commands[situation.time_s]
        return [Command(sensor=sensor, position_ecef_m=position_m)]

    pointed = run(decide, spot={"pointing": {"at_deg": [34.0, -120.0]}})
    words = [record.refusal for record in pointed.commands]
    assert [of.split()[0] for of in words] == ["out", "its", "WIDE"]
    assert reported[:4] == [[], words[:1], words[1:2], words[2:]]
    assert len(spot_times_s(pointed)) > 500  # it goes on as it was: at its own place


def test_a_record_has_the_point_in_the_axis_when_the_field_looks_there() -> None:
    velocity_m_s = np.array([100.0, -50.0, 20.0])

    def decide(situation: Situation) -> Sequence[Command]:
        return {
            0.0: [Command(sensor="SPOT", reason="stay")],
            10.0: [
                Command(sensor="SPOT", position_ecef_m=LAUNCH_M, velocity_m_s=velocity_m_s),
            ],
            20.0: [Command(sensor="SPOT", position_ecef_m=-LAUNCH_M)],
        }.get(situation.time_s, [])

    nadir, moved, refused = run(decide).commands
    assert nadir.position_ecef_m == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(
        moved.position_ecef_m, LAUNCH_M + velocity_m_s * (moved.from_s - 10.0), atol=1e-6
    )
    assert refused.position_ecef_m is None


def test_the_last_of_several_commands_counts() -> None:
    def decide(situation: Situation) -> Sequence[Command]:
        places = (ELSEWHERE_M, LAUNCH_M) if situation.time_s == 0.0 else ()
        return [Command(sensor="SPOT", position_ecef_m=place) for place in places]

    assert spot_times_s(run(decide)).tolist() == spot_times_s(run(point_at(LAUNCH_M))).tolist()


def test_a_command_waits_for_the_turn_before_it_and_replaces_those_that_wait() -> None:
    def decide(situation: Situation) -> Sequence[Command]:
        place = {0.0: ELSEWHERE_M, 10.0: ELSEWHERE_M + 1e6, 20.0: LAUNCH_M}.get(situation.time_s)
        return [] if place is None else [Command(sensor="SPOT", position_ecef_m=place)]

    slow = {"pointing": {"slew_deg_s": 0.3, "half_angle_deg": 0.5}}
    first, second, third = run(decide, spot=slow).commands
    assert first.from_s > 22.0
    assert second.start_s == third.start_s == first.from_s


def test_a_director_gets_what_has_been_reported_and_no_more() -> None:
    seen: list[tuple[float, Any]] = []

    def decide(situation: Situation) -> Sequence[Command]:
        seen.append((situation.time_s, situation.detections))
        assert (situation.detections.reported_ns <= situation.time_s * 1e9).all()
        return []

    sensors = [
        {
            "model": "generic-scanner",
            "id": "WIDE",
            "orbital_slot_deg": -150.0,
            "reporting": {"downlink": {"mean_s": 12.0, "sigma_s": 4.0}},
        },
        {"model": "SPOT", "id": "SPOT", "orbital_slot_deg": -100.0},
    ]
    whole = run(decide, sensors=sensors)
    assert [time_s for time_s, _ in seen] == [10.0 * step for step in range(12)]
    total = sum(len(detections) for _, detections in seen)
    assert total == np.count_nonzero(whole.detections.reported_ns <= 110e9)


CUED = {
    "sensors": [
        {"model": "generic-scanner", "id": "WEST", "orbital_slot_deg": -150.0},
        {"model": "generic-scanner", "id": "EAST", "orbital_slot_deg": -90.0},
        {"model": "SPOT", "id": "SPOT", "orbital_slot_deg": -100.0},
    ],
    "tracker": "imm",
    "director": {"model": "cue", "least_probability_launch": 0.0},
    "duration_s": 150.0,
}


@pytest.mark.parametrize(
    ("director", "settings"),
    [
        ("cue", {"window_s": 3.7}),
        ("cue", {"window_s": 40.0}),
        ("cue", {"workers": 2}),
        ("information", {"window_s": 3.7}),
    ],
)
def test_windows_and_workers_do_not_change_a_directed_run(
    director: str, settings: dict[str, Any]
) -> None:
    pytest.importorskip("opir_trackers")
    host = host_of(stay)
    directed = {"model": director, "least_probability_launch": 0.0}
    cued = opir.scene_from_mapping(two_sensor_scene(**{**CUED, "director": directed}), host=host)
    whole, sliced = opir.simulate(cued, host), opir.simulate(cued, host, **settings)
    assert np.count_nonzero(whole.detections.sensor == 2) > 300
    for one, other in zip(columns(whole), columns(sliced), strict=True):
        np.testing.assert_array_equal(one, other)
    assert whole.commands == sliced.commands


def test_a_scene_without_a_director_has_no_word_of_it() -> None:
    named_none = opir.scene_from_mapping(two_sensor_scene(director="none"))
    assert named_none == opir.scene_from_mapping(two_sensor_scene())
    assert "director" not in scene_mapping(opir.scene_from_mapping(two_sensor_scene()))
    directed = scene(stay)
    assert scene_mapping(directed)["director"] == {"model": "script"}
    assert scene_hash(directed) != scene_hash(scene(stay, director=None))
    assert opir.scene_from_mapping(scene_mapping(directed), host=host_of(stay)) == directed


def test_a_scene_without_a_director_loads_nothing_of_it() -> None:
    code = (
        "import sys, opir_core as opir\n"
        "opir.simulate(opir.load_scene('examples/first_light.yaml', overrides=['duration_s=20']))\n"
        "print([name for name in sys.modules if 'direct' in name and name.startswith('opir_core')])"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert printed.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"director": "scrip"}, "director: no director is named 'scrip'"),
        (
            {"sensors": [{"model": "generic-scanner", "id": "A", "orbital_slot_deg": -100.0}]},
            "director: no sensor of the scene has a narrow field",
        ),
        ({"tracking_order": "report"}, "director: a director needs tracking_order: observation"),
    ],
)
def test_scenes_that_cannot_be_directed_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(opir.OpirError) as refused:
        run(stay, **changes)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (None, "commands at 0 s returned NoneType, not a sequence of Command"),
        (["SPOT"], "commands at 0 s returned str among its commands, not a Command"),
        (
            [Command(sensor="SPOT", position_ecef_m=[1.0, 2.0])],
            "a command to SPOT whose vectors are not of shape (3,)",
        ),
    ],
)
def test_a_director_that_returns_something_else_is_named(returned: Any, words: str) -> None:
    with pytest.raises(opir.ModelError, match="the director 'script' of") as error:
        run(lambda _situation: returned)
    assert words in str(error.value)


def test_a_director_that_raises_is_named() -> None:
    with pytest.raises(opir.ModelError, match=r"the director 'script' of .* raised TypeError"):
        run(lambda situation: situation.tracks["state"])


@pytest.mark.slow
def test_silence_after_a_field_turned_away_is_that_of_the_scanner() -> None:
    """Eight looks a second, then one in 12 s: the burn goes on until these fail to come."""

    def follow_for_a_while(situation: Situation) -> Sequence[Command]:
        target_m = {0.0: LAUNCH_M, 70.0: ELSEWHERE_M}.get(situation.time_s)
        return [] if target_m is None else point_at(target_m, situation.time_s)(situation)

    wide = {"model": "generic-scanner", "id": "WIDE", "orbital_slot_deg": -150.0}
    sensors = [
        wide | {"scan_period_ms": 10_000.0},
        {"model": "SPOT", "id": "SPOT", "orbital_slot_deg": -100.0},
    ]
    of = run(follow_for_a_while, duration_s=300.0, tracker="imm", sensors=sensors)
    assert 71.0 < spot_times_s(of).max() < 73.0
    chance = dict(zip(of.tracks.tick_s.tolist(), of.tracks.probability_burning, strict=True))
    assert all(chance[time_s] > 0.7 for time_s in np.arange(60.0, 150.0).tolist())
    assert of.plan.targets.burnout_s[0] == 250.0
    assert chance[300.0] < 0.3
