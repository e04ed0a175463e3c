"""Conformance tests of detection models."""

from typing import Any

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.plugin import DetectionModel, DetectionProbability, RandomDraws
from opir_testing.contracts.contract import (
    count_excess,
    rate_excess,
    require,
    require_array_computation,
    require_complete_abilities,
    require_equal,
    require_independent_rows,
    require_rows,
    require_same_copy,
)
from opir_testing.contracts.scenes import SceneContract

#: The purposes of the engine's own random streams.
RESERVED_PURPOSES = frozenset({"detection", "line-of-sight", "scan-phase"})


class RecordingDraws:
    """Random draws that record their purposes."""

    def __init__(self, rng: RandomDraws, purposes: set[str] | None = None) -> None:
        self._rng = rng
        self.purposes: set[str] = set() if purposes is None else purposes

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return the numbers of the wrapped draws."""
        self.purposes.add(purpose)
        return self._rng.uniforms(purpose, words)

    def normals(self, purpose: str, count: int = 1) -> FloatArray:
        """Return the numbers of the wrapped draws."""
        self.purposes.add(purpose)
        return self._rng.normals(purpose, count)

    def pair_uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        """Return the numbers of the wrapped draws."""
        self.purposes.add(purpose)
        return self._rng.pair_uniforms(purpose, words)

    def take(self, rows: Any) -> RandomDraws:
        """Return the draws of some of the rows."""
        return RecordingDraws(self._rng.take(rows), self.purposes)

    def require_own_purposes(self) -> None:
        """Require that no purpose was one of the engine's own."""
        taken = sorted(self.purposes & RESERVED_PURPOSES)
        words = f"it draws by the purpose {', '.join(taken)}"
        require(not taken, words, "Choose a purpose of your own, e.g. its name.")


def reported_chances(
    chances: FloatArray, pair: IntArray, scan: IntArray, needed: IntArray, scans: IntArray
) -> FloatArray:
    """Return the probabilities (n,) that looks detect and are reported: at least M - 1 of the N - 1
    scans before do.
    """
    order = np.lexsort((scan, pair))
    sorted_pair = pair[order]
    sorted_scan = scan[order]
    hit = chances[order]
    counts = np.zeros((len(hit), int(needed.max(initial=1)) + 1))
    counts[:, 0] = 1.0
    for back in range(1, int(scans.max(initial=1))):
        row = np.arange(back, len(hit))
        is_equal = (sorted_pair[row] == sorted_pair[row - back]) & (
            sorted_scan[row] - sorted_scan[row - back] < scans[order][row]
        )
        chance = np.where(is_equal, hit[row - back], 0.0)[:, None]
        # Counts above the last column are lost: only small ones matter.
        counts[row, 1:] = counts[row, 1:] * (1.0 - chance) + counts[row, :-1] * chance
        counts[row, 0] *= 1.0 - chance[:, 0]
    fewer = np.where(np.arange(counts.shape[1]) < needed[order][:, None] - 1, counts, 0.0).sum(
        axis=1
    )
    reported = np.empty(len(hit))
    reported[order] = hit * (1.0 - fewer)
    return reported


class DetectionContract(SceneContract):
    """Conformance tests of a detection model."""

    kind = DetectionModel
    key = "detection"

    @classmethod
    def model(cls) -> DetectionProbability:
        """Return the built model."""
        return cls.plan().detection

    @classmethod
    def part(cls) -> Any:
        """Return the built model."""
        return cls.model()

    def test_probabilities_lie_in_the_unit_interval(self) -> None:
        """Each look has a probability in [0, 1]."""
        exposed = self.looks().exposures
        probability = self.model().probability(exposed)
        require_rows("probability", probability, len(exposed))
        require(
            probability.dtype == np.float64
            and bool(np.all((probability >= 0.0) & (probability <= 1.0))),
            f"probabilities are {probability.dtype} from {np.min(probability)} to"
            f" {np.max(probability)}",
            "Return float64 in [0, 1], never nan: clip rounding errors; 0 where the probability is"
            " unknown.",
        )

    def test_probabilities_are_independent(self) -> None:
        """The probability of a look does not depend on the other looks of the call."""
        model = self.model()
        exposed = self.looks().exposures
        require_independent_rows(
            "probability", lambda rows: model.probability(exposed.take(rows).freeze()), len(exposed)
        )

    def test_pairs_and_looks_agree(self) -> None:
        """The probability of a pair, if it has one, is that of all its looks."""
        model = self.model()
        exposed = self.looks().exposures
        of_pair = model.pair_probability(exposed.sensor, exposed.target)
        if of_pair is None:
            return
        require_independent_rows(
            "pair_probability",
            lambda rows: model.pair_probability(exposed.sensor[rows], exposed.target[rows]),
            len(exposed),
        )
        is_equal = np.array_equal(of_pair, model.probability(exposed))
        require_equal(
            is_equal,
            "pair_probability and probability differ",
            "Return None from pair_probability where looks differ.",
        )

    def test_geometry_is_declared_if_it_is_used(self) -> None:
        """A model with `needs_geometry = False` returns the same probabilities without geometry."""
        model = self.model()
        exposed = self.looks().exposures
        if model.needs_geometry:
            return
        nothing = np.empty(0)
        no_vectors = np.empty((0, 3))
        bare = evolve(
            exposed,
            range_m=nothing,
            elevation_sine=nothing,
            target_ecef_m=no_vectors,
            sensor_ecef_m=no_vectors,
        )
        try:
            is_equal = np.array_equal(model.probability(bare), model.probability(exposed))
        except (IndexError, ValueError):
            is_equal = False
        require_equal(
            is_equal, "needs_geometry is False, but geometry is used", "Set needs_geometry = True."
        )

    def test_confirming_bands_are_the_sensors_bands(self) -> None:
        """Each detection has at least one confirming band, and only bands of its sensor."""
        looks = self.looks()
        rows = np.arange(len(self.looks().exposures))
        measured = self.model().measure(looks.exposures, looks.draws(rows))
        require_rows("the bands measured", measured.bands, len(rows))
        require_rows("the snr measured", measured.snr, len(rows))
        counts = np.array([len(sensor.bands) for sensor in self.plan().sensors])[
            looks.exposures.sensor
        ]
        require(
            measured.bands.dtype == np.uint8
            and bool(np.all((measured.bands > 0) & (measured.bands >> counts == 0))),
            "a mask of bands is empty, or has bits beyond the sensor's bands",
            "Bit b stands for the sensor's band b; set at least the first if none confirms; return"
            " uint8.",
        )
        require(
            not np.isinf(measured.snr).any(),
            "an snr is infinite",
            "Return finite values, or nan for none.",
        )

    def test_measurements_are_independent(self) -> None:
        """The measurement of a look does not depend on the other looks of the call."""
        model = self.model()
        looks = self.looks()

        def measured(rows: Any) -> FloatArray:
            result = model.measure(looks.exposures.take(rows).freeze(), looks.draws(rows))
            return np.stack([result.bands.astype(np.float64), result.snr], axis=1)

        require_independent_rows("the measurement", measured, len(looks.exposures))

    def test_reserved_random_streams_are_not_used(self) -> None:
        """Measurements do not use the purposes of the engine's random streams."""
        looks = self.looks()
        rng = RecordingDraws(looks.draws(np.arange(len(looks.exposures))))
        self.model().measure(looks.exposures, rng)
        rng.require_own_purposes()

    def test_detections_occur_at_the_stated_rate(self) -> None:
        """The number of detections agrees with the probabilities, within 99.9 %."""
        looks = self.looks()
        count = int(np.sum(self.run().truth.target >= 0))
        model = self.model()
        chances = model.probability(looks.exposures)
        if model.confirmation is not None:
            needed, scans = model.confirmation[looks.exposures.sensor].T
            chances = reported_chances(chances, looks.pair, looks.exposures.scan, needed, scans)
        require(
            count_excess(count, chances) <= 1.0,
            f"{count} looks detect; the probabilities add up to {chances.sum():.1f}",
            "probability(...) must return the same value for a look in each call.",
        )

    def test_false_alarms_occur_at_the_stated_rate(self) -> None:
        """False alarms, if a model has any, occur at its stated rate, within 99.9 %."""
        per_scan = self.model().rate_per_scan
        if per_scan is None:
            return
        run = self.run_of(self.scene(targets=[]))
        scans = [run.plan.end_ns / sensor.scan.period_ns for sensor in run.plan.sensors]
        expected = float(np.sum(per_scan * np.array(scans)))
        count = int(np.sum(run.truth.target < 0))
        require(
            rate_excess(count, expected) <= 1.0,
            f"there are {count} false alarms; the stated rates add up to {expected:.1f}",
            "rate_per_scan is the mean number of false alarms in one scan of a sensor's field of"
            " regard.",
        )

    def test_optional_abilities_are_complete(self) -> None:
        """An optional ability is implemented completely or not at all."""
        signals = ("probability_tolerance", "response", "measure_response")
        false_alarms = ("rate_per_scan", "words", "measure_noise")
        require_complete_abilities(DetectionProbability, self.model(), (signals, false_alarms))

    def test_expected_measurements_agree_with_probabilities(self) -> None:
        """The quantiles that `response` returns are those of its probabilities."""
        model = self.model()
        exposed = self.looks().exposures
        response = model.response(exposed)
        if response is None:
            return
        from scipy.special import ndtr

        require_rows("response", response.snr, len(exposed), axes=2)
        is_equal = response.probit is not None and np.allclose(
            ndtr(response.probit), model.probability(exposed), atol=1e-9
        )
        require_equal(
            is_equal,
            "response and probability differ",
            "Return the standard normal quantile of P_d as probit.",
        )

    def test_looks_are_computed_as_arrays(self) -> None:
        """The number of Python steps does not grow with the looks: computations are on arrays."""
        model = self.model()
        exposed = self.looks().exposures
        count = len(self.looks().exposures)
        # Spread over all looks: the first ones are of one sensor, and each kind of sensor may take
        # its own steps.
        require_array_computation(
            "look",
            lambda rows: model.probability(exposed.take(np.arange(rows) * count // rows).freeze()),
            count // 4,
            count,
        )

    def test_a_built_model_pickles(self) -> None:
        """The built model can be pickled, and its copy returns the same."""
        require_same_copy(self.model(), lambda model: model.probability(self.looks().exposures))
