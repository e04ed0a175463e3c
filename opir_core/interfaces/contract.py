"""The base of the contracts, and parts that have the methods of one without deriving from it."""

import abc
import inspect
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Self

from opir_core.errors import ModelError, kind_of

if TYPE_CHECKING:
    optional = property
    required = abc.abstractproperty
else:

    class optional:  # noqa: N801 - a decorator
        """A property with a default, which a subclass or an instance may replace by a plain
        attribute.
        """

        def __init__(self, fget: Callable[[Any], Any]) -> None:
            self.fget = fget
            self.__doc__ = fget.__doc__

        def __get__(self, component: Any, _owner: Any = None) -> Any:
            return self if component is None else self.fget(component)

    class required(optional):  # noqa: N801 - a decorator
        """A property without a body, which a subclass or an instance must replace by a plain
        attribute or a property.
        """

        def __get__(self, component: Any, _owner: Any = None) -> Any:
            if component is None:
                return self
            raise AttributeError(f"{type(component).__name__} defines no {self.fget.__name__}")


class PluginPart(abc.ABC):  # noqa: B024 - its subclasses have the abstract methods
    """What the part that a component builds must have: required members, and optional ones with
    defaults.
    """

    @classmethod
    def adopt(cls, component: Any, owner: Callable[[], str] | None = None) -> Self:
        """Return a part as one of this class; what one of another class does not define has the
        default.

        Raises `ModelError`, which begins with what `owner` returns, if a required member is
        missing.
        """
        missing = [name for name in _required(cls) if not hasattr(component, name)]
        if missing:
            raise ModelError(
                f"{f'{owner()}: ' if owner else ''}build made {kind_of(component)} without"
                f" {', '.join(missing)};"
                f" derive its class from {_home(cls)}.{cls.__name__}, which says what is required"
            )
        return component if isinstance(component, cls) else _adopter(cls)(component)


def _home(contract: type) -> str:
    """Return the package of which a contract is a public name."""
    package = contract.__module__.partition(".")[0]
    return "opir_core.plugin" if package == "opir_core" else package


def undefined(component: PluginPart, method: str, companion: str) -> ModelError:
    """Return the error of a part that has a `companion` and lacks the method that belongs to it."""
    part = component._part if isinstance(component, _Adopted) else component
    contract = next(base for base in type(component).__mro__ if method in vars(base))
    return ModelError(
        f"{type(part).__module__}.{type(part).__qualname__} has {companion} and defines no"
        f" {method}; define it as opir_core.plugin.{contract.__name__} says, or leave {companion}"
        f" out"
    )


def has_own(base: type, component: Any, name: str) -> bool:
    """Return whether a part defines a member itself, instead of the default of its base class."""
    if isinstance(component, _Adopted):
        return hasattr(object.__getattribute__(component, "_part"), name)
    return inspect.getattr_static(component, name, None) is not inspect.getattr_static(
        base, name, None
    )


class _Adopted:
    """A part and the defaults of a contract, for the members that the part lacks."""

    def __init__(self, component: Any) -> None:
        self._part = component

    def __getattribute__(self, name: str) -> Any:
        if name == "_part" or (name.startswith("__") and name.endswith("__")):
            return object.__getattribute__(self, name)
        component = object.__getattribute__(self, "_part")
        try:
            return getattr(component, name)
        except AttributeError:
            if (
                inspect.getattr_static(component, name, None) is not None
            ):  # a property of the part has failed
                raise
            return object.__getattribute__(self, name)

    def __reduce__(self) -> Any:
        contract: Any = type(self).__bases__[1]
        return contract.adopt, (object.__getattribute__(self, "_part"),)


@cache
def _adopter(contract: Any) -> Any:
    adopter: Any = type(contract.__name__, (_Adopted, contract), {})
    adopter.__abstractmethods__ = frozenset()
    return adopter


@cache
def _required(contract: Any) -> list[str]:
    values = (
        name for name, member in inspect.getmembers_static(contract) if isinstance(member, required)
    )
    return sorted({*contract.__abstractmethods__, *values})
