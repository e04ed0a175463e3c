"""The packages and modules whose `__all__` are the public names: those of the API reference."""

import sys
from importlib import import_module

from repository import ROOT

sys.path.append(str(ROOT / "docs"))
try:
    PUBLIC: frozenset[str] = frozenset(import_module("api_reference").PUBLIC)
finally:
    sys.path.pop()


def is_public(module, name):
    """Return whether a name may be imported from a module: it is in its `__all__`, or a public
    module itself.

    Of other distributions the package itself is public.
    """
    is_door = module in PUBLIC or "." not in module
    return f"{module}.{name}" in PUBLIC or (
        is_door and name in getattr(import_module(module), "__all__", ())
    )
