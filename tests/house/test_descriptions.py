"""What `opir describe` says of a component in words agrees with the values beside the words."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from attrs import NOTHING, fields, has

from opir_core.host.components import CATALOGUE, Constellation, SensorModel
from opir_core.host.host import Host
from opir_core.scene.fields import info_of
from opir_core.scene.scene import TARGET_TYPES
from opir_core.sensors.scanning_sensor import SCAN_PATTERNS, ScanningSensorConfig

HOST = Host.discover()
ROOT = Path(__file__).parents[2]
EVERY = {
    f"{kind.kind} {name}": HOST.component(kind, name)
    for hook, kind in CATALOGUE.items()
    for name in HOST.names(hook)
}
SENSORS = {
    name: each
    for name, each in EVERY.items()
    if isinstance(each, SensorModel) and issubclass(each.config, ScanningSensorConfig)
}
#: How each rule over bands is known, and words of a sensor that are a setting's to say.
RULES = {
    "likelihood": "likelihood",
    "none": "any band",
    "dual-band-ratio": "dual-band ratio",
    "triple-coincidence": "triple-coincidence",
}
SETTING_WORDS = (
    *SCAN_PATTERNS,
    *RULES.values(),
    "ratio",
    "coincidence",
    "-band",
    "bands",
    "spinning",
    "stare",
    "wave",
)


def default(sensor, name):
    return getattr(fields(sensor.config), name).default


def each_field(config):
    """Yield the fields of a class of settings, and those of the blocks that it has by default."""
    for field in fields(config):
        yield field
        if has(type(field.default)):
            yield from each_field(type(field.default))


@pytest.mark.parametrize("name", SENSORS)
def test_a_sensor_is_described_by_its_defaults(name):
    sensor = SENSORS[name]
    model, _, stated = sensor.summary.rpartition(": ")
    for band, (low_um, high_um) in default(sensor, "bands").items():
        assert f"{band} {low_um:g}-{high_um:g}" in stated
    assert [scan_pattern for scan_pattern in SCAN_PATTERNS if scan_pattern in stated] == [
        default(sensor, "scan_pattern")
    ]
    assert f" {1e-3 * default(sensor, 'scan_period_ms'):g} s;" in stated
    rules = [rule for rule, words in RULES.items() if words in stated]
    assert rules == (
        [default(sensor, "spectral_discrimination")] if len(default(sensor, "bands")) > 1 else []
    )
    assert model
    assert not [word for word in SETTING_WORDS if word in model.lower()], (
        "a setting's words come from its value"
    )
    assert not re.search(r"\d (?:u?m|ms|s)\b", model)


def test_a_fleet_is_described_by_its_satellites():
    fleets = [pattern for pattern in EVERY.values() if isinstance(pattern, Constellation)]
    assert len(fleets) >= 6
    for fleet in fleets:
        assert fleet.summary.startswith(f"{len(fleet.satellites)} {fleet.model} satellites")
        patterns = [
            satellite["orbit"]["walker"]
            for satellite in fleet.satellites
            if "walker" in satellite.get("orbit", {})
        ]
        for pattern in patterns:
            place = (
                f"{pattern['inclination_deg']:g} deg:"
                f" {pattern['total']}/{pattern['planes']}/{pattern['phasing']}"
            )
            assert f"{place} at {pattern['altitude_km']:g} km" in fleet.summary


@pytest.mark.parametrize("name", EVERY)
def test_words_beside_a_default_are_of_that_default(name):
    component = EVERY[name]
    config = getattr(component, "config", None)
    if config is None or not has(config):
        return
    for field in each_field(config):
        info = info_of(field)
        if re.search(r"\bdefault: |\bby default\b", info.help):
            assert field.default is None, (
                f"{field.name}: the help speaks of a default that is not {field.default!r}"
            )
        value, colon, _ = info.source.partition(": ")
        is_scalar = isinstance(field.default, str | int | float)
        if (
            is_scalar
            and colon
            and (value in info.choices or re.fullmatch(r"-?\d+(\.\d+)?|true|false", value))
        ):
            assert value == _written(field.default), f"{field.name}: {info.source}"
        for preset, remainder in re.findall(r"preset (\w+): ([^,;]+)", info.source):
            assert _written(component.presets[preset][field.name]) == remainder


#: What the page of a sensor's package says in its table, and the setting that has the value.
ROWS: dict[str, tuple[str, Callable[[str], object]]] = {
    "bands": (
        "bands",
        lambda text: {name: (float(a), float(b)) for name, a, b in re.findall(_BAND, text)},
    ),
    "scan": ("scan_pattern", lambda text: text.partition(",")[0]),
    "threshold": ("threshold_sigma", lambda text: float(text.removesuffix(" σ"))),
    "line-of-sight error": (
        "line_of_sight_sigma_urad",
        lambda text: float(text.removesuffix(" µrad")),
    ),
    "IFOV (resolution cell)": ("ifov_urad", lambda text: float(text.removesuffix(" µrad"))),
    "false-alarm susceptibility": ("false_alarm_susceptibility", str),
    "spectral discrimination": ("spectral_discrimination", lambda text: text.partition(":")[0]),
    "field of regard": (
        "field_of_regard_half_angle_deg",
        lambda text: float(text.partition("°")[0]),
    ),
    "P_d per look, ICBM / IRBM / SRBM": (
        "detection_probability",
        lambda text: dict(zip(TARGET_TYPES, map(float, text.split(" / ")), strict=True)),
    ),
}
_BAND = r"(\w+) ([\d.]+)–([\d.]+) µm"
PAGES = {
    "opir_dsp": ["DSP"],
    "opir_sbirs": ["SBIRS-GEO"],
    "opir_nextgen": ["NEXTGEN-GEO"],
    "opir_heo": ["HEO"],
    "opir_leo": ["LEO-WIDE", "LEO-MEDIUM"],
}


@pytest.mark.parametrize("package", PAGES)
def test_the_page_of_a_sensor_has_its_defaults(package):
    text = (ROOT / "plugins" / package / "README.md").read_text(encoding="utf-8")
    table = [line.strip("| \n").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    checked = 0
    for name, *cells in table:
        if name not in ROWS:
            continue
        setting, value = ROWS[name]
        for model, cell in zip(PAGES[package], cells, strict=False):
            sensor = SENSORS[f"sensor model {model}"]
            assert value(cell) == default(sensor, setting), f"{model} {setting}"
            if name == "scan":
                assert cell.endswith(f"{default(sensor, 'scan_period_ms'):g} ms")
            checked += 1
    assert checked >= 5


def _written(value):
    if isinstance(value, bool) or value is NOTHING:
        return str(value).lower()
    return f"{value:g}" if isinstance(value, int | float) else str(value)
