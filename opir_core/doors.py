"""Doors: the public names of a package, listed once in its stub (`__init__.pyi`), each imported at
first use; and functions whose module is imported when they are called.
"""

import re
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

__all__ = ["deferred", "door"]

#: The imports of a stub: the module, and its names in parentheses or on the line. The library
#: `lazy_loader` reads stubs too, but refuses imports from outside the package.
_IMPORT = re.compile(r"^from (\S+) import (?:\(([^)]*)\)|(.+))$", re.MULTILINE)


def door(spec: Any) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of the package of a module spec, from the
    imports in its stub.

    >>> from opir_core import geometry
    >>> "ecef_to_geodetic" in dir(geometry)
    True
    """
    package: str = spec.name
    text = spec.loader.get_data(f"{spec.origin}i").decode("utf-8")
    homes = {
        words.split()[-1]: module
        for module, listed_names, single_name in _IMPORT.findall(text)
        for words in (listed_names or single_name).split(",")
        if words.split()
    }

    def attribute(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    names = sorted(homes)
    return attribute, lambda: names, names


class deferred:  # noqa: N801 - used as a function
    """A function that calls the one at a place, `package.module.name`, and imports its module only
    then: the `build` of a component. It can be pickled.

    >>> from opir_core.plugin import deferred
    >>> deferred("math.hypot")(3.0, 4.0)
    5.0
    """

    def __init__(self, place: str) -> None:
        # Errors of a component name the package of its `build`.
        self.__module__, _, self._name = place.rpartition(".")

    def __call__(self, *arguments: Any) -> Any:
        """Return what the function returns."""
        return getattr(import_module(self.__module__), self._name)(*arguments)
