"""A scene pays only for what it names: a plugin that advertises is imported when a name of its is
asked for.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import opir_core
from opir_core.errors import PluginError
from opir_core.plugin import Host

FLEET = """
@hookimpl
def opir_constellations():
    yield Constellation(name="{name}", summary="a fleet", model="{name}", satellites=[{{"id": "{name}-1"}}])

@hookimpl
def opir_sensor_models():
    yield SensorModel(name="{name}", summary="a sensor", build=print)
"""

MISMATCH = "its installed entry points differ from what it offers: "
AGAIN = "install again: python -m pip install "
NOT_LISTED = "offers it, but its installed entry points do not list it"
NOT_OFFERED = "lists it in its installed entry points, but does not offer it"

#: Core's own plugin is replaced, so that what is counted is the host's doing.
ASK = """
import json, sys, types
from opir_core.plugin import NoConfig, TrackerModel, hookimpl
from opir_core.host.host import Host
core = types.ModuleType("core")
core.opir_trackers = hookimpl(specname="opir_trackers")(lambda: [TrackerModel(name="t", summary="s", build=print)])
sys.modules["opir_core.builtin.plugin"] = core
host = Host.discover()
after_discovery = sorted(name for name in sys.modules if name.startswith("opir_") and "core" not in name)
names = host.names("opir_constellations")
after_names = sorted(name for name in sys.modules if name.startswith("opir_") and "core" not in name)
host.component("opir_constellations", "DSP")
print(json.dumps([after_discovery, names, after_names, sorted(sys.modules)]))
"""


def run(code, *folders):
    root = Path(opir_core.__file__).parents[1]
    path = ":".join(map(str, [*folders, root]))
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": path},
        check=True,
    )
    return json.loads(done.stdout)


@pytest.fixture
def fleets(shop):
    def install(name):
        advertise = (f"constellations.{name}", f"sensor_models.{name}")
        return shop.install(name.lower(), FLEET.format(name=name), advertise=advertise)

    return [install(name) for name in ("DSP", "SBIRS", "HEO")]


def test_a_scene_of_dsp_imports_no_other_constellation(fleets):
    after_discovery, names, after_names, modules = run(ASK, *fleets)
    assert after_discovery == after_names == []
    assert {"DSP", "HEO", "SBIRS"} <= set(names)
    assert {
        name for name in modules if name.startswith(("opir_dsp", "opir_sbirs", "opir_heo"))
    } == {
        "opir_dsp",
        "opir_dsp.plugin",
    }


def test_resolution_imports_nothing_heavy(fleets):
    *_, modules = run(ASK, *fleets)
    heavy = {
        "numpy",
        "scipy",
        "importlib.metadata",
        "email",
        "logging",
        "difflib",
        "yaml",
        "cattrs",
        "argparse",
    }
    assert heavy & set(modules) == set()


def test_a_plugin_without_adverts_is_imported_at_resolution(fleets, shop, trackers):
    silent = shop.install("silent", trackers("kalman"))
    *_, modules = run(ASK, *fleets, silent)
    assert "opir_silent.plugin" in modules
    assert "opir_heo" not in modules


def test_resolving_a_name_imports_only_its_owner(fleets):
    host = Host.discover()
    host.component("opir_sensor_models", "HEO")
    assert {"opir_heo", "opir_dsp", "opir_sbirs"} & set(sys.modules) == {"opir_heo"}
    host.component("opir_sensor_models", "DSP")
    assert "opir_sbirs" not in sys.modules
    host.catalogue()
    assert "opir_sbirs" in sys.modules


@pytest.mark.parametrize(
    ("offered", "advertised", "name", "difference"),
    [
        (["arc"], ["arc", "mht"], "mht", NOT_OFFERED),
        (["arc", "mht"], ["arc"], "mht", NOT_LISTED),
        (["arc", "mht"], ["mht"], "arc", NOT_LISTED),
    ],
)
def test_a_stale_component_costs_itself(
    shop, trackers, caplog, offered, advertised, name, difference
):
    shop.install("one", trackers(*offered), advertise=[f"trackers.{item}" for item in advertised])
    host = Host.discover()
    (usable,) = set(offered) & set(advertised)
    assert host.component("opir_trackers", usable).name == usable
    with pytest.raises(PluginError) as error:
        host.component("opir_trackers", name, "tracker")
    assert str(error.value) == (
        f"tracker: the tracker {name!r} cannot be used: opir-one 1.0 (plugin one) {difference}\n"
        f"  {AGAIN}--force-reinstall opir-one"
    )
    reason = f"{MISMATCH}trackers.{name}; {AGAIN}--force-reinstall opir-one"
    assert caplog.messages == [f"opir-one 1.0 (plugin one): {reason}"]
    row = host.catalogue()[-1]
    assert (row.state, row.failure) == ("ready", reason)
    assert [component.name for component in row.components] == [usable]


def test_an_editable_install_is_installed_again_from_its_folder(shop, trackers):
    folder = shop.install("one", trackers("arc", "mht"), advertise=["trackers.arc"])
    info = next(folder.glob("*.dist-info"))
    record = {"url": "file:///home/my%20code/one", "dir_info": {"editable": True}}
    (info / "direct_url.json").write_text(json.dumps(record))
    with pytest.raises(PluginError, match=f"\n  {AGAIN}-e '/home/my code/one'$"):
        Host.discover().component("opir_trackers", "mht")


@pytest.mark.parametrize(
    ("entry", "value", "reason"),
    [
        (
            "trackerz.arc",
            "opir_one.plugin",
            "advertises trackerz.arc, which is not a kind of component and a name",
        ),
        (
            "trackers",
            "opir_one.plugin",
            "advertises trackers, which is not a kind of component and a name",
        ),
        (
            "trackers.arc",
            "opir_one.plugn",
            (
                "advertises trackers.arc for 'opir_one.plugn', which is not one of its entry points in"
                " group opir"
            ),
        ),
    ],
)
def test_an_advertisement_that_makes_no_sense(shop, trackers, entry, value, reason):
    groups = {"opir": {"one": "opir_one.plugin"}, "opir.components": {entry: value}}
    shop.install("one", trackers("arc"), entry_points=groups)
    host = Host.discover()
    with pytest.raises(PluginError):
        host.component("opir_trackers", "arc")
    assert [str(failure) for failure in host.failures] == [f"opir-one 1.0 (plugin one): {reason}"]
    assert "opir_one" not in sys.modules


def test_an_advertisement_of_no_plugin_at_all(shop, trackers):
    shop.install("one", entry_points={"opir.components": {"trackers.arc": "opir_one.plugin"}})
    with pytest.raises(PluginError) as error:
        Host.discover().component("opir_trackers", "arc")
    assert str(error.value).endswith(
        "failed: opir-one 1.0: advertises trackers.arc for 'opir_one.plugin', which is not one of"
        " its entry points in "
        "group opir"
    )


def test_names_with_dots_and_signs(shop, trackers):
    names = ["a.b", "SBIRS-GEO", "v1.2+x_y"]
    shop.install("one", trackers(*names), advertise=[f"trackers.{name}" for name in names])
    host = Host.discover()
    assert [host.component("opir_trackers", name).name for name in names] == names


def test_two_plugins_of_one_distribution_are_loaded_apart(shop, trackers):
    folder = shop.install(
        "two",
        trackers("arc"),
        entry_points={
            "opir": {"two": "opir_two.plugin", "more": "opir_two.more"},
            "opir.components": {"trackers.arc": "opir_two.plugin", "trackers.mht": "opir_two.more"},
        },
    )
    (folder / "opir_two" / "more.py").write_text(
        "from opir_core.plugin import TrackerModel, hookimpl\n" + trackers("mht")
    )
    host = Host.discover()
    assert str(host.provenance("opir_trackers", "mht")) == "opir-two 1.0 (plugin more)"
    assert "opir_two.plugin" not in sys.modules
