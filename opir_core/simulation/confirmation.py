"""Confirmation over scans: a sensor reports a detection if it is the last of M in N successive
scans.
"""

import numpy as np

from opir_core.arrays import BoolArray, IntArray

#: Before every scan.
_NEVER = -(1 << 62)


class Confirmation:
    """M-of-N confirmation of the detections of pairs; remembers each pair's last detections between
    windows.

    `needed` (pairs,) is M, `scans` (pairs,) is N, of each pair's sensor.
    """

    def __init__(self, needed: IntArray, scans: IntArray) -> None:
        self._needed = needed
        self._scans = scans
        #: The scans (pairs, most M - 1) of the last detections of each pair, the latest one first.
        self.recent = np.full((len(needed), int(needed.max(initial=1)) - 1), _NEVER)

    def confirmed(self, pair: IntArray, scan: IntArray) -> BoolArray:
        """Return which detections are reported, given by pairs (n,) and scans (n,), sorted by pair,
        then scan.
        """
        start = np.flatnonzero(np.diff(pair, prepend=-1))
        times = np.diff(start, append=len(pair))
        place = np.arange(len(pair)) - np.repeat(start, times)
        back = self._needed[pair] - 1
        inside = np.flatnonzero(place >= back)
        remembered = np.flatnonzero(place < back)
        oldest_scan = np.empty(len(pair), dtype=np.int64)
        oldest_scan[inside] = scan[inside - back[inside]]
        oldest_scan[remembered] = self.recent[
            pair[remembered], back[remembered] - 1 - place[remembered]
        ]
        self._remember(pair[start], times, scan, start)
        return scan - oldest_scan < self._scans[pair]

    def take_over(self, former: "Confirmation", own_row: IntArray, former_row: IntArray) -> None:
        """Continue with the last detections of pairs of another one."""
        width = min(self.recent.shape[1], former.recent.shape[1])
        self.recent[own_row, :width] = former.recent[former_row, :width]

    def _remember(self, pair: IntArray, times: IntArray, scan: IntArray, start: IntArray) -> None:
        """Keep the scans of the last detections of distinct pairs, the latest one first."""
        recent = self.recent[pair]
        for back in range(recent.shape[1]):
            is_new = times > back
            new = scan[np.where(is_new, start + times - 1 - back, start)]
            old = recent[np.arange(len(pair)), np.where(is_new, 0, back - times)]
            self.recent[pair, back] = np.where(is_new, new, old)
