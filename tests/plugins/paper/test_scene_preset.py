"""`preset` of a scene: each component that has it starts from it, and the paper's light takes no
time.
"""

from typing import Any

import pytest

import opir_core as opir
from opir_core.errors import SceneError
from opir_core.reading import scene_mapping

AIM = {"lat_deg": 40.0, "lon_deg": 0.0}
TARGET = {"id": "T", "type": "ICBM", "launch": {"lat_deg": 5.0, "lon_deg": -100.0}, "aim": AIM}


def scene(*sensors: dict[str, Any], **keys: Any) -> opir.Scene:
    head = {"scene": "s", "epoch": "2026-04-01T00:00:00Z", "duration_s": 60.0}
    return opir.scene_from_mapping({**head, "sensors": list(sensors), "targets": [TARGET], **keys})


def sensor(model: str, **settings: Any) -> dict[str, Any]:
    return {"model": model, "id": model, "orbital_slot_deg": -100.0, **settings}


def test_the_papers_preset_is_that_of_all_its_sensors() -> None:
    names = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")
    whole = scene(*map(sensor, names), preset="paper")
    single = scene(*(sensor(name, preset="paper") for name in names), light_time=False)
    assert scene_mapping(whole) == scene_mapping(single)
    assert whole.sensors[1].model.config.spectral_discrimination == "dual-band-ratio"
    assert not whole.light_time


def test_constellations_start_from_it_too() -> None:
    fleet = scene({"constellation": "SBIRS-GEO"}, preset="paper").sensors
    assert {each.model.config.scan_phase for each in fleet} == {"aligned"}


def test_what_a_scene_sets_itself_holds() -> None:
    sensors = sensor("DSP", preset="heritage"), sensor("SBIRS-GEO", scan_phase="random")
    own = scene(*sensors, preset="paper", light_time=True)
    assert own.light_time
    assert own.sensors[0].model.config.scan_period_ms == 10_000.0
    assert own.sensors[1].model.config.scan_phase == "random"
    assert own.sensors[1].model.config.spectral_discrimination == "dual-band-ratio"


def test_heritage_is_that_of_the_sensors_that_have_it() -> None:
    both = scene(sensor("DSP"), sensor("SBIRS-GEO"), preset="heritage")
    assert both.light_time
    assert [each.model.config.scan_period_ms for each in both.sensors] == [10_000.0, 100.0]


def test_an_unknown_preset_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SceneError, match=r"preset: .*paper.*heritage"):
        scene(sensor("DSP"), preset="papr")
