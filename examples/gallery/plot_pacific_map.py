"""
Three launches and where they will come down
============================================

Ground tracks of three launches in the Pacific, thick while they burn, with the regions that the
tracker ``imm`` predicts to contain the impacts with 95 %. The projection is azimuthal equidistant
about the launches, so the antimeridian and the poles are no exceptions.
"""

from matplotlib import pyplot

import opir_core as opir

run = opir.simulate(opir.load_scene("../pacific_test_range.yaml"))
run.plot.map()
pyplot.show()
