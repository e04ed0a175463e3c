"""Detection models that reckon with light: what they have beside `DetectionProbability`.

The engine asks a model for `SignalModel` where it has `probability_tolerance`, and for `FalseAlarmModel` where it has
`rate_per_scan`.
"""

from typing import Protocol, runtime_checkable

from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Measured, RandomDraws
from opir_core.interfaces.records import Exposures


@frozen(eq=False)
class Response(Columns):
    """What looks would measure: the quantile of their probability of detection, and each band's signal and noise.

    `probit` (n,) is the standard normal quantile of the probability, None where the engine knows that; `snr` (n, B) the
    expected signals over `noise_w_m2` (n, B), the standard deviations of the noise at the aperture; 0 and 1 beyond a
    sensor's own bands.
    """

    probit: FloatArray | None
    snr: FloatArray
    noise_w_m2: FloatArray

    def __len__(self) -> int:
        return len(self.snr)


@runtime_checkable
class SignalModel(Protocol):
    """What detection models also have whose probabilities vary slowly along a track, so that looks may share knots."""

    @property
    def probability_tolerance(self) -> float | None:
        """How far the probability of a look may be from the exact one, or None where every look is evaluated."""

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        """Return what looks would measure; with a `slack`, probabilities need to be right only to within it."""

    def measure_response(
        self, response: Response, sensor: IndexArray, dice: RandomDraws, probability: FloatArray | None = None
    ) -> Measured:
        """Return what is measured in looks that detected; `probability` (n,) stands in for a probit of None."""


@runtime_checkable
class WithBreakpoints(Protocol):
    """What `SignalModel` models also have that know when signals jump or bend: knots are laid there at once."""

    def breakpoints_s(self) -> FloatArray:
        """Return when (targets, k), by scene time at the target, any of its signals may jump or bend; nan for none."""


@runtime_checkable
class FalseAlarmModel(Protocol):
    """How often, and as what, noise alone crosses a sensor's threshold."""

    @property
    def rate_per_scan(self) -> FloatArray:
        """Mean numbers (sensors,) of exceedances in one scan of the whole field of regard."""

    @property
    def words(self) -> int:
        """How many numbers an exceedance is drawn with."""

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return what is measured (n,) where noise alone crossed, from numbers (n, words) in [0, 1)."""
