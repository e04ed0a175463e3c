"""Parameter studies: sweeps over scenes, metrics with intervals, executors, comparison of
trackers.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
