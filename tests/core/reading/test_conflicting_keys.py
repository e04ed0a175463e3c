"""What can be reported in two ways is reported in one: both in one block is an error, and the
nearer block wins.
"""

import itertools
import sys
from collections.abc import Iterable
from typing import Any

import pytest
from attrs import evolve, fields, frozen
from fake_components import fake_host, good_mapping

from opir_core.errors import PluginError, SceneError
from opir_core.plugin import Constellation, Host, SensorModel, hookimpl, number, with_defaults
from opir_core.reading import scene_from_mapping, scene_hash, scene_mapping
from opir_core.scene import info_of


@frozen(kw_only=True)
class Eye:
    slot_deg: float = number(help="slot", default=0.0)
    noise_w_m2: float = number(help="noise", default=1e-12)
    noise_w_cm2: float | None = number(help="the same", default=None, instead_of="noise_w_m2")


@with_defaults(noise_w_cm2=5e-16)
class CentimetreEye(Eye):
    """By default reported in the other way."""


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    presets = {"cm": {"noise_w_cm2": 2e-16}, "m": {"noise_w_m2": 3e-12}, "both": {**M, **CM}}
    yield SensorModel(name="EYE", summary="looks", config=Eye, build=print, presets=presets)
    yield SensorModel(
        name="CM-EYE", summary="looks", config=CentimetreEye, build=print, presets=presets
    )


@hookimpl
def opir_constellations() -> Iterable[Constellation]:
    for name, settings in (("EYES", {"noise_w_cm2": 4e-16}), ("METRE-EYES", {"noise_w_m2": 4e-12})):
        yield Constellation(
            name=name, summary="two", model="EYE", satellites=[{"id": f"{name}-1", **settings}]
        )


M = {"noise_w_m2": 7e-12}
CM = {"noise_w_cm2": 8e-16}
HOST = fake_host(sys.modules[__name__])


def scene_of(*sensors: dict[str, Any], host: Any = HOST) -> Any:
    return scene_from_mapping({**good_mapping(), "sensors": list(sensors)}, host=host)


def reported(**block: Any) -> tuple[float, float | None]:
    """Return what a sensor's configuration has: W/m² of its own, and W/cm² where that is what
    counts.
    """
    named = {} if "constellation" in block else {"id": "A"}
    config = scene_of({**named, **block}).sensors[0].model.config
    return config.noise_w_m2, config.noise_w_cm2


def effective_w_m2(**block: Any) -> float:
    plain, metre_value = reported(**block)
    return plain if metre_value is None else metre_value * 1e4


@pytest.mark.parametrize("model", ["EYE", "CM-EYE"])
@pytest.mark.parametrize("preset", [{}, {"preset": "cm"}, {"preset": "m"}])
def test_what_the_scene_names_wins_over_preset_and_class(
    model: str, preset: dict[str, str]
) -> None:
    assert effective_w_m2(model=model, **preset, **M) == 7e-12
    assert effective_w_m2(model=model, **preset, **CM) == 8e-12
    bare = {"EYE": 1e-12, "CM-EYE": 5e-12}[model]
    expected = {"cm": 2e-12, "m": 3e-12}.get(preset.get("preset", ""), bare)
    assert effective_w_m2(model=model, **preset) == pytest.approx(expected)


@pytest.mark.parametrize("fleet", ["EYES", "METRE-EYES"])
def test_precedence_of_scene_constellation_and_preset(fleet: str) -> None:
    for preset in ({}, {"preset": "cm"}, {"preset": "m"}):
        assert effective_w_m2(constellation=fleet, **preset) == pytest.approx(4e-12)
        assert effective_w_m2(constellation=fleet, **preset, **M) == 7e-12
        assert effective_w_m2(constellation=fleet, **preset, **CM) == 8e-12


def test_both_in_one_block_is_one_error_with_its_place() -> None:
    with pytest.raises(SceneError) as caught:
        scene_of(
            {"model": "EYE", "id": "A", **M, **CM, "slot_deg": "east"},
            {"constellation": "EYES", **M, **CM},
        )
    lines = [str(problem) for problem in caught.value.problems]
    words = (
        "noise_w_cm2: sets the same quantity as noise_w_m2, which is also set; omit one of the two"
    )
    assert [line for line in lines if "noise" in line] == [
        f"sensors[0].{words}",
        f"sensors[1].{words}",
    ]
    assert any(line.startswith("sensors[0].slot_deg") for line in lines)


def test_one_of_them_set_to_none_is_not_reported() -> None:
    assert effective_w_m2(model="CM-EYE", **M, noise_w_cm2=None) == 7e-12
    assert effective_w_m2(model="CM-EYE", noise_w_cm2=None) == 1e-12


def test_a_preset_that_tells_both_is_its_plugin_s_fault() -> None:
    with pytest.raises(
        PluginError, match=r"EYE.*noise_w_cm2: sets the same quantity as noise_w_m2"
    ):
        scene_of({"model": "EYE", "id": "A", "preset": "both"})
    assert effective_w_m2(model="EYE", preset="both", **CM) == 8e-12


def test_the_canonical_form_has_one_of_two_conflicting_keys() -> None:
    blocks = itertools.product(
        ("EYE", "CM-EYE"), ({}, {"preset": "cm"}, {"preset": "m"}), ({}, M, CM)
    )
    sensors = [
        {"model": model, "id": f"A{n}", **more, **own_rows}
        for n, (model, more, own_rows) in enumerate(blocks)
    ]
    scene = scene_of(*sensors, {"constellation": "METRE-EYES", **CM})
    same_scene = scene_from_mapping(scene_mapping(scene), host=HOST)
    assert same_scene == scene
    assert scene_hash(same_scene) == scene_hash(scene)


def test_python_tells_it_once_as_a_scene_does() -> None:
    """What is left out is the class's, also where the number set is the same as the class's."""
    words = (
        "noise_w_cm2 sets the same quantity as noise_w_m2, which is also set; omit one of the two,"
        " or set"
    )
    for settings in ({**M, **CM}, {**CM, "noise_w_m2": float("1e-12")}):
        with pytest.raises(ValueError, match=words):
            Eye(**settings)
        with pytest.raises(ValueError, match=words):
            CentimetreEye(**settings)
    with pytest.raises(ValueError, match=f"{words} noise_w_cm2 to None"):
        evolve(Eye(**CM), **M)


def test_python_s_setting_wins_over_the_class_in_either_way() -> None:
    for eye in (
        CentimetreEye(**M),
        evolve(CentimetreEye(), **M),
        evolve(Eye(**CM), **M, noise_w_cm2=None),
    ):
        assert (eye.noise_w_m2, eye.noise_w_cm2) == (7e-12, None)
        assert evolve(eye, slot_deg=3.0).noise_w_cm2 is None
    for eye in (Eye(**CM), CentimetreEye(**CM), evolve(Eye(**CM), slot_deg=3.0)):
        assert (eye.noise_w_m2, eye.noise_w_cm2) == (1e-12, 8e-16)
    assert CentimetreEye().noise_w_cm2 == 5e-16


@pytest.mark.parametrize("model", Host.discover().names("opir_sensor_models"))
def test_the_installed_sensors_refuse_two_ways_in_python(model: str) -> None:
    config = Host.discover().component("opir_sensor_models", model).config
    with pytest.raises(ValueError, match="nei_w_cm2 sets the same quantity as nei_w_m2"):
        config(nei_w_m2=2e-12, nei_w_cm2=2e-16)
    with pytest.raises(
        ValueError, match="false_alarm_probability sets the same quantity as threshold_sigma"
    ):
        config(threshold_sigma=4.0, false_alarm_probability=1e-6)


def test_alternatives_name_an_optional_setting_of_the_class() -> None:
    """The pairs of the sensors that are installed."""
    alternatives = set()
    host = Host.discover()
    for name in host.names("opir_sensor_models"):
        config = host.component("opir_sensor_models", name).config
        for field in fields(config):
            if info_of(field).instead_of:
                names = [setting.name for setting in fields(config)]
                assert info_of(field).instead_of in names[: names.index(field.name)], (
                    "it stands before"
                )
                alternatives.add((field.name, info_of(field).instead_of))
    assert alternatives == {
        ("nei_w_cm2", "nei_w_m2"),
        ("false_alarm_probability", "threshold_sigma"),
    }
