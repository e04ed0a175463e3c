"""Sensors that look in spans of a scene only."""

from typing import Any

import numpy as np
import pytest
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.reading import scene_hash, scene_mapping

SPANS = {"WEST": [[0.0, 40.0], [55.0, 90.0]], "EAST": [[30.0, 90.0]]}


def scene(**changes: Any) -> opir.Scene:
    return opir.scene_from_mapping(two_sensor_scene(**{"duration_s": 90.0, **changes}))


def looks(scene: opir.Scene) -> set[tuple[int, int]]:
    """Return the sensor and the time, ns, of each detection of a scene."""
    detections = opir.simulate(scene).detections
    return set(zip(detections.sensor.tolist(), detections.time_ns.tolist(), strict=True))


def test_outside_of_its_spans_a_sensor_detects_nothing_and_else_the_same() -> None:
    everything = looks(scene())
    within = {
        (sensor, time_ns)
        for sensor, time_ns in everything
        if any(start <= time_ns * 1e-9 <= end for start, end in SPANS[("WEST", "EAST")[sensor]])
    }
    assert 0 < len(within) < len(everything)
    assert looks(scene(watched_s=SPANS)) == within


def test_false_alarms_are_of_watched_times_too() -> None:
    settings = {"detection": {"model": "snr"}, "preset": "heritage"}
    pytest.importorskip("opir_photons")
    sensors = [
        {
            "model": "DSP",
            "id": "D1",
            "orbital_slot_deg": -100.0,
            "false_alarm_probability": 1e-6,
        }
    ]
    whole = scene(sensors=sensors, targets=[], **settings)
    part = scene(sensors=sensors, targets=[], watched_s={"D1": [[30.0, 60.0]]}, **settings)
    alarms = looks(whole)
    assert alarms
    assert looks(part) == {
        (sensor, time_ns) for sensor, time_ns in alarms if 30e9 <= time_ns <= 60e9
    }


def test_spans_are_in_the_scene_and_its_hash_only_where_they_are_set() -> None:
    plain, part = scene(), scene(watched_s=SPANS)
    assert "watched_s" not in scene_mapping(plain)
    assert scene_mapping(part)["watched_s"] == SPANS
    assert opir.scene_from_mapping(scene_mapping(part)) == part
    assert scene_hash(plain) == scene_hash(scene(watched_s={})) != scene_hash(part)


def test_the_manifest_says_when_each_sensor_looked() -> None:
    part = scene(watched_s={"EAST": SPANS["EAST"]})
    assert opir.simulate(part).manifest["watched_s"] == {
        "WEST": [[0.0, 90.0]],
        "EAST": [[30.0, 90.0]],
    }


@pytest.mark.parametrize(
    ("spans", "words"),
    [
        ({"EST": [[0, 1]]}, "there is no sensor 'EST'"),
        ({"EAST": [[0, 10], [5, 20]]}, "EAST: 5 to 20 s is no span after 10 s"),
        ({"EAST": [[10, 10]]}, "EAST: 10 to 10 s is no span after 0 s"),
        ({"EAST": [[-1, 10]]}, "-1"),
        ({"EAST": [10, 20]}, "watched_s"),
    ],
)
def test_spans_that_are_wrong_are_refused(spans: Any, words: str) -> None:
    with pytest.raises(opir.SceneError, match="watched_s") as refused:
        scene(watched_s=spans)
    assert words in str(refused.value)


def test_watched_times_add_up_the_spans() -> None:
    sensors = opir.compile_plan(scene(watched_s={**SPANS, "EAST": []})).sensors
    times_s = np.array([0.0, 20.0, 40.0, 50.0, 60.0, 90.0, 100.0])
    west, east = (sensor.watched_until_s(times_s) for sensor in sensors)
    np.testing.assert_allclose(west, [0.0, 20.0, 40.0, 40.0, 45.0, 75.0, 75.0])
    assert not east.any()
    assert sensors[0].is_watching(times_s).tolist() == [True, True, True, False, True, True, False]
    (plain, _) = opir.compile_plan(scene()).sensors
    assert plain.watched_until_s(times_s) is times_s
    assert plain.is_watching(times_s).all()
