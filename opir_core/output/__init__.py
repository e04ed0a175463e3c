"""Output: windows to sinks, and the files of a run.

Each name is imported when it is first used, so that a run without files imports no encoder.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
