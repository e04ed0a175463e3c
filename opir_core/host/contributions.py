"""The contributions of a plugin: its hooks are checked against the specifications, and each is
called once.

An error in a plugin is an `InvalidPlugin` with the reason. It affects only that plugin, because
every plugin is registered with a pluggy manager of its own and its hooks are never called together
with those of another.
"""

import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any

import pluggy
from attrs import field, frozen, has

from opir_core.errors import kind_of, nearest, with_article
from opir_core.host.components import CATALOGUE, Component, Constellation, Offered, plural
from opir_core.host.discovery import COMMAND_HOOK, Offer
from opir_core.host.error_messages import described_error, one_line
from opir_core.host.hookspecs import PROJECT, CatalogueHooks, ExtensionHooks
from opir_core.scene.target_classes import TargetClass

#: Maximum number of components that one hook of one plugin yields.
MAXIMUM_COMPONENTS = 10_000

#: All hooks.
HOOKS = (*CATALOGUE, COMMAND_HOOK)

_ORDERING_OPTIONS = ("tryfirst", "trylast", "wrapper", "hookwrapper")

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,63}")
_NAME_RULE = "names are 1 to 64 letters, digits and . _ + -, and begin with a letter or a digit"


class InvalidPlugin(Exception):  # noqa: N818 - the host turns it into a `PluginFailure`
    """A plugin that cannot be used; the message is the reason, without the plugin's name."""


@frozen(eq=False, repr=False)
class Contributions:
    """The components of a valid plugin by hook and name, and the functions that add commands.

    `stale` are the components in which the plugin and its installed entry points differ, each with
    the difference: they cannot be used until the plugin is installed again.
    """

    components: Mapping[Offer, Offered]
    add_commands: tuple[Callable[[Any], None], ...] = ()
    stale: Mapping[Offer, str] = field(factory=dict)


def contributions_of(plugin: object) -> Contributions:
    """Return the contributions of a plugin (a module or object with hook implementations); raises
    `InvalidPlugin`.
    """
    implementations = _implementations(plugin)
    components: dict[Offer, Offered] = {}
    for hook, kind in CATALOGUE.items():
        for implementation in implementations.get(hook, ()):
            for component in _yielded(implementation, hook):
                if not isinstance(component, kind):
                    raise InvalidPlugin(
                        f"{hook} yielded {kind_of(component)} instead of"
                        f" {with_article(kind.__name__)}"
                    )
                fault = _fault_in(component)
                if fault:
                    raise InvalidPlugin(f"{hook} yielded {with_article(kind.kind)} {fault}")
                if (hook, component.name) in components:
                    raise InvalidPlugin(
                        f"{hook} yielded two {plural(kind.kind)} named {component.name!r}"
                    )
                components[hook, component.name] = component
    commands = implementations.get(COMMAND_HOOK, ())
    return Contributions(
        components, tuple(partial(_add_commands, implementation) for implementation in commands)
    )


def _implementations(plugin: object) -> dict[str, Sequence[pluggy.HookImpl]]:
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(CatalogueHooks)
    manager.add_hookspecs(ExtensionHooks)
    if faults := list(_faults_in_marks(manager, plugin)):
        raise InvalidPlugin("; ".join(faults))
    try:
        manager.register(plugin, name="plugin")
    except pluggy.PluginValidationError as error:
        raise InvalidPlugin(
            "; ".join(_faults_in_signatures(manager, plugin)) or str(error)
        ) from error
    callers = manager.get_hookcallers(plugin) or []
    if not callers:
        raise InvalidPlugin(
            "offers nothing: none of its functions is marked with @hookimpl from opir_core.plugin"
        )
    return {caller.name: caller.get_hookimpls() for caller in callers}


def _faults_in_marks(manager: pluggy.PluginManager, plugin: object) -> Iterable[str]:
    for name, options in _marked(manager, plugin).items():
        hook = (options or {}).get("specname") or name
        if options is None:
            yield f"{name} is not marked with @hookimpl"
        elif hook not in HOOKS and not options.get("optionalhook"):
            yield f"implements {hook}, which is not a hook of opir{nearest(hook, HOOKS)}"
        for option in _ORDERING_OPTIONS:
            if options and options.get(option):
                yield f"{hook} is marked {option}, but hooks of opir have no order and no wrappers"


def _marked(manager: pluggy.PluginManager, plugin: object) -> dict[str, Mapping[str, Any] | None]:
    """Return the options of each hook implementation; None for a function that has a hook's name
    without the mark.
    """
    options_by_name: dict[str, Mapping[str, Any] | None] = {}
    for name in dir(plugin):
        options = manager.parse_hookimpl_opts(plugin, name)
        if options is not None:
            options_by_name[name] = {**options}
        elif name in HOOKS and callable(inspect.getattr_static(plugin, name, None)):
            options_by_name[name] = None
    return options_by_name


def _faults_in_signatures(manager: pluggy.PluginManager, plugin: object) -> Iterable[str]:
    for name, options in _marked(manager, plugin).items():
        hook = (options or {}).get("specname") or name
        if hook not in HOOKS:
            continue
        spec: Any = getattr(manager.hook, hook).spec
        parameters = inspect.signature(getattr(plugin, name)).parameters.values()
        positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        required = [
            item.name
            for item in parameters
            if item.kind in positional and item.default is item.empty
        ]
        if set(required).difference(spec.argnames):
            yield f"{name} takes ({', '.join(required)}), but {hook} is called with ({', '.join(spec.argnames)})"


def _yielded(implementation: pluggy.HookImpl, hook: str) -> list[Any]:
    try:
        product = implementation.function()
        items = (
            list(islice(product, MAXIMUM_COMPONENTS + 1)) if isinstance(product, Iterable) else None
        )
    except (Exception, SystemExit) as error:
        raise InvalidPlugin(f"{hook} raised {described_error(error)}") from error
    if items is None:
        if inspect.iscoroutine(product):
            product.close()
        raise InvalidPlugin(
            f"{hook} returned {kind_of(product)} instead of an iterable of"
            f" {CATALOGUE[hook].__name__}"
        )
    if len(items) > MAXIMUM_COMPONENTS:
        raise InvalidPlugin(f"{hook} yields more than {MAXIMUM_COMPONENTS} components")
    return items


def _add_commands(implementation: pluggy.HookImpl, commands: Any) -> None:
    implementation.function(*(commands for _ in implementation.argnames))


def _fault_in(component: Offered) -> str:
    name: Any = component.name
    summary: Any = component.summary
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        return f"named {one_line(repr(name))}; {_NAME_RULE}"
    if not isinstance(summary, str) or not summary.strip() or len(summary.splitlines()) > 1:
        return f"named {name!r} with a summary that is not one line of text"
    fault = _fault_of_kind(component)
    return f"named {name!r} {fault}" if fault else ""


def _fault_of_kind(component: Offered) -> str:
    if isinstance(component, TargetClass):
        return component.fault()
    return (
        _fault_in_fleet(component)
        if isinstance(component, Constellation)
        else _fault_in_parts(component)
    )


def _fault_in_parts(component: Component) -> str:
    config: Any = component.config
    if not isinstance(config, type) or not has(config):
        return f"with the config {one_line(repr(config))}, not an attrs class"
    build: Any = component.build
    if not callable(build):
        return f"with the build {one_line(repr(build))}, not a function"
    presets: Any = component.presets
    if not isinstance(presets, Mapping) or not all(
        isinstance(name, str) and isinstance(values, Mapping) for name, values in presets.items()
    ):
        return "with presets that are not a mapping of names to mappings"
    return ""


def _fault_in_fleet(constellation: Constellation) -> str:
    model: Any = constellation.model
    satellites: Any = constellation.satellites
    if not isinstance(model, str) or not model:
        return f"with the model {one_line(repr(model))}, not the name of a sensor model"
    if not isinstance(satellites, Sequence) or not all(
        isinstance(satellite, Mapping) for satellite in satellites
    ):
        return "with satellites that are not a sequence of mappings"
    ids = [satellite.get("id") for satellite in satellites]
    if not ids:
        return "without satellites"
    if not all(isinstance(name, str) and name for name in ids):
        return "with a satellite that has no id"
    return "with two satellites of one id" if len(set(ids)) < len(ids) else ""
