"""Stage of the engine: the detections of each pair are counted and, where sensors do so, confirmed over scans."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import IndexArray, IntArray
from opir_core.planning.plan import Plan
from opir_core.simulation.confirmation import Confirmation, confirmation_of
from opir_core.simulation.observation import Observation


class CountDetections:
    """Takes `row`, `pair` and `scan` (n,); gives `count` (n,), and of all four only the rows that are reported."""

    def __init__(self, plan: Plan) -> None:
        self._names = plan.pair_names()
        self._counts = np.zeros(len(plan.pairs), dtype=np.int32)
        self._confirmation: Confirmation | None = confirmation_of(plan.detection, plan.pairs, len(plan.sensors))

    @property
    def carried(self) -> Sequence[IntArray]:
        """The state passed on to the next window, changed in place: each pair's count and last detections."""
        recent = () if self._confirmation is None else (self._confirmation.recent,)
        return self._counts, *recent

    def take_over(self, former: "CountDetections") -> None:
        """Continue with the counts and last detections of another run with the same sensors."""
        rows = {name: row for row, name in enumerate(former._names)}
        both = [(row, rows[name]) for row, name in enumerate(self._names) if name in rows]
        own_row, former_row = np.array(both, dtype=np.int64).reshape(-1, 2).T
        self._counts = np.zeros(len(self._names), dtype=np.int32)
        self._counts[own_row] = former._counts[former_row]
        if self._confirmation is not None and former._confirmation is not None:
            self._confirmation.take_over(former._confirmation, own_row, former_row)

    def __call__(self, window: Observation) -> None:
        """Count the detections, which come in runs of a pair in order of time."""
        with window.turn:
            window.count = self._counted(window.pair)
            if self._confirmation is None:
                return
            reported = np.flatnonzero(self._confirmation.confirmed(window.pair, window.scan))
        window.row, window.pair = window.row.take(reported), window.pair.take(reported)
        window.scan, window.count = window.scan.take(reported), window.count.take(reported)

    def _counted(self, pair: IntArray) -> IndexArray:
        """Return the numbers (n,) of detections of pairs (n,) so far, each included."""
        start = np.flatnonzero(np.diff(pair, prepend=-1))
        distinct, times = pair[start], np.diff(start, append=len(pair))
        place = np.arange(len(pair)) - np.repeat(start, times)
        count: IndexArray = (self._counts[pair] + place + 1).astype(np.int32)
        self._counts[distinct] += times.astype(np.int32)
        return count
