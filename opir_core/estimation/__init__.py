"""Estimation shared by the trackers and the bounds of scoring: square-root filters, motion models,
tangent axes.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
