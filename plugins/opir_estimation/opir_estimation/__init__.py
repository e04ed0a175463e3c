"""Estimation for trackers and scores: lines of sight, gates, assignment, triangulation, square-root
filters and their mixtures, registration. It knows no scene.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
