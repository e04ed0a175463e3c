"""Scores of tracks against truth: errors, consistency, bounds, containment, completeness, purity,
GOSPA.

Only scores compare tracks with truth; no tracker imports this package.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
