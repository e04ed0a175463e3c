"""Optional abilities of components: a component that has all members of one of these protocols is used for it.

The engine, the live run and the sinks ask with `isinstance`, once, when they are made. A component that has some of the
members and not all of them fails the conformance tests of its hook.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Measured, RandomDraws
from opir_core.interfaces.records import ClassifierInputs, Exposures


@runtime_checkable
class FreeFlight(Protocol):
    """`Trajectories` of targets that can be followed after burnout."""

    @property
    def end_s(self) -> FloatArray:
        """Scene times up to which positions are known, (n,) s: impact, or burnout if no sensor follows targets."""


@runtime_checkable
class WithClasses(Protocol):
    """`Trajectories` of targets of classes finer than the missile types; without it the class is the missile type."""

    @property
    def class_names(self) -> Sequence[str]:
        """Names of the target classes, one per target."""


@runtime_checkable
class WithBurns(Protocol):
    """`Trajectories` of targets with several burns; without it a plume radiates from ignition to burnout."""

    @property
    def burns_s(self) -> FloatArray:
        """Scene times (n, k, 2) of ignition and burnout of each burn, in order; nan where a target has fewer.

        The first begins at `ignition_s`, the last ends at `burnout_s`. Where one does not follow at once, the plume is
        dark: only sensors that follow bodies observe the target, as after burnout.
        """


@runtime_checkable
class FromFiles(Protocol):
    """`Trajectories` that are read from files; the run manifest lists them."""

    @property
    def files(self) -> Sequence[Mapping[str, Any]]:
        """The `path` and `sha256` of each file."""


@frozen(eq=False, repr=False)
class Response(Columns):
    """Expected measurements of looks: the quantile of P_d, and each band's signal and noise.

    `probit` (n,) is the standard normal quantile of P_d, None where the engine has it already; `snr` (n, B) the
    expected signals over `noise_w_m2` (n, B), the standard deviations of the noise at the aperture; 0 and 1 beyond a
    sensor's own bands. `elevation_sine` (n,) is of the sensor's elevation above the target's horizon; None if the model
    does not need it to measure.
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


@runtime_checkable
class SignalModel(Protocol):
    """A detection model with a P_d that varies slowly along a track, so that it can be interpolated between looks."""

    @property
    def probability_tolerance(self) -> float | None:
        """Largest error of an interpolated P_d, or None to evaluate every look."""

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        """Return the expected measurements of looks, with P_d to within `slack`."""

    def measure_response(
        self, response: Response, sensor: IndexArray, dice: RandomDraws, probability: FloatArray | None = None
    ) -> Measured:
        """Return the measurements of looks that detected; `probability` (n,) replaces a probit of None."""


@runtime_checkable
class WithBreakpoints(Protocol):
    """A `SignalModel` that knows when signals jump or bend: the interpolation grid starts with these times."""

    def breakpoints_s(self) -> FloatArray:
        """Return the scene times (targets, k) at the target when any of its signals may jump or bend; nan for none."""


@runtime_checkable
class ConfirmingModel(Protocol):
    """A detection model of sensors that confirm detections over scans before they report them."""

    @property
    def confirmation(self) -> IntArray:
        """The needed detections M and the successive scans N among which these must be, (sensors, 2)."""


@runtime_checkable
class FalseAlarmModel(Protocol):
    """A detection model with false alarms: rate and measurements of noise alone above a sensor's threshold.

    With `ConfirmingModel` these are the confirmed ones.
    """

    @property
    def rate_per_scan(self) -> FloatArray:
        """Mean number (sensors,) of reported false alarms in one scan of the whole field of regard."""

    @property
    def words(self) -> int:
        """Number of random numbers per false alarm."""

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return the measurements (n,) of false alarms, from numbers (n, words) in [0, 1)."""


@runtime_checkable
class PosteriorClassifier(Protocol):
    """A `Classifier` that returns type probabilities: tracks can revise them."""

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray:
        """Return ln P (n, 4) over `REPORTED_TYPES`."""

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        """Return posteriors (n, 4) combined with type probabilities from the tracks' motion, (n, 4)."""

    def reported(self, log_posterior: FloatArray) -> NDArray[np.uint8]:
        """Return the codes (n,) reported for posteriors."""


@runtime_checkable
class TypeConfidence(Protocol):
    """A `Confidence` that follows from type probabilities: the engine hands it those that it has already."""

    def of_types(self, reported_type: NDArray[np.uint8], log_probability: FloatArray) -> FloatArray:
        """Return confidences (n,) of reported types (n,) with ln P (n, 4) over `REPORTED_TYPES`."""
