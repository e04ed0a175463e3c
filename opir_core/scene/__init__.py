"""The scene: its classes, the fields of settings with units and ranges, target classes."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
