"""Components of a plugin that misbehave in one method: they hang, raise what they should not, or
return nonsense.
"""

import threading

from attrs import evolve

from opir_core.host.components import CATALOGUE
from opir_core.host.host import Host
from opir_core.interfaces.contract import PluginPart, has_own
from opir_core.plugin import hookimpl


class Rogue:
    """A plugin with the component `rogue` of one hook: a sound component with one method that
    misbehaves.
    """

    def __init__(self, hook, sound, method, deed):
        component = Host.discover().component(hook, sound)

        def build(config, context):
            return (
                deed(component.build(config, context))
                if method == "build"
                else spoilt(build_sound(config, context))
            )

        def build_sound(config, context):
            return component.build(config, context)

        def spoilt(component):
            return with_deed(component, method, deed)

        rogue = evolve(component, name="rogue", build=build)
        setattr(self, hook, hookimpl(self._yielding(rogue), specname=hook))
        assert hook in CATALOGUE

    @staticmethod
    def _yielding(component):
        def yielding():
            yield component

        return yielding


def with_deed(component, method, deed):
    """Return a part like another, except for one method or attribute; defaults of its contract call
    the new one.
    """
    contracts = (each for each in type(component).__mro__[1:] if issubclass(each, PluginPart))
    contract = next(
        (each for each in contracts if each.__module__.startswith("opir_core.interfaces.")), object
    )

    def delegate(name):
        if callable(getattr(component, name)):
            return lambda _self, *inputs, **named: getattr(component, name)(*inputs, **named)
        return property(lambda _self: getattr(component, name))

    members = {
        name: delegate(name)
        for name in dir(component)
        if not name.startswith("_") and has_own(contract, component, name)
    }
    if callable(getattr(component, method)):
        members[method] = lambda _self, *inputs, **named: deed(
            getattr(component, method)(*inputs, **named)
        )
    else:
        members[method] = property(lambda _self: deed(getattr(component, method)))
    return type("RoguePart", (), members)()


def rogue_host(hook, sound, method, deed):
    """Return a host of the installed plugins and the component `rogue` of a hook, with a method
    that misbehaves.
    """
    host = Host.discover()
    host.register(Rogue(hook, sound, method, deed), "rogue")
    return host


class Hang:
    """A deed that does not return until `end` is called."""

    def __init__(self):
        self._over = threading.Event()
        self.begun = threading.Event()

    def __call__(self, answer):
        self.begun.set()
        self._over.wait(200.0)
        return answer

    def end(self):
        self._over.set()


def raising(error):
    """Return a deed that raises."""

    def deed(_answer):
        raise error

    return deed
