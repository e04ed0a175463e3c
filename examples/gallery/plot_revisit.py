"""
How the revisit interval changes the latency
============================================

A study: one launch and one satellite, four scan periods, forty runs of each. Points are means with
95 % intervals; the second plot is the difference from the shortest period, run by run: intervals
without 0 show a difference. The scene has the paper's constant P_d per look, without air or light.
Needs ``opir-studies``.
"""

from pathlib import Path
from tempfile import mkdtemp

from matplotlib import pyplot
from opir_report import StudyPlots
from opir_studies import Study, sweep

folder = Path(mkdtemp()) / "revisit"
study = Study(
    scene="../first_light.yaml",
    vary={"sensors[*].scan_period_ms": [50, 100, 200, 400]},
    overrides={"duration_s": 60},
    runs=40,
    metrics=["latency"],
    executor="serial",
)
sweep(study, folder)
StudyPlots(folder).effect("latency_s")

# %%
# Paired differences: every design sees the same random numbers.

StudyPlots(folder).difference("latency_s")
pyplot.show()
