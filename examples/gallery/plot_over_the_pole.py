"""
Launches over the pole
======================

Geostationary satellites look along the ground in the far north; satellites in highly elliptical and
low orbits see it from above. The same launches on a map of their region, and on one of the whole
Earth with every field of view.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../arctic_watch.yaml"))
run.plot.map()

# %%
# Fields of view end at the horizon or at the edge of the field of regard: spherical caps,
# dashed. Satellites that detect nothing are pale.

run.plot.world()
pyplot.show()
