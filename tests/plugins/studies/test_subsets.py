"""Designs of a study with some of a scene's sensors."""

import pytest
from opir_studies import Study
from opir_studies.planning import planned_study

from opir_core.errors import SceneError

SCENE = {
    "scene": "four",
    "epoch": "2026-04-01T00:00:00Z",
    "duration_s": 100.0,
    "seed": 1,
    "sensors": [
        {"model": "generic-scanner", "id": name, "orbital_slot_deg": slot}
        for name, slot in zip("ABCD", (-135.0, -45.0, 45.0, 135.0), strict=True)
    ],
    "targets": [],
}


def kept(path, values, **more):
    planned = planned_study(Study(scene=SCENE, vary={path: values}, metrics=("latency",), **more))
    return ["".join(sensor.id for sensor in each.scene.sensors) for each in planned.designs]


def test_a_number_of_sensors_is_taken_evenly_from_the_list():
    assert kept("sensors.count", [1, 2, 3, 4]) == ["A", "AC", "ABC", "ABCD"]


def test_sensors_are_kept_or_left_out_by_name():
    assert kept("sensors.keep", ["B", ["D", "A"], "all"]) == ["B", "AD", "ABCD"]
    assert kept("sensors.without", ["none", "B", ["A", "D"]]) == ["ABCD", "ACD", "BC"]
    assert kept("sensors.count", [1, 2], overrides={"sensors.without": "A"}) == ["B", "BC"]


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("sensors.count", 5, "5 is not a whole number from 1 to 4"),
        ("sensors.count", 0, "0 is not a whole number"),
        ("sensors.keep", "E", "no sensor or constellation is called 'E'"),
        ("sensors.without", list("ABCD"), "leaves no sensor"),
    ],
)
def test_a_value_that_chooses_no_sensor_is_refused_with_its_setting(path, value, words):
    with pytest.raises(SceneError) as refused:
        kept(path, [value])
    assert path in str(refused.value)
    assert words in str(refused.value)
