"""The range of plugin interfaces that a plugin declares: read from metadata, told by `opir plugins`, insisted on."""

import sys
from collections.abc import Callable

import pytest

from opir_core._version import __version__
from opir_core.errors import PluginError
from opir_core.plugin.api import API_VERSION, ApiRange
from opir_core.plugin.components import PluginRow
from opir_core.plugin.host import Host


@pytest.mark.parametrize(
    ("text", "words", "inside", "outside"),
    [
        ("1", "1.0 to 1.x", [(1, 0), (1, 99)], [(0, 9), (2, 0)]),
        ("1.2", "1.2 to 1.x", [(1, 2), (1, 3)], [(1, 1), (2, 2)]),
        ("1.2-3", "1.2 to 3.x", [(1, 2), (2, 0), (3, 50)], [(1, 1), (4, 0)]),
        ("1.2-3.4", "1.2 to 3.4", [(1, 2), (3, 4)], [(1, 1), (3, 5)]),
    ],
)
def test_ranges(text: str, words: str, inside: list[tuple[int, int]], outside: list[tuple[int, int]]) -> None:
    declared = ApiRange.of(text)
    assert str(declared) == words
    assert all(declared.admits(version) for version in inside)
    assert not any(declared.admits(version) for version in outside)


@pytest.mark.parametrize("text", ["", "one", ">=1", "1.", "1.0.0", "1-", "2-1", "1.3-1.2", "-1"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="declares the plugin API"):
        ApiRange.of(text)


def install(shop: object, code: str, *declared: str, name: str = "other") -> None:
    module = f"opir_{name}.plugin"
    groups = {"opir": {name: module}, "opir.api": dict.fromkeys(declared, module)}
    shop.install(name, code, version="2.0", entry_points=groups)  # type: ignore[attr-defined]


def row_of(plugin: str) -> PluginRow:
    return next(row for row in Host.discover().catalogue() if row.plugin == plugin)


def test_a_plugin_in_range_is_used_and_its_range_shown(shop: object, trackers: Callable[..., str]) -> None:
    install(shop, trackers("arc"), "1.0-2")
    assert Host.discover().component("opir_trackers", "arc").name == "arc"
    assert row_of("other").api == "1.0-2"


def test_a_plugin_that_declares_nothing_is_used(shop: object, trackers: Callable[..., str]) -> None:
    install(shop, trackers("arc"))
    assert Host.discover().component("opir_trackers", "arc").name == "arc"
    assert row_of("other").api == ""


def test_a_plugin_for_another_api_is_refused_without_being_imported(shop: object, trackers: Callable[..., str]) -> None:
    install(shop, trackers("arc"), "2.1")
    sentence = (
        f"opir-other 2.0 (plugin other): is written for plugin API 2.1 to 2.x, and opir-core {__version__} has 1.0;"
        " install an opir-core that has it, or a release of opir-other for API 1.0"
    )
    with pytest.raises(PluginError) as error:
        Host.discover().component("opir_trackers", "arc", "tracker")
    assert f"failed: {sentence}" in str(error.value)
    assert "opir_other" not in sys.modules
    row = row_of("other")
    assert (row.state, row.api, f"opir-other 2.0 (plugin other): {row.failure}") == ("failed", "2.1", sentence)


@pytest.mark.parametrize(
    ("declared", "complaint"),
    [
        (["banana"], "declares the plugin API 'banana', which is not of the form 1.0, 1.2-3 or 1.2-3.4"),
        (["1.0", "1.1"], "declares several plugin APIs, 1.0 and 1.1; one range is due"),
    ],
)
def test_a_declaration_that_means_nothing_is_a_fault(
    shop: object, trackers: Callable[..., str], declared: list[str], complaint: str
) -> None:
    install(shop, trackers("arc"), *declared)
    assert row_of("other").failure == complaint


def test_a_declaration_for_no_plugin_is_a_fault(shop: object, trackers: Callable[..., str]) -> None:
    groups = {"opir": {"other": "opir_other.plugin"}, "opir.api": {"1.0": "opir_other.plugins"}}
    shop.install("other", trackers("arc"), entry_points=groups)  # type: ignore[attr-defined]
    assert row_of("other").failure == (
        "advertises 1.0 for 'opir_other.plugins', which is no entry point of it in group opir"
    )


def test_the_plugins_of_this_house_declare_the_api_they_are_tested_with() -> None:
    rows = [row for row in Host.discover().catalogue() if row.distribution.startswith("opir-")]
    declared = {row.plugin: row.api for row in rows if row.plugin in {"builtin", "dsp", "sbirs", "nextgen"}}
    assert len(declared) == 4
    assert all(ApiRange.of(written).admits(API_VERSION) for written in declared.values())
