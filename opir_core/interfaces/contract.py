"""The base of the contracts, and parts that have the methods of one without deriving from it."""

import inspect
from abc import ABC
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Self

from opir_core.errors import ModelError, kind_of

if TYPE_CHECKING:
    optional = property
    required = property
else:

    class optional:  # noqa: N801 - a decorator
        """A property with a default, which a subclass or an instance may replace by a plain
        attribute.
        """

        def __init__(self, fget: Callable[[Any], Any]) -> None:
            self.fget = fget
            self.__doc__ = fget.__doc__

        def __get__(self, part: Any, _owner: Any = None) -> Any:
            return self if part is None else self.fget(part)

    class required(optional):  # noqa: N801 - a decorator
        """A property that a subclass or an instance must replace, by a plain attribute or a
        property.
        """

        def __get__(self, part: Any, _owner: Any = None) -> Any:
            if part is None:
                return self
            raise AttributeError(f"{type(part).__name__} defines no {self.fget.__name__}")


class PluginPart(ABC):  # noqa: B024 - its subclasses have the abstract methods
    """What the part that a component builds must have: required members, and optional ones with
    defaults.
    """

    @classmethod
    def adopt(cls, part: Any, owner: Callable[[], str] | None = None) -> Self:
        """Return a part as one of this class; what one of another class does not define has the
        default.

        Raises `ModelError`, which begins with what `owner` returns, if a required member is
        missing.
        """
        missing = [name for name in _required(cls) if not hasattr(part, name)]
        if missing:
            raise ModelError(
                f"{f'{owner()}: ' if owner else ''}build made {kind_of(part)} without"
                f" {', '.join(missing)};"
                f" derive its class from opir_core.plugin.{cls.__name__}, which says what is"
                f" required"
            )
        return part if isinstance(part, cls) else _adopter(cls)(part)


def has_own(base: type, part: Any, name: str) -> bool:
    """Return whether a part defines a member itself, instead of the default of its base class."""
    if isinstance(part, _Adopted):
        return hasattr(object.__getattribute__(part, "_part"), name)
    return inspect.getattr_static(part, name, None) is not inspect.getattr_static(base, name, None)


class _Adopted:
    """A part and the defaults of a contract, for the members that the part lacks."""

    def __init__(self, part: Any) -> None:
        self._part = part

    def __getattribute__(self, name: str) -> Any:
        if name == "_part" or (name.startswith("__") and name.endswith("__")):
            return object.__getattribute__(self, name)
        part = object.__getattribute__(self, "_part")
        try:
            return getattr(part, name)
        except AttributeError:
            if (
                inspect.getattr_static(part, name, None) is not None
            ):  # a property of the part has failed
                raise
            return object.__getattribute__(self, name)

    def __reduce__(self) -> Any:
        contract: Any = type(self).__bases__[1]
        return contract.adopt, (object.__getattribute__(self, "_part"),)


@cache
def _adopter(contract: Any) -> Any:
    made: Any = type(contract.__name__, (_Adopted, contract), {})
    made.__abstractmethods__ = frozenset()
    return made


@cache
def _required(contract: Any) -> list[str]:
    values = (
        name for name, member in inspect.getmembers_static(contract) if isinstance(member, required)
    )
    return sorted({*contract.__abstractmethods__, *values})
