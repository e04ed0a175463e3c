"""Sensors as the detection model `snr` needs them: their bands, their noise, and the rule over their bands."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.detection.any_band import AnyBand
from opir_core.detection.calibration import calibrated
from opir_core.detection.configs import SnrConfig
from opir_core.detection.irradiance_noise import noise_w_m2, photon_energy_j
from opir_core.detection.ratio_gates import RatioGates
from opir_core.detection.threshold import probit
from opir_core.errors import ModelError
from opir_core.plugin.radiometer import Radiometer
from opir_core.protocols import Sensor
from opir_core.scenery import Scenery

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

    def count_w_m2(self, place: int) -> float:
        """Return the irradiance that one photon counted in one of its bands stands for; 0 beyond them."""
        return self.photon_j[place] / self.radiometer.collection_m2_s if place < len(self.photon_j) else 0.0

    def chances(self, snr: FloatArray, noise: FloatArray, slack: float) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,)."""
        return self.rule.log_chances(snr, noise, slack)

    def quantile(self, snr: FloatArray, noise: FloatArray, slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,); with a slack P_d may be off by as much."""
        return self.rule.quantile(snr, noise, slack) if slack else probit(*self.chances(snr, noise, 0.0))


def noise_chance(receiver: Receiver) -> float:
    """Return the logarithm of the chance that noise alone detects, in one resolution cell and look."""
    nothing = np.zeros((1, len(receiver.bands)))
    return float(receiver.chances(nothing, noise_w_m2(receiver.nei_w_m2)[None, :], 0.0)[0][0])


def receivers_of(sensors: Sequence[Sensor], scenery: Scenery, config: SnrConfig) -> list[Receiver]:
    """Return all receivers; those of one kind are calibrated once."""
    receivers, known = list[Receiver](), dict[tuple[Any, ...], Radiometer]()
    for sensor in sensors:
        receiver = _receiver(sensor, scenery)
        if config.calibrate == "paper":
            wanted = _wanted(sensor)
            kind = (*receiver.kind, wanted)
            if kind not in known:
                owner = f"sensor {sensor.id} ({sensor.type})"
                intensity = scenery.reference_intensity_w_sr[receiver.bands]
                known[kind] = calibrated(receiver.radiometer, receiver.rule, intensity, wanted, owner)
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


def by_number(numbers: IndexArray, count: int) -> "Sequence[tuple[int, slice | IntArray]]":
    """Return each number that occurs with its rows: a slice of them where they stand in order."""
    counts = np.bincount(numbers, minlength=count)
    present = np.flatnonzero(counts).tolist()
    if np.all(numbers[1:] >= numbers[:-1]):
        ends = np.cumsum(counts)
        return [(number, slice(int(ends[number] - counts[number]), int(ends[number]))) for number in present]
    return [(number, np.flatnonzero(numbers == number)) for number in present]
