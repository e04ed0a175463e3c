"""Live runs: a scene paced by the clock in its own thread, with launches and changed settings
between two windows.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
