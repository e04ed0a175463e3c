"""Stage of the engine, of scenes with interpolated P_d: the measurements of all hits at once."""

from attrs import evolve, frozen

from opir_core.arrays import IndexArray
from opir_core.simulation.observation import Observation
from opir_core.simulation.output_checks import checked_measured


@frozen(eq=False, repr=False)
class MeasureResponses:
    """Takes `hits` (n,), `numbers` and `interpolant`; gives `measured`.

    In other scenes `BuildDetections` measures, block by block, with the geometry that it needs
    anyway.

    `sensor` (pairs,) are the pairs' sensors, `bands` is the largest number of bands of a sensor.
    """

    sensor: IndexArray
    bands: int
    keeps_noise: bool

    def __call__(self, window: Observation) -> None:
        """Measure all hits, which are sorted by sensor."""
        hits = window.hits
        interpolant = window.interpolant
        if interpolant is None or not len(hits):
            return
        rng = window.numbers.of(hits.row, hits.pair, hits.direction_words)
        measured = interpolant.measured(hits.row, self.sensor[hits.pair], rng, hits.probability)
        checked = checked_measured(measured, len(hits), self.bands, "measure_response")
        window.measured = checked if self.keeps_noise else evolve(checked, band_noise_w_m2=None)
