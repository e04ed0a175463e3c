"""What is asked for by name: exactly one component with its owner, or a complete answer."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import opir_core
from opir_core.errors import PluginError
from opir_core.host.components import Provenance
from opir_core.plugin import Constellation, EventEncoder, Host, SensorModel, TrackerModel, hookimpl

DSP = """
@frozen
class Settings:
    scan_period_ms: float = number(help="time between looks", default=200.0)

@hookimpl
def opir_sensor_models():
    yield SensorModel(name="DSP", summary="a spinning scanner", config=Settings, build=lambda config, context: config)

@hookimpl
def opir_constellations():
    yield Constellation(name="DSP", summary="two of them", model="DSP", satellites=[{"id": "A"}, {"id": "B"}])
"""


class Plugin:
    def __init__(self, *names):
        self.names = names

    @hookimpl
    def opir_trackers(self):
        return [TrackerModel(name=name, summary="a tracker", build=print) for name in self.names]


def complaint(host, hook, name, path=""):
    with pytest.raises(PluginError) as error:
        host.component(hook, name, path)
    with pytest.raises(PluginError) as second_error:
        host.provenance(hook, name, path)
    assert str(second_error.value) == str(error.value)
    assert error.value.exit_code == 3
    return str(error.value)


@pytest.mark.parametrize("advertise", [(), ("sensor_models.DSP", "constellations.DSP")])
def test_a_good_plugin(shop, advertise):
    shop.install("dsp", DSP, version="0.4", advertise=advertise)
    host = Host.discover()
    model = host.component("opir_sensor_models", "DSP", "sensors[0]")
    assert isinstance(model, SensorModel)
    assert model.build(model.config(), None).scan_period_ms == 200.0
    assert host.component(Constellation, "DSP").model == "DSP"
    assert host.component(SensorModel, "DSP") is model
    assert host.provenance(SensorModel, "DSP") == Provenance("dsp", "opir-dsp", "0.4")
    assert host.names("opir_sensor_models") == host.names(Constellation) == ["DSP"]
    assert host.names("opir_sinks") == []
    assert host.failures == ()


def test_what_was_loaded_and_what_was_used(shop, trackers):
    shop.install("dsp", DSP, version="0.4", advertise=["sensor_models.DSP", "constellations.DSP"])
    shop.install("silent", trackers("kalman"))
    shop.install("asleep", trackers("arc"), advertise=["trackers.arc"])
    host = Host.discover()
    assert host.loaded() == host.used() == ()
    host.component("opir_sensor_models", "DSP")
    host.provenance("opir_trackers", "kalman")
    assert [owner.plugin for owner in host.loaded()] == ["builtin", "dsp", "silent"]
    assert host.used() == (Provenance("dsp", "opir-dsp", "0.4"),)


def test_a_missing_name_with_the_nearest(shop, trackers):
    shop.install("dsp", DSP)
    shop.install("more", trackers("Kepler-Arc", "kalman", "mht"), version="2.1")
    shop.install("arc", trackers("kepler-are"), advertise=["trackers.kepler-are"])
    assert complaint(Host.discover(), "opir_trackers", "kepler-arc", "tracker") == (
        "tracker: no tracker is named 'kepler-arc'\n"
        "  nearest: Kepler-Arc of opir-more 2.1 (plugin more), kepler-are of opir-arc 1.0 (plugin"
        " arc)\n"
        "  opir-trackers provides it; from a clone of opir: python -m pip install"
        " ./plugins/opir_estimation ./plugins/opir_forecast ./plugins/opir_trackers\n"
        "  trackers installed: Kepler-Arc of opir-more 2.1 (plugin more), kalman of opir-more 2.1"
        " (plugin more), "
        "kepler-are of opir-arc 1.0 (plugin arc), mht of opir-more 2.1 (plugin more)"
    )


def test_a_missing_name_that_another_kind_has(shop, trackers):
    shop.install("dsp", DSP)
    assert complaint(Host.discover(), "opir_trackers", "DSP") == (
        "no tracker is named 'DSP'\n"
        "  trackers installed: none\n"
        "  'DSP' is a constellation of opir-dsp 1.0 (plugin dsp), not a tracker\n"
        "  'DSP' is a sensor model of opir-dsp 1.0 (plugin dsp), not a tracker"
    )
    reported = complaint(Host.discover(), "opir_atmosphere_models", "DSP")
    assert (
        "'DSP' is a constellation of opir-dsp 1.0 (plugin dsp), not an atmosphere model" in reported
    )


def test_a_missing_name_wakes_every_plugin_to_say_what_failed(shop, trackers):
    shop.install("bad", "import aiobroken", version="7", advertise=["sinks.kafka"])
    assert complaint(Host.discover(), "opir_trackers", "arc") == (
        "no tracker is named 'arc'\n"
        "  trackers installed: none\n"
        "  failed: opir-bad 7 (plugin bad): cannot be imported: ModuleNotFoundError: No module"
        " named 'aiobroken' "
        "(opir_bad/plugin.py, line 3)"
    )


BOTH = "acme-dsp 2.0 (plugin acme) and opir-dsp 0.4 (plugin dsp)"
WAY_OUT = (
    "uninstall all of them but one, or set OPIR_PLUGINS to the plugins to use, without acme or dsp"
)


@pytest.mark.parametrize("first", [(), ("sensor_models.DSP", "constellations.DSP")])
@pytest.mark.parametrize("second", [(), ("sensor_models.DSP", "constellations.DSP")])
def test_two_owners_of_one_name(shop, monkeypatch, first, second):
    shop.install("dsp", DSP, version="0.4", advertise=first)
    shop.install("acme", DSP, version="2.0", distribution="acme-dsp", advertise=second)
    host = Host.discover()
    assert host.names("opir_sensor_models") == ["DSP"]
    assert complaint(host, "opir_sensor_models", "DSP", "sensors[0].model") == (
        f"sensors[0].model: two plugins offer the sensor model 'DSP': {BOTH}\n  {WAY_OUT}"
    )
    loaded = {"opir_dsp.plugin", "acme_dsp.plugin"} & set(sys.modules)
    assert loaded == {
        name
        for name, reported in (("opir_dsp.plugin", first), ("acme_dsp.plugin", second))
        if not reported
    }
    monkeypatch.setenv("OPIR_PLUGINS", "acme")
    assert Host.discover().provenance("opir_sensor_models", "DSP").distribution == "acme-dsp"


def test_a_contested_name_in_the_catalogue(shop, trackers):
    shop.install("one", trackers("arc", "kalman"))
    shop.install("two", trackers("arc"), advertise=["trackers.arc"])
    contested = {
        (row.plugin, component.name): [str(owner) for owner in component.contested_by]
        for row in Host.discover().catalogue()
        for component in row.components
    }
    assert contested == {
        ("builtin", "constant"): [],
        ("one", "arc"): ["opir-two 1.0 (plugin two)"],
        ("one", "kalman"): [],
        ("two", "arc"): ["opir-one 1.0 (plugin one)"],
    }


def test_a_contest_does_not_touch_other_names(shop, trackers):
    shop.install("one", trackers("arc", "kalman"))
    shop.install("two", trackers("arc"))
    assert Host.discover().provenance("opir_trackers", "kalman").plugin == "one"


def test_three_owners_and_core_among_them(shop):
    code = """
    @hookimpl
    def opir_detection_models():
        yield DetectionModel(name="constant", summary="mine", build=print)
    """
    shop.install("one", code)
    shop.install("two", code)
    assert complaint(Host.discover(), "opir_detection_models", "constant") == (
        f"3 plugins offer the detection model 'constant': opir-core {opir_core.__version__} (plugin"
        f" builtin) and "
        "opir-one 1.0 (plugin one) and opir-two 1.0 (plugin two)\n"
        "  uninstall all of them but one, or set OPIR_PLUGINS to the plugins to use, without one or"
        " two"
    )


def test_two_distributions_with_one_plugin_name(shop):
    shop.install("dsp", DSP, version="0.4")
    shop.install("dsp", DSP, version="2.0", distribution="acme-dsp")
    assert complaint(Host.discover(), "opir_sensor_models", "DSP") == (
        "two plugins offer the sensor model 'DSP': acme-dsp 2.0 (plugin dsp) and opir-dsp 0.4"
        " (plugin dsp)\n"
        "  uninstall all of them but one"
    )


def test_a_failed_owner_still_contests_what_it_advertises(shop, trackers):
    """Whether a name is contested must not depend on which plugin happened to be loaded before."""
    shop.install("bad", "1 / 0", advertise=["trackers.arc", "trackers.mht"])
    shop.install("good", trackers("arc"))
    host = Host.discover()
    contest = complaint(host, "opir_trackers", "arc")
    complaint(host, "opir_trackers", "mht")
    assert contest == complaint(host, "opir_trackers", "arc")
    assert contest.startswith("two plugins offer the tracker 'arc'")


def test_a_hook_that_does_not_exist_is_a_mistake_of_the_program(shop):
    with pytest.raises(
        ValueError, match="'opir_trackerz' is not a catalogue hook; those are opir_constellations, "
    ):
        Host.discover().component("opir_trackerz", "x")


class TestPluginsOfThisProgram:
    pytestmark = pytest.mark.usefixtures("shop")

    def test_objects_and_modules(self, shop):
        module = SimpleNamespace(
            __name__="my_module", opir_event_encoders=hookimpl(lambda: [encoder()])
        )
        module.opir_event_encoders = hookimpl(specname="opir_event_encoders")(lambda: [encoder()])
        host = Host.of(Plugin("arc"), Plugin("kalman"), module)
        assert host.provenance("opir_trackers", "arc") == Provenance("Plugin", "", "")
        assert (
            str(host.provenance("opir_trackers", "kalman"))
            == "plugin Plugin-2 (registered by this program)"
        )
        assert host.provenance("opir_event_encoders", "csv").plugin == "my_module"
        assert host.component("opir_detection_models", "constant").name == "constant"

    def test_installed_plugins_are_left_out(self, shop, trackers):
        shop.install("one", trackers("arc"))
        assert Host.of().names("opir_trackers") == []

    def test_a_plugin_beside_the_installed_ones(self, shop, trackers):
        shop.install("one", trackers("arc"))
        host = Host.discover()
        host.register(Plugin("kalman"), name="mine")
        assert host.names("opir_trackers") == ["arc", "kalman"]
        host.register(Plugin("arc"), name="other")
        assert complaint(host, "opir_trackers", "arc") == (
            "two plugins offer the tracker 'arc': opir-one 1.0 (plugin one) and plugin other"
            " (registered by this "
            "program)\n  leave out other, which this program registered"
        )

    def test_an_unfit_plugin_is_refused_at_once(self, shop):
        with pytest.raises(PluginError) as error:
            Host.of(Plugin("a b"))
        assert str(error.value).startswith(
            "plugin Plugin (registered by this program): opir_trackers yielded a tracker named 'a"
            " b'; names are"
        )

    def test_a_name_that_is_taken(self, shop):
        host = Host.of()
        host.register(Plugin("arc"), name="mine")
        with pytest.raises(PluginError, match="a plugin named 'mine' is registered already"):
            host.register(Plugin("kalman"), name="mine")
        assert host.names("opir_trackers") == ["arc"]

    def test_hosts_know_nothing_of_each_other(self, shop):
        plugin_host = Host.of(Plugin("arc"))
        core_host = Host.of()
        assert (plugin_host.names("opir_trackers"), core_host.names("opir_trackers")) == (
            ["arc"],
            [],
        )


def encoder():
    return EventEncoder(name="csv", summary="lines", build=print)


def test_there_is_no_host_but_those_that_are_made():
    code = (
        "import gc, opir_core, opir_core.host.host as h, opir_core.plugin, pluggy\n"
        "alive = [o for o in gc.get_objects() if isinstance(o, (h.Host, pluggy.PluginManager))]\n"
        "assert alive == [], alive\n"
        "kept = h.Host.discover()\n"
        "assert any(o is kept for o in gc.get_objects())\n"
    )
    root = str(Path(opir_core.__file__).parents[1])
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": root})
