"""Classifiers: `paper` draws from confusion matrices; `always` is right each time; `none` and
`never` give UNKNOWN.
"""

from collections.abc import Mapping

import numpy as np
from attrs import frozen

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.builtin.configs import ConfusionConfig, WeightedConfig
from opir_core.errors import ModelError, nearest
from opir_core.host.components import NoConfig
from opir_core.interfaces.classification import Classifier, Confidence
from opir_core.interfaces.contexts import ModelContext
from opir_core.interfaces.detection_models import RandomDraws
from opir_core.interfaces.records import ClassifierInputs
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.scene import UNKNOWN_TYPE
from opir_core.scene.target_classes import TargetClass
from opir_core.sensors.confusion_matrix import Confusion, confusion_complaint


class PairClassifier(Classifier):
    """A classifier with one answer for all detections of a sensor and target."""

    def reported_type(self, sightings: ClassifierInputs, rng: RandomDraws) -> ByteArray:
        """Return codes (n,) into `REPORTED_TYPES`."""
        return np.asarray(self.pair_type(sightings.sensor, sightings.target, rng), dtype=np.uint8)


@frozen(eq=False, repr=False)
class ConfusionClassifier(PairClassifier):
    """The reported type, drawn once for each sensor and target from the sensor's confusion matrix.

    `thresholds` (reported types - 1, sensors · classes) are cumulative probabilities, 1 from the
    last type of any probability on; a type is reported where the draw lies below its threshold and
    not below the one before. `class_number` are the targets' classes, of which there are `classes`.
    """

    thresholds: FloatArray
    class_number: IndexArray
    classes: int

    def pair_type(self, sensor: IndexArray, target: IndexArray, rng: RandomDraws) -> ByteArray:
        """Return codes (n,) into `REPORTED_TYPES`, the same for all detections of a pair."""
        drawn = rng.pair_uniforms("classification")[:, 0]
        row = sensor * self.classes + self.class_number[target]
        reported = np.zeros(len(drawn), dtype=np.uint8)
        for threshold in self.thresholds:
            reported += drawn >= threshold.take(row)
        return reported


@frozen(eq=False, repr=False)
class TrueType(PairClassifier):
    """The right type to report, each time: `type_code` are the codes of the targets' into
    `REPORTED_TYPES`.
    """

    type_code: ByteArray

    def pair_type(self, _sensor: IndexArray, target: IndexArray, _rng: RandomDraws) -> ByteArray:
        """Return codes (n,) of the targets' types; other emitters are UNKNOWN."""
        return self.type_code[target]


@frozen
class NoClassifier(PairClassifier):
    """UNKNOWN, each time."""

    uses_truth: bool = False

    def pair_type(self, sensor: IndexArray, _target: IndexArray, _rng: RandomDraws) -> ByteArray:
        """Return the code of UNKNOWN (n,)."""
        return np.full(len(sensor), UNKNOWN_TYPE, dtype=np.uint8)


def confusion_classifier(config: ConfusionConfig, context: ModelContext) -> Classifier:
    """Return the classifier `paper`; sources other than targets are always UNKNOWN.

    Raises `ModelError` where neither the configuration nor the sensor says how a class that the
    scene launches is reported, and where the configuration has a matrix for a sensor type that the
    scene has not.
    """
    _refuse_unknowns(config, context)
    names, class_number = context.emitter_classes()
    thresholds = np.zeros((len(context.sensors), len(names), len(context.reported_types) - 1))
    # Other sources are UNKNOWN: their draw lies above the thresholds of the types before, and
    # below those after.
    thresholds[:, :, UNKNOWN_TYPE:] = 1.0
    classes = context.launched_classes()
    launched = [
        (place, context.target_class(name)) for place, name in enumerate(names) if name in classes
    ]
    for number, sensor in enumerate(context.sensors):
        matrix = {**sensor.confusion, **config.matrices.get(sensor.type, {})}
        for place, kind in launched:
            probability = _probabilities(_row(matrix, sensor, kind), context)
            cumulative = np.cumsum(probability)
            # The sum may be 1 to rounding only; no draw may fall past the last type that has a
            # probability.
            cumulative[np.flatnonzero(probability)[-1] :] = 1.0
            thresholds[number, place] = cumulative[:-1]
    columns = np.ascontiguousarray(thresholds.reshape(-1, thresholds.shape[-1]).T)
    return ConfusionClassifier(columns, class_number, len(names))


def true_type(_config: NoConfig, context: ModelContext) -> Classifier:
    """Return the classifier `always`."""
    names, class_number = context.emitter_classes()
    launched = context.launched_classes()
    right = [_reportable(name, context) if name in launched else "UNKNOWN" for name in names]
    codes = np.array([context.reported_types.index(name) for name in right], dtype=np.uint8)
    return TrueType(codes[class_number])


def _reportable(name: str, context: ModelContext) -> str:
    """Return a type that is reported, or the one that is right for a class that is not."""
    return name if name in context.reported_types else context.target_class(name).reported_type


def _probabilities(row: Mapping[str, float], context: ModelContext) -> FloatArray:
    """Return the probabilities (n,) of the reported types; a class that is not reported adds to its
    reported type.
    """
    probability = np.zeros(len(context.reported_types))
    for name, chance in row.items():
        probability[context.reported_types.index(_reportable(name, context))] += chance
    return probability


def no_answer(_config: NoConfig, _context: ModelContext) -> Classifier:
    """Return the classifier `none`."""
    return NoClassifier()


def _refuse_unknowns(config: ConfusionConfig, context: ModelContext) -> None:
    types = {sensor.type for sensor in context.sensors}
    for unknown in sorted(config.matrices.keys() - types):
        raise ModelError(
            f"classification: matrices.{unknown} is for sensors of type {unknown}, and the scene"
            f" has none"
            f"{nearest(unknown, types)}; the scene's sensors are of type {', '.join(sorted(types))}"
        )


def _row(matrix: Confusion, sensor: Sensor, kind: TargetClass) -> Mapping[str, float]:
    row = kind.own(matrix)
    target_type = kind.name
    if row is None:
        raise ModelError(
            f"sensor {sensor.id} ({sensor.type}) has no confusion matrix row for {target_type}"
            f" targets: give"
            f" {target_type} in its confusion, or under matrices.{sensor.type} of classification:"
            f" paper, or choose"
            " classification: none"
        )
    complaint = confusion_complaint({target_type: row})
    if complaint:
        raise ModelError(f"sensor {sensor.id} ({sensor.type}): confusion matrix: {complaint}")
    return row


#: min(1, log10(1 + n)) for n = 0 to 9, from where on it is 1.
_COUNT_TERMS = np.log10(1.0 + np.arange(10))


@frozen
class WeightedConfidence(Confidence):
    """C = w_b n_b/N_b + w_n min(1, log10(1 + n)) + w_g max(0, sin(theta)); opir-simulator paper
    (2026), section 4.3.

    The paper's count term is unbounded and its elevation term negative below the horizon; with the
    bounds above, C is in [0, 1] for every input. The count term is 1 from nine detections on.
    """

    band: float
    count: float
    geometry: float

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return confidences (n,) in [0, 1]; a term whose input is not finite or has no bands is
        0.
        """
        total: FloatArray = (
            self.band * _band_share(sightings)
            + self.count
            * _COUNT_TERMS.take(np.clip(sightings.detection_count, 0, len(_COUNT_TERMS) - 1))
            + self.geometry * np.nan_to_num(np.maximum(sightings.elevation_sine, 0.0), nan=0.0)
        )
        return np.clip(total, 0.0, 1.0)


@frozen
class ConstantConfidence(Confidence):
    """One confidence for all."""

    value: float

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return the confidence (n,)."""
        return np.full(len(sightings), self.value)


def weighted_confidence(config: WeightedConfig, _context: ModelContext) -> Confidence:
    """Return the model `weighted`."""
    return WeightedConfidence(config.band, config.count, config.geometry)


def full_confidence(_config: NoConfig, _context: ModelContext) -> Confidence:
    """Return the model `always`."""
    return ConstantConfidence(1.0)


def no_confidence(_config: NoConfig, _context: ModelContext) -> Confidence:
    """Return the model `never`."""
    return ConstantConfidence(0.0)


def _band_share(sightings: ClassifierInputs) -> FloatArray:
    total = np.maximum(sightings.band_total, 1)
    return np.clip(np.where(sightings.band_total > 0, sightings.band_count, 0) / total, 0.0, 1.0)
