"""Geometry of sensors, targets, the Earth and the Sun: arrays in, arrays out, the last axis x, y,
z.

Functions of the Sun and of sidereal time are imported when they are first used.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
