"""
What each sensor detects, and when
==================================

A hundred launches within ten seconds. Each row is a sensor; its detections are stacked by type of
target. Each look sees the plumes through the air, before the Earth; no types are reported.
"""

from matplotlib import pyplot

import opir_core as opir

light = ["detection=snr", "atmosphere=lowtran", "background=earth", "classification=none"]
run = opir.simulate(opir.load_scene("../raid_100.yaml", overrides=["duration_s=180", *light]))
run.plot.timeline()
pyplot.show()
