"""A run as Arrow tables and data frames, and in formats of other programs.

Each name is imported when it is first used, so that a list of formats does not import pyarrow.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_export.tabular.run_tables import tables, to_pandas, to_polars

__all__ = ["tables", "to_pandas", "to_polars"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'opir_export' has no attribute {name!r}")
    return getattr(import_module("opir_export.tabular.run_tables"), name)


def __dir__() -> list[str]:
    return __all__
