"""What a plugin object offers: its hooks checked against the specifications, each called once, on its own.

A fault in a plugin is an `InvalidPlugin` with the reason in words; it costs that plugin and no other, because every
plugin is registered with a pluggy manager of its own and its hooks are never called together with another's.
"""

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from typing import Any

import pluggy
from attrs import frozen

from opir_core.plugin.components import CATALOGUE, Component, Constellation
from opir_core.plugin.discovery import COMMAND_HOOK, Offer
from opir_core.plugin.hookspecs import PROJECT, CatalogueHooks, ExtensionHooks
from opir_core.plugin.validation import InvalidPlugin, described_error, fault_in, nearest

#: How many components one hook of one plugin may yield.
MOST_COMPONENTS = 10_000

#: Every hook there is.
HOOKS = (*CATALOGUE, COMMAND_HOOK)

_ORDERING_OPTIONS = ("tryfirst", "trylast", "wrapper", "hookwrapper")


@frozen(eq=False)
class Contributions:
    """What a fit plugin has: components by hook and name, and functions that add commands."""

    components: Mapping[Offer, Component | Constellation]
    add_commands: tuple[Callable[[Any], None], ...] = ()


def contributions_of(plugin: object) -> Contributions:
    """Return what a plugin (a module or an object with hook implementations) offers; raises `InvalidPlugin`."""
    implementations = _implementations(plugin)
    components: dict[Offer, Component | Constellation] = {}
    for hook, kind in CATALOGUE.items():
        for implementation in implementations.get(hook, ()):
            for component in _yielded(implementation, hook):
                _add(components, component, hook, kind)
    commands = implementations.get(COMMAND_HOOK, ())
    return Contributions(components, tuple(_command_adder(implementation) for implementation in commands))


def _implementations(plugin: object) -> dict[str, Sequence[pluggy.HookImpl]]:
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(CatalogueHooks)
    manager.add_hookspecs(ExtensionHooks)
    faults = [*_faults_in_marks(manager, plugin)]
    if faults:
        raise InvalidPlugin("; ".join(faults))
    try:
        manager.register(plugin, name="plugin")
    except pluggy.PluginValidationError as error:
        raise InvalidPlugin("; ".join(_faults_in_signatures(manager, plugin)) or str(error)) from error
    callers = manager.get_hookcallers(plugin) or []
    if not callers:
        raise InvalidPlugin("offers nothing: none of its functions is marked with @hookimpl from opir_core.plugin")
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
    """Return the options of everything that is a hook implementation, or (None) is named as one and is not marked."""
    found: dict[str, Mapping[str, Any] | None] = {}
    for name in dir(plugin):
        options = manager.parse_hookimpl_opts(plugin, name)
        if options is not None:
            found[name] = {**options}
        elif name in HOOKS and callable(inspect.getattr_static(plugin, name, None)):
            found[name] = None
    return found


def _faults_in_signatures(manager: pluggy.PluginManager, plugin: object) -> Iterable[str]:
    for name, options in _marked(manager, plugin).items():
        hook = (options or {}).get("specname") or name
        spec: Any = getattr(manager.hook, hook).spec if hook in HOOKS else None
        required = _required_arguments(getattr(plugin, name)) if spec else []
        if set(required).difference(spec.argnames if spec else ()):
            yield f"{name} takes ({', '.join(required)}), but {hook} is called with ({', '.join(spec.argnames)})"


def _required_arguments(function: Callable[..., Any]) -> list[str]:
    parameters = inspect.signature(function).parameters.values()
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return [item.name for item in parameters if item.kind in positional and item.default is item.empty]


def _yielded(implementation: pluggy.HookImpl, hook: str) -> list[Any]:
    try:
        product = implementation.function()
        items = list(islice(product, MOST_COMPONENTS + 1)) if isinstance(product, Iterable) else None
    except (Exception, SystemExit) as error:
        raise InvalidPlugin(f"{hook} raised {described_error(error)}") from error
    if items is None:
        if inspect.iscoroutine(product):
            product.close()
        raise InvalidPlugin(
            f"{hook} returned {_article(product)}, where an iterable of {CATALOGUE[hook].__name__} was due"
        )
    if len(items) > MOST_COMPONENTS:
        raise InvalidPlugin(f"{hook} yields more than {MOST_COMPONENTS} components")
    return items


def _add(
    components: dict[Offer, Component | Constellation],
    component: Any,
    hook: str,
    kind: type[Component] | type[Constellation],
) -> None:
    if not isinstance(component, kind):
        raise InvalidPlugin(f"{hook} yielded {_article(component)}, where {_article_of(kind.__name__)} was due")
    fault = fault_in(component)
    if fault:
        raise InvalidPlugin(f"{hook} yielded {_article_of(kind.kind)} {fault}")
    if (hook, component.name) in components:
        raise InvalidPlugin(f"{hook} yielded two {kind.kind}s named {component.name!r}")
    components[hook, component.name] = component


def _command_adder(implementation: pluggy.HookImpl) -> Callable[[Any], None]:
    def add(commands: Any) -> None:
        implementation.function(*(commands for _ in implementation.argnames))

    return add


def _article(value: object) -> str:
    return "None" if value is None else _article_of(type(value).__name__)


def _article_of(noun: str) -> str:
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"
