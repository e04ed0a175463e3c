"""Who can see whom, and when: the pairs of a sensor and a target that have looks at all.

Along each pair's burn the geometry is sampled on a grid of scene time. Between two samples it cannot stray from the
straight line by more than acceleration · step² / 8, so most stretches are certain: seen throughout or not at all. The
looks of a pair with an uncertain stretch are judged one by one, in that stretch.
"""

from opir_core.planning.visibility.compilation import compile_pairs
from opir_core.planning.visibility.grid import distance_m
from opir_core.planning.visibility.margins import visible_now
from opir_core.planning.visibility.records import Blocked, GridPlace, Pairs, Sightlines, Visibility

__all__ = ["Blocked", "GridPlace", "Pairs", "Sightlines", "Visibility", "compile_pairs", "distance_m", "visible_now"]
