"""The plan of a scene: components built, targets, lines of sight, visibility."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
