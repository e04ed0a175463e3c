"""Counter-based random streams and the ids of detections."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
