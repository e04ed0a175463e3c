"""The contract of detection models, and the records and random numbers that they work on.

The result of a row must not depend on the other rows of a call: the engine may pass any slice of a
run, and the bytes of the events must be the same.
"""

from abc import abstractmethod
from typing import Any, Protocol

from attrs import frozen

from opir_core.arrays import ByteArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.contract import PluginPart, optional, undefined
from opir_core.interfaces.records import Exposures
from opir_core.interfaces.sensors import Band


class RandomDraws(Protocol):
    """Random numbers for a batch of rows, each from the stream of its (sensor, target, purpose),
    addressed by scan.

    The numbers of a row depend on the seed, the two ids, the purpose and the scan alone.

    >>> class Halves:  # to call a model without a run
    ...     def uniforms(self, purpose, words=1):
    ...         return np.full((1, words), 0.5)
    ...
    ...     normals = pair_uniforms = uniforms
    ...
    ...     def take(self, rows):
    ...         return self
    >>> rng: RandomDraws = Halves()
    >>> rng.uniforms("bands", words=2)
    array([[0.5, 0.5]])
    """

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (rows, words) numbers in [0, 1), fresh for each scan."""

    def normals(self, purpose: str, count: int = 1) -> FloatArray:
        """Return (rows, count) standard normal numbers, fresh for each scan."""

    def pair_uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return (rows, words) numbers in [0, 1), the same for all scans of a sensor and a
        target.
        """

    def take(self, rows: Any) -> "RandomDraws":
        """Return the random draws of some of the rows."""


@frozen(eq=False, repr=False)
class Measured(Columns):
    """Measurements of looks that detected, as in `Detections`; None for the sensor's own sigma, or
    if not measured.
    """

    bands: ByteArray
    snr: FloatArray
    line_of_sight_sigma_rad: FloatArray | None = None
    band_irradiance_w_m2: FloatArray | None = None
    band_noise_w_m2: FloatArray | None = None


@frozen(eq=False, repr=False)
class Response(Columns):
    """Expected measurements of looks: the quantile of P_d, and each band's signal and noise.

    `probit` (n,) is the standard normal quantile of P_d, None where the engine has it already;
    `snr` (n, B) the expected signals over `noise_w_m2` (n, B), the standard deviations of the noise
    at the aperture; 0 and 1 beyond a sensor's own bands. `elevation_sine` (n,) is of the sensor's
    elevation above the target's horizon; None if the model does not need it to measure.
    """

    probit: FloatArray | None
    snr: FloatArray
    noise_w_m2: FloatArray
    elevation_sine: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.snr)

    def sine(self, rows: Any) -> FloatArray | None:
        """Return the sines of the elevations of some of the looks, if there are any."""
        return None if self.elevation_sine is None else self.elevation_sine[rows]


class DetectionProbability(PluginPart):
    """Exposures to probability of detection; by default every look on its own, without signals or
    false alarms.

    A model with signals defines `response` and `measure_response`: if it has a
    `probability_tolerance` too, the engine interpolates its P_d between looks. One with false
    alarms defines `rate_per_scan`, `words` and `measure_noise`.

    >>> class Sure(DetectionProbability):
    ...     def probability(self, exposures):
    ...         return np.ones(len(exposures))
    ...
    ...     def measure(self, exposures, rng):
    ...         return Measured(
    ...             bands=np.ones(len(exposures), dtype=np.uint8), snr=np.full(len(exposures), np.nan)
    ...         )
    >>> Sure().probability(range(2))
    array([1., 1.])
    """

    @optional
    def needs_geometry(self) -> bool:
        """Whether `probability` reads the geometry columns of its exposures."""
        return True

    @optional
    def uses_seed(self) -> bool:
        """Whether the model is built from the scene's seed; replicates share one that is not."""
        return True

    def pair_probability(self, sensor: IndexArray, target: IndexArray) -> FloatArray | None:
        """Return P_d (n,) of all looks of the pairs, or None if it varies from look to look."""
        return None

    @abstractmethod
    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probability of detection of each look, in [0, 1]."""

    @abstractmethod
    def measure(self, exposures: Exposures, rng: RandomDraws) -> Measured:
        """Return the measurements of looks that detected."""

    @optional
    def probability_tolerance(self) -> float | None:
        """Largest error of a P_d that is interpolated between looks, or None to evaluate every
        look.
        """
        return None

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response | None:
        """Return the expected measurements of looks, with P_d to within `slack`; None for a model
        without signals.
        """
        return None

    def measure_response(
        self,
        response: Response,
        sensor: IndexArray,
        rng: RandomDraws,
        probability: FloatArray | None = None,
    ) -> Measured:
        """Return the measurements of looks that detected; `probability` (n,) replaces a probit of
        None.

        A model with `response` must define it; `ModelError` without it.
        """
        raise undefined(self, "measure_response", "response")

    def breakpoints_s(self) -> FloatArray | None:
        """Return the scene times (targets, k) at the target when any of its signals may jump or
        bend; nan for none.
        """
        return None

    def transmittance(self, exposures: Exposures, band: Band) -> FloatArray | None:
        """Return the transmittances (n,) in a band between the targets and the sensors of looks,
        None if unknown.
        """
        return None

    @optional
    def confirmation(self) -> IntArray | None:
        """The needed detections M and the successive scans N among which these must be, (sensors,
        2); None for 1 of 1.

        The false alarms of a model with confirmation are the confirmed ones.
        """
        return None

    @optional
    def rate_per_scan(self) -> FloatArray | None:
        """Mean number (sensors,) of reported false alarms in one scan of the whole field of regard;
        None for none.
        """
        return None

    @optional
    def words(self) -> int:
        """Number of random numbers per false alarm."""
        return 0

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return the measurements (n,) of false alarms, from numbers (n, words) in [0, 1).

        A model with `rate_per_scan` must define it; `ModelError` without it.
        """
        raise undefined(self, "measure_noise", "rate_per_scan")
