"""Stage of the engine: the looks of a window."""

from attrs import frozen

from opir_core.planning.looks import Looks
from opir_core.planning.sightlines import Pairs
from opir_core.random_streams.pair_streams import PairStreams, WindowNumbers
from opir_core.simulation.observation import Observation


@frozen(eq=False)
class FindLooks:
    """Takes the window's times; gives `looks` and `numbers`."""

    pairs: Pairs
    streams: PairStreams

    def __call__(self, window: Observation) -> None:
        """Find the looks in [start, end)."""
        looks = window.looks = Looks.between(self.pairs, window.start_ns, window.end_ns)
        window.numbers = WindowNumbers(self.streams, looks.active, looks.first_scan, looks.scans)

    def forget(self, window: Observation) -> None:
        """Release the random streams of pairs without further looks; the last stage."""
        active = window.looks.active
        self.streams.forget(active[self.pairs.is_over(window.end_ns)[active]])
