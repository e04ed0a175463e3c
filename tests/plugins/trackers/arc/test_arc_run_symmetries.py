"""Runs of `kepler-arc` that differ in what no track can depend on: order, numbers, windows,
longitude.
"""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.arc.tracker import kepler_arc_tracker
from opir_trackers.configs import KeplerArcConfig
from stepped_trackers import context_of, portions, stepped
from symmetric_scenes import BLIND, scene, simulated, turned
from tracks_alike import assert_alike, moved

import opir_core as opir
from opir_core.planning.plan import compile_plan
from opir_core.plugin import Sensor, Tracks

#: Fits end where a step changes nothing to 1e-8 of the state.
ROUNDING = 1e-6
MAPPING = scene("kepler-arc")


@pytest.fixture(scope="module")
def run() -> opir.Run:
    return simulated(MAPPING)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"sensors": MAPPING["sensors"][::-1]}, id="sensors reversed"),
        pytest.param({"sensors": [BLIND, *MAPPING["sensors"]]}, id="a blind sensor first"),
        pytest.param({"targets": MAPPING["targets"][::-1]}, id="targets reversed"),
    ],
)
def test_order_changes_no_track(run: opir.Run, changes: dict[str, Any]) -> None:
    assert_alike(run.tracks, simulated({**MAPPING, **changes}).tracks, ROUNDING)


def test_windows_change_no_track(run: opir.Run) -> None:
    assert_alike(run.tracks, simulated(MAPPING, window_s=0.37).tracks, 0.0)


def test_a_scene_further_east_has_the_same_tracks_further_east(run: opir.Run) -> None:
    other = simulated(turned(MAPPING, 37.25))
    assert np.isfinite(run.tracks.impact[:, 0]).sum() > 20
    assert_alike(moved(run.tracks, turn_rad=np.radians(37.25)), other.tracks, ROUNDING)


def changed(sensors: tuple[Sensor, ...]) -> tuple[Sensor, ...]:
    """Return sensors that detect little, and say so."""
    return tuple(
        evolve(one, detection_probability={"ICBM": 0.3, "IRBM": 0.2, "SRBM": 0.1})
        for one in sensors
    )


def test_settings_changed_before_the_first_detection_are_those_of_a_scene_that_has_them(
    run: opir.Run,
) -> None:
    """And settings that are changed back leave the tracks as they were."""
    plan = compile_plan(opir.scene_from_mapping(MAPPING))
    sensors = plan.tracker_sensors()
    ticks_s = np.arange(1.0, 31.0).tolist()
    parts = portions(run.detections, ticks_s)
    trackers = [kepler_arc_tracker(KeplerArcConfig(), context_of(plan, sensors)) for _ in range(3)]
    trackers.append(kepler_arc_tracker(KeplerArcConfig(), context_of(plan, changed(sensors))))
    same, back, live, built = trackers
    live.set_sensors(changed(sensors))
    back.set_sensors(changed(sensors))
    back.set_sensors(sensors)
    tracks: list[Tracks] = [stepped(one, ticks_s, parts) for one in (same, back, live, built)]
    assert_alike(tracks[0], tracks[1], 0.0)
    assert_alike(tracks[3], tracks[2], 0.0)
    with pytest.raises(AssertionError):
        assert_alike(tracks[0], tracks[2], ROUNDING)
