"""Stages of the engine, of every scene: looks are found, drawn against their P_d, counted, and
ordered by time.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from opir_core.arrays import IndexArray, IntArray
from opir_core.planning.looks import Looks, look_times_ns
from opir_core.planning.plan import Plan
from opir_core.planning.sightlines import Pairs
from opir_core.random_streams.pair_streams import PairStreams, WindowNumbers
from opir_core.random_streams.philox import uniforms_of
from opir_core.simulation.observation import Hits, Observation
from opir_core.simulation.output_checks import checked_confirmation

if TYPE_CHECKING:
    from opir_core.planning.sensor_modes import SensorModes
    from opir_core.simulation.confirmation import Confirmation
    from opir_core.simulation.pointing import PointedFields

#: numpy sorts whole numbers of 16 bits by radix, several times faster than longer ones.
_RADIX_LIMIT = 1 << 16


@frozen(eq=False, repr=False)
class FindLooks:
    """Takes the window's times; gives `looks` and `numbers`."""

    pairs: Pairs
    streams: PairStreams
    #: Of scenes whose sensors have modes: those not in force make no look.
    fields: "PointedFields | None" = None

    def __call__(self, window: Observation) -> None:
        """Find the looks in [start, end)."""
        span_ns = window.start_ns, window.end_ns
        idle = () if self.fields is None else self.fields.idle(*span_ns)
        looks = Looks.between(self.pairs, *span_ns, idle)
        window.looks = looks
        window.numbers = WindowNumbers(self.streams, looks.active, looks.first_scan, looks.scans)

    def forget(self, window: Observation) -> None:
        """Release the random streams of pairs without further looks; the last stage."""
        active = window.looks.active
        self.streams.forget(active[self.pairs.is_over(window.end_ns)[active]])


def draw_detections(window: Observation) -> None:
    """Draw which looks detect.

    Takes `looks`, `numbers`, `probability` (l,) and `undecided`; gives `row`, `pair` and `scan`
    (n,) of looks that detect, sorted by sensor, then target, then time.
    """
    # Looks with a P_d of 0 or 1 need no random number: 0 will do.
    drawn = window.numbers.words("detection", window.undecided)
    row = np.flatnonzero(uniforms_of(drawn) < window.probability)
    window.row = row
    window.pair = window.looks.pair.take(row)
    window.scan = window.looks.scan.take(row)


@frozen(eq=False, repr=False)
class DrawDirections:
    """Takes `row`, `pair`, `scan`, `count` and `numbers`; gives `hits` (n,), with their times and
    random words.
    """

    pairs: Pairs

    def __call__(self, window: Observation) -> None:
        """Draw the random words of the line-of-sight errors."""
        row = window.row
        pair = window.pair
        scan = window.scan
        words = window.numbers.of_rows("line-of-sight", 1, row, pair)[:, 0]
        time_ns = look_times_ns(self.pairs, pair, scan)
        window.hits = Hits(
            row, pair, scan, time_ns, window.count, window.probability.take(row), words
        )


class CountDetections:
    """Takes `row`, `pair` and `scan` (n,); gives `count` (n,), and of all four only the rows that
    are reported.
    """

    def __init__(self, plan: Plan, modes: "SensorModes | None" = None) -> None:
        self._names = plan.pair_names()
        self._pairs = plan.pairs
        #: By pair that of the sensor with its own settings, which counts for all its modes.
        self._counted_pair: IntArray | None = None
        if modes is not None:
            pairs = plan.pairs
            self._counted_pair = modes.sensor[pairs.sensor] * len(plan.targets.ids) + pairs.target
        self._counts = np.zeros(len(plan.pairs), dtype=np.int32)
        self._confirmation = _confirmation(plan)

    @property
    def carried(self) -> Sequence[IntArray]:
        """The state passed on to the next window, changed in place: each pair's count and last
        detections.
        """
        recent = () if self._confirmation is None else (self._confirmation.recent,)
        return self._counts, *recent

    def take_over(self, former: "CountDetections") -> None:
        """Continue with the counts and last detections of another run with the same sensors."""
        rows = {name: row for row, name in enumerate(former._names)}
        row_pairs = [(row, rows[name]) for row, name in enumerate(self._names) if name in rows]
        own_row, former_row = np.array(row_pairs, dtype=np.int64).reshape(-1, 2).T
        self._counts = np.zeros(len(self._names), dtype=np.int32)
        self._counts[own_row] = former._counts[former_row]
        if self._confirmation is not None and former._confirmation is not None:
            self._confirmation.take_over(former._confirmation, own_row, former_row)

    def __call__(self, window: Observation) -> None:
        """Count the detections, which come in runs of a pair in order of time."""
        with window.turn:
            window.count = self._counts_of(window.pair, window.scan)
            if self._confirmation is None:
                return
            reported = np.flatnonzero(self._confirmation.confirmed(window.pair, window.scan))
        window.row = window.row.take(reported)
        window.pair = window.pair.take(reported)
        window.scan = window.scan.take(reported)
        window.count = window.count.take(reported)

    def _counts_of(self, pair: IntArray, scan: IntArray) -> IndexArray:
        """Return the numbers (n,) of detections by sensor and target so far, in order of time."""
        if self._counted_pair is None:
            return self._counted(pair)
        counted = self._counted_pair[pair]
        order = np.lexsort((look_times_ns(self._pairs, pair, scan), counted))
        count = np.empty(len(pair), dtype=np.int32)
        count[order] = self._counted(counted[order])
        return count

    def _counted(self, pair: IntArray) -> IndexArray:
        """Return the numbers (n,) of detections of pairs (n,) so far, each included."""
        start = np.flatnonzero(np.diff(pair, prepend=-1))
        distinct = pair[start]
        times = np.diff(start, append=len(pair))
        place = np.arange(len(pair)) - np.repeat(start, times)
        count: IndexArray = (self._counts[pair] + place + 1).astype(np.int32)
        self._counts[distinct] += times.astype(np.int32)
        return count


def _confirmation(plan: Plan) -> "Confirmation | None":
    """Return the confirmation over scans, if the detection model has one and it needs more than one
    detection.
    """
    if plan.detection.confirmation is None:
        return None
    confirmation = checked_confirmation(plan.detection.confirmation, len(plan.sensors))
    if not np.any(confirmation[:, 0] > 1):
        return None
    from opir_core.simulation.confirmation import Confirmation

    needed, scans = confirmation[plan.pairs.sensor].T
    return Confirmation(needed, scans)


@frozen(eq=False, repr=False)
class OrderByTime:
    """Takes `hits` (n,), sorted by pair, then time; gives `order` (n,), by time, then pair.

    `tick_ns` is the longest step of which all look times are whole multiples.
    """

    tick_ns: int

    @classmethod
    def of(cls, pairs: Pairs) -> "OrderByTime":
        """Return the stage for the look times of pairs."""
        return cls(
            int(np.gcd.reduce(np.concatenate([pairs.period_ns, pairs.phase_ns]), initial=0)) or 1
        )

    def __call__(self, window: Observation) -> None:
        """Sort the hits."""
        time_ns = window.hits.time_ns
        ticks = (time_ns - (time_ns.min() if len(time_ns) else 0)) // self.tick_ns
        if ticks.max(initial=0) < _RADIX_LIMIT:
            window.order = np.argsort(ticks.astype(np.uint16), kind="stable")
        else:
            window.order = np.lexsort((window.hits.pair, time_ns))
