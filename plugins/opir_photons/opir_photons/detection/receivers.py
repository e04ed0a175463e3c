"""Receivers of the detection model `snr`: a sensor's bands, noise, and rule over its bands.

Noise at the aperture, W/m²: of the detector, of the background's photons, and residual clutter.
Calibration: the factor on a sensor's noise with which it detects the reference target with a given
probability.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from numpy.typing import ArrayLike
from scipy.special import ndtri

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError
from opir_core.interfaces import Radiometer
from opir_core.plugin import Band, Sensor
from opir_photons.columns import floats
from opir_photons.detection.air_ratios import AirRatios
from opir_photons.detection.band_rules import AnyBand, RatioGates
from opir_photons.detection.configs import SnrConfig
from opir_photons.detection.focal_planes import FocalPlaneTerms, focal_plane_terms
from opir_photons.detection.fused_bands import FusedBands
from opir_photons.detection.threshold import probit
from opir_photons.environment import REFERENCE_TARGET, RadiometricEnvironment
from opir_photons.radiometry.planck import PHOTON_J_UM

#: Least noise, W/m²: no division by zero for a sensor without noise.
LEAST_NOISE_W_M2 = 1e-60


def photon_energy_j(band: Band) -> float:
    """Return the photon energy at the centre of a band, J."""
    return PHOTON_J_UM / (0.5 * (band.lower_um + band.upper_um))


def photon_noise_w_m2(irradiance_w_m2: ArrayLike, count_w_m2: ArrayLike) -> FloatArray:
    """Return the photon noise of an irradiance E: sqrt(E · hc/λ / (A η t)), W/m².

    `count_w_m2` is the irradiance of one count, hc/λ / (A η t), of aperture, efficiency and
    integration time. Counts are Poisson distributed.
    """
    return np.sqrt(floats(irradiance_w_m2) * floats(count_w_m2))


def noise_w_m2(
    detector_w_m2: ArrayLike, photons_w_m2: ArrayLike = 0.0, clutter_w_m2: ArrayLike = 0.0
) -> FloatArray:
    """Return the standard deviation of the sum of independent noises, at least `LEAST_NOISE_W_M2`,
    up to 1e150 W/m².
    """
    # A tenth of the time of `numpy.hypot`.
    variance = np.square(floats(detector_w_m2)) + np.square(floats(photons_w_m2))
    variance = variance + np.square(floats(clutter_w_m2))
    return np.maximum(np.sqrt(variance), LEAST_NOISE_W_M2)


#: Search range of the factor of a calibration: powers of ten on either side of 1.
_DECADES = 20.0


def calibrated(
    radiometer: Radiometer,
    rule: "Rule",
    intensity_w_sr: FloatArray,
    probability: float,
    owner: str,
) -> Radiometer:
    """Return a radiometer with noise scaled so that the reference target is detected with a
    probability.

    `intensity_w_sr` (B,) are those of the reference target in the sensor's bands. Raises
    `ModelError`, with the sensor as `owner`, if there is no such factor.
    """
    signal = intensity_w_sr / REFERENCE_TARGET.range_m**2
    quantile = float(ndtri(probability))

    def misses(log_factor: float) -> bool:
        noise = noise_w_m2(np.array(radiometer.nei_w_m2) * 10.0**log_factor)[None, :]
        snr = signal[None, :] / noise
        log_chances = rule.log_chances(snr, slopes_of(rule, snr, noise), 1e-13)
        return float(probit(*log_chances)[0]) < quantile

    if not misses(_DECADES) or misses(-_DECADES):
        values = ", ".join(f"{level:.3g}" for level in intensity_w_sr)
        raise ModelError(
            f"{owner}: calibrate: paper finds no noise with which the reference ICBM, {values} W/sr"
            f" in the sensor's bands, is detected with probability {probability:g}; give it bands and"
            " plausible_ratios that do not leave the ICBM out, or calibrate: none"
        )
    factor = 10.0 ** _turn(misses)
    return evolve(radiometer, nei_w_m2=tuple(float(nei * factor) for nei in radiometer.nei_w_m2))


def _turn(misses: Callable[[float], bool]) -> float:
    """Return the point at which a condition becomes true, by bisection."""
    low = -_DECADES
    high = _DECADES
    for _ in range(64):
        middle = 0.5 * (low + high)
        if misses(middle):
            high = middle
        else:
            low = middle
    return low


Rule = AnyBand | RatioGates | FusedBands


def slopes_of(
    rule: Rule, snr: FloatArray, noise: FloatArray, air: FloatArray | None = None
) -> FloatArray:
    """Return the slopes (n, k) that a rule's methods take, of looks with expected signals and noise
    (n, B).
    """
    return rule.directions(snr, noise) if isinstance(rule, FusedBands) else rule.slopes(noise, air)


@frozen(eq=False)
class Receiver:
    """A sensor's band numbers in the radiometric environment, its radiometer and its rule.

    `plane` are the figures of its focal plane, None for a sensor without one; `air` are the factors
    of the atmosphere on the bounds of the rule, None where it changes none.
    """

    bands: IntArray
    radiometer: Radiometer
    rule: Rule
    photon_j: tuple[float, ...]
    plane: FocalPlaneTerms | None = None
    air: AirRatios | None = None

    @property
    def kind(self) -> tuple[Any, ...]:
        """A key that is equal for receivers with equal noise and rule."""
        return (self.radiometer, type(self.rule), *self.bands.tolist())

    @property
    def nei_w_m2(self) -> FloatArray:
        """The noise-equivalent irradiances (B,)."""
        return np.array(self.radiometer.nei_w_m2, dtype=np.float64)

    def count_w_m2(self, place: int) -> float:
        """Return the irradiance, W/m², of one photon counted in a band; 0 beyond the sensor's
        bands.

        With a focal plane times the factor on the variance of photons by its filters.
        """
        if place >= len(self.photon_j):
            return 0.0
        gain = 1.0 if self.plane is None else float(self.plane.photon_gain[place])
        return self.photon_j[place] / self.radiometer.collection_m2_s * gain

    def slopes(
        self, snr: FloatArray, noise: FloatArray, elevation_sine: FloatArray | None
    ) -> FloatArray:
        """Return the rule's slopes for looks with expected signals and noise (n, B) at elevations
        (n,).
        """
        air = None if self.air is None or elevation_sine is None else self.air.at(elevation_sine)
        return slopes_of(self.rule, snr, noise, air)

    def quantile(self, snr: FloatArray, slopes: FloatArray, slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,), to within a slack of P_d."""
        if slack:
            return self.rule.quantile(snr, slopes, slack)
        return probit(*self.rule.log_chances(snr, slopes))


def noise_chance(receiver: Receiver) -> float:
    """Return the logarithm of the false-alarm probability per resolution cell and look."""
    noise = noise_w_m2(receiver.nei_w_m2)[None, :]
    snr = np.zeros(noise.shape)
    # Overhead: within 1 % noise passes gates alike at all elevations, since the tolerance of their
    # sides is several standard deviations.
    slopes = receiver.slopes(snr, noise, np.ones(1))
    return float(receiver.rule.log_chances(snr, slopes)[0][0])


def receivers_of(
    sensors: Sequence[Sensor], environment: RadiometricEnvironment, config: SnrConfig
) -> list[Receiver]:
    """Return the receivers of sensors; those of one kind are calibrated once."""
    receivers = list[Receiver]()
    radiometers = dict[tuple[Any, ...], Radiometer]()
    for sensor in sensors:
        receiver = _receiver(sensor, environment)
        if config.calibrate == "paper":
            probability = _calibration_probability(sensor)
            kind = (*receiver.kind, probability)
            if kind not in radiometers:
                owner = f"sensor {sensor.id} ({sensor.type})"
                intensity = environment.reference_intensity_w_sr[receiver.bands]
                radiometers[kind] = calibrated(
                    receiver.radiometer, receiver.rule, intensity, probability, owner
                )
            receiver = evolve(receiver, radiometer=radiometers[kind])
        receivers.append(receiver)
    return receivers


def _receiver(sensor: Sensor, environment: RadiometricEnvironment) -> Receiver:
    radiometer = sensor.radiometer
    if radiometer is None:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}) does not say how it measures light (its noise, its"
            f" footprint), which"
            " detection: snr needs; choose another sensor model, or detection: constant"
        )
    plane = focal_plane_terms(radiometer, sensor.bands, environment.background)
    if plane is not None:
        radiometer = evolve(
            radiometer, nei_w_m2=plane.nei_w_m2, collection_m2_s=plane.collection_m2_s
        )
    bands = np.array([environment.bands.index(band) for band in sensor.bands])
    rule = rule_of(sensor, radiometer, environment.reference_intensity_w_sr[bands])
    return Receiver(
        bands=bands,
        radiometer=radiometer,
        rule=rule,
        photon_j=tuple(photon_energy_j(band) for band in sensor.bands),
        plane=plane,
        air=_air(environment, bands, rule) if isinstance(rule, RatioGates) else None,
    )


def _air(
    environment: RadiometricEnvironment, bands: IntArray, rule: RatioGates
) -> AirRatios | None:
    """Return the factors of a scene's atmosphere on ratios of bands, None if there are none."""
    ratios = AirRatios.of(
        environment.atmosphere, int(bands[rule.reference]), bands[rule.others].tolist()
    )
    return None if ratios.is_clear else ratios


def rule_of(sensor: Sensor, radiometer: Radiometer, design: FloatArray) -> Rule:
    """Return the rule over a sensor's bands, by its `spectral_discrimination`.

    `design` (B,) are the intensities of the reference target, by which noise alone is weighed.
    """
    if sensor.spectral_discrimination == "likelihood":
        # A direction for reference targets that show nothing in a band.
        weights = np.maximum(design, 1e-6 * design.max())
        return FusedBands(radiometer.threshold, weights, radiometer.coincidence)
    if sensor.spectral_discrimination == "none":
        return AnyBand(radiometer.threshold)
    lower, upper = np.array(radiometer.ratios, dtype=np.float64).T
    return RatioGates(
        radiometer.threshold,
        radiometer.coincidence,
        lower,
        upper,
        tolerance=radiometer.ratio_tolerance,
        reference=radiometer.reference,
    )


def _calibration_probability(sensor: Sensor) -> float:
    probability = sensor.detection_probability.get("ICBM")
    if probability is None or not 0.0 < probability < 1.0:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}): calibrate: paper needs a detection_probability"
            f" for ICBM between 0 and 1, not {probability!r}"
        )
    return probability


def by_number(numbers: IndexArray, count: int) -> "Sequence[tuple[int, slice | IntArray]]":
    """Return each number that occurs with its rows: a slice if `numbers` are sorted."""
    counts = np.bincount(numbers, minlength=count)
    present = np.flatnonzero(counts).tolist()
    if np.any(numbers[1:] < numbers[:-1]):
        return [(number, np.flatnonzero(numbers == number)) for number in present]
    ends = np.cumsum(counts)
    starts = ends - counts
    return [(number, slice(int(starts[number]), int(ends[number]))) for number in present]
