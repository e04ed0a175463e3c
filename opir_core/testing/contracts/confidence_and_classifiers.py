"""The contracts of what judges detections: confidence models and classifiers."""

from functools import cache
from typing import Any, ClassVar

import numpy as np

from opir_core.interfaces.optional import PosteriorClassifier
from opir_core.interfaces.records import ClassifierInputs
from opir_core.plugin.components import ClassifierModel, Component, ConfidenceModel
from opir_core.scene.scene import REPORTED_TYPES
from opir_core.testing.bench import LookTable, bench_scene, sightings_of
from opir_core.testing.contracts.comparisons import (
    insist_complete,
    insist_pickles,
    insist_rows,
    insist_rows_stand_alone,
)
from opir_core.testing.contracts.contract import insist
from opir_core.testing.contracts.detection import RESERVED_PURPOSES, WatchedDice
from opir_core.testing.contracts.scenes import SceneContract
from opir_core.testing.steps import LOOP_STEPS, steps_per_row

_ARRAYS = "Replace the loop over detections by arithmetic on whole columns."


class ConfidenceContract(SceneContract):
    """What a confidence model promises."""

    kind: ClassVar[type[Component]] = ConfidenceModel

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the confidence model."""
        return bench_scene(**{"confidence": {"model": cls.name, **cls.block()}, **changes})

    @classmethod
    @cache
    def sightings(cls) -> ClassifierInputs:
        """Return sightings of every kind."""
        plan = cls.plan()
        return sightings_of(plan, LookTable.of(plan))

    def test_confidences_lie_in_the_unit_interval(self) -> None:
        """There is one confidence for each detection, in [0, 1], whatever is unknown of it."""
        seen = self.sightings()
        confidence = self.plan().confidence.confidence(seen)
        insist_rows("confidence", confidence, len(seen))
        insist(
            confidence.dtype == np.float64 and bool(np.all((confidence >= 0.0) & (confidence <= 1.0))),
            f"confidences are {confidence.dtype} from {np.min(confidence)} to {np.max(confidence)}",
            "Return float64 in [0, 1], never nan: snr is nan where the detection model has none; clip at the end.",
        )

    def test_each_detection_has_its_own_confidence(self) -> None:
        """The confidence of a detection does not depend on which detections are judged with it."""
        model, seen = self.plan().confidence, self.sightings()
        insist_rows_stand_alone("confidence", lambda rows: model.confidence(seen.take(rows).freeze()), len(seen))

    def test_detections_are_not_worked_through_one_by_one(self) -> None:
        """More detections take no more steps of Python: the work is done on arrays."""
        model, seen = self.plan().confidence, self.sightings()
        many = len(seen)
        steps = steps_per_row(lambda rows: model.confidence(seen.take(slice(0, rows)).freeze()), many // 4, many)
        insist(steps < LOOP_STEPS, f"each detection more takes {steps:.1f} steps of Python", _ARRAYS)

    def test_a_built_model_pickles(self) -> None:
        """The built model can be pickled, and its copy says the same."""
        model, seen = self.plan().confidence, self.sightings()
        same = np.array_equal(insist_pickles(model).confidence(seen), model.confidence(seen))
        insist(same, "a pickled copy gives other confidences", "Keep all state in fields that pickle.")


class ClassifierContract(SceneContract):
    """What a classifier promises."""

    kind: ClassVar[type[Component]] = ClassifierModel

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the classifier."""
        detection = "snr" if getattr(cls.component().config, "needs_irradiance", False) else "constant"
        chosen = {"detection": detection, "classification": {"model": cls.name, **cls.block()}}
        return bench_scene(**{**chosen, **changes})

    @classmethod
    @cache
    def looks(cls) -> LookTable:
        """Return all looks of the scene."""
        return LookTable.of(cls.plan())

    @classmethod
    @cache
    def sightings(cls) -> ClassifierInputs:
        """Return sightings of every kind."""
        return sightings_of(cls.plan(), cls.looks())

    def test_codes_are_of_types_that_are_reported(self) -> None:
        """There is one code for each detection, of a type that an event may report."""
        codes = self._codes(np.arange(len(self.sightings())))
        insist_rows("reported_type", codes, len(self.sightings()))
        insist(
            codes.dtype == np.uint8 and bool(np.all(codes < len(REPORTED_TYPES))),
            f"codes are {codes.dtype} up to {np.max(codes)}",
            f"Return uint8 codes into REPORTED_TYPES: {', '.join(REPORTED_TYPES)}.",
        )

    def test_each_detection_has_its_own_type(self) -> None:
        """The type reported does not depend on which detections are judged with it."""
        insist_rows_stand_alone("reported_type", self._codes, len(self.sightings()))

    def test_pairs_and_detections_agree(self) -> None:
        """Where one type holds for all detections of a pair, it is that of each detection."""
        plan, looks = self.plan(), self.looks()
        of_pair = plan.classifier.pair_type(plan.pairs.sensor, plan.pairs.target, looks.streams.of_pairs())
        if of_pair is None:
            return
        insist_rows("pair_type", of_pair, len(plan.pairs))
        same = np.array_equal(of_pair[looks.pair], self._codes(np.arange(len(self.sightings()))))
        insist(same, "pair_type and reported_type differ", "Draw both from dice.pair_uniforms, or return None.")

    def test_optional_abilities_are_complete(self) -> None:
        """An optional protocol is implemented with all its members, or not at all."""
        insist_complete(self.plan().classifier, (PosteriorClassifier,))

    def test_type_probabilities_agree_with_types(self) -> None:
        """The posteriors of a `PosteriorClassifier` sum to 1 and lead to the types that it reports."""
        model, seen = self.plan().classifier, self.sightings()
        if not isinstance(model, PosteriorClassifier):
            return
        posterior = model.log_posterior(seen)
        insist_rows("log_posterior", posterior, len(seen))
        total = np.exp(posterior).sum(axis=1)
        sums_to_one = posterior.shape[1] == len(REPORTED_TYPES) and bool(np.all(np.abs(total - 1.0) < 1e-6))
        change = "Return natural logarithms of probabilities over REPORTED_TYPES, one row per detection."
        insist(sums_to_one, "type probabilities do not sum to 1", change)
        same = np.array_equal(model.reported(posterior), self._codes(np.arange(len(seen))))
        insist(same, "reported and reported_type differ", "Return reported(log_posterior(...)) from reported_type.")

    def test_the_engines_own_numbers_are_left_alone(self) -> None:
        """Classifying draws no number that the engine uses itself."""
        dice = WatchedDice(self.looks().dice(np.arange(len(self.sightings()))))
        self.plan().classifier.reported_type(self.sightings(), dice)
        taken = sorted(dice.purposes & RESERVED_PURPOSES)
        insist(not taken, f"it draws by the purpose {', '.join(taken)}", "Choose a purpose of your own, e.g. its name.")

    def test_detections_are_not_worked_through_one_by_one(self) -> None:
        """More detections take no more steps of Python: the work is done on arrays."""
        many = len(self.sightings())
        steps = steps_per_row(lambda rows: self._codes(np.arange(rows)), many // 4, many)
        insist(steps < LOOP_STEPS, f"each detection more takes {steps:.1f} steps of Python", _ARRAYS)

    def test_a_built_classifier_pickles(self) -> None:
        """The built classifier can be pickled, and its copy says the same."""
        model, rows = self.plan().classifier, np.arange(len(self.sightings()))
        copy = insist_pickles(model)
        same = np.array_equal(copy.reported_type(self.sightings(), self.looks().dice(rows)), self._codes(rows))
        insist(same, "a pickled copy gives other types", "Keep all state in fields that pickle.")

    def _codes(self, rows: Any) -> Any:
        seen = self.sightings().take(rows).freeze()
        return self.plan().classifier.reported_type(seen, self.looks().dice(rows))
