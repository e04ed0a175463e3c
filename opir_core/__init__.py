"""opir: a plugin-based simulator of overhead infrared (OPIR) missile-warning sensors.

The names below are the public door; each is imported when it is first used, so `import opir_core`
costs next to nothing.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
