"""
How soon a launch is detected
=============================

With `detection: constant`, the paper's arithmetic, a scan period of 200 ms and a probability of
detection of 0.6 give a known distribution of the time to the first detection (dashed). The solid
lines are what the simulated sensors did: one step for each pair of sensor and launch.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../raid_100.yaml", overrides=["duration_s=60"]))
run.plot.latency()
pyplot.show()
