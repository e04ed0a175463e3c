"""`detection: auto`, the default: the model that reads light if the scene describes light, else
constant.
"""

import json
from pathlib import Path
from typing import Any

import pytest

import opir_core as opir
from opir_core.errors import PluginError, SceneError
from opir_core.host import PACKAGES
from opir_core.host.error_messages import READERS
from opir_core.plugin import Host
from opir_core.reading import scene_mapping
from opir_core.simulation.explanation import explained

TARGET = {
    "id": "T1",
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 1.0},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
FLARE = {"id": "F", "model": "flares", "at": [{"lat_deg": 32.0, "lon_deg": -102.0}]}
SBIRS: dict[str, Any] = {"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": -130.0}
DSP: dict[str, Any] = {"model": "DSP", "id": "D", "orbital_slot_deg": -130.0}

#: Changes of a scene that describe light, with the path of what does.
LIGHT: list[tuple[dict[str, Any], str]] = [
    ({"atmosphere": "lowtran"}, "atmosphere"),
    ({"atmosphere": {"model": "lowtran", "climate": "us1976"}}, "atmosphere"),
    ({"background": "earth"}, "background"),
    ({"targets": [{**TARGET, "signature": "plume"}]}, "targets[0].signature"),
    ({"sensors": [{**SBIRS, "focal_plane": {"aperture_m": 0.01}}]}, "sensors[0].focal_plane"),
    ({"sensors": [{**SBIRS, "focal_plane": "notional"}]}, "sensors[0].focal_plane"),
    ({"sensors": [SBIRS, {**DSP, "threshold_sigma": 5.0}]}, "sensors[1].threshold_sigma"),
    (
        {"sensors": [{"constellation": "SBIRS-GEO", "false_alarm_probability": 1e-6}]},
        "sensors[0].false_alarm_probability",
    ),
    (
        {"sensors": [{**SBIRS, "band_focal_plane": {"SWIR": {"bits": 10}}}]},
        "sensors[0].band_focal_plane",
    ),
    (
        {"sensors": [{**SBIRS, "spectral_discrimination": "none"}]},
        "sensors[0].spectral_discrimination",
    ),
    ({"sensors": [{**DSP, "bands": {"SWIR": [2.6, 2.9]}}]}, "sensors[0].bands"),
    ({"sensors": [{**DSP, "preset": "heritage"}]}, "sensors[0].preset"),
    ({"sensors": [DSP], "preset": "heritage"}, "preset"),
    ({"sensors": [{**DSP, "model": "GOES-ABI"}]}, "sensors[0]"),
    ({"sources": [FLARE]}, "sources"),
    ({"detection": {"model": "auto", "exact": True}}, "detection.exact"),
    ({"detection": "auto", "atmosphere": "lowtran"}, "atmosphere"),
]

#: Changes that describe none.
DARK: list[dict[str, Any]] = [
    {},
    {"detection": "auto"},
    {"detection": {"model": "auto", "band_confirmation": 0.5}},
    {"atmosphere": "clear", "background": "none", "sources": []},
    {"sensors": [{**SBIRS, "detection_probability": {"ICBM": 0.5}, "scan_period_ms": 100.0}]},
    {"sensors": [DSP], "preset": "paper"},
]


def scene(**changes: Any) -> opir.Scene:
    mapping = {
        "scene": "auto",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 5.0,
        "sensors": [SBIRS],
        "targets": [TARGET],
    }
    return opir.scene_from_mapping({**mapping, **changes})


@pytest.mark.parametrize(("changes", "path"), LIGHT, ids=str)
def test_described_light_chooses_the_model_that_reads_it(
    changes: dict[str, Any], path: str
) -> None:
    checked_scene = scene(**changes)
    assert checked_scene.detection.name == "snr"
    assert checked_scene.classification.name == "spectral"
    assert checked_scene.automatic == [f"detection: snr, since the scene describes light: {path}"]


@pytest.mark.parametrize("changes", DARK, ids=str)
def test_a_scene_without_light_has_constant_probability(
    changes: dict[str, Any],
) -> None:
    checked_scene = scene(**changes)
    assert (checked_scene.detection.name, checked_scene.classification.name) == (
        "constant",
        "paper",
    )
    assert checked_scene.automatic == ["detection: constant, since the scene describes no light"]


@pytest.mark.parametrize("name", ["constant", "snr", "never"])
def test_a_model_that_is_named_stays_and_nothing_is_said(name: str) -> None:
    for changes in ({}, {"atmosphere": "lowtran"}):
        checked_scene = scene(detection=name, **changes)
        assert (checked_scene.detection.name, checked_scene.automatic) == (name, [])


def test_a_scene_written_out_is_read_as_the_same_scene() -> None:
    for changes in (*DARK, LIGHT[0][0], LIGHT[4][0], LIGHT[6][0]):
        checked_scene = scene(**changes)
        same_scene = opir.scene_from_mapping(scene_mapping(checked_scene))
        assert same_scene == checked_scene
        assert same_scene.automatic == []


def test_defaults_written_out_describe_no_light() -> None:
    plain = {
        key: value
        for key, value in scene_mapping(scene()).items()
        if key not in ("detection", "classification")
    }
    assert opir.scene_from_mapping(plain).detection.name == "constant"


def test_overrides_count(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps({**_plain(), "sensors": [SBIRS]}), encoding="utf-8")
    for override in (
        "atmosphere=lowtran",
        "detection.exact=true",
        "sensors[0].threshold_sigma=5.0",
    ):
        assert opir.load_scene(path, overrides=[override]).detection.name == "snr"
    scene_with_overrides = opir.load_scene(
        path, overrides=["atmosphere=lowtran", "classification.launches=16"]
    )
    assert (
        scene_with_overrides.classification.name,
        scene_with_overrides.classification.config.launches,
    ) == (
        "spectral",
        16,
    )
    assert (
        opir.load_scene(path, overrides=["detection.band_confirmation=0.5"]).detection.name
        == "constant"
    )


def _plain() -> dict[str, Any]:
    return {
        "scene": "auto",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 5.0,
        "targets": [TARGET],
    }


@pytest.mark.parametrize(
    ("changes", "path"),
    [
        ({"threshold_sigma": 4.0}, "sensors[0].threshold_sigma"),
        ({"preset": "heritage"}, "sensors[0].preset"),
    ],
)
def test_without_a_model_that_reads_light_the_scene_is_refused(
    changes: dict[str, Any], path: str
) -> None:
    host = Host.discover(["dsp"])
    with pytest.raises(SceneError) as caught:
        opir.scene_from_mapping({**_plain(), "sensors": [{**DSP, **changes}]}, host=host)
    (problem,) = caught.value.problems
    assert problem.path == path
    assert "python -m pip install" in problem.message
    assert "./plugins/opir_photons" in problem.message


def test_a_missing_atmosphere_model_is_the_only_complaint() -> None:
    with pytest.raises(PluginError, match="no atmosphere model is named 'lowtran'"):
        opir.scene_from_mapping(
            {**_plain(), "sensors": [DSP], "atmosphere": "lowtran"}, host=Host.discover(["dsp"])
        )


def test_the_message_names_the_model_that_reads_light() -> None:
    host = Host.discover()
    for subject, entry in READERS.items():
        kind, _, name = entry.partition(".")
        declared = [
            detection_name
            for detection_name in host.names(f"opir_{kind}")
            if subject in (_reads(host, f"opir_{kind}", detection_name))
        ]
        assert declared == [name]
        assert sum(entry in entries for entries in PACKAGES.values()) == 1


def _reads(host: Host, hook: str, name: str) -> Any:
    component = host.component(hook, name)
    return component.subjects_read(component.config()) or ()


def test_explanation_summary_and_manifest_tell_the_model() -> None:
    checked_scene = scene(sensors=[{**SBIRS, "threshold_sigma": 6.0}])
    run = opir.simulate(checked_scene)
    line = "detection: snr, since the scene describes light: sensors[0].threshold_sigma"
    assert explained(run.plan)["automatic"] == run.summary["automatic"] == [line]
    assert run.manifest["scene"]["detection"]["model"] == "snr"
    repeated_run = opir.simulate(opir.scene_from_mapping(run.manifest["scene"]))
    assert repeated_run.detections.detection_id.tobytes() == run.detections.detection_id.tobytes()


def test_dsp_starts_from_its_preset_for_light() -> None:
    def period_ms(sensor: dict[str, Any], **changes: Any) -> float:
        return scene(sensors=[sensor], **changes).sensors[0].model.config.scan_period_ms

    fleet = {"constellation": "DSP"}
    assert period_ms(DSP) == period_ms(fleet) == 200.0
    assert period_ms(DSP, detection="snr") == period_ms(fleet, atmosphere="lowtran") == 10_000.0
    assert period_ms({**DSP, "preset": "paper"}, detection="snr") == 200.0
    assert period_ms(DSP, detection="snr", preset="paper") == 200.0
    assert period_ms({**DSP, "scan_period_ms": 5000.0}, detection="snr") == 5000.0
    assert period_ms(DSP, detection="constant", atmosphere="lowtran") == 200.0


def test_a_preset_gives_nothing_to_bands_that_the_scene_replaces() -> None:
    config = (
        scene(sensors=[{**DSP, "bands": {"SWIR": [2.6, 2.9]}}], detection="snr")
        .sensors[0]
        .model.config
    )
    assert dict(config.band_focal_plane) == {}
    settings = {"bands": {"SWIR": [2.6, 2.9]}, "band_focal_plane": {"MWIR": {"bits": 8}}}
    with pytest.raises(
        SceneError, match=r"band_focal_plane: MWIR is not one of the sensor's bands"
    ):
        scene(sensors=[{**DSP, **settings}], detection="snr")
