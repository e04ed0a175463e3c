"""
How good the tracks are
=======================

The normalised estimation error squared (NEES) compares the error of a track with the covariance
that it reports: divided by its six degrees of freedom, 1 is consistent. The second plot shows how
sure detections and tracks are of the type.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../pacific_test_range.yaml"))
run.plot.nees()

# %%
# Confidence of the detections, and dotted the probability of the likeliest type of each track.

run.plot.confidence()

# %%
# The scores of the tracks, as ``opir score`` prints them.

run.plot.scorecard()
pyplot.show()
