"""The pages of what is modelled and left out, and every default with a source or the word
notional.
"""

import csv
import importlib
import pkgutil
from typing import get_type_hints

import pytest
from attrs import fields, has
from opir_displays.settings import DatagramConfig
from opir_photons.movers.configs import MoverConfig
from opir_photons.radiometry.source_configs import PlacedConfig, SourceConfig
from repository import ROOT

from opir_core.builtin.configs import PlaceConfig
from opir_core.host.components import CATALOGUE, Component
from opir_core.host.host import Host
from opir_core.reading.scene_schema import SceneFile
from opir_core.scene.field_rows import field_rows, nested_config
from opir_core.scene.fields import METADATA_KEY
from opir_core.scene.links import Links
from opir_core.scene.scene import SceneDrag, SpoolConfig
from opir_core.sensors.pointed_sensor import PointedSensorConfig, SteeredSensorConfig
from opir_core.sensors.radiometer import RadiometerConfig
from opir_core.sensors.scanning_sensor import ScanningSensorConfig

PAGES = ROOT / "docs" / "explanation"
LABELS = {"computed", "tabulated", "notional"}
PHOTONS = ("classification", "detection", "imagers", "movers", "radiometry")
PLUGINS = (
    *(
        "dsp",
        "sbirs",
        "nextgen",
        "heo",
        "leo",
        "trackers",
        "kafka",
        "displays",
        "stonesoup",
        "readers",
        "export",
        "studies",
        "dask",
        "coverage",
    ),
)
#: What others are made of: no scene names them.
BASES = {
    DatagramConfig,
    MoverConfig,
    PlaceConfig,
    PlacedConfig,
    PointedSensorConfig,
    RadiometerConfig,
    ScanningSensorConfig,
    SourceConfig,
    SteeredSensorConfig,
}


def settable():
    """Return the configuration classes that a scene or a user may set, by their names in the table
    of defaults.
    """
    from opir_http.settings import HttpSettings
    from opir_readers.orbits.fleet_config import FleetConfig
    from opir_studies import Study

    host = Host.discover((*PHOTONS, *PLUGINS))
    offered = [host.component(hook, name) for hook in CATALOGUE for name in host.names(hook)]
    components = {
        f"{component.kind} {component.name}": component.config
        for component in offered
        if isinstance(component, Component)
    }
    records = {
        "scene": SceneFile,
        "forces: [{drag: ...}]": SceneDrag,
        "links": Links,
        "output's spool": SpoolConfig,
    }
    records["sensors: [{fleet: ...}]"] = FleetConfig
    return {**components, **records, "opir serve": HttpSettings, "study": Study}


def defaults(config):
    """Yield what has a value by default; what stands below a block that is none has not."""
    unset = ()
    for row in field_rows(config):
        if row.default is None and not row.is_required:
            unset += (f"{row.key}.",)
        elif not row.is_required and not row.key.startswith(unset):
            yield row


@pytest.fixture(scope="module")
def listed():
    """Return value and source of the listed defaults, by component and key."""
    with (PAGES / "defaults.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    result = {(row["component"], row["key"]): (row["default"], row["source"]) for row in rows}
    assert len(result) == len(rows)
    return result


def test_every_default_is_listed_with_its_value_and_source(
    listed,
):
    expected = {
        (name, row.key): row for name, config in settable().items() for row in defaults(config)
    }
    assert set(listed) == set(expected)
    assert len(listed) > 250
    for place, row in expected.items():
        value, source = listed[place]
        assert value == row.default_text, place
        assert source == row.source, place
        assert source.strip(), place


def test_the_page_counts_the_listed_defaults(
    listed,
):
    text = " ".join((PAGES / "what-is-modelled.md").read_text(encoding="utf-8").split())
    notional = sum(source == "notional" for _, source in listed.values())
    assert f"All {len(listed)} defaults" in text
    assert f"{notional} of them are notional" in text


def test_no_configuration_class_is_left_out():
    reached = set()
    for config in settable().values():
        reach(config, reached)
    plugins = (f"opir_{name}" for name in (*PLUGINS, "http"))
    packages = ("opir_core", "opir_photons", *plugins)
    result = {config for package in packages for config in configs(package)}
    assert result - reached == BASES
    assert len(reached) > 30


def reach(config, reached):
    """Add a configuration class and all that it holds."""
    if config not in reached:
        reached.add(config)
        hints = get_type_hints(config)
        for inner in (nested_config(hints[field.name]) for field in fields(config)):
            if inner is not None:
                reach(inner, reached)


def configs(package):
    """Yield all configuration classes of a package's modules."""
    root = importlib.import_module(package)
    for result in pkgutil.walk_packages(root.__path__, f"{package}."):
        if result.name.rpartition(".")[2] != "__main__":
            for var in vars(importlib.import_module(result.name)).values():
                if (
                    isinstance(var, type)
                    and has(var)
                    and any(METADATA_KEY in field.metadata for field in fields(var))
                ):
                    yield var


def table(page, head):
    """Return the cells of the table whose head begins with some text."""
    lines = (PAGES / page).read_text(encoding="utf-8").splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(head)) + 2
    end = next(number for number in range(start, len(lines)) if not lines[number].startswith("|"))
    return [line.strip("| ").split(" | ") for line in lines[start:end]]


def test_every_part_has_a_label_and_a_model():
    rows = table("what-is-modelled.md", "| part |")
    assert 10 < len(rows) <= 20
    assert {row[1] for row in rows} == LABELS
    assert all(len(row) == 3 and all(row) for row in rows)


def test_every_part_says_what_it_omits_and_the_error_of_that():
    rows = table("what-is-left-out.md", "| part |")
    assert [row[0] for row in rows] == [row[0] for row in table("what-is-modelled.md", "| part |")]
    assert all(len(row) == 3 and all(row) for row in rows)
