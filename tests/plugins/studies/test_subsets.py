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


def sensors(path, values, **settings):
    study = Study(scene=SCENE, vary={path: values}, metrics=("latency",), **settings)
    designs = planned_study(study).designs
    return ["".join(sensor.id for sensor in design.scene.sensors) for design in designs]


def test_a_number_of_sensors_is_taken_evenly_from_the_list():
    assert sensors("sensors.count", [1, 2, 3, 4]) == ["A", "AC", "ABC", "ABCD"]


def test_sensors_are_kept_or_left_out_by_name():
    assert sensors("sensors.keep", ["B", ["D", "A"], "all"]) == ["B", "AD", "ABCD"]
    assert sensors("sensors.without", ["none", "B", ["A", "D"]]) == ["ABCD", "ACD", "BC"]
    assert sensors("sensors.count", [1, 2], overrides={"sensors.without": "A"}) == ["B", "BC"]


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
        sensors(path, [value])
    assert path in str(refused.value)
    assert words in str(refused.value)
