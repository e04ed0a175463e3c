"""What a plugin brings is not the fault of the scene: missing components, supplied values,
configuration classes.
"""

from typing import Any

import numpy as np
import pytest
from attrs import field, frozen
from fake_components import fake_host, good_mapping
from scene_reading import host_with_tracker, plugin_of, problems, read

from opir_core.errors import PluginError
from opir_core.plugin import Constellation


def test_all_missing_components_are_reported_at_once() -> None:
    with pytest.raises(PluginError) as caught:
        read(
            sensors=[{"constellation": "FLET"}, {"model": "SCANER", "id": "A"}],
            tracker="arcs",
            detection="snr",
        )
    lines = [line for line in str(caught.value).splitlines() if not line.startswith(" ")]
    assert lines == [
        "sensors[0]: no constellation is named 'FLET'",
        "sensors[1]: no sensor model is named 'SCANER'",
        "detection: no detection model is named 'snr'",
        "tracker: no tracker is named 'arcs'",
    ]
    assert caught.value.exit_code == 3


def test_one_missing_component_is_reported_once() -> None:
    targets = [{**target, "model": "glider"} for target in good_mapping()["targets"]]
    with pytest.raises(PluginError) as caught:
        read(targets=targets)
    assert str(caught.value).count("glider") == 1


def test_problems_of_the_scene_come_before_missing_components() -> None:
    assert problems(tracker="arcs", seed=-1) == ["seed: -1 is outside [0, 9223372036854775807]"]


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ({"constellation": "LOST"}, "sensors[0]: no sensor model is named 'NOWHERE'"),
        ({"constellation": "ODD"}, "sensors[0]: constellation 'ODD' of plugin fake_components "),
        (
            {"constellation": "BENT"},
            "does not fit SCANNER: orbital_slot_deg: 400.0 is outside [-180, 180] deg",
        ),
        (
            {"model": "SCANNER", "id": "A", "orbital_slot_deg": 1, "preset": "broken"},
            "fit SCANNER: rows: 0.5 is not",
        ),
    ],
)
def test_what_a_plugin_supplies_is_not_the_fault_of_the_scene(
    sensor: dict[str, Any], words: str
) -> None:
    with pytest.raises(PluginError) as caught:
        read(sensors=[sensor])
    assert words in str(caught.value)


def test_a_scene_may_mend_what_a_constellation_supplies() -> None:
    scene = read(sensors=[{"constellation": "BENT", "orbital_slot_deg": 40}])
    assert [sensor.model.config.orbital_slot_deg for sensor in scene.sensors] == [40.0, 40.0]


def test_a_supplied_array_is_the_fault_of_the_plugin() -> None:
    fleet = Constellation(
        name="ARRAY",
        summary="an array",
        model="SCANNER",
        satellites=[{"id": "A", "orbital_slot_deg": np.zeros(1)}],
    )
    host = fake_host(plugin_of(opir_constellations=lambda: [fleet]))
    with pytest.raises(
        PluginError,
        match=r"constellation 'ARRAY' .* orbital_slot_deg: a value of type numpy.ndarray",
    ):
        read(host=host, sensors=[{"constellation": "ARRAY"}])


@frozen
class Unheard:
    when: set[int] = field(factory=set)


@frozen
class Unknown:
    what: "Nowhere" = field(default=None)  # type: ignore[name-defined]  # noqa: F821


@frozen
class Crashing:
    def __attrs_post_init__(self) -> None:
        raise KeyError("window")


@frozen
class Reserved:
    model: str = "x"


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (Unheard, "Unheard.when: scenes cannot hold a value of type set[int]"),
        (Unknown, "the field types of Unknown are not known: name 'Nowhere' is not defined"),
        (
            Crashing,
            "its configuration fails: KeyError: 'window' (reading/test_plugin_faults.py, line 101)",
        ),
        (Reserved, "its configuration has the field model, a key reserved by scenes"),
    ],
)
def test_a_configuration_class_that_cannot_be_read(config: type, words: str) -> None:
    with pytest.raises(PluginError) as caught:
        read(host=host_with_tracker(config), tracker="other")
    assert (
        str(caught.value)
        == f"tracker: tracker 'other' of plugin other (registered by this program): {words}"
    )


def test_an_encoder_that_is_missing_is_reported() -> None:
    with pytest.raises(
        PluginError, match=r"outputs\[0\]\.encoder: no event encoder is named 'round'"
    ):
        read("outputs[0].jsonl.encoder=round")


def test_an_id_of_a_constellation_may_not_be_another_sensor_too() -> None:
    sensors = [
        {"model": "STARER", "id": "FLEET-2", "orbital_slot_deg": 1},
        {"constellation": "FLEET"},
    ]
    assert problems(sensors=sensors) == ["sensors[1]: FLEET-2 is the id of sensors[0] already"]
