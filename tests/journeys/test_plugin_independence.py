"""A scene's results are those of the components it names: what else is installed, in which order,
changes no byte.
"""

import json
import random
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest
import yaml
from opir_testing.bench import encoder_of, planned
from repository import ROOT

from opir_core.host.discovery import CORE_PLUGINS
from opir_core.host.host import Host
from opir_core.simulation.manifest import run_manifest
from opir_core.simulation.run import plan_windows
from opir_core.simulation.summary import Tally

PLUGINS = sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))

#: Scenes by name, and the plugins that each needs.
SCENES = {
    "first_light": {"opir_dsp"},
    "pacific_test_range": {
        *(
            "opir_dsp",
            "opir_sbirs",
            "opir_nextgen",
            "opir_photons",
            "opir_estimation",
            "opir_forecast",
            "opir_trackers",
        ),
    },
}

#: What plugins compute with; it offers no components itself.
LIBRARY = "opir_estimation"

#: What somebody else's plugins are like: they offer names of their own, under hooks that the scenes
#: use.
FOREIGN = """
from opir_core.plugin import *
from opir_core.builtin import plugin as core

@hookimpl
def opir_sensor_models():
    yield SensorModel(name="{name}-scanner", summary="somebody else's", build=print)

@hookimpl
def opir_detection_models():
    for model in core.opir_detection_models():
        yield DetectionModel(name=f"{name}-{{model.name}}", summary="somebody else's", build=print)

@hookimpl
def opir_trackers():
    yield TrackerModel(name="{name}", summary="somebody else's", build=print)
"""

BROKEN = "raise RuntimeError('broken, as plugins are at times')\n"


def metadata(folder, name, version, groups):
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.3\nName: {name}\nVersion: {version}\n\n", encoding="utf-8"
    )
    lines = [
        line
        for group, entries in groups.items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


def real(folder, source):
    """Install a plugin of this house into a folder of its own."""
    project = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    place = folder / source.name
    metadata(place, project["name"], project["version"], project.get("entry-points", {}))
    (place / source.name).symlink_to(source / source.name)
    return place


def foreign_plugin(folder, name, code):
    """Install a plugin of somebody else's into a folder of its own."""
    place = folder / name
    metadata(place, f"opir-{name}", "1.0", {"opir": {name: f"foreign_{name}"}})
    (place / f"foreign_{name}.py").write_text(code.format(name=name), encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """Every plugin of this house, and some of others, each in a folder that is not yet on the
    path.
    """
    folder = tmp_path_factory.mktemp("shelf")
    house = {source.name: real(folder, source) for source in PLUGINS}
    foreign = {
        name: foreign_plugin(folder, name, FOREIGN) for name in ("aardvark", "mole", "zebra")
    }
    return {**house, **foreign, "wreck": foreign_plugin(folder, "wreck", BROKEN)}


@pytest.fixture
def path_of_folders(monkeypatch):
    """A function that makes folders, in an order, all that is installed beside Python itself."""
    standard = [sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")]
    standard.append(str(Path(sysconfig.get_path("platstdlib")) / "lib-dynload"))
    monkeypatch.delenv("OPIR_PLUGINS", raising=False)

    def forget():
        for name in [name for name in sys.modules if name.startswith(("opir_", "foreign_"))]:
            if name.partition(".")[0] != "opir_core":
                monkeypatch.delitem(sys.modules, name)

    def choose(folders):
        forget()
        monkeypatch.setattr(sys, "path", [*map(str, folders), *standard])

    return choose


def results(scene):
    """Return a scene's events and its manifest, with what is installed."""
    plan = planned(scene, Host.discover())
    tally = Tally(plan)
    windows = list(tally.over(plan_windows(plan)))
    events = b"".join(encoder_of(plan).encode(window) for window in windows)
    return events, json.dumps(run_manifest(plan, tally.counts()), sort_keys=True)


def orders(needed, plugins):
    """Yield what is installed, in order: the least, each pair in both orders, and by chance."""
    everything = [*needed, *plugins]
    yield from (list(needed), everything, everything[::-1])
    rng = random.Random(20260401)
    for _ in range(2):
        selected = [*needed, *(plugin for plugin in plugins if rng.random() < 0.5)]
        rng.shuffle(selected)
        yield selected


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["first_light", pytest.param("pacific_test_range", marks=pytest.mark.slow)]
)
def test_other_plugins_and_their_order_change_no_byte(name, shelf, path_of_folders):
    scene = {
        **yaml.safe_load((ROOT / "examples" / f"{name}.yaml").read_text(encoding="utf-8")),
        "duration_s": 80.0,
    }
    scene.pop("outputs", None)
    everything = results(scene)
    assert len(everything[0]) > 1000
    needed = sorted(SCENES[name])
    for order in orders(needed, [other for other in shelf if other not in needed]):
        path_of_folders([shelf[one] for one in order])
        catalogue = Host.discover().catalogue()
        rows = {row.plugin: row.state for row in catalogue}
        of_others = {row.distribution for row in catalogue if row.plugin not in CORE_PLUGINS}
        assert {name.removeprefix("opir-") for name in of_others} == {
            one.removeprefix("opir_") for one in order if one != LIBRARY
        }
        assert [plugin for plugin, state in rows.items() if state == "failed"] == ["wreck"] * (
            "wreck" in order
        )
        assert results(scene) == everything, order
