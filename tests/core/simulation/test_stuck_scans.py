"""Scans that are stuck: what trackers and directors know of them, and what is refused."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from directed_spot import ELSEWHERE_M, LAUNCH_M, host_of, run, scene, spot_times_s
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.plugin import Command, Situation

STUCK: Mapping[str, Any] = {"sensor": "SPOT", "fault": "stuck-scan", "at_s": 30.0, "until_s": 70.0}


def turns(situation: Situation) -> Sequence[Command]:
    place_m = {0.0: LAUNCH_M, 40.0: ELSEWHERE_M, 80.0: ELSEWHERE_M}.get(situation.time_s)
    if place_m is None:
        return []
    return [Command(sensor="SPOT", position_ecef_m=place_m)]


def test_a_pointed_sensor_keeps_its_direction_and_refuses_commands() -> None:
    result = run(turns, faults=[STUCK])
    assert [record.refusal for record in result.commands] == [
        "",
        "its scan is stuck since 30 s",
        "",
    ]
    times_s = spot_times_s(result)
    # It goes on looking at the launch until it is turned away after the repair.
    assert len(times_s[(times_s >= 30.0) & (times_s < 82.0)]) == 520
    assert not len(times_s[times_s >= 82.0])


DOWN: Mapping[str, Any] = {**STUCK, "fault": "down"}
STATION: Mapping[str, Any] = {"id": "S", "lat_deg": 30.0, "lon_deg": -100.0}


def linked(keep_s: float) -> Mapping[str, Any]:
    """Return the links of a sensor that sends nothing from 30 to 70 s."""
    outage = {"node": "SPOT", "at_s": 30.0, "until_s": 70.0}
    downlinks = [{"rate_bytes_s": 1e6, "keep_s": keep_s}]
    return {"stations": [STATION], "downlinks": downlinks, "outages": [outage]}


@pytest.mark.parametrize(
    ("changes", "out_of_reach_s"),
    [
        ({"faults": [STUCK]}, [30.0, 40.0, 50.0, 60.0]),
        ({"faults": [DOWN]}, [30.0, 40.0, 50.0, 60.0]),
        ({"watched_s": {"SPOT": [[0.0, 40.0], [50.0, 120.0]]}}, [40.0]),
        # Reports of looks from 49.5 s on are of use when they arrive.
        ({"links": linked(keep_s=20.5)}, [30.0, 40.0]),
        # Nobody knows that it is blind.
        ({"faults": [{**STUCK, "fault": "blind"}]}, []),
    ],
)
def test_a_director_knows_when_a_sensor_sees_nothing_for_it(
    changes: Mapping[str, Any], out_of_reach_s: Sequence[float]
) -> None:
    reach = {}
    later = {}

    def decide(situation: Situation) -> Sequence[Command]:
        time_s = situation.time_s
        reach[time_s] = bool(situation.in_reach("SPOT", LAUNCH_M[None])[0])
        later[time_s + 20.0] = bool(situation.in_reach("SPOT", LAUNCH_M[None], 20.0)[0])
        return []

    run(decide, **changes)
    for reached in (reach, later):
        times_s = [time_s for time_s, is_reached in reached.items() if not is_reached]
        assert times_s == out_of_reach_s


def test_a_sensor_that_is_down_refuses_commands() -> None:
    result = run(turns, faults=[DOWN])
    assert [record.refusal for record in result.commands] == ["", "it is down since 30 s", ""]


def test_a_command_whose_turn_would_begin_in_the_fault_is_refused() -> None:
    """The turn begins two seconds after the command."""
    result = run(turns, faults=[{**STUCK, "at_s": 41.5}])
    assert result.commands[1].refusal == "its scan is stuck since 41.5 s"


def spinning(**changes: Any) -> opir.Scene:
    settings = two_sensor_scene(**changes)
    for sensor in settings["sensors"]:
        sensor["scan_pattern"] = "step-stare"
    return opir.scene_from_mapping(settings)


WEST: Mapping[str, Any] = {**STUCK, "sensor": "WEST", "until_s": 50.0}


def test_silence_of_a_stuck_scan_says_nothing_until_the_repair() -> None:
    plan = opir.compile_plan(spinning(faults=[WEST]))
    spans = ((0.0, 30.0), (50.0, 60.0))
    assert plan.tracker_sensors()[0].watched_s == spans
    assert plan.make_tracker() is not None
    manifest = opir.simulate(spinning(faults=[WEST])).manifest
    assert manifest["watched_s"]["WEST"] == [list(span) for span in spans]
    assert plan.tracker_sensors()[1].watched_s is None


def test_others_and_other_times_are_as_without_the_fault() -> None:
    intact, faulty = opir.simulate(spinning()), opir.simulate(spinning(faults=[WEST]))
    is_faulty = (intact.detections.time_s >= 30.0) & (intact.detections.time_s < 50.0)
    intact_rows = np.flatnonzero((intact.detections.sensor == 1) | ~is_faulty)
    during = (faulty.detections.time_s >= 30.0) & (faulty.detections.time_s < 50.0)
    faulty_rows = np.flatnonzero((faulty.detections.sensor == 1) | ~during)
    for name in ("time_ns", "sensor", "line_of_sight_ecef"):
        np.testing.assert_array_equal(
            getattr(faulty.detections, name)[faulty_rows],
            getattr(intact.detections, name)[intact_rows],
        )


@pytest.mark.parametrize("settings", [{"window_s": 3.7}, {"workers": 2}])
def test_windows_and_workers_change_no_byte(settings: Any) -> None:
    faults = [{**WEST, "until_s": None, "mtbf_s": 5.0, "mttr_s": 5.0}]
    faults = [{key: value for key, value in faults[0].items() if value is not None}]
    intact = opir.simulate(spinning(faults=faults))
    sliced = opir.simulate(spinning(faults=faults), **settings)
    np.testing.assert_array_equal(intact.detections.time_ns, sliced.detections.time_ns)
    assert len(intact.manifest["watched_s"]["WEST"]) > 2


@pytest.mark.parametrize(
    "changes", [{"scan_pattern": "staring"}, {"scan_pattern": "spin", "scan_phase": "aligned"}]
)
def test_a_sensor_without_a_scan_is_refused_with_the_place_of_its_fault(
    changes: Mapping[str, Any],
) -> None:
    mapping = two_sensor_scene(faults=[{**WEST, "fault": "down"}, dict(WEST)])
    mapping["sensors"][0].update(changes)
    with pytest.raises(opir.SceneError) as refused:
        opir.compile_plan(opir.scene_from_mapping(mapping))
    assert "faults[1].fault: WEST has no scan that could be stuck" in str(refused.value)


def test_a_setting_of_another_fault_is_refused() -> None:
    with pytest.raises(opir.SceneError, match="stuck-scan has no factor"):
        scene(turns, faults=[{**STUCK, "factor": 2.0}])
    assert host_of(turns)
