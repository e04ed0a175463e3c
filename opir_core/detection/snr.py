"""The detection model `snr`: from intensity, air, aperture and noise to the probability of detection."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.detection.any_band import AnyBand
from opir_core.detection.calibration import calibrated
from opir_core.detection.configs import SnrConfig
from opir_core.detection.irradiance_noise import noise_w_m2, photon_energy_j, photon_noise_w_m2
from opir_core.detection.ratio_gates import RatioGates
from opir_core.detection.threshold import probit
from opir_core.errors import ModelError
from opir_core.plugin.radiometer import Radiometer
from opir_core.plugin.sensors import MAXIMUM_BANDS
from opir_core.protocols import Dice, Measured, ModelContext, Sensor
from opir_core.records import Exposures, FloatArray, IndexArray, IntArray
from opir_core.responses import Response
from opir_core.scenery import Scenery

#: Signals over noise are held within it: its square is still a double.
_MOST_SNR = 1e100
#: Beside one number a band there is one that chooses.
_FREE = 1

Rule = AnyBand | RatioGates


@frozen(eq=False)
class Receiver:
    """A sensor as the model needs it: the numbers of its bands in the scenery, its noise and its rule."""

    bands: IntArray
    radiometer: Radiometer
    rule: Rule
    photon_j: tuple[float, ...]

    @property
    def kind(self) -> tuple[Any, ...]:
        """Return what receivers share whose noise crosses equally often."""
        return (self.radiometer, type(self.rule), *self.bands.tolist())

    @property
    def nei_w_m2(self) -> FloatArray:
        """Return the noise-equivalent irradiances (B,)."""
        return np.array(self.radiometer.nei_w_m2, dtype=np.float64)

    def chances(self, snr: FloatArray, noise: FloatArray, slack: float) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,)."""
        return self.rule.log_chances(snr, noise, slack)


@frozen(eq=False)
class SnrDetection:
    """Signal over noise in each band, and the sensor's rule over its bands; see docs/explanation/detection.md.

    `width` is the largest number of bands of the sensors; `floor_rad` (sensors,) the spread of lines of sight that no
    signal betters; `rate_per_scan` (sensors,) the mean number of exceedances of noise alone in a scan.
    """

    scenery: Scenery
    receivers: tuple[Receiver, ...]
    width: int
    floor_rad: FloatArray
    footprint_rad: FloatArray
    rate_per_scan: FloatArray
    probability_tolerance: float | None
    needs_geometry: bool = True

    def pair_probability(self, sensor: IndexArray, target: IndexArray) -> FloatArray | None:
        """Return None: probabilities vary from look to look."""
        return None

    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probability of detection of each look."""
        from scipy.special import ndtr

        chance: FloatArray = ndtr(self.response(exposures).probit)
        return chance

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        """Return what looks would measure; with a `slack`, probabilities may be off by as much."""
        signal = self._irradiance_w_m2(exposures)
        noise = self._noise_w_m2(exposures)
        snr = np.minimum(signal / noise, _MOST_SNR)
        quantile = np.empty(len(exposures))
        for number, rows in _by_number(exposures.sensor, len(self.receivers)):
            receiver = self.receivers[number]
            width = len(receiver.bands)
            chances = receiver.chances(snr[rows, :width], noise[rows, :width], slack)
            quantile[rows] = probit(*chances)
        return Response(quantile, snr, noise)

    def measure(self, exposures: Exposures, dice: Dice) -> Measured:
        """Return what is measured in looks that detected."""
        return self.measure_response(self.response(exposures), exposures.sensor, dice)

    def measure_response(self, response: Response, sensor: IndexArray, dice: Dice) -> Measured:
        """Return what is measured, conditional on the detection: where a free draw does not detect, an exact one."""
        measured = response.snr + _normals(dice, self.width)
        for number, rows in _by_number(sensor, len(self.receivers)):
            receiver = self.receivers[number]
            width = len(receiver.bands)
            failed = rows[~receiver.rule.passes(measured[rows, :width], response.noise_w_m2[rows, :width])]
            if len(failed):
                columns = response.snr[failed, :width], response.noise_w_m2[failed, :width]
                uniforms = dice.uniforms("measurement:detected", width + _FREE)[failed]
                measured[failed, :width] = receiver.rule.conditional(*columns, _chosen(uniforms, width))
        return self._measured(measured, response.noise_w_m2, sensor)

    @property
    def words(self) -> int:
        """Return how many numbers an exceedance is drawn with."""
        return MAXIMUM_BANDS + _FREE

    def measure_noise(self, sensor: IndexArray, uniforms: FloatArray) -> Measured:
        """Return what is measured (n,) where noise alone crossed, before a dark background."""
        noise, measured = np.ones((len(sensor), self.width)), np.zeros((len(sensor), self.width))
        for number, rows in _by_number(sensor, len(self.receivers)):
            receiver = self.receivers[number]
            width = len(receiver.bands)
            noise[rows, :width] = noise_w_m2(receiver.nei_w_m2)
            nothing = np.zeros((len(rows), width))
            drawn = receiver.rule.conditional(nothing, noise[rows, :width], _chosen(uniforms[rows], width))
            measured[rows, :width] = drawn
        return self._measured(measured, noise, sensor)

    def _measured(self, measured: FloatArray, noise: FloatArray, sensor: IndexArray) -> Measured:
        """Return measurements in standard deviations (n, B) as what a detection carries."""
        bands, best = np.zeros(len(sensor), dtype=np.uint8), np.empty(len(sensor))
        irradiance = measured * noise
        for number, rows in _by_number(sensor, len(self.receivers)):
            receiver = self.receivers[number]
            width = len(receiver.bands)
            own = measured[rows, :width]
            confirms = receiver.rule.confirms(own)
            for band in range(width):
                bands[rows] |= confirms[:, band].astype(np.uint8) << np.uint8(band)
            best[rows] = own.max(axis=1)
            irradiance[rows, width:] = np.nan
        sigma_rad = np.hypot(self.floor_rad[sensor], self.footprint_rad[sensor] / best)
        return Measured(bands, best, sigma_rad, irradiance)

    def _irradiance_w_m2(self, exposures: Exposures) -> FloatArray:
        """Return the irradiances (n, B) of targets at the aperture; 0 beyond a sensor's bands."""
        paths, aspect = self.scenery.paths(exposures), self.scenery.aspect_rad(exposures)
        irradiance = np.zeros((len(exposures), self.width))
        for band, place, rows in self._by_band(exposures.sensor):
            looks, path = exposures.take(rows), paths.take(rows)
            intensity = self.scenery.intensity_w_sr(band, looks, path.height_m, aspect[rows])
            shining = np.flatnonzero(intensity > 0.0)
            through = self.scenery.atmosphere.transmittance(band, path.take(shining))
            irradiance[rows[shining], place] = intensity[shining] * through / np.square(looks.range_m[shining])
        return irradiance

    def _noise_w_m2(self, exposures: Exposures) -> FloatArray:
        """Return the noise (n, B) at the aperture; 1 beyond a sensor's bands."""
        noise = np.ones((len(exposures), self.width))
        view = self.scenery.views(exposures) if self.scenery.has_background else None
        for number, rows in _by_number(exposures.sensor, len(self.receivers)):
            receiver = self.receivers[number]
            pixel_sr = receiver.radiometer.footprint_rad**2
            for place, band in enumerate(receiver.bands.tolist()):
                photons, clutter = np.zeros(len(rows)), np.zeros(len(rows))
                if view is not None:
                    behind = view.take(rows)
                    radiance = self.scenery.background.radiance_w_m2_sr(band, behind)
                    collected = receiver.radiometer.collection_m2_s, receiver.photon_j[place]
                    photons = photon_noise_w_m2(radiance * pixel_sr, *collected)
                    clutter = self.scenery.background.clutter_w_m2_sr(band, behind) * pixel_sr
                noise[rows, place] = noise_w_m2(receiver.nei_w_m2[place], photons, clutter)
        return noise

    def _by_band(self, sensor: IndexArray) -> "Sequence[tuple[int, int, IntArray]]":
        """Return each band of the scenery, its place in sensors' columns, and the rows of the sensors it stands at."""
        found = []
        for band in range(len(self.scenery.bands)):
            for place in range(self.width):
                owners = [
                    n for n, each in enumerate(self.receivers) if each.bands[place : place + 1].tolist() == [band]
                ]
                rows = np.flatnonzero(np.isin(sensor, owners)) if owners else np.empty(0, dtype=np.int64)
                if len(rows):
                    found.append((band, place, rows))
        return found


def snr_detection(config: SnrConfig, context: ModelContext) -> SnrDetection:
    """Return the detection model `snr`; raises `ModelError` for sensors that do not say how they measure light."""
    assert context.make_scenery is not None
    scenery = context.make_scenery()
    receivers = _receivers(context.sensors, scenery, config)
    half_angle = np.array([sensor.field_of_regard_half_angle_rad for sensor in context.sensors])
    footprint_rad = np.array([receiver.radiometer.footprint_rad for receiver in receivers])
    cells = 4.0 * np.pi * np.square(np.sin(0.5 * half_angle) / footprint_rad)
    of_kind = {receiver.kind: noise_chance(receiver) for receiver in receivers}
    chances = np.exp(np.array([of_kind[receiver.kind] for receiver in receivers]))
    return SnrDetection(
        scenery=scenery,
        receivers=tuple(receivers),
        width=max(len(receiver.bands) for receiver in receivers),
        floor_rad=np.array([sensor.line_of_sight_sigma_rad for sensor in context.sensors]),
        footprint_rad=footprint_rad,
        rate_per_scan=chances * cells,
        probability_tolerance=None if config.exact else config.probability_tolerance,
    )


def noise_chance(receiver: Receiver) -> float:
    """Return the logarithm of the chance that noise alone detects, in one resolution cell and look."""
    nothing = np.zeros((1, len(receiver.bands)))
    return float(receiver.chances(nothing, noise_w_m2(receiver.nei_w_m2)[None, :], 0.0)[0][0])


def _receivers(sensors: Sequence[Sensor], scenery: Scenery, config: SnrConfig) -> list[Receiver]:
    """Return all receivers; those of one kind are calibrated once."""
    receivers, known = list[Receiver](), dict[tuple[Any, ...], Radiometer]()
    for sensor in sensors:
        receiver = _receiver(sensor, scenery)
        if config.calibrate == "paper":
            wanted = _wanted(sensor)
            kind = (*receiver.kind, wanted)
            if kind not in known:
                intensity = scenery.reference_intensity_w_sr[receiver.bands]
                known[kind] = calibrated(receiver.radiometer, receiver.rule, intensity, wanted)
            receiver = evolve(receiver, radiometer=known[kind])
        receivers.append(receiver)
    return receivers


def _receiver(sensor: Sensor, scenery: Scenery) -> Receiver:
    radiometer = sensor.radiometer
    if radiometer is None:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}) does not say how it measures light (its noise, its footprint), which"
            " detection: snr needs; choose another sensor model, or detection: constant"
        )
    return Receiver(
        bands=np.array([scenery.bands.index(band) for band in sensor.bands]),
        radiometer=radiometer,
        rule=rule_of(sensor, radiometer),
        photon_j=tuple(photon_energy_j(band) for band in sensor.bands),
    )


def rule_of(sensor: Sensor, radiometer: Radiometer) -> Rule:
    """Return how a sensor combines its bands: by its `spectral_discrimination`."""
    if sensor.spectral_discrimination == "none":
        return AnyBand(radiometer.threshold)
    lower, upper = np.array(radiometer.ratios, dtype=np.float64).T
    return RatioGates(radiometer.threshold, radiometer.coincidence, 0, lower, upper)


def _wanted(sensor: Sensor) -> float:
    probability = sensor.detection_probability.get("ICBM")
    if probability is None or not 0.0 < probability < 1.0:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}): calibrate: paper needs a detection_probability for ICBM between 0 and"
            f" 1, not {probability!r}"
        )
    return probability


def _normals(dice: Dice, count: int) -> FloatArray:
    """Return standard normal numbers (rows, count), two of two uniform ones (Box and Muller, 1958)."""
    columns = []
    for first in range(0, count, 2):
        uniforms = dice.uniforms(f"measurement:{first}", 2)
        radius = np.sqrt(-2.0 * np.log1p(-uniforms[:, 0]))
        angle = 2.0 * np.pi * uniforms[:, 1]
        columns.append(radius * np.cos(angle))
        if first + 1 < count:
            columns.append(radius * np.sin(angle))
    return np.stack(columns, axis=1)


def _chosen(uniforms: FloatArray, width: int) -> FloatArray:
    """Return the numbers of a sensor's own bands, and the one that chooses, which is the first."""
    return np.concatenate([uniforms[:, 1 : 1 + width], uniforms[:, :1]], axis=1)


def _by_number(numbers: IndexArray, count: int) -> "Sequence[tuple[int, IntArray]]":
    """Return each number that occurs with its rows."""
    present = np.flatnonzero(np.bincount(numbers, minlength=count)).tolist()
    if len(present) == 1:
        return [(present[0], np.arange(len(numbers)))]
    return [(number, np.flatnonzero(numbers == number)) for number in present]
