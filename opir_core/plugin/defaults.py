"""Other defaults for the fields of a configuration class that a plugin inherits."""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from attrs import Attribute, evolve, frozen

from opir_core.fields import METADATA_KEY, info_of

C = TypeVar("C", bound=type)


@frozen
class Cited:
    """A default value and where it comes from."""

    value: Any
    source: str


def cited(value: Any, source: str) -> Cited:
    """Return a default that names its source; a default given bare is notional."""
    return Cited(value, source)


def with_defaults(**defaults: Any) -> Callable[[C], C]:
    """Return a class decorator that makes a frozen attrs class of a configuration class's heir, with other defaults.

    Unit, help and range stay those of the inherited field, its source becomes that of `cited` or "notional". A field
    that the class does not have is a `TypeError`.
    """

    def decorated(heir: C) -> C:
        return frozen(heir, kw_only=True, field_transformer=partial(_redefaulted, defaults))

    return decorated


def _redefaulted(defaults: dict[str, Any], heir: type, attributes: "list[Attribute[Any]]") -> "list[Attribute[Any]]":
    unknown = sorted(set(defaults) - {attribute.name for attribute in attributes})
    if unknown:
        raise TypeError(f"{heir.__name__} has no field {', '.join(unknown)}")
    return [
        _with_default(attribute, defaults[attribute.name]) if attribute.name in defaults else attribute
        for attribute in attributes
    ]


def _with_default(attribute: "Attribute[Any]", default: Any) -> "Attribute[Any]":
    chosen = default if isinstance(default, Cited) else Cited(default, "notional")
    info = evolve(info_of(attribute), source=chosen.source)
    # Attribute.evolve is attrs' own way to change an attribute in a field transformer.
    return attribute.evolve(default=chosen.value, metadata={**attribute.metadata, METADATA_KEY: info})
