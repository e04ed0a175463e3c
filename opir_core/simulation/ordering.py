"""Stage of the engine: the order of the detections by time."""

import numpy as np
from attrs import frozen

from opir_core.planning.sightlines import Pairs
from opir_core.simulation.observation import Observation

#: numpy sorts whole numbers of 16 bits by radix, several times faster than longer ones.
_RADIX_LIMIT = 1 << 16


@frozen(eq=False)
class OrderByTime:
    """Takes `hits` (n,), sorted by pair, then time; gives `order` (n,), by time, then pair.

    `tick_ns` is the longest step of which all look times are whole multiples.
    """

    tick_ns: int

    @classmethod
    def of(cls, pairs: Pairs) -> "OrderByTime":
        """Return the stage for the look times of pairs."""
        return cls(int(np.gcd.reduce(np.concatenate([pairs.period_ns, pairs.phase_ns]), initial=0)) or 1)

    def __call__(self, window: Observation) -> None:
        """Sort the hits."""
        time_ns = window.hits.time_ns
        ticks = (time_ns - (time_ns.min() if len(time_ns) else 0)) // self.tick_ns
        if ticks.max(initial=0) < _RADIX_LIMIT:
            window.order = np.argsort(ticks.astype(np.uint16), kind="stable")
        else:
            window.order = np.lexsort((window.hits.pair, time_ns))
