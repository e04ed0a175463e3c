"""
Signal, probability and air along a boost
=========================================

Near the ground water vapour and carbon dioxide take most of the plume's light; above some 30 km
next to nothing. The signal-to-noise ratio decides whether a look detects: DSP-1, in long waves
before the sunlit Earth, sees nothing.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../photons.yaml"))

figure, (top, middle, bottom) = pyplot.subplots(3, 1, figsize=(8.6, 8.5), layout="constrained")
run.plot.snr("T1", ax=top)
run.plot.probability("T1", ax=middle)
run.plot.air("T1", ax=bottom)
pyplot.show()
