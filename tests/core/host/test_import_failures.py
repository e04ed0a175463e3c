"""A plugin that cannot be imported, or whose hooks do not fit their specifications."""

import logging
import sys

import pytest

from opir_core.errors import PluginError
from opir_core.host.components import PluginFailure, Provenance
from opir_core.plugin import Host

FAULTS = {
    "a missing dependency": (
        "import aiobroken",
        (
            "cannot be imported: ModuleNotFoundError: No module named 'aiobroken' (opir_bad/plugin.py,"
            " line 3)"
        ),
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
        (
            "opir_trackers raised TypeError: opir_trackers() missing 1 required keyword-only argument:"
            " 'scene'"
        ),
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
}


@pytest.mark.parametrize(("code", "reason"), FAULTS.values(), ids=FAULTS.keys())
def test_a_broken_plugin_costs_itself_alone_and_says_whose_it_is(assert_left_out, code, reason):
    assert_left_out(code, reason)


def test_an_interrupt_is_not_swallowed(shop):
    shop.install("bad", "raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        Host.discover().names("opir_trackers")


def test_a_failed_plugin_is_tried_once(shop, caplog):
    folder = shop.install(
        "bad", "import sys\nsys.tries = getattr(sys, 'tries', 0) + 1\nraise ValueError"
    )
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
    assert [failure.provenance.plugin for failure in host.failures] == ["a", "b", "c"]


def test_a_hook_for_later_cores_is_allowed(shop, trackers):
    shop.install(
        "new", trackers("kalman") + "@hookimpl(optionalhook=True)\ndef opir_dreams(): pass\n"
    )
    assert Host.discover().names("opir_trackers") == ["kalman"]


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (
            "opir_odd.plugin:absent",
            "AttributeError: module 'opir_odd.plugin' has no attribute 'absent'",
        ),
        (
            "opir_odd.plugin:",
            (
                "ImportError: the entry point 'opir_odd.plugin:' is not of the form module or"
                " module:object"
            ),
        ),
        (
            "opir odd",
            "ImportError: the entry point 'opir odd' is not of the form module or module:object",
        ),
        ("opir_absent.plugin", "ModuleNotFoundError: No module named 'opir_absent'"),
    ],
)
def test_an_entry_point_that_leads_nowhere(shop, value, reason):
    shop.install("odd", entry_points={"opir": {"odd": value}})
    host = Host.discover()
    host.catalogue()
    assert host.failures == (
        PluginFailure(Provenance("odd", "opir-odd", "1.0"), f"cannot be imported: {reason}"),
    )


def test_an_entry_point_may_name_an_object(shop, trackers):
    code = """
    class Plugin:
        @hookimpl
        def opir_trackers(self):
            return [TrackerModel(name="kalman", summary="a tracker", build=print)]
    class shelf:
        plugin = Plugin()
    """
    shop.install(
        "object", code, entry_points={"opir": {"object": "opir_object.plugin : shelf.plugin"}}
    )
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
    assert caplog.messages[0] == "opir-bad 1.0 (plugin bad)"
