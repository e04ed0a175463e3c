"""A broken plugin costs its own components and one warning, and the reason says whose it is and what is wrong."""

import logging
import sys
import warnings

import pytest

from opir_core.errors import PluginError
from opir_core.plugin.host import Host
from opir_core.plugin.offerings import MOST_COMPONENTS
from opir_core.plugin.provenance import PluginFailure

NAME_RULE = "names are 1 to 64 letters, digits and . _ + -, and begin with a letter or a digit"

FAULTS = {
    "a missing dependency": (
        "import aiobroken",
        "cannot be imported: ModuleNotFoundError: No module named 'aiobroken' (opir_bad/plugin.py, line 3)",
    ),
    "an error on import": (
        "1 / 0",
        "cannot be imported: ZeroDivisionError: division by zero (opir_bad/plugin.py, line 3)",
    ),
    "an exit on import": (
        "raise SystemExit(4)",
        "cannot be imported: SystemExit: 4 (opir_bad/plugin.py, line 3)",
    ),
    "an error that cannot say what it is": (
        """
        class Mute(Exception):
            def __str__(self):
                raise ValueError
        raise Mute
        """,
        "cannot be imported: Mute (opir_bad/plugin.py, line 7)",
    ),
    "an error of many lines": (
        "raise ValueError('one\\n\\n   two ' + 'x' * 1000)",
        f"cannot be imported: ValueError: one two {'x' * 292}… (opir_bad/plugin.py, line 3)",
    ),
    "an unknown hook": (
        """
        @hookimpl
        def opir_trackerz():
            return ()
        """,
        "implements opir_trackerz, which is not a hook of opir; the nearest is 'opir_trackers'",
    ),
    "an unknown hook like no other": (
        """
        @hookimpl
        def qqq():
            return ()
        """,
        "implements qqq, which is not a hook of opir",
    ),
    "an argument too many": (
        """
        @hookimpl
        def opir_trackers(scene, config):
            return ()
        """,
        "opir_trackers takes (scene, config), but opir_trackers is called with ()",
    ),
    "an argument of another name": (
        """
        @hookimpl
        def opir_add_commands(parsers):
            pass
        """,
        "opir_add_commands takes (parsers), but opir_add_commands is called with (commands)",
    ),
    "an argument that pluggy does not see": (
        """
        @hookimpl
        def opir_trackers(*, scene):
            return ()
        """,
        "opir_trackers raised TypeError: opir_trackers() missing 1 required keyword-only argument: 'scene'",
    ),
    "no mark": (
        """
        def opir_trackers():
            return ()
        """,
        "opir_trackers is not marked with @hookimpl",
    ),
    "nothing at all": (
        "",
        "offers nothing: none of its functions is marked with @hookimpl from opir_core.plugin",
    ),
    "a wrapper and an order": (
        """
        @hookimpl(wrapper=True, tryfirst=True)
        def opir_trackers():
            return (yield)
        """,
        "; ".join(
            f"opir_trackers is marked {option}, but hooks of opir have no order and no wrappers"
            for option in ("tryfirst", "wrapper")
        ),
    ),
    "an old wrapper": (
        """
        @hookimpl(hookwrapper=True)
        def opir_trackers():
            yield
        """,
        "opir_trackers is marked hookwrapper, but hooks of opir have no order and no wrappers",
    ),
    "trylast": (
        """
        @hookimpl(specname="opir_trackers", trylast=True)
        def mine():
            return ()
        """,
        "opir_trackers is marked trylast, but hooks of opir have no order and no wrappers",
    ),
    "a hook that raises": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="good", summary="a tracker", build=print)
            raise ValueError("no table")
        """,
        "opir_trackers raised ValueError: no table (opir_bad/plugin.py, line 7)",
    ),
    "a hook that exits": (
        """
        import sys
        @hookimpl
        def opir_trackers():
            sys.exit("bye")
        """,
        "opir_trackers raised SystemExit: bye (opir_bad/plugin.py, line 7)",
    ),
    "a hook that returns nothing": (
        """
        @hookimpl
        def opir_trackers():
            TrackerModel(name="lost", summary="a tracker", build=print)
        """,
        "opir_trackers returned None, where an iterable of TrackerModel was due",
    ),
    "a hook that is a coroutine": (
        """
        @hookimpl
        async def opir_trackers():
            return ()
        """,
        "opir_trackers returned a coroutine, where an iterable of TrackerModel was due",
    ),
    "a hook that returns the component itself": (
        """
        @hookimpl
        def opir_event_encoders():
            return EventEncoder(name="x", summary="an encoder", build=print)
        """,
        "opir_event_encoders returned an EventEncoder, where an iterable of EventEncoder was due",
    ),
    "a hook without end": (
        """
        from itertools import count
        @hookimpl
        def opir_trackers():
            return (TrackerModel(name=f"t{n}", summary="a tracker", build=print) for n in count())
        """,
        f"opir_trackers yields more than {MOST_COMPONENTS} components",
    ),
    "a product of another kind": (
        """
        @hookimpl
        def opir_trackers():
            yield EventEncoder(name="x", summary="an encoder", build=print)
        """,
        "opir_trackers yielded an EventEncoder, where a TrackerModel was due",
    ),
    "no component": (
        """
        @hookimpl
        def opir_trackers():
            yield {"name": "x"}
        """,
        "opir_trackers yielded a dict, where a TrackerModel was due",
    ),
    "a name with a blank": (
        """
        @hookimpl
        def opir_atmosphere_models():
            yield AtmosphereModel(name="thin air", summary="s", build=print)
        """,
        f"opir_atmosphere_models yielded an atmosphere model named 'thin air'; {NAME_RULE}",
    ),
    "a name that is no text": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name=7, summary="s", build=print)
        """,
        f"opir_trackers yielded a tracker named 7; {NAME_RULE}",
    ),
    "no summary": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary=" ", build=print)
        """,
        "opir_trackers yielded a tracker named 't' whose summary is not one line of text",
    ),
    "a configuration class that is none": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", config=dict, build=print)
        """,
        "opir_trackers yielded a tracker named 't' whose config is <class 'dict'>, not an attrs class",
    ),
    "a configuration instead of its class": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", config=NoConfig(), build=print)
        """,
        "opir_trackers yielded a tracker named 't' whose config is NoConfig(), not an attrs class",
    ),
    "a build that is none": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", build="opir_bad.tracker:build")
        """,
        "opir_trackers yielded a tracker named 't' whose build is 'opir_bad.tracker:build', not a function",
    ),
    "presets that are a list": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", build=print, presets={"old": ["x"]})
        """,
        "opir_trackers yielded a tracker named 't' whose presets are not a mapping from names to mappings of values",
    ),
    "a name twice": (
        """
        @hookimpl
        def opir_trackers():
            return [TrackerModel(name="t", summary=s, build=print) for s in ("one", "two")]
        """,
        "opir_trackers yielded two trackers named 't'",
    ),
    "a name twice, in two functions": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", build=print)
        more = hookimpl(specname="opir_trackers")(lambda: opir_trackers())
        """,
        "opir_trackers yielded two trackers named 't'",
    ),
    "a fleet without satellites": (
        """
        @hookimpl
        def opir_constellations():
            yield Constellation(name="F", summary="s", model="M", satellites=[])
        """,
        "opir_constellations yielded a constellation named 'F' without satellites",
    ),
    "a fleet without a model": (
        """
        @hookimpl
        def opir_constellations():
            yield Constellation(name="F", summary="s", model=None, satellites=[{"id": "F-1"}])
        """,
        "opir_constellations yielded a constellation named 'F' whose model is None, not the name of a sensor model",
    ),
    "satellites that are names": (
        """
        @hookimpl
        def opir_constellations():
            yield Constellation(name="F", summary="s", model="M", satellites="F1")
        """,
        "opir_constellations yielded a constellation named 'F' whose satellites are not a sequence of mappings",
    ),
    "a satellite without an id": (
        """
        @hookimpl
        def opir_constellations():
            yield Constellation(name="F", summary="s", model="M", satellites=[{"orbital_slot_deg": 1}])
        """,
        "opir_constellations yielded a constellation named 'F' with a satellite that has no id",
    ),
    "two satellites of one id": (
        """
        @hookimpl
        def opir_constellations():
            yield Constellation(name="F", summary="s", model="M", satellites=[{"id": "F-1"}, {"id": "F-1"}])
        """,
        "opir_constellations yielded a constellation named 'F' with two satellites of one id",
    ),
    "a component that cannot be looked at": (
        """
        class Shy:
            def __repr__(self):
                raise RuntimeError("not today")
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", build=Shy())
        """,
        "cannot be examined: RuntimeError: not today (opir_bad/plugin.py, line 6)",
    ),
}


@pytest.mark.parametrize(("code", "reason"), FAULTS.values(), ids=FAULTS.keys())
def test_a_broken_plugin_is_one_failure_with_its_owner(shop, trackers, caplog, code, reason):
    shop.install("bad", code, version="3.1")
    shop.install("good", trackers("kalman"))
    host = Host.discover()
    assert host.component("opir_trackers", "kalman").name == "kalman"
    assert host.names("opir_trackers") == ["kalman"]
    assert host.failures == (PluginFailure("bad", "opir-bad", "3.1", reason),)
    warned = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert warned == [f"plugin left out: opir-bad 3.1 (plugin bad): {reason}"]
    assert {record.name for record in caplog.records} == {"opir"}


@pytest.mark.parametrize(("code", "reason"), FAULTS.values(), ids=FAULTS.keys())
def test_a_missing_name_is_answered_with_every_failure(shop, code, reason):
    shop.install("bad", code, version="3.1")
    with pytest.raises(PluginError) as error:
        Host.discover().component("opir_trackers", "kalman", "tracker")
    assert str(error.value) == (
        "tracker: no tracker is named 'kalman'\n"
        "  trackers installed: none\n"
        f"  failed: opir-bad 3.1 (plugin bad): {reason}"
    )


@pytest.mark.parametrize(("code", "reason"), FAULTS.values(), ids=FAULTS.keys())
def test_an_advertised_name_whose_plugin_fails_is_refused_with_the_reason(shop, code, reason):
    shop.install("bad", code, version="3.1", advertise=["trackers.kalman"])
    host = Host.discover()
    assert host.names("opir_trackers") == ["kalman"]
    assert host.failures == ()
    with pytest.raises(PluginError) as error:
        host.component("opir_trackers", "kalman", "tracker")
    assert str(error.value) == (
        f"tracker: the tracker 'kalman' cannot be used, because its plugin failed\n"
        f"  failed: opir-bad 3.1 (plugin bad): {reason}"
    )
    assert host.names("opir_trackers") == []


def test_a_coroutine_is_closed_and_leaves_no_warning_behind(shop):
    shop.install("bad", FAULTS["a hook that is a coroutine"][0])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert len([row for row in Host.discover().catalogue() if row.state == "failed"]) == 1
    assert caught == []


def test_an_interrupt_is_not_swallowed(shop):
    shop.install("bad", "raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        Host.discover().names("opir_trackers")


def test_a_failed_plugin_is_tried_once(shop, caplog):
    folder = shop.install("bad", "import sys\nsys.tries = getattr(sys, 'tries', 0) + 1\nraise ValueError")
    host = Host.discover()
    for _ in range(3):
        host.catalogue()
    assert sys.tries == 1
    del sys.tries
    assert len(caplog.records) == 1, folder


def test_failures_are_sorted_however_they_were_found(shop):
    for name in ("c", "a", "b"):
        shop.install(name, "1 / 0", advertise=[f"trackers.{name}"])
    host = Host.discover()
    for name in ("b", "c", "a"):
        with pytest.raises(PluginError):
            host.component("opir_trackers", name)
    assert [failure.plugin for failure in host.failures] == ["a", "b", "c"]


def test_a_hook_for_later_cores_is_allowed(shop, trackers):
    shop.install("new", trackers("kalman") + "@hookimpl(optionalhook=True)\ndef opir_dreams(): pass\n")
    assert Host.discover().names("opir_trackers") == ["kalman"]


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("opir_odd.plugin:absent", "AttributeError: module 'opir_odd.plugin' has no attribute 'absent'"),
        (
            "opir_odd.plugin:",
            "ImportError: the entry point 'opir_odd.plugin:' is not of the form module or module:object",
        ),
        ("opir odd", "ImportError: the entry point 'opir odd' is not of the form module or module:object"),
        ("opir_absent.plugin", "ModuleNotFoundError: No module named 'opir_absent'"),
    ],
)
def test_an_entry_point_that_leads_nowhere(shop, value, reason):
    shop.install("odd", entry_points={"opir": {"odd": value}})
    host = Host.discover()
    host.catalogue()
    assert host.failures == (PluginFailure("odd", "opir-odd", "1.0", f"cannot be imported: {reason}"),)


def test_an_entry_point_may_name_an_object(shop, trackers):
    code = """
    class Plugin:
        @hookimpl
        def opir_trackers(self):
            return [TrackerModel(name="kalman", summary="a tracker", build=print)]
    class shelf:
        plugin = Plugin()
    """
    shop.install("object", code, entry_points={"opir": {"object": "opir_object.plugin : shelf.plugin"}})
    assert Host.discover().names("opir_trackers") == ["kalman"]


def test_the_name_of_cores_own_plugin_is_taken(shop, trackers):
    shop.install("builtin", trackers("kalman"), distribution="acme-sensors")
    host = Host.discover()
    assert host.names("opir_trackers") == []
    assert [str(failure) for failure in host.failures] == [
        "acme-sensors 1.0 (plugin builtin): the plugin name 'builtin' belongs to opir-core"
    ]
    assert "acme_sensors" not in sys.modules


def test_a_traceback_is_there_for_who_asks(shop, caplog):
    caplog.set_level(logging.DEBUG, logger="opir")
    shop.install("bad", "1 / 0")
    Host.discover().catalogue()
    assert [record.exc_info is not None for record in caplog.records] == [True, False]
    assert caplog.records[0].getMessage() == "opir-bad 1.0 (plugin bad)"
