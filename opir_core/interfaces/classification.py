"""The contracts of classifiers and of confidence models.

The result of a row must not depend on the other rows of a call: the engine may pass any slice of a
run, and the bytes of the events must be the same.
"""

from abc import abstractmethod
from collections.abc import Sequence

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.interfaces.contract import PluginPart, optional, undefined
from opir_core.interfaces.detection_models import RandomDraws
from opir_core.interfaces.records import ClassifierInputs


class Classifier(PluginPart):
    """Measurements to the reported target type; with `log_posterior`, `reported` and `revised`,
    also to type probabilities that tracks revise.

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
        """Whether reports may depend on the targets' true types; with other targets it is built
        anew.
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
        """Return posteriors combined with type probabilities from the tracks' motion, (n, 4).

        A classifier with `log_posterior` must define it; `ModelError` without it.
        """
        raise undefined(self, "revised", "log_posterior")

    def reported(self, log_posterior: FloatArray) -> ByteArray:
        """Return the codes (n,) reported for posteriors.

        A classifier with `log_posterior` must define it; `ModelError` without it.
        """
        raise undefined(self, "reported", "log_posterior")


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
