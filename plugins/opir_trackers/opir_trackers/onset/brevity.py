"""Which tracks were seen too briefly to tell a launch from a light that stands still.

Looks at a source, evenly over a time T, with the summed information J of its place, tell its
velocity with the information J T² / 12 along each axis. Two motions that differ by v are separated
with the expected log odds of half of v² times this.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_trackers.onset.motion_statistics import LAUNCH, MotionStatistics
from opir_trackers.onset.posterior import SURE

#: What shone for less, s, is no launch unless that is certain: boosts last longer; notional.
SHORT_S = 5.0

#: A launch that is less probable needs no such doubt.
_MAYBE = 0.05


def are_brief(statistics: MotionStatistics, first_s: FloatArray, last_s: FloatArray) -> BoolArray:
    """Return which tracks (n,) have looks that cannot tell the speed of sound from none, or shone for
    moments.

    `first_s` and `last_s` (n,) are the times of their first and last looks; of one that was dark
    between, those since count. Those that are launches for sure are none, nor are those whose
    statistics have begun anew since the last look: they have been seen for long.
    """
    was_dark = ~statistics.has_begun_anew & (statistics.epoch_s > first_s)
    span_s = last_s - np.where(was_dark, statistics.epoch_s, first_s)
    place = 0.5 * np.trace(statistics.static_information, axis1=1, axis2=2)
    # The speed of sound, m/s (ISO 2533, sea level): launches pass it 50 to 70 s after lift-off,
    # where clouds end.
    log_odds = 0.5 * 340.3**2 * place * np.square(span_s) / 12.0
    launched = statistics.probability[:, LAUNCH]
    are_open = (launched < SURE) & (statistics.epoch_s <= last_s)
    # Odds of 20 to 1 are strong evidence (Kass and Raftery, Journal of the American Statistical
    # Association, 1995).
    are_weak = log_odds < np.log(20.0)
    return are_open & (are_weak | ((span_s < SHORT_S) & (launched > _MAYBE)))
