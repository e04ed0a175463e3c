"""Tracks that begin with rays from before they were known: the fit goes through that time as if it had known them."""

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.strain import OffModelFilters


def caught_up(
    fitting: Fitting,
    bank: OffModelFilters,
    track: IntArray,
    rays: LinesOfSight,
    stray: FloatArray,
    cadence_s: float,
    now_s: float,
) -> OffModelFilters:
    """Return the bank with tracks that begin with rays (m,) from up to a tick, given to them by number (m,).

    All at once they would leave the fit far from where it begins. So each tick that one of the tracks was seen in is
    taken by itself. `stray` (m,) is the share of strays among each ray's track's.
    """
    young = OffModelFilters.empty(bank.seen.hits.shape[1])
    ticks_s = np.minimum((np.floor(rays.time_s / cadence_s) + 1.0) * cadence_s, now_s)
    for tick_s in np.unique(ticks_s).tolist():
        mine = np.flatnonzero(ticks_s == tick_s)
        young = fitting.stepped(young, tick_s, track[mine], rays.take(mine), stray[mine])
    return bank.joined(young)
