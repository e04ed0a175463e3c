"""The kit for sensor packages: scanning sensors, scan patterns, confusion matrices."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
