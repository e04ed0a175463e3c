"""Which tracks were seen too briefly to tell a launch from a light that stands still.

Looks at a source, evenly over a time T, with the summed information J of its place, tell its
velocity with the information J T² / 12 along each axis. Two motions that differ by v are separated
with the expected log odds of half of v² times this.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_trackers.onset.motion_statistics import LAUNCH, MotionStatistics
from opir_trackers.onset.posterior import SURE


def are_brief(statistics: MotionStatistics, first_s: FloatArray, last_s: FloatArray) -> BoolArray:
    """Return which tracks (n,) have looks that cannot tell the speed of sound from none.

    `first_s` and `last_s` (n,) are the times of their first and last looks. Those that are launches
    for sure are none, nor are those whose statistics have begun anew since the last look: they have
    been seen for long.
    """
    place = 0.5 * np.trace(statistics.static_information, axis1=1, axis2=2)
    # The speed of sound, m/s (ISO 2533, sea level): launches pass it 50 to 70 s after lift-off,
    # where clouds end.
    log_odds = 0.5 * 340.3**2 * place * np.square(last_s - first_s) / 12.0
    are_open = (statistics.probability[:, LAUNCH] < SURE) & (statistics.epoch_s <= last_s)
    # Odds of 20 to 1 are strong evidence (Kass and Raftery, Journal of the American Statistical
    # Association, 1995).
    return (log_odds < np.log(20.0)) & are_open
