"""Stages of the engine: each look is drawn against its P_d, and hits get their times and directions."""

import numpy as np
from attrs import frozen

from opir_core.planning.looks import look_times_ns
from opir_core.planning.sightlines import Pairs
from opir_core.random_streams.philox import uniforms_of
from opir_core.simulation.observation import Hits, Observation


def draw_detections(window: Observation) -> None:
    """Draw which looks detect.

    Takes `looks`, `numbers`, `probability` (l,) and `undecided`; gives `row`, `pair` and `scan` (n,) of looks that
    detect, sorted by sensor, then target, then time.
    """
    # Looks with a P_d of 0 or 1 need no random number: 0 will do.
    drawn = window.numbers.words("detection", window.undecided)
    row = window.row = np.flatnonzero(uniforms_of(drawn) < window.probability)
    window.pair, window.scan = window.looks.pair.take(row), window.looks.scan.take(row)


@frozen(eq=False)
class DrawDirections:
    """Takes `row`, `pair`, `scan`, `count` and `numbers`; gives `hits` (n,), with their times and random words."""

    pairs: Pairs

    def __call__(self, window: Observation) -> None:
        """Draw the random words of the line-of-sight errors."""
        row, pair, scan = window.row, window.pair, window.scan
        words = window.numbers.of_rows("line-of-sight", 1, row, pair)[:, 0]
        time_ns = look_times_ns(self.pairs, pair, scan)
        window.hits = Hits(row, pair, scan, time_ns, window.count, window.probability.take(row), words)
