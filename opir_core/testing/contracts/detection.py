"""The contract of detection models: exposures to probability of detection."""

from functools import cache
from typing import Any, ClassVar

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray
from opir_core.interfaces.optional import FalseAlarmModel, SignalModel
from opir_core.interfaces.protocols import DetectionProbability, RandomDraws
from opir_core.plugin.components import Component, DetectionModel
from opir_core.testing.bench import LookTable, bench_scene
from opir_core.testing.chance import excess_of_count, excess_of_rate
from opir_core.testing.contracts.comparisons import (
    insist_complete,
    insist_pickles,
    insist_rows,
    insist_rows_stand_alone,
)
from opir_core.testing.contracts.contract import insist
from opir_core.testing.contracts.scenes import SceneContract
from opir_core.testing.steps import LOOP_STEPS, steps_per_row

#: Purposes whose numbers the engine draws itself.
RESERVED_PURPOSES = frozenset({"detection", "line-of-sight", "scan-phase"})


class WatchedDice:
    """Dice that keep note of the purposes they are asked for."""

    def __init__(self, dice: RandomDraws, purposes: set[str] | None = None) -> None:
        self._dice = dice
        self.purposes: set[str] = set() if purposes is None else purposes

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return the numbers of the dice."""
        self.purposes.add(purpose)
        return self._dice.uniforms(purpose, words)

    def normals(self, purpose: str, count: int = 1) -> FloatArray:
        """Return the numbers of the dice."""
        self.purposes.add(purpose)
        return self._dice.normals(purpose, count)

    def pair_uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return the numbers of the dice."""
        self.purposes.add(purpose)
        return self._dice.pair_uniforms(purpose, words)

    def take(self, rows: Any) -> RandomDraws:
        """Return the dice of some of the rows."""
        return WatchedDice(self._dice.take(rows), self.purposes)


class DetectionContract(SceneContract):
    """What a detection model promises."""

    kind: ClassVar[type[Component]] = DetectionModel

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the detection model."""
        return bench_scene(**{"detection": {"model": cls.name, **cls.block()}, **changes})

    @classmethod
    def model(cls) -> DetectionProbability:
        """Return the built model."""
        return cls.plan().detection

    @classmethod
    @cache
    def looks(cls) -> LookTable:
        """Return all looks of the scene."""
        return LookTable.of(cls.plan())

    def test_probabilities_lie_in_the_unit_interval(self) -> None:
        """There is one probability for each look, in [0, 1]."""
        exposed = self.looks().exposures
        probability = self.model().probability(exposed)
        insist_rows("probability", probability, len(exposed))
        insist(
            probability.dtype == np.float64 and bool(np.all((probability >= 0.0) & (probability <= 1.0))),
            f"probabilities are {probability.dtype} from {np.min(probability)} to {np.max(probability)}",
            "Return float64 in [0, 1], never nan: clip what rounding takes outside; 0 where nothing can be said.",
        )

    def test_each_look_has_its_own_probability(self) -> None:
        """The probability of a look does not depend on which looks are asked about with it."""
        model, exposed = self.model(), self.looks().exposures
        insist_rows_stand_alone(
            "probability", lambda rows: model.probability(exposed.take(rows).freeze()), len(exposed)
        )

    def test_pairs_and_looks_agree(self) -> None:
        """Where a probability holds for all looks of a pair, it is that of its looks, and known for no pairs too."""
        model, exposed = self.model(), self.looks().exposures
        of_pair = model.pair_probability(exposed.sensor, exposed.target)
        if of_pair is None:
            return
        insist_rows_stand_alone(
            "pair_probability",
            lambda rows: model.pair_probability(exposed.sensor[rows], exposed.target[rows]),
            len(exposed),
        )
        same = np.array_equal(of_pair, model.probability(exposed))
        insist(same, "pair_probability and probability differ", "Return None from pair_probability where looks differ.")

    def test_geometry_is_asked_for_where_it_is_read(self) -> None:
        """A model that says it needs no geometry gives the same without."""
        model, exposed = self.model(), self.looks().exposures
        if model.needs_geometry:
            return
        nothing, no_vectors = np.empty(0), np.empty((0, 3))
        bare = evolve(
            exposed, range_m=nothing, elevation_sine=nothing, target_ecef_m=no_vectors, sensor_ecef_m=no_vectors
        )
        try:
            same = np.array_equal(model.probability(bare), model.probability(exposed))
        except (IndexError, ValueError):
            same = False
        insist(same, "needs_geometry is false, and geometry is read", "Say needs_geometry = True.")

    def test_bands_that_confirm_are_the_sensors(self) -> None:
        """Each detection is confirmed by at least one band, and by none that its sensor does not have."""
        looks, rows = self.looks(), np.arange(len(self.looks().exposures))
        measured = self.model().measure(looks.exposures, looks.dice(rows))
        insist_rows("the bands measured", measured.bands, len(rows))
        insist_rows("the snr measured", measured.snr, len(rows))
        counts = np.array([len(sensor.bands) for sensor in self.plan().sensors])[looks.exposures.sensor]
        insist(
            measured.bands.dtype == np.uint8 and bool(np.all((measured.bands > 0) & (measured.bands >> counts == 0))),
            "a mask of bands is empty, or has bits beyond the sensor's bands",
            "Bit b stands for the sensor's band b; set at least the first where no band is sure; return uint8.",
        )
        insist(not np.isinf(measured.snr).any(), "an snr is infinite", "Return finite values, or nan for none.")

    def test_each_detection_is_measured_on_its_own(self) -> None:
        """What is measured of a look does not depend on which looks are measured with it."""
        model, looks = self.model(), self.looks()

        def measured(rows: Any) -> FloatArray:
            found = model.measure(looks.exposures.take(rows).freeze(), looks.dice(rows))
            return np.stack([found.bands.astype(np.float64), found.snr], axis=1)

        insist_rows_stand_alone("what is measured", measured, len(looks.exposures))

    def test_the_engines_own_numbers_are_left_alone(self) -> None:
        """Measuring draws no number that the engine uses itself."""
        looks = self.looks()
        dice = WatchedDice(looks.dice(np.arange(len(looks.exposures))))
        self.model().measure(looks.exposures, dice)
        taken = sorted(dice.purposes & RESERVED_PURPOSES)
        insist(not taken, f"it draws by the purpose {', '.join(taken)}", "Choose a purpose of your own, e.g. its name.")

    def test_detections_come_at_the_stated_rate(self) -> None:
        """Looks detect as often as the probabilities say, within 99.9 %."""
        looks, found = self.looks(), int(np.sum(self.run().truth.target >= 0))
        chances = self.model().probability(looks.exposures)
        insist(
            excess_of_count(found, chances) <= 1.0,
            f"{found} looks detect, where the probabilities add up to {chances.sum():.1f}",
            "probability(...) must say the same of a look whenever it is asked.",
        )

    def test_noise_crosses_as_often_as_stated(self) -> None:
        """False alarms of a `FalseAlarmModel` come at the rate that it states, within 99.9 %."""
        model = self.model()
        if not isinstance(model, FalseAlarmModel):
            return
        per_scan = model.rate_per_scan
        run = self.run_of(self.scene(targets=[]))
        scans = [run.plan.end_ns / sensor.scan.period_ns for sensor in run.plan.sensors]
        due, found = float(np.sum(per_scan * np.array(scans))), int(np.sum(run.truth.target < 0))
        insist(
            excess_of_rate(found, due) <= 1.0,
            f"noise crosses {found} times, where the stated rates add up to {due:.1f}",
            "rate_per_scan is the mean number of exceedances in one scan of a sensor's whole field of regard.",
        )

    def test_optional_abilities_are_complete(self) -> None:
        """An optional protocol is implemented with all its members, or not at all."""
        insist_complete(self.model(), (SignalModel, FalseAlarmModel))

    def test_expected_measurements_agree_with_probabilities(self) -> None:
        """The quantiles that a `SignalModel` returns are those of its probabilities."""
        model, exposed = self.model(), self.looks().exposures
        if not isinstance(model, SignalModel):
            return
        from scipy.special import ndtr

        response = model.response(exposed)
        insist_rows("response", response.snr, len(exposed))
        same = response.probit is not None and np.allclose(ndtr(response.probit), model.probability(exposed), atol=1e-9)
        insist(same, "response and probability differ", "Return the standard normal quantile of P_d as probit.")

    def test_looks_are_not_worked_through_one_by_one(self) -> None:
        """More looks take no more steps of Python: the work is done on arrays."""
        model, exposed = self.model(), self.looks().exposures
        many = len(exposed)
        steps = steps_per_row(lambda rows: model.probability(exposed.take(slice(0, rows)).freeze()), many // 4, many)
        insist(
            steps < LOOP_STEPS,
            f"each look more takes {steps:.1f} steps of Python",
            "Replace the loop over looks by arithmetic on whole columns.",
        )

    def test_a_built_model_pickles(self) -> None:
        """The built model can be pickled, and its copy says the same."""
        copy, exposed = insist_pickles(self.model()), self.looks().exposures
        same = np.array_equal(copy.probability(exposed), self.model().probability(exposed))
        insist(same, "a pickled copy gives other probabilities", "Keep all state in fields that pickle.")
