"""A plugin whose hooks raise, or yield what is not a component, or a component that is not fit to
be chosen.
"""

import warnings

import pytest

from opir_core.host.contributions import MAXIMUM_COMPONENTS
from opir_core.plugin import Host

NAME_RULE = "names are 1 to 64 letters, digits and . _ + -, and begin with a letter or a digit"

FAULTS = {
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
        "opir_trackers returned None instead of an iterable of TrackerModel",
    ),
    "a hook that is a coroutine": (
        """
        @hookimpl
        async def opir_trackers():
            return ()
        """,
        "opir_trackers returned a coroutine instead of an iterable of TrackerModel",
    ),
    "a hook that returns the component itself": (
        """
        @hookimpl
        def opir_event_encoders():
            return EventEncoder(name="x", summary="an encoder", build=print)
        """,
        "opir_event_encoders returned an EventEncoder instead of an iterable of EventEncoder",
    ),
    "a hook without end": (
        """
        from itertools import count
        @hookimpl
        def opir_trackers():
            return (TrackerModel(name=f"t{n}", summary="a tracker", build=print) for n in count())
        """,
        f"opir_trackers yields more than {MAXIMUM_COMPONENTS} components",
    ),
    "a product of another kind": (
        """
        @hookimpl
        def opir_trackers():
            yield EventEncoder(name="x", summary="an encoder", build=print)
        """,
        "opir_trackers yielded an EventEncoder instead of a TrackerModel",
    ),
    "no component": (
        """
        @hookimpl
        def opir_trackers():
            yield {"name": "x"}
        """,
        "opir_trackers yielded a dict instead of a TrackerModel",
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
        "opir_trackers yielded a tracker named 't' with a summary that is not one line of text",
    ),
    "a configuration class that is none": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", config=dict, build=print)
        """,
        (
            "opir_trackers yielded a tracker named 't' with the config <class 'dict'>, not an attrs"
            " class"
        ),
    ),
    "a configuration instead of its class": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", config=NoConfig(), build=print)
        """,
        "opir_trackers yielded a tracker named 't' with the config NoConfig(), not an attrs class",
    ),
    "a build that is none": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", build="opir_bad.tracker:build")
        """,
        (
            "opir_trackers yielded a tracker named 't' with the build 'opir_bad.tracker:build', not a"
            " function"
        ),
    ),
    "presets that are a list": (
        """
        @hookimpl
        def opir_trackers():
            yield TrackerModel(name="t", summary="s", build=print, presets={"old": ["x"]})
        """,
        (
            "opir_trackers yielded a tracker named 't' with presets that are not a mapping of names to"
            " mappings"
        ),
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
        (
            "opir_constellations yielded a constellation named 'F' with the model None, not the name of"
            " a sensor model"
        ),
    ),
    "satellites that are names": (
        """
        @hookimpl
        def opir_constellations():
            yield Constellation(name="F", summary="s", model="M", satellites="F1")
        """,
        (
            "opir_constellations yielded a constellation named 'F' with satellites that are not a"
            " sequence of mappings"
        ),
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


@pytest.mark.slow
@pytest.mark.parametrize(("code", "reason"), FAULTS.values(), ids=FAULTS.keys())
def test_an_invalid_component_costs_only_its_plugin(assert_left_out, code, reason):
    assert_left_out(code, reason)


def test_a_coroutine_is_closed_and_leaves_no_warning_behind(shop):
    shop.install("bad", FAULTS["a hook that is a coroutine"][0])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert len([row for row in Host.discover().catalogue() if row.state == "failed"]) == 1
    assert caught == []
