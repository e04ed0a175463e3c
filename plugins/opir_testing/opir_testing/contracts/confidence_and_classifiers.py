"""Conformance tests of confidence models and classifiers."""

from functools import cache
from typing import Any

import numpy as np

from opir_core.arrays import IntArray
from opir_core.plugin import (
    REPORTED_TYPES,
    Classifier,
    ClassifierInputs,
    ClassifierModel,
    ConfidenceModel,
)
from opir_testing.bench import classifier_inputs
from opir_testing.contracts.contract import (
    require,
    require_array_computation,
    require_complete_abilities,
    require_equal,
    require_independent_rows,
    require_rows,
    require_same_copy,
)
from opir_testing.contracts.detection import RecordingDraws
from opir_testing.contracts.scenes import SceneContract


class ConfidenceContract(SceneContract):
    """Conformance tests of a confidence model."""

    kind = ConfidenceModel
    key = "confidence"

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the confidence model, and with type probabilities if it needs
        them.
        """
        needs = getattr(cls.component().config, "needs_posterior", False)
        models = {"detection": "snr", "classification": "spectral"} if needs else {}
        return super().scene(**{**models, **changes})

    @classmethod
    def part(cls) -> Any:
        """Return the built model."""
        return cls.plan().confidence

    @classmethod
    @cache
    def inputs(cls) -> ClassifierInputs:
        """Return inputs with all combinations of bands, counts and SNR."""
        return classifier_inputs(cls.plan(), cls.looks())

    def test_confidences_lie_in_the_unit_interval(self) -> None:
        """Each detection has a confidence in [0, 1], also with unknown SNR."""
        inputs = self.inputs()
        confidence = self.plan().confidence.confidence(inputs)
        require_rows("confidence", confidence, len(inputs))
        require(
            confidence.dtype == np.float64
            and bool(np.all((confidence >= 0.0) & (confidence <= 1.0))),
            f"confidences are {confidence.dtype} from {np.min(confidence)} to {np.max(confidence)}",
            "Return float64 in [0, 1], never nan: snr is nan where the detection model has none;"
            " clip at the end.",
        )

    def test_confidences_are_independent(self) -> None:
        """The confidence of a detection does not depend on the other detections of the call."""
        model = self.plan().confidence
        inputs = self.inputs()
        require_independent_rows(
            "confidence", lambda rows: model.confidence(inputs.take(rows).freeze()), len(inputs)
        )

    def test_detections_are_computed_as_arrays(self) -> None:
        """The number of Python steps does not grow with the detections: computations are on
        arrays.
        """
        model = self.plan().confidence
        inputs = self.inputs()
        require_array_computation(
            "detection",
            lambda rows: model.confidence(inputs.take(_spread(len(inputs), rows)).freeze()),
            len(inputs) // 4,
            len(inputs),
        )

    def test_a_built_model_pickles(self) -> None:
        """The built model can be pickled, and its copy returns the same."""
        require_same_copy(self.plan().confidence, lambda model: model.confidence(self.inputs()))


class ClassifierContract(SceneContract):
    """Conformance tests of a classifier."""

    kind = ClassifierModel
    key = "classification"

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the classifier."""
        detection = (
            "snr" if getattr(cls.component().config, "needs_irradiance", False) else "constant"
        )
        return super().scene(**{"detection": detection, **changes})

    @classmethod
    def part(cls) -> Any:
        """Return the built classifier."""
        return cls.plan().classifier

    @classmethod
    @cache
    def inputs(cls) -> ClassifierInputs:
        """Return inputs with all combinations of bands, counts and SNR."""
        return classifier_inputs(cls.plan(), cls.looks())

    def test_codes_are_reported_types(self) -> None:
        """Each detection has the code of a type that events may report."""
        codes = self._codes(np.arange(len(self.inputs())))
        require_rows("reported_type", codes, len(self.inputs()))
        require(
            codes.dtype == np.uint8 and bool(np.all(codes < len(REPORTED_TYPES))),
            f"codes are {codes.dtype} up to {np.max(codes)}",
            f"Return uint8 codes into REPORTED_TYPES: {', '.join(REPORTED_TYPES)}.",
        )

    def test_types_are_independent(self) -> None:
        """The reported type does not depend on the other detections of the call."""
        require_independent_rows("reported_type", self._codes, len(self.inputs()))

    def test_pairs_and_detections_agree(self) -> None:
        """The type of a pair, if it has one, is that of all its detections."""
        plan = self.plan()
        looks = self.looks()
        of_pair = plan.classifier.pair_type(
            plan.pairs.sensor, plan.pairs.target, looks.streams.of_pairs()
        )
        if of_pair is None:
            return
        require_rows("pair_type", of_pair, len(plan.pairs))
        is_equal = np.array_equal(of_pair[looks.pair], self._codes(np.arange(len(self.inputs()))))
        require_equal(
            is_equal,
            "pair_type and reported_type differ",
            "Draw both from rng.pair_uniforms, or return None.",
        )

    def test_optional_abilities_are_complete(self) -> None:
        """An optional ability is implemented completely or not at all."""
        require_complete_abilities(
            Classifier, self.plan().classifier, [("log_posterior", "revised", "reported")]
        )

    def test_type_probabilities_agree_with_types(self) -> None:
        """The posteriors of a classifier, if it has any, sum to 1 and give the types that it
        reports.
        """
        model = self.plan().classifier
        inputs = self.inputs()
        posterior = model.log_posterior(inputs)
        if posterior is None:
            return
        require_rows("log_posterior", posterior, len(inputs), axes=2)
        over_types = model.over_types(posterior, REPORTED_TYPES)
        total = np.exp(over_types).sum(axis=1)
        sums_to_one = over_types.shape[1] == len(REPORTED_TYPES) and bool(
            np.all(np.abs(total - 1.0) < 1e-6)
        )
        change = (
            "Return natural logarithms of probabilities over REPORTED_TYPES, one row per detection,"
            " or over all hypotheses, with an over_types that sums them."
        )
        require(sums_to_one, "type probabilities do not sum to 1", change)
        is_equal = np.array_equal(model.reported(posterior), self._codes(np.arange(len(inputs))))
        require_equal(
            is_equal,
            "reported and reported_type differ",
            "Return reported(log_posterior(...)) from reported_type.",
        )

    def test_reserved_random_streams_are_not_used(self) -> None:
        """Classification does not use the purposes of the engine's random streams."""
        rng = RecordingDraws(self.looks().draws(np.arange(len(self.inputs()))))
        self.plan().classifier.reported_type(self.inputs(), rng)
        rng.require_own_purposes()

    def test_detections_are_computed_as_arrays(self) -> None:
        """The number of Python steps does not grow with the detections: computations are on
        arrays.
        """
        count = len(self.inputs())
        require_array_computation(
            "detection", lambda rows: self._codes(_spread(count, rows)), count // 4, count
        )

    def test_a_built_classifier_pickles(self) -> None:
        """The built classifier can be pickled, and its copy returns the same."""
        rng = self.looks().draws(np.arange(len(self.inputs())))
        require_same_copy(
            self.plan().classifier, lambda model: model.reported_type(self.inputs(), rng)
        )

    def _codes(self, rows: Any) -> Any:
        inputs = self.inputs().take(rows).freeze()
        return self.plan().classifier.reported_type(inputs, self.looks().draws(rows))


def _spread(count: int, rows: int) -> IntArray:
    """Return rows evenly over all, so that few have the same sensors as many: what a sensor costs
    is not by row.
    """
    return np.linspace(0, count - 1, rows).astype(np.int64)
