"""
How a predicted impact region shrinks
=====================================

While the target burns, its impact may be nearly anywhere; after burnout the region is a few hundred
kilometres wide. Left: the last regions of the ICBM with the true impact. Right: the area of the 95
% region, tick by tick.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../pacific_test_range.yaml"))

figure, (left, right) = pyplot.subplots(1, 2, figsize=(12, 4.2), layout="constrained")
run.plot.impact("T1", ax=left)
run.plot.containment(ax=right)
pyplot.show()
