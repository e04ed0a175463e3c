"""Values of a scene that are allowed and implausible: far outside what real equipment and studies
have.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from attrs import NOTHING, Attribute, fields, has

from opir_core.errors import Problem
from opir_core.scene.fields import info_of, numbers_inside
from opir_core.scene.scene import PLAUSIBLE_DURATION_S, Scene

#: How to accept implausible values.
REMEDY = "if it is meant, set allow_implausible: true"


def implausible_values(scene: Scene) -> list[Problem]:
    """Return the implausible values of a scene, each with its path and the plausible range; each
    once.

    `allow_implausible` has no effect here.
    """
    problems: dict[Problem, None] = {}
    for choice in scene.choices:
        problems |= dict.fromkeys(implausible_settings(choice.config, choice.path))
    low_s, high_s = PLAUSIBLE_DURATION_S
    if not low_s <= scene.duration_s <= high_s:
        text = f"{scene.duration_s:g} s is outside the plausible {low_s:g} to {high_s:g} s"
        problems[Problem("duration_s", text)] = None
    return list(problems)


def implausible_settings(config: Any, path: str) -> Iterator[Problem]:
    """Yield the implausible values of a configuration, nested ones included; `path` is that of its
    block.
    """
    if not has(type(config)):
        return
    config_class: type = type(config)
    fine = _plausible_defaults(config_class)
    for attribute in fields(type(config)):
        value = getattr(config, attribute.name)
        if value is not fine.get(attribute.name, NOTHING):
            yield from _implausible_value(attribute, value, path)


@cache
def _plausible_defaults(config_class: type) -> Mapping[str, Any]:
    """Return the plausible defaults of a configuration class: most settings of a large scene are
    left as they are.
    """
    attributes = {attribute.name: attribute for attribute in fields(config_class)}
    return {
        name: attribute.default
        for name, attribute in attributes.items()
        if not any(_implausible_value(attribute, attribute.default, ""))
    }


def _implausible_value(attribute: "Attribute[Any]", value: Any, path: str) -> Iterator[Problem]:
    """Yield the implausible values of a setting, nested configurations included."""
    info = info_of(attribute)
    place = f"{path}.{attribute.name}" if path else attribute.name
    for key, inner in _configurations(value):
        yield from implausible_settings(inner, f"{place}{key}")
    unit = f" {info.unit}" if info.unit not in {"", "1"} else ""
    for number in () if has(type(value)) else numbers_inside(value):
        if info.implausible(number):
            low, high = info.plausible_range or (0.0, 0.0)
            yield Problem(
                place, f"{number:g}{unit} is outside the plausible {low:g} to {high:g}{unit}"
            )


def implausible_defaults(component: Any, settings: Mapping[str, Any]) -> list[Problem]:
    """Return the implausible numbers among a component's defaults, its presets and some
    settings.
    """
    problems: dict[Problem, None] = {}
    config = getattr(component, "config", None)
    if config is None:  # a constellation or a target class
        return []
    infos = {attribute.name: attribute for attribute in fields(config)}
    settings_by_path = [
        ("", {name: attribute.default for name, attribute in infos.items()}),
        ("", settings),
    ]
    settings_by_path += [(f"presets.{name}", values) for name, values in component.presets.items()]
    for path, values in settings_by_path:
        for key in values.keys() & infos.keys():
            problems |= dict.fromkeys(_implausible_value(infos[key], values[key], path))
    return list(problems)


def _configurations(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the configurations that a value is or holds, each after its place in it."""
    if has(type(value)):
        yield "", value
    elif isinstance(value, Mapping):
        yield from ((f".{key}", item) for key, item in value.items() if has(type(item)))
    elif isinstance(value, tuple | list):
        yield from (("", item) for item in value if has(type(item)))
