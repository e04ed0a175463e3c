"""Coverage of launch places by a fleet of infrared sensors."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
