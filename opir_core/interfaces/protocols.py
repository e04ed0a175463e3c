"""The contracts of components: arrays in, arrays out.

A component's `build` returns one of these. The result of a row must not depend on the other rows of
a call: the engine may pass any slice of a run, and the bytes of the events must be the same.

The contexts of `build` are in `opir_core.interfaces.contexts`, the contracts of outputs in
`opir_core.interfaces.outputs`, those of signature, source, atmosphere and background models in
`opir_core.interfaces.radiometric_models`, imported only for scenes with a radiometric detection
model.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from attrs import field, frozen

from opir_core.arrays import ByteArray, FloatArray, IndexArray, IntArray
from opir_core.errors import Problem
from opir_core.flight.burns import one_burn_s
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.contract import PluginPart, optional, required
from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.interfaces.records import ClassifierInputs, Detections, Exposures, Tracks
from opir_core.interfaces.sensor_health import SensorHealth
from opir_core.scene.scene import EMITTER_TYPES


@frozen
class Band:
    """A spectral band, in µm."""

    name: str
    lower_um: float
    upper_um: float


@frozen
class Radiometer:
    """Radiometric properties of a sensor, by band in the order of its `bands`.

    `nei_w_m2` are noise-equivalent irradiances per look, nan where they follow from the focal
    plane; `ifov_rad` is the angle across a resolution cell; `collection_m2_s` the product of
    aperture area, efficiency and integration time, which gives photons from irradiance. A look
    detects above `threshold` standard deviations of its noise. For rules over several bands it is
    that of the band `reference`, and `coincidence` that of the others; `ratios` bound their
    intensity over that of the reference band at the source, and `ratio_tolerance` is how far noise
    may carry a measurement beyond these bounds, in standard deviations. `confirmation` are the
    detections M that a sensor needs in N successive scans to report the last, within the distance
    that a source moves at `confirmation_speed_m_s`.

    With `focal_planes`, by band, noise, clutter, saturation and the accuracy of lines of sight
    follow from them, in pixels of `ifov_rad`.
    """

    nei_w_m2: tuple[float, ...]
    ifov_rad: float
    collection_m2_s: float
    threshold: float
    coincidence: float
    ratios: tuple[tuple[float, float], ...]
    focal_planes: tuple[FocalPlaneConfig, ...] = ()
    ratio_tolerance: float = 0.0
    reference: int = 0
    confirmation: tuple[int, int] = (1, 1)
    confirmation_speed_m_s: float = 0.0


class Orbit(Protocol):
    """The orbit of a satellite.

    >>> class Parked:
    ...     is_stationary = True
    ...
    ...     def position_ecef_m(self, time_s):
    ...         return np.tile([4.2164e7, 0.0, 0.0], (len(time_s), 1))
    >>> orbit: Orbit = Parked()
    >>> orbit.position_ecef_m(np.zeros(2)).shape
    (2, 3)
    """

    @property
    def is_stationary(self) -> bool:
        """Whether the position in ECEF does not change."""

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,)."""


class ScanPattern(Protocol):
    """The scan of a sensor: times of looks within its period.

    >>> class Together:
    ...     period_ns = 5_000_000_000
    ...
    ...     def phase_ns(self, sensor_ecef_m, target_ecef_m, uniform):
    ...         return np.full(len(target_ecef_m), int(uniform * self.period_ns))
    >>> scan: ScanPattern = Together()
    >>> scan.phase_ns(np.zeros(3), np.zeros((2, 3)), 0.5)
    array([2500000000, 2500000000])
    """

    @property
    def period_ns(self) -> int:
        """Time between two looks at one target, ns: a positive integer, so that look times are
        exact.
        """

    def phase_ns(
        self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float
    ) -> IntArray:
        """Return offsets (n,) in [0, period) of the looks at targets (n, 3); scan k looks at phase
        + k · period.

        `uniform` is a random number of the sensor in [0, 1), for patterns with a random start.
        """


@frozen
class ReportingStage:
    """A stage between a look and its report: the mean and the standard deviation of its latency, s.

    The latency is constant where `sigma_s` is 0, else gamma distributed.
    """

    name: str
    mean_s: float
    sigma_s: float = 0.0


@frozen(eq=False, kw_only=True)
class Sensor:
    """A sensor, built by a sensor model from a scene's block.

    `detection_probability` is P_d per look, by target type, for models with constant P_d;
    `confusion` gives, by true type, the probabilities of each reported type, or is empty.
    `minimum_elevation_rad` is the least elevation of the sensor above the target's horizon, -pi/2
    for no limit. `settings` are the complete settings of the sensor's block, for `opir explain` and
    the manifest.

    A sensor cannot look within `solar_exclusion_rad` of the Sun's centre while any part of the Sun
    is in view of the satellite; 0 for no limit.

    `line_of_sight_sigma_rad` is the standard deviation of single lines of sight, per axis,
    `line_of_sight_bias_sigma_rad` that of the bias, per axis, which is constant during a run. A
    sensor that `follows_bodies` observes targets after burnout, up to impact. The report of a scan
    follows its looks by the sum of the latencies of `reporting`; without stages, at once.
    """

    id: str
    type: str
    orbital_slot_deg: float | None
    bands: tuple[Band, ...]
    orbit: Orbit
    scan: ScanPattern
    field_of_regard_half_angle_rad: float
    minimum_elevation_rad: float
    line_of_sight_sigma_rad: float
    detection_probability: Mapping[str, float]
    confusion: Mapping[str, Mapping[str, float]] = field(factory=dict)
    line_of_sight_bias_sigma_rad: float = 0.0
    false_alarm_susceptibility: str = "moderate"
    spectral_discrimination: str = "none"
    follows_bodies: bool = False
    solar_exclusion_rad: float = 0.0
    radiometer: Radiometer | None = None
    reporting: tuple[ReportingStage, ...] = ()
    settings: Mapping[str, Any] = field(factory=dict)


class Trajectories(PluginPart):
    """The trajectories of all targets of one model; by default of one burn each, up to burnout.

    >>> import numpy as np
    >>> class Pad(Trajectories):
    ...     type_code = np.zeros(1, dtype=np.uint8)
    ...     ignition_s, burnout_s = np.array([5.0]), np.array([65.0])
    ...
    ...     def position_ecef_m(self, target, time_s):
    ...         return np.full((len(time_s), 3), 3.7e6)
    ...
    ...     def truth(self):
    ...         return [{"id": "T1"}]
    >>> Pad().end_s, Pad().class_names
    (array([65.]), ['ICBM'])
    """

    @required
    def type_code(self) -> ByteArray:
        """Codes (n,) into `EMITTER_TYPES`: of targets, the missile type that their class
        resembles.
        """
        raise NotImplementedError

    @required
    def ignition_s(self) -> FloatArray:
        """Scene times from which the plumes radiate, (n,) s."""
        raise NotImplementedError

    @required
    def burnout_s(self) -> FloatArray:
        """Scene times to which the plumes radiate, (n,) s."""
        raise NotImplementedError

    @abstractmethod
    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,); nan before ignition and
        after the end.
        """

    @abstractmethod
    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping of plain values per target, for the truth file."""

    @optional
    def end_s(self) -> FloatArray:
        """Scene times up to which positions are known, (n,) s: impact, or burnout if no sensor
        follows targets.
        """
        return self.burnout_s

    @optional
    def warnings(self) -> Sequence[Problem]:
        """What of the settings, or of the files they name, may be an error, each with its path in
        the scene.
        """
        return ()

    @optional
    def class_names(self) -> Sequence[str]:
        """Names of the target classes, one per target; the missile types, unless the classes are
        finer.
        """
        return [EMITTER_TYPES[code] for code in self.type_code.tolist()]

    @optional
    def burns_s(self) -> FloatArray:
        """Scene times (n, k, 2) of ignition and burnout of each burn, in order; nan where a target
        has fewer.

        The first begins at `ignition_s`, the last ends at `burnout_s`. Between burns plumes are
        dark, as after burnout.
        """
        return one_burn_s(self.ignition_s, self.burnout_s)

    @optional
    def course_breakpoints_s(self) -> FloatArray | None:
        """Scene times (n, k) at which the direction of flight jumps or bends, s; nan where there
        are fewer.
        """
        return None

    @optional
    def files(self) -> Sequence[Mapping[str, Any]]:
        """The `path` and `sha256` of each file that was read; the run manifest lists them."""
        return ()


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
    ...         return Measured(bands=np.ones(len(exposures), dtype=np.uint8), snr=np.full(len(exposures), np.nan))
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
        """
        raise NotImplementedError

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
        """Return the measurements (n,) of false alarms, from numbers (n, words) in [0, 1)."""
        raise NotImplementedError


class Classifier(PluginPart):
    """Measurements to the reported target type; with `log_posterior`, also to type probabilities
    that tracks revise.

    >>> class Undecided(Classifier):
    ...     def reported_type(self, sightings, rng):
    ...         return np.zeros(len(sightings), dtype=np.uint8)
    >>> Undecided().reported_type(range(2), rng=None)
    array([0, 0], dtype=uint8)
    """

    def pair_type(
        self, sensor: IndexArray, target: IndexArray, rng: RandomDraws
    ) -> ByteArray | None:
        """Return codes (n,) of all detections of the pairs, or None if they vary; rows are
        pairs.
        """
        return None

    @abstractmethod
    def reported_type(self, sightings: ClassifierInputs, rng: RandomDraws) -> ByteArray:
        """Return codes (n,) into `REPORTED_TYPES`."""

    @optional
    def uses_truth(self) -> bool:
        """Whether what is reported may depend on the targets' true types; with other targets it is
        built anew.
        """
        return True

    def expected_launches(self, duration_s: float) -> float | None:
        """Return the mean number of launches that it expects in a time, or None for one without
        such a prior.
        """
        return None

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray | None:
        """Return ln P (n, 4) over `REPORTED_TYPES`, or (n, H) over the context's `hypotheses` with
        an `over_types`, or None for a classifier without probabilities.
        """
        return None

    def over_types(self, log_posterior: FloatArray, types: Sequence[str]) -> FloatArray:
        """Return posteriors as ln P (n, types) over types that are reported."""
        return log_posterior

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        """Return posteriors combined with type probabilities from the tracks' motion, (n, 4)."""
        raise NotImplementedError

    def reported(self, log_posterior: FloatArray) -> ByteArray:
        """Return the codes (n,) reported for posteriors."""
        raise NotImplementedError


class Confidence(PluginPart):
    """Detections and detection counts to confidence.

    >>> class Even(Confidence):
    ...     def confidence(self, sightings):
    ...         return np.full(len(sightings), 0.5)
    >>> Even().confidence(range(2))
    array([0.5, 0.5])
    """

    @abstractmethod
    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return confidences (n,) in [0, 1]."""

    def of_types(self, reported_type: ByteArray, log_probability: FloatArray) -> FloatArray | None:
        """Return confidences (n,) of reported types (n,) with the classifier's posteriors.

        None, the default, for models whose confidences do not follow from type probabilities alone.
        """
        return None


class Tracker(PluginPart):
    """Detections to tracks; stepped at ticks of scene time, never at window edges.

    >>> class Following(Tracker):
    ...     cadence_s = 2.0
    ...
    ...     def associate(self, detections):
    ...         return np.full(len(detections), -1)
    ...
    ...     def step(self, tick_s, detections):
    ...         return Tracks.empty()
    >>> from opir_testing.doubles import stub_window
    >>> Following().associate(stub_window(2).detections)
    array([-1, -1])
    """

    @required
    def cadence_s(self) -> float | None:
        """Time between ticks, s, or None for a tracker that never steps."""

    @abstractmethod
    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, by the tracks of the last tick; changes no
        state.
        """

    @abstractmethod
    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Process the detections since the last tick; return the estimates at this one, sorted by
        track.
        """

    def is_idle(self) -> bool:
        """Return whether it follows and awaits nothing: steps without detections return no tracks
        and may be left out.

        A step may then pass over any time.
        """
        return False

    def expected_launches(self, duration_s: float) -> float | None:
        """Return the mean number of launches that it expects in a time, or None for one without
        such a prior.
        """
        return None

    def sensor_health(self) -> SensorHealth | None:
        """Return what it has found of the sensors up to the last tick, or None for one that judges
        none.
        """
        return None

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Use new settings of the sensors, as many in the same order; a running scene may change
        them.
        """
        return
