"""A run as Arrow tables and data frames, and in formats of other programs.

Each name is imported when it is first used, so that a list of formats does not import pyarrow.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
