"""Plots of a run with matplotlib, and reports of runs and studies as one HTML file.

Each name is imported when it is first used, so that a command that draws nothing does not import
matplotlib.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
