"""Detection models that know no radiometry: `constant`, `always` and `never`."""

from collections.abc import Sequence

import numpy as np
from attrs import define

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.builtin.configs import ConstantConfig
from opir_core.errors import ModelError
from opir_core.host.components import NoConfig
from opir_core.interfaces.contexts import ModelContext
from opir_core.interfaces.detection_models import DetectionProbability, Measured, RandomDraws
from opir_core.interfaces.records import Exposures
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.scene import MAXIMUM_BANDS
from opir_core.scene.target_classes import TargetClass
from opir_core.sensors.confusion_matrix import is_probability


@define(eq=False, repr=False)
class ConstantDetection(DetectionProbability):
    """A probability of detection for each sensor and target class, the same for every look.

    `probability_table` is (sensors, classes); `class_number` the targets' columns in it;
    `band_count` the sensors' numbers of bands. Each band confirms a detection independently with
    probability `band_confirmation`; where none would, the sensor's first band does.
    """

    probability_table: FloatArray
    class_number: IndexArray
    band_count: ByteArray
    band_confirmation: float
    needs_geometry: bool = False
    uses_seed: bool = False

    def pair_probability(self, sensor: IndexArray, target: IndexArray) -> FloatArray:
        """Return the probabilities (n,) of pairs."""
        return self.probability_table[sensor, self.class_number[target]]

    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probabilities (n,) of looks: those of their pairs."""
        return self.pair_probability(exposures.sensor, exposures.target)

    def measure(self, exposures: Exposures, rng: RandomDraws) -> Measured:
        """Return the bands that confirm; SNR is nan in this model."""
        counts = self.band_count[exposures.sensor]
        bands = (
            _all_bands(counts) if self.band_confirmation >= 1.0 else self._confirmed(counts, rng)
        )
        return Measured(bands, np.full(len(counts), np.nan))

    def _confirmed(self, counts: ByteArray, rng: RandomDraws) -> ByteArray:
        """Return masks of the bands that confirm.

        Sensors with equally many bands draw together, so that a row's numbers do not hang on what
        else is in the scene.
        """
        bands = np.zeros(len(counts), dtype=np.uint8)
        for count in _present(counts[counts > 0]):
            rows = np.flatnonzero(counts == count)
            confirms = rng.uniforms("bands", count)[rows] < self.band_confirmation
            bands[rows] = np.packbits(confirms, axis=1, bitorder="little")[:, 0]
        return np.where((bands == 0) & (counts > 0), np.uint8(1), bands)


def constant_detection(config: ConstantConfig, context: ModelContext) -> DetectionProbability:
    """Return the model `constant`: each sensor's own probability by target class.

    Raises `ModelError` where a sensor has no probability for a class that the scene launches.
    """
    names, class_number = context.emitter_classes()
    _refuse_sources(names, context)
    classes = [context.target_class(name) for name in names]
    rows = [[_probability(sensor, kind) for kind in classes] for sensor in context.sensors]
    table = np.array(rows, dtype=np.float64).reshape(len(context.sensors), len(classes))
    return _detection(table, class_number, context, config.band_confirmation)


def always_detection(_config: NoConfig, context: ModelContext) -> DetectionProbability:
    """Return the model `always`: every look detects, in all bands."""
    return _same_for_all(1.0, context)


def never_detection(_config: NoConfig, context: ModelContext) -> DetectionProbability:
    """Return the model `never`: no look detects."""
    return _same_for_all(0.0, context)


def _same_for_all(probability: float, context: ModelContext) -> DetectionProbability:
    everyone = np.zeros(len(context.target_type_code), dtype=np.int32)
    return _detection(np.full((len(context.sensors), 1), probability), everyone, context, 1.0)


def _present(codes: ByteArray) -> list[int]:
    """Return the codes that occur, each once, ascending. (`np.unique` would import masked arrays
    for the same.)
    """
    return np.flatnonzero(np.bincount(codes)).tolist()


def _refuse_sources(needed: Sequence[str], context: ModelContext) -> None:
    launched = context.launched_classes()
    unknown = [name for name in needed if name not in launched]
    if unknown:
        raise ModelError(
            f"detection: constant has no probability of detection for the source type {unknown[0]}:"
            f" choose"
            " a radiometric detection model (detection: snr), or omit the sources"
        )


def _detection(
    table: FloatArray, class_number: IndexArray, context: ModelContext, band_confirmation: float
) -> ConstantDetection:
    counts = np.array([_band_count(sensor) for sensor in context.sensors], dtype=np.uint8)
    return ConstantDetection(table, class_number, counts, band_confirmation)


def _probability(sensor: Sensor, kind: TargetClass) -> float:
    probability = kind.own(sensor.detection_probability)
    target_type = kind.name
    if probability is None:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}) has no probability of detection for {target_type}"
            f" targets: give"
            f" {target_type} in its detection_probability, or choose a detection model other than"
            f" constant"
        )
    if not is_probability(probability):
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}): the probability of detection {probability!r} for"
            f" {target_type}"
            " targets is not in [0, 1]"
        )
    return probability


def _band_count(sensor: Sensor) -> int:
    if len(sensor.bands) > MAXIMUM_BANDS:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}) has {len(sensor.bands)} bands; at most"
            f" {MAXIMUM_BANDS} can confirm"
        )
    return len(sensor.bands)


def _all_bands(counts: ByteArray) -> ByteArray:
    """Return masks with the lowest `counts` bits set."""
    return ((1 << counts.astype(np.uint16)) - 1).astype(np.uint8)
