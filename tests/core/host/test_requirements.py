"""The versions of opir-core that a plugin requires: read from its dependencies, shown by `opir
plugins`, checked.
"""

import re
import sys
import tomllib
from collections.abc import Callable

import pytest
from repository import ROOT

from opir_core import __version__
from opir_core.errors import PluginError, install_command
from opir_core.host import PACKAGES
from opir_core.host.discovery import core_specifier, error_of_requirement
from opir_core.host.registry import PluginRow
from opir_core.plugin import Host


@pytest.mark.parametrize(
    ("specifier", "inside", "outside"),
    [
        ("", ["0", "0.1", "7.0.0"], []),
        (">=1.0,<2", ["1.0", "1", "1.0.0", "1.99.3"], ["0.9", "2", "2.0.0", "2.1"]),
        (">1.2,<=1.4", ["1.2.1", "1.3", "1.4", "1.4.0"], ["1.2", "1.2.0", "1.4.1"]),
        ("==1.2", ["1.2", "1.2.0"], ["1.2.1", "1.3"]),
        ("==1.2.*", ["1.2", "1.2.7"], ["1.3", "1.20"]),
        ("!=1.2,>=1", ["1.0", "1.2.1"], ["1.2", "1.2.0", "0.9"]),
        ("!=1.2.*", ["1.1", "1.3"], ["1.2", "1.2.5"]),
        ("~=1.2", ["1.2", "1.9"], ["1.1", "2.0"]),
        ("~=1.2.3", ["1.2.3", "1.2.9"], ["1.2.2", "1.3"]),
        (">=1.0,banana", ["1.0"], ["0.9"]),
    ],
)
def test_versions_inside_and_outside(specifier: str, inside: list[str], outside: list[str]) -> None:
    assert [
        version for version in inside if error_of_requirement(specifier, "opir-x", version)
    ] == []
    assert [
        version for version in outside if not error_of_requirement(specifier, "opir-x", version)
    ] == []


@pytest.mark.parametrize("version", ["0.1.0", "0.1.7", "0.2.0", "1.0", "1.2.3", "2.0", "10.0.1"])
@pytest.mark.parametrize(
    "specifier", [">=0.1,<0.2", "~=1.0", "==1.*", "!=2.0", ">1,<=10", ">=1.2.3", "<2"]
)
def test_versions_agree_with_packaging(specifier: str, version: str) -> None:
    packaging = pytest.importorskip("packaging.specifiers")
    assert packaging.SpecifierSet(specifier).contains(version) == (
        not error_of_requirement(specifier, "x", version)
    )


@pytest.mark.parametrize(
    ("requirements", "specifier"),
    [
        ([], ""),
        (["numpy>=2"], ""),
        (["opir-core"], ""),
        (["opir-core<0.2,>=0.1", "numpy>=2"], ">=0.1,<0.2"),
        (["opir_core (>=0.1, <0.2)"], ">=0.1,<0.2"),
        (["Opir.Core[sgp4]~=1.0"], "~=1.0"),
        (['opir-core>=0.1; python_version > "3"'], ">=0.1"),
        (['opir-core>=5; extra == "test"', "opir-core>=0.1"], ">=0.1"),
        (["opir-core-extras>=3"], ""),
        (["opir-core @ https://example.org/opir.whl"], ""),
    ],
)
def test_the_specifier_of_the_core_among_requirements(
    requirements: list[str], specifier: str
) -> None:
    assert core_specifier(requirements) == specifier


def row_of(plugin: str) -> PluginRow:
    return next(row for row in Host.discover().catalogue() if row.plugin == plugin)


def test_a_plugin_in_range_is_used_and_its_range_shown(
    shop: object, trackers: Callable[..., str]
) -> None:
    shop.install("other", trackers("arc"), requires=["opir-core<2,>=0.1", "numpy"])  # type: ignore[attr-defined]
    assert Host.discover().component("opir_trackers", "arc").name == "arc"
    assert row_of("other").requires_core == ">=0.1,<2"


def test_a_plugin_without_a_range_is_used(shop: object, trackers: Callable[..., str]) -> None:
    shop.install("other", trackers("arc"))  # type: ignore[attr-defined]
    assert Host.discover().component("opir_trackers", "arc").name == "arc"
    assert row_of("other").requires_core == ""


def test_a_plugin_for_another_core_is_rejected_without_import(
    shop: object, trackers: Callable[..., str]
) -> None:
    shop.install("other", trackers("arc"), version="2.0", requires=["opir-core>=7.1"])  # type: ignore[attr-defined]
    sentence = (
        f"opir-other 2.0 (plugin other): requires opir-core >=7.1, and opir-core {__version__} is"
        f" installed; install an"
        f" opir-core in that range, or a release of opir-other for opir-core {__version__}"
    )
    with pytest.raises(PluginError) as error:
        Host.discover().component("opir_trackers", "arc", "tracker")
    assert f"failed: {sentence}" in str(error.value)
    assert "opir_other" not in sys.modules
    row = row_of("other")
    expected = ("failed", ">=7.1", sentence)
    assert (
        row.state,
        row.requires_core,
        f"opir-other 2.0 (plugin other): {row.failure}",
    ) == expected


def projects() -> dict[str, dict[str, object]]:
    files = (ROOT / "plugins").glob("*/pyproject.toml")
    return {
        project["name"]: project
        for project in (tomllib.loads(path.read_text())["project"] for path in sorted(files))
    }


def test_the_plugins_of_this_repository_require_this_core() -> None:
    for name, project in projects().items():
        specifier = core_specifier(project["dependencies"])  # type: ignore[arg-type]
        assert specifier, name
        assert not error_of_requirement(specifier, name, __version__)


def needed_by(name: str) -> list[str]:
    """Return the distributions of this project besides the core that one needs, each after its own
    needs.
    """
    required = [
        re.split(r"[^\w.-]", words)[0]
        for words in projects().get(name, {}).get("dependencies", [])  # type: ignore[attr-defined]
        if words.startswith("opir-") and not words.startswith("opir-core")
    ]
    ordered = [each for other in required for each in (*needed_by(other), other)]
    return list(dict.fromkeys(ordered))


def test_a_package_is_installed_with_those_that_it_needs() -> None:
    for name in PACKAGES:
        folders = [f"./plugins/{each.replace('-', '_')}" for each in (*needed_by(name), name)]
        assert install_command(name).endswith(f"pip install {' '.join(folders)}")


def test_the_table_of_packages_is_what_they_advertise() -> None:
    advertised = {
        name: tuple(sorted(project["entry-points"]["opir.components"]))  # type: ignore[index]
        for name, project in projects().items()
        if "entry-points" in project
    }
    assert {name: tuple(sorted(entries)) for name, entries in PACKAGES.items()} == advertised
