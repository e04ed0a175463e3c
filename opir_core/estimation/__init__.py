"""Ellipses of containment, which outputs, scores and reports share."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
