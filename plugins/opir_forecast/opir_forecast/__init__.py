"""Forecasts of launched targets for any tracker: hypotheses, impact regions, launch points."""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
