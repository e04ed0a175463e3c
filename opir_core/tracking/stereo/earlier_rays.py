"""Whose rays are that came before their tracks were sure: those of a track's beginning, and of before it.

A track's labels begin once it has been seen often enough; with sensors that look seldom most of a burn is over by then.
"""

import numpy as np

from opir_core.arrays import IntArray
from opir_core.tracking.association import associate_nearest, nobody
from opir_core.tracking.gating import candidates, gated
from opir_core.tracking.rays import Rays
from opir_core.tracking.stereo.situation import Situation
from opir_core.tracking.stereo.tracking import StereoTracking


def earlier_owners(tracking: StereoTracking, now: Situation, number: IntArray, rays: Rays) -> IntArray:
    """Return which of tracks by number (k,) each ray (n,) is of, -1 for none, judged by their paths followed back."""
    rows = np.flatnonzero(np.isin(now.roster.number, number))
    if not len(rows) or not len(rays.time_s):
        return nobody(len(rays.time_s))
    gate, light_time = tracking.config.gate_sigma, tracking.following.light_time
    path = tracking.filter.outlook(now.bank.take(rows), now.time_s)
    rays, span = tracking.biases.widened(rays), now.time_s - float(rays.time_s.min())
    pairs = gated(path, rays, *candidates(path, rays, span, gate, light_time), gate, light_time)
    owner = associate_nearest(pairs, rays, tracking.following.chances).owner
    whose: IntArray = np.append(now.roster.number[rows], -1)[owner]
    return whose
