"""Type, confidence and measured line of sight of looks that detect, from their measurements."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from attrs import field, frozen

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray, WordArray
from opir_core.geometry.vectors import vector
from opir_core.host.boundary import PluginErrors
from opir_core.interfaces.classification import Classifier, Confidence
from opir_core.interfaces.columns import Deferred
from opir_core.interfaces.contract import has_own
from opir_core.interfaces.detection_models import Measured, RandomDraws
from opir_core.interfaces.records import ClassifierInputs, Detections, Exposures, Tracks
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_states import SensorStates
from opir_core.random_streams.philox import normal_pairs
from opir_core.scene.scene import REPORTED_TYPES
from opir_core.simulation.output_checks import (
    checked_confidence,
    checked_log_probability,
    checked_types,
)

#: The number of bits set in each byte.
BITS_SET = np.array([value.bit_count() for value in range(256)], dtype=np.int64)


def classifier_inputs(
    measured: Measured,
    time_s: FloatArray,
    sensor: IndexArray,
    target: IndexArray,
    range_m: FloatArray,
    elevation_sine: FloatArray,
    band_total: IntArray,
    count: IndexArray,
) -> ClassifierInputs:
    """Return the inputs of classifiers and confidence models, with (n, 0) columns for unmeasured
    quantities.
    """
    irradiance = measured.band_irradiance_w_m2
    noise = measured.band_noise_w_m2
    return ClassifierInputs(
        time_s=time_s,
        sensor=sensor,
        target=target,
        range_m=range_m,
        elevation_sine=elevation_sine,
        bands=measured.bands,
        band_count=BITS_SET[measured.bands],
        band_total=band_total,
        detection_count=count,
        snr=measured.snr,
        band_irradiance_w_m2=np.empty((len(time_s), 0)) if irradiance is None else irradiance,
        band_noise_w_m2=np.empty((len(time_s), 0)) if noise is None else noise,
    )


@frozen(eq=False, repr=False)
class Classified:
    """Reported types (n,), the posteriors that they are from, or (n, 0), and the columns of
    detections of these.
    """

    reported_type: ByteArray
    log_posterior: FloatArray
    columns: Mapping[str, Any]

    @classmethod
    def of(
        cls, classifier: Classifier, rows: int, log_posterior: FloatArray, method: str, types: int
    ) -> "Classified":
        """Return the types that a classifier reports for posteriors (rows, ...), which its `method`
        returned.
        """
        over_types = classifier.over_types(log_posterior, REPORTED_TYPES)
        columns = {
            "type_log_probability": checked_log_probability(
                over_types, rows, len(REPORTED_TYPES), method
            )
        }
        if log_posterior.shape != over_types.shape:
            columns["hypothesis_log_probability"] = log_posterior
        return cls(
            checked_types(classifier.reported(log_posterior), rows, types, "reported"),
            log_posterior,
            columns,
        )


def classified(
    classifier: Classifier,
    sightings: ClassifierInputs,
    rng: RandomDraws,
    types: int = len(REPORTED_TYPES),
) -> Classified:
    """Return the types that a classifier reports, with its probabilities if it has any."""
    rows = len(sightings)
    posterior = classifier.log_posterior(sightings)
    if posterior is not None:
        return Classified.of(classifier, rows, posterior, "log_posterior", types)
    codes = checked_types(classifier.reported_type(sightings, rng), rows, types, "reported_type")
    return Classified(codes, np.empty((rows, 0)), {})


def confidences(model: Confidence, sightings: ClassifierInputs, types: Classified) -> FloatArray:
    """Return confidences (n,) of classified detections."""
    of_types = model.of_types(types.reported_type, types.log_posterior)
    if of_types is not None:
        return checked_confidence(of_types, len(sightings), "of_types")
    return checked_confidence(model.confidence(sightings), len(sightings), "confidence")


#: The columns of detections that a classifier with probabilities makes.
_TYPED = frozenset(
    {"reported_type", "confidence", "type_log_probability", "hypothesis_log_probability"}
)


@frozen
class Classification:
    """Types and confidences of a run's detections: computed when they are first read, if the
    classifier has probabilities, and with the detections otherwise.

    `types` is the number of types that events may report.
    """

    classifier: Classifier = field(eq=id)
    confidence: Confidence = field(eq=id)
    types: int
    has_probabilities: bool
    errors: PluginErrors = field(eq=False)

    @classmethod
    def of(cls, plan: Plan) -> "Classification":
        """Return the classification of a plan; asks the classifier for the posteriors of no
        detections.
        """
        classifier = plan.classifier
        nothing = ClassifierInputs.empty()
        return cls(
            classifier=classifier,
            confidence=plan.confidence,
            types=len(plan.reported_types),
            has_probabilities=has_own(Classifier, classifier, "log_posterior")
            and classifier.log_posterior(nothing) is not None,
            errors=PluginErrors(plan.host, plan.scene),
        )

    def detections(
        self,
        columns: Mapping[str, Any],
        sightings: ClassifierInputs,
        rng: RandomDraws,
        codes: ByteArray | None,
    ) -> Detections:
        """Return detections with their other `columns`; `codes` (n,) are types that do not follow
        from measurements.
        """
        if codes is None and self.has_probabilities:
            no_path = np.empty((len(sightings), 0), dtype=np.int64)
            present = {**columns, "path": no_path}
            return Detections.deferring(present, Deferred(_TYPED, sightings, self))
        types = (
            classified(self.classifier, sightings, rng, self.types)
            if codes is None
            else Classified(codes, np.empty((len(codes), 0)), {})
        )
        return Detections(
            **columns,
            reported_type=types.reported_type,
            confidence=confidences(self.confidence, sightings, types),
            **types.columns,
        )

    def __call__(self, sightings: ClassifierInputs) -> Mapping[str, Any]:
        """Return the columns of types and confidence of detections, by name."""
        rows = len(sightings)
        with self.errors:
            posterior: Any = self.classifier.log_posterior(sightings)
            types = Classified.of(self.classifier, rows, posterior, "log_posterior", self.types)
            return {
                "hypothesis_log_probability": np.empty((rows, 0)),
                **types.columns,
                "reported_type": types.reported_type,
                "confidence": confidences(self.confidence, sightings, types),
            }


def with_tracks(
    classifier: Classifier, confidence: Confidence, detections: Detections, estimates: Tracks
) -> Detections:
    """Return detections with type probabilities revised by their tracks.

    Only tracks with a burnout estimate are used: their types come from motion, those of others may
    come from the very reports.
    """
    if not len(estimates) or not detections.type_log_probability.shape[1]:
        return detections
    moved: BoolArray = np.all(np.isfinite(estimates.burnout), axis=1)
    rows = np.flatnonzero((detections.estimate >= 0) & moved[detections.estimate])
    if not len(rows):
        return detections
    of_track = estimates.type_probability[detections.estimate[rows]]
    has_all = detections.hypothesis_log_probability.shape[1] > 0
    posterior = (
        detections.hypothesis_log_probability if has_all else detections.type_log_probability
    )
    types = Classified.of(
        classifier, len(rows), classifier.revised(posterior[rows], of_track), "revised", 256
    )
    columns = {
        name: _replaced(getattr(detections, name), rows, column)
        for name, column in {"reported_type": types.reported_type, **types.columns}.items()
    }
    changed = detections.replaced(**columns)
    of_types = confidence.of_types(
        changed.reported_type, _replaced(posterior, rows, types.log_posterior)
    )
    if of_types is None:
        return changed
    return changed.replaced(confidence=checked_confidence(of_types, len(detections), "of_types"))


def _replaced(column: Any, rows: IntArray, values: Any) -> Any:
    """Return a copy of a column with other values in some rows."""
    copy = column.copy()
    copy[rows] = values
    return copy


def measured_lines_of_sight(
    states: SensorStates, exposed: Exposures, sigma_rad: FloatArray, words: WordArray
) -> FloatArray:
    """Return measured unit vectors (n, 3) in ECEF: with the sensor's bias, and two normal errors
    across each.

    `sigma_rad` (n,) is the standard deviation along both axes; `words` (n,) are raw random words.
    The true direction is to the target's position at emission.
    """
    east_normal, north_normal = normal_pairs(words)
    direction = _directions(exposed)
    if states.bias is not None:
        direction = states.bias.applied(*direction, exposed.sensor, exposed.sensor_ecef_m)
    return vector(*_tilted(*direction, east_normal * sigma_rad, north_normal * sigma_rad))


def _directions(exposed: Exposures) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the components (n,) of the true unit vectors from sensor to target."""
    per_m = 1.0 / exposed.range_m
    target_m = exposed.target_ecef_m
    sensor_m = exposed.sensor_ecef_m
    x, y, z = ((target_m[:, axis] - sensor_m[:, axis]) * per_m for axis in range(3))
    return x, y, z


def _tilted(
    x: FloatArray, y: FloatArray, z: FloatArray, first_rad: FloatArray, second_rad: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors moved by small angles along two directions across them.

    The directions are those of increasing longitude and latitude of the vector about the Earth's
    axis, so that a rotation of a whole scene about this axis does not change its errors. On the
    axis the longitude is 0.
    """
    level = np.sqrt(x * x + y * y)
    on_axis = level == 0.0
    per_level = 1.0 / (level + on_axis)
    cosine = x * per_level + on_axis
    sine = y * per_level
    outward = z * second_rad
    moved_x = x - sine * first_rad - cosine * outward
    moved_y = y + cosine * first_rad - sine * outward
    moved_z = z + level * second_rad
    per_length = 1.0 / np.sqrt(moved_x * moved_x + moved_y * moved_y + moved_z * moved_z)
    return moved_x * per_length, moved_y * per_length, moved_z * per_length
