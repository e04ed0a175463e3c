"""Detection models that know no radiometry: `constant`, `always` and `never`."""

from collections.abc import Sequence

import numpy as np
from attrs import define
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray
from opir_core.builtin.configs import ConstantConfig
from opir_core.errors import ModelError
from opir_core.interfaces.contexts import ModelContext
from opir_core.interfaces.protocols import DetectionProbability, Measured, RandomDraws, Sensor
from opir_core.interfaces.records import Exposures
from opir_core.plugin.components import NoConfig
from opir_core.scene.scene import EMITTER_TYPES, MAXIMUM_BANDS, TARGET_TYPES
from opir_core.sensors.confusion_matrix import is_probability


@define(eq=False)
class ConstantDetection:
    """A probability of detection for each sensor and target type, the same for every look.

    `probability_table` is (sensors, types), nan where the sensor has no figure; `type_code` the targets' codes into
    `EMITTER_TYPES`; `band_count` the sensors' numbers of bands. Each band confirms a detection independently with
    probability `band_confirmation`; where none would, the sensor's first band does.
    """

    probability_table: FloatArray
    type_code: NDArray[np.uint8]
    band_count: NDArray[np.uint8]
    band_confirmation: float
    needs_geometry: bool = False

    def pair_probability(self, sensor: IndexArray, target: IndexArray) -> FloatArray:
        """Return the probabilities (n,) of pairs."""
        chosen: FloatArray = self.probability_table[sensor, self.type_code[target]]
        return chosen

    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probabilities (n,) of looks: those of their pairs."""
        return self.pair_probability(exposures.sensor, exposures.target)

    def measure(self, exposures: Exposures, dice: RandomDraws) -> Measured:
        """Return the bands that confirm; there is no SNR in this model, so it is nan."""
        counts = self.band_count[exposures.sensor]
        bands = _all_bands(counts) if self.band_confirmation >= 1.0 else self._confirmed(counts, dice)
        return Measured(bands, np.full(len(counts), np.nan))

    def _confirmed(self, counts: NDArray[np.uint8], dice: RandomDraws) -> NDArray[np.uint8]:
        """Return masks of the bands that confirm.

        Sensors with equally many bands draw together, so that a row's numbers do not hang on what else is in the scene.
        """
        bands = np.zeros(len(counts), dtype=np.uint8)
        for count in _present(counts[counts > 0]):
            rows = np.flatnonzero(counts == count)
            confirms = dice.uniforms("bands", count)[rows] < self.band_confirmation
            bands[rows] = np.packbits(confirms, axis=1, bitorder="little")[:, 0]
        return np.where((bands == 0) & (counts > 0), np.uint8(1), bands)


def constant_detection(config: ConstantConfig, context: ModelContext) -> DetectionProbability:
    """Return the model `constant`: each sensor's own probability by target type.

    Raises `ModelError` where a sensor has no probability for a type that the scene launches.
    """
    needed = [EMITTER_TYPES[code] for code in _present(context.target_type_code)]
    _refuse_sources(needed)
    table = np.full((len(context.sensors), len(TARGET_TYPES)), np.nan)
    for row, sensor in enumerate(context.sensors):
        for name in needed:
            probability = sensor.detection_probability.get(name)
            if probability is None:
                raise ModelError(
                    f"sensor {sensor.id} ({sensor.type}) has no probability of detection for {name} targets: give"
                    f" {name} in its detection_probability, or choose a detection model other than constant"
                )
            if not is_probability(probability):
                raise ModelError(
                    f"sensor {sensor.id} ({sensor.type}): the probability of detection {probability!r} for {name}"
                    " targets is not in [0, 1]"
                )
            table[row, TARGET_TYPES.index(name)] = probability
    return _detection(table, context, config.band_confirmation)


def always_detection(_config: NoConfig, context: ModelContext) -> DetectionProbability:
    """Return the model `always`: every look detects, in all bands."""
    return _detection(np.ones((len(context.sensors), len(EMITTER_TYPES))), context, 1.0)


def never_detection(_config: NoConfig, context: ModelContext) -> DetectionProbability:
    """Return the model `never`: no look detects."""
    return _detection(np.zeros((len(context.sensors), len(EMITTER_TYPES))), context, 1.0)


def _present(codes: NDArray[np.uint8]) -> list[int]:
    """Return the codes that occur, each once, ascending. (`np.unique` would import masked arrays for the same.)"""
    return np.flatnonzero(np.bincount(codes)).tolist()


def _refuse_sources(needed: Sequence[str]) -> None:
    unknown = [name for name in needed if name not in TARGET_TYPES]
    if unknown:
        raise ModelError(
            f"detection: constant has no probability of detection for the source type {unknown[0]}: choose"
            " a radiometric detection model (detection: snr), or omit the sources"
        )


def _detection(table: FloatArray, context: ModelContext, band_confirmation: float) -> ConstantDetection:
    counts = np.array([_band_count(sensor) for sensor in context.sensors], dtype=np.uint8)
    return ConstantDetection(table, context.target_type_code, counts, band_confirmation)


def _band_count(sensor: Sensor) -> int:
    if len(sensor.bands) > MAXIMUM_BANDS:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}) has {len(sensor.bands)} bands; at most {MAXIMUM_BANDS} can confirm"
        )
    return len(sensor.bands)


def _all_bands(counts: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return masks with the lowest `counts` bits set."""
    return ((1 << counts.astype(np.uint16)) - 1).astype(np.uint8)
