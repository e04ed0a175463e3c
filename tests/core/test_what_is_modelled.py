"""The page of what is modelled: every default of every configuration class, with a source or the word notional."""

import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from attrs import fields, has

from opir_core.plugin.components import CATALOGUE, Component
from opir_core.plugin.description import FieldRow, field_rows, nested_config
from opir_core.plugin.host import Host
from opir_core.radiometry.source_configs import SourceConfig
from opir_core.scene.fields import METADATA_KEY
from opir_core.scene.reading.scene_schema import SceneFile
from opir_core.scene.scene import SceneDrag
from opir_core.scene.spool_settings import SpoolConfig
from opir_core.sensors.radiometer import RadiometerConfig
from opir_core.sensors.scanning_sensor import ScanningSensorConfig

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "what-is-modelled.md"
PLUGINS = ("dsp", "sbirs", "nextgen", "heo", "leo", "kafka", "stonesoup")
#: What others are made of: no scene names them.
BASES = {RadiometerConfig, ScanningSensorConfig, SourceConfig}


def told() -> dict[str, type]:
    """Return the configuration classes that a scene or a user may set, by what the page calls them."""
    from opir_http.settings import HttpSettings

    host = Host.discover(PLUGINS)
    offered = [host.component(hook, name) for hook in CATALOGUE for name in host.names(hook)]
    components = {f"{each.kind} `{each.name}`": each.config for each in offered if isinstance(each, Component)}
    others = {"a scene": SceneFile, "`forces: [{drag: ...}]`": SceneDrag, "an output's `spool`": SpoolConfig}
    return {**components, **others, "`opir serve`": HttpSettings}


def defaults(config: type) -> Iterator[FieldRow]:
    """Yield what has a value by default; what stands below a block that is none has not."""
    unset: tuple[str, ...] = ()
    for row in field_rows(config):
        if row.default is None and not row.is_required:
            unset += (f"{row.key}.",)
        elif not row.is_required and not row.key.startswith(unset):
            yield row


@pytest.fixture(scope="module")
def lines() -> dict[tuple[str, str], list[str]]:
    """Return the page's defaults, value and source, by component and key."""
    table = PAGE.read_text(encoding="utf-8").split("## Every default")[1]
    cells = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")][1:]
    return {(row[0], row[1]): row[2:] for row in cells}


def test_every_default_is_on_the_page_as_it_is_and_says_where_it_comes_from(
    lines: dict[tuple[str, str], list[str]],
) -> None:
    expected = {(name, f"`{row.key}`"): row for name, config in told().items() for row in defaults(config)}
    assert set(lines) == set(expected)
    assert len(lines) > 250
    for place, row in expected.items():
        value, source = lines[place]
        assert value == f"`{row.default_text}`", place
        assert source.strip() == row.source.strip() != "", place


def test_no_configuration_class_is_left_out() -> None:
    reached: set[type] = set()
    for config in told().values():
        reach(config, reached)
    found = {
        one for package in ("opir_core", *(f"opir_{name}" for name in (*PLUGINS, "http"))) for one in configs(package)
    }
    assert found - reached == BASES
    assert len(reached) > 30


def reach(config: type, reached: set[type]) -> None:
    """Add a configuration class and all that it holds."""
    if config not in reached:
        reached.add(config)
        hints = get_type_hints(config)
        for inner in (nested_config(hints[each.name]) for each in fields(config)):
            if inner is not None:
                reach(inner, reached)


def configs(package: str) -> Iterator[type]:
    """Yield all configuration classes of a package's modules."""
    root: Any = importlib.import_module(package)
    for found in pkgutil.walk_packages(root.__path__, f"{package}."):
        if found.name.rpartition(".")[2] != "__main__":
            for one in vars(importlib.import_module(found.name)).values():
                if isinstance(one, type) and has(one) and any(METADATA_KEY in each.metadata for each in fields(one)):
                    yield one


def test_every_part_of_the_chain_says_how_it_is_had() -> None:
    chain = PAGE.read_text(encoding="utf-8").split("## The chain")[1].split("## Every default")[0]
    rows = [line.split(" | ") for line in chain.splitlines() if line.startswith("| ") and not line.startswith("| part")]
    assert len(rows) > 10
    assert {row[1] for row in rows} == {"computed", "tabulated", "notional"}
    assert all(len(row) == 4 and all(row) for row in rows)
