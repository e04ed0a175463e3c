"""The paper's three constellations: its tables, their fleets, and that they are plugins as an
outsider writes them.
"""

import ast
import importlib
import math
import subprocess
import sys
import tomllib
from importlib.util import find_spec

import numpy as np
import pytest
import yaml
from attrs import evolve
from repository import ROOT
from scipy.stats import binom

import opir_core.plugin
from opir_core import Host
from opir_core.host.components import CATALOGUE
from opir_core.plugin import (
    REPORTED_TYPES,
    TARGET_TYPES,
    ClassifierInputs,
    ClassifierModel,
    DetectionModel,
    FocalPlaneConfig,
    ModelContext,
    SensorContext,
)
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene.fields import field_infos

PACKAGES = {"DSP": "opir_dsp", "SBIRS-GEO": "opir_sbirs", "NEXTGEN-GEO": "opir_nextgen"}
HEAVY = ("numpy", "scipy", "cattrs", "msgspec", "yaml")

for package in PACKAGES.values():
    # Where the plugins are not installed, their sources are tested.
    if find_spec(package) is None:
        sys.path.append(str(ROOT / "plugins" / package))

SWIR = ("SWIR", 2.5, 3.0)
MWIR = ("MWIR", 4.0, 5.0)
LWIR = ("LWIR", 8.0, 12.0)

#: Bands, scan pattern, period in ms, probability of detection of an ICBM, susceptibility to false
#: alarms, and discrimination: opir-simulator paper (2026), tables of sections 3.1 to 3.4.
PAPER = {
    "DSP": ([LWIR], "spin", 200.0, 0.60, "high", "none"),
    "SBIRS-GEO": ([SWIR, MWIR], "step-stare", 100.0, 0.80, "moderate", "dual-band-ratio"),
    "NEXTGEN-GEO": ([SWIR, MWIR, LWIR], "staring", 50.0, 0.95, "low", "triple-coincidence"),
}

ALL = pytest.mark.parametrize("name", PACKAGES)


def plugin_of(name):
    return importlib.import_module(f"{PACKAGES[name]}.plugin")


def model_of(name):
    (model,) = plugin_of(name).opir_sensor_models()
    return model


def fleet_of(name):
    (fleet,) = plugin_of(name).opir_constellations()
    return fleet


def sensor_of(name, **settings):
    model = model_of(name)
    config = model.config(**{"orbital_slot_deg": 0.0, **settings})
    return model.build(config, SensorContext(id=f"{name}-1", epoch_us=0))


def built(kind, name, sensors):
    """Return a model of the core for sensors and a target of each type."""
    model = Host.of().component(kind, name)
    codes = np.arange(len(TARGET_TYPES), dtype=np.uint8)
    return model.build(model.config(), ModelContext(sensors=tuple(sensors), target_type_code=codes))


@ALL
def test_a_model_has_the_papers_values(name):
    bands, pattern, period_ms, probability, susceptibility, discrimination = PAPER[name]
    sensor = sensor_of(name)
    assert sensor.type == model_of(name).name == name
    assert [(band.name, band.lower_um, band.upper_um) for band in sensor.bands] == bands
    assert sensor.settings["scan_pattern"] == pattern
    assert sensor.scan.period_ns == period_ms * 1_000_000
    assert sensor.detection_probability["ICBM"] == probability
    assert sensor.false_alarm_susceptibility == susceptibility
    by_name = sensor_of(name, **model_of(name).presets["paper"])
    assert by_name.spectral_discrimination == discrimination
    assert by_name.radiometer.threshold == 5.0
    assert sensor.spectral_discrimination == ("none" if len(bands) == 1 else "likelihood")


@ALL
def test_values_cite_the_paper_or_are_called_notional(name):
    infos = field_infos(model_of(name).config)
    papers = (
        "bands",
        "scan_pattern",
        "scan_period_ms",
        "false_alarm_susceptibility",
        "spectral_discrimination",
    )
    assert all("opir-simulator paper" in infos[field].source for field in papers)
    assert infos["detection_probability"].source.endswith("IRBM, SRBM: notional")
    assert infos["confusion"].source == infos["line_of_sight_sigma_urad"].source == "notional"


@ALL
def test_detection_falls_with_size_and_rises_with_sensors(name):
    sensor = sensor_of(name)
    by_size = [sensor.detection_probability[target] for target in TARGET_TYPES]
    assert by_size == sorted(by_size, reverse=True)
    order = [sensor_of(each) for each in PACKAGES]
    for target in TARGET_TYPES:
        seen = [each.detection_probability[target] for each in order]
        right = [each.confusion[target][target] for each in order]
        assert seen == sorted(set(seen))
        assert right == sorted(set(right))
    sigmas = [each.line_of_sight_sigma_rad for each in order]
    assert sigmas == pytest.approx([5e-5, 2e-5, 1e-5])


@ALL
def test_rows_of_the_confusion_matrix_sum_to_1(name):
    confusion = sensor_of(name).confusion
    assert list(confusion) == list(TARGET_TYPES)
    for row in confusion.values():
        assert set(row) == set(REPORTED_TYPES)
        assert math.fsum(row.values()) == pytest.approx(1.0, abs=1e-12)
        assert row["UNKNOWN"] > 0.0


class SeededDice:
    """Uniform numbers, one a row."""

    def __init__(self, rows):
        self.rows = rows

    def pair_uniforms(self, purpose, words=1):
        return np.random.default_rng(2026).random((self.rows, words))


@ALL
@pytest.mark.parametrize("true_type", TARGET_TYPES)
def test_what_is_reported_follows_the_matrix(name, true_type):
    rows = 30_000
    sensor = sensor_of(name)
    classifier = built(ClassifierModel, "paper", [sensor])
    index = np.zeros(rows, np.int32)
    floats = np.zeros(rows)
    target = np.full(rows, TARGET_TYPES.index(true_type), dtype=np.int32)
    mask = np.ones(rows, np.uint8)
    count = np.ones(rows, np.int64)
    seen = ClassifierInputs(
        floats,
        index,
        target,
        floats,
        floats,
        mask,
        count,
        count,
        index,
        floats,
        np.empty((rows, 0)),
    )
    codes = classifier.reported_type(seen, SeededDice(rows))
    for code, reported in enumerate(REPORTED_TYPES):
        low, high = binom.interval(0.999, rows, sensor.confusion[true_type][reported])
        assert low <= np.count_nonzero(codes == code) <= high


def test_the_models_work_with_the_constant_detection():
    model = built(DetectionModel, "constant", [sensor_of(name) for name in PACKAGES])
    icbm = model.pair_probability(np.arange(3, dtype=np.int32), np.zeros(3, dtype=np.int32))
    assert icbm.tolist() == [0.60, 0.80, 0.95]


@ALL
def test_a_fleet_is_spread_evenly_and_carries_its_own_model(name):
    fleet = fleet_of(name)
    assert fleet.name == fleet.model == name
    assert [satellite["id"] for satellite in fleet.satellites] == [
        f"{name}-{number}" for number in range(1, 5)
    ]
    slots = [satellite["orbital_slot_deg"] for satellite in fleet.satellites]
    assert np.diff(slots).tolist() == [90.0] * 3
    for satellite in fleet.satellites:
        sensor_of(name, orbital_slot_deg=satellite["orbital_slot_deg"])


def test_no_two_satellites_share_a_slot_or_an_id():
    satellites = [satellite for name in PACKAGES for satellite in fleet_of(name).satellites]
    assert len({satellite["orbital_slot_deg"] for satellite in satellites}) == len(satellites) == 12
    assert len({satellite["id"] for satellite in satellites}) == 12


def test_the_heritage_preset_has_the_public_figures():
    heritage = dict(model_of("DSP").presets["heritage"])
    sensor = sensor_of(
        "DSP", **{**heritage, "focal_plane": FocalPlaneConfig(**heritage["focal_plane"])}
    )
    assert sensor.radiometer.focal_planes[0].detector_temperature_k == 193.0
    assert sensor.scan.period_ns == 10_000_000_000
    assert type(sensor.scan).__name__ == "SpinSweep"
    (short, middle) = sensor.bands
    assert short.lower_um < 2.7 < short.upper_um
    assert middle.lower_um < 4.3 < middle.upper_um
    assert sensor.detection_probability["ICBM"] == 0.60


@ALL
def test_the_paper_preset_aligns_scans(name):
    assert type(sensor_of(name).scan).__name__ in ("SpinSweep", "StepStareSweep")
    assert model_of(name).presets["paper"]["scan_phase"] == "aligned"
    scan = sensor_of(name, **model_of(name).presets["paper"]).scan
    assert type(scan).__name__ == "AlignedScan"


@ALL
def test_the_scene_lines_of_the_readme_are_read(name):
    readme = (ROOT / "plugins" / PACKAGES[name] / "README.md").read_text(encoding="utf-8")
    lines = yaml.safe_load(readme.partition("```yaml\n")[2].partition("```")[0])
    head = {
        "scene": "readme",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 1.0,
        "seed": 1,
        "targets": [],
    }
    scene = scene_from_mapping({**head, **lines}, host=Host.of(plugin_of(name)))
    assert [sensor.constellation for sensor in scene.sensors] == [name] * 4 + [None]
    settings = {
        key: value
        for key, value in lines["sensors"][-1].items()
        if key not in ("model", "id", "preset")
    }
    assert settings == {key: getattr(scene.sensors[-1].model.config, key) for key in settings}


def test_a_scene_may_override_a_preset_and_a_fleet():
    sensors = [
        {"constellation": "DSP", "preset": "heritage", "scan_phase": "random"},
        {"constellation": "SBIRS-GEO", "detection_probability": {"SRBM": 0.1}},
    ]
    head = {
        "scene": "s",
        "epoch": "2026-04-01T12:00:00Z",
        "detection": "constant",
        "duration_s": 1.0,
        "seed": 1,
        "targets": [],
    }
    host = Host.of(plugin_of("DSP"), plugin_of("SBIRS-GEO"))
    scene = scene_from_mapping({**head, "sensors": sensors}, host=host)
    dsp = scene.sensors[0].model
    sbirs = scene.sensors[4].model
    assert (dsp.config.scan_period_ms, dsp.config.scan_phase) == (10_000.0, "random")
    built = model_of("SBIRS-GEO").build(sbirs.config, SensorContext(id="S", epoch_us=0))
    assert built.detection_probability == {"ICBM": 0.80, "IRBM": 0.72, "SRBM": 0.1}


@ALL
def test_a_plugin_imports_only_public_names_of_the_core(name):
    source = ROOT / "plugins" / PACKAGES[name] / PACKAGES[name]
    for path in source.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert not any(alias.name.startswith("opir_core") for alias in node.names), path
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("opir_core"):
                assert node.module == "opir_core.plugin", path
                assert {alias.name for alias in node.names} <= set(opir_core.plugin.__all__), path


@ALL
def test_a_plugin_module_imports_nothing_heavy(name):
    package = PACKAGES[name]
    paths = [str(ROOT), str(ROOT / "plugins" / package)]
    code = (
        f"import sys; sys.path[:0] = {paths!r}; import {package}.plugin as p;"
        " list(p.opir_sensor_models()), list(p.opir_constellations()); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {module.partition(".")[0] for module in done.stdout.split()}
    assert loaded.isdisjoint(HEAVY), loaded & set(HEAVY)
    assert {other for other in loaded if other in PACKAGES.values()} == {package}


@ALL
def test_a_plugin_advertises_what_it_offers(name):
    package = PACKAGES[name]
    project = tomllib.loads(
        (ROOT / "plugins" / package / "pyproject.toml").read_text(encoding="utf-8")
    )["project"]
    module = f"{package}.plugin"
    assert project["entry-points"]["opir"] == {package.removeprefix("opir_"): module}
    offered = {
        f"{hook.removeprefix('opir_')}.{component.name}"
        for hook in CATALOGUE
        for component in getattr(plugin_of(name), hook, tuple)()
    }
    assert project["entry-points"]["opir.components"] == dict.fromkeys(offered, module)
    assert "opir-core>=0.1,<0.2" in project["dependencies"]
    assert project["version"] == "0.1.0"


def test_a_nested_setting_changes_the_preset_not_the_default():
    sensors = [
        {"model": "DSP", "preset": preset, "id": f"{preset}-{name}", "orbital_slot_deg": 0.0, **own}
        for preset in ("heritage", "paper")
        for name, own in (("plain", {}), ("small", {"focal_plane": {"aperture_m": 0.5}}))
    ]
    head = {"scene": "s", "epoch": "2026-04-01T12:00:00Z", "detection": "constant"}
    scene = scene_from_mapping({**head, "duration_s": 1.0, "sensors": sensors, "targets": []})
    planes = [sensor.model.config.focal_plane for sensor in scene.sensors]
    heritage, small_heritage, paper, small_paper = planes
    assert small_heritage == evolve(heritage, aperture_m=0.5)
    assert small_paper == evolve(paper, aperture_m=0.5)
    assert heritage.detector_temperature_k != paper.detector_temperature_k
    assert scene_from_mapping(scene_mapping(scene)) == scene
