"""Trackers for opir, `kepler-arc` and `imm`, and how they begin a track, for adapters of other
trackers.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
