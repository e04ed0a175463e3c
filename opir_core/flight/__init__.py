"""Flight: two-body arcs, aimed boosts, numerical propagation, and trajectories as piecewise
polynomials.

Each name is imported when it is first used, so that a scene with two-body motion imports no
numerical propagation.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
