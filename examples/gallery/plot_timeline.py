"""
What each sensor detects, and when
==================================

A hundred launches within ten seconds. Each row is a sensor; its detections are stacked by type of
target.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../raid_100.yaml", overrides=["duration_s=180"]))
run.plot.timeline()
pyplot.show()
