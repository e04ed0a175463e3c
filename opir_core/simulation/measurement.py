"""From looks that detect to detections: measured, classified, given a confidence and an id."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.optional import PosteriorClassifier
from opir_core.interfaces.protocols import Classifier, Measured, RandomDraws
from opir_core.interfaces.records import ClassifierInputs, Detections, DetectionTruth, Exposures, Tracks
from opir_core.planning.looks import exposures
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_states import SensorStates
from opir_core.random_streams.detection_ids import stream_key_words, uuid8_words
from opir_core.random_streams.pair_streams import PairStreams, RowDraws, WindowNumbers
from opir_core.random_streams.philox import normal_pairs

#: The number of bits set in each byte.
_BITS_SET = np.array([value.bit_count() for value in range(256)], dtype=np.int64)


@frozen(eq=False)
class Hits(Columns):
    """Looks of a window that detect: their rows among the looks, pairs, scans and times, and running detection counts.

    `probability` is the look's; `direction_words` are the raw random words of the line-of-sight error, and seed what
    else is drawn for the detection.
    """

    row: IntArray
    pair: IntArray
    scan: IntArray
    time_ns: IntArray
    count: IndexArray
    probability: FloatArray
    direction_words: NDArray[np.uint64]


class DetectionBuilder:
    """Makes detections of hits, block by block."""

    def __init__(self, plan: Plan, sites: SensorStates, streams: PairStreams, names: Sequence[tuple[str, str]]) -> None:
        self._plan = plan
        self._sites = sites
        self._id_keys = stream_key_words(plan.scene, names)
        self._pair_type = plan.classifier.pair_type(plan.pairs.sensor, plan.pairs.target, streams.of_pairs())
        self._band_totals = np.array([len(sensor.bands) for sensor in plan.sensors], dtype=np.int64)

    @property
    def judges(self) -> bool:
        """Whether the classifier goes by what is measured, and not by pairs."""
        return self._pair_type is None

    def block(
        self, hits: Hits, numbers: WindowNumbers, measured: Measured | None = None
    ) -> tuple[Detections, DetectionTruth]:
        """Return the detections of a block of hits, and their truth; the model is asked where nothing is measured."""
        plan, dice = self._plan, numbers.of(hits.row, hits.pair, hits.direction_words)
        time_s = hits.time_ns.astype(np.float64) * 1e-9
        exposed = exposures(plan, self._sites, hits.pair, hits.scan, geometry=True, time_s=time_s)
        measured = plan.detection.measure(exposed, dice) if measured is None else measured
        sightings = self._sightings(exposed, measured, hits)
        sigma_rad = measured.line_of_sight_sigma_rad
        if sigma_rad is None:
            sigma_rad = self._sites.sigma_rad.take(exposed.sensor)
        detections = self._detections(exposed, sightings, sigma_rad, hits, dice)
        truth = DetectionTruth(
            exposed.target, exposed.emission_time_s, exposed.range_m, exposed.elevation_sine, hits.probability
        )
        return detections, truth

    def _sightings(self, exposed: Exposures, measured: Measured, hits: Hits) -> ClassifierInputs:
        return ClassifierInputs(
            time_s=exposed.time_s,
            sensor=exposed.sensor,
            target=exposed.target,
            range_m=exposed.range_m,
            elevation_sine=exposed.elevation_sine,
            bands=measured.bands,
            band_count=_BITS_SET[measured.bands],
            band_total=self._band_totals[exposed.sensor],
            detection_count=hits.count,
            snr=measured.snr,
            band_irradiance_w_m2=self._band_irradiance(measured, len(hits)),
            band_noise_w_m2=np.empty((len(hits), 0)) if measured.band_noise_w_m2 is None else measured.band_noise_w_m2,
        )

    def _band_irradiance(self, measured: Measured, rows: int) -> FloatArray:
        measured_w_m2 = measured.band_irradiance_w_m2
        if measured_w_m2 is None:
            return np.empty((rows, 0))
        owed = (rows, int(self._band_totals.max()))
        if measured_w_m2.shape != owed:
            raise ModelError(f"the detection model measured irradiances of shape {measured_w_m2.shape}, not {owed}")
        return measured_w_m2

    def _detections(
        self, exposed: Exposures, sightings: ClassifierInputs, sigma_rad: FloatArray, hits: Hits, dice: RowDraws
    ) -> Detections:
        plan = self._plan
        none = np.full(len(hits), -1, dtype=np.int64)
        reported_type, log_probability = self._judged(sightings, hits, dice)
        return Detections(
            time_ns=hits.time_ns,
            sensor=exposed.sensor,
            scan=exposed.scan,
            detection_id=uuid8_words(self._id_keys[hits.pair], exposed.scan),
            reported_type=reported_type,
            bands=sightings.bands,
            detection_count=hits.count,
            confidence=plan.confidence.confidence(sightings),
            line_of_sight_ecef=measured_lines_of_sight(self._sites, exposed, sigma_rad, hits.direction_words),
            sensor_ecef_m=exposed.sensor_ecef_m,
            snr=sightings.snr,
            track=none,
            estimate=none,
            line_of_sight_sigma_rad=sigma_rad,
            band_irradiance_w_m2=sightings.band_irradiance_w_m2,
            type_log_probability=log_probability,
        )

    def _judged(self, sightings: ClassifierInputs, hits: Hits, dice: RowDraws) -> tuple[NDArray[np.uint8], FloatArray]:
        if self._pair_type is None:
            return judged(self._plan.classifier, sightings, dice)
        return self._pair_type.take(hits.pair), np.empty((len(hits), 0))


def judged(
    classifier: Classifier, sightings: ClassifierInputs, dice: RandomDraws
) -> tuple[NDArray[np.uint8], FloatArray]:
    """Return reported types (n,), and ln of the probabilities (n, 4) of a classifier that gives them, or (n, 0)."""
    if not isinstance(classifier, PosteriorClassifier):
        return classifier.reported_type(sightings, dice), np.empty((len(sightings), 0))
    log_probability = classifier.log_posterior(sightings)
    return classifier.reported(log_probability), log_probability


def with_tracks(classifier: Any, detections: Detections, estimates: Tracks) -> Detections:
    """Return detections with what their tracks' motion says of the type.

    Tracks that tell a burnout have their types from motion; those of others may be made of the very reports.
    """
    if not detections.type_log_probability.shape[1] or not len(estimates):
        return detections
    moved: BoolArray = np.all(np.isfinite(estimates.burnout), axis=1)
    rows = np.flatnonzero((detections.estimate >= 0) & moved[detections.estimate])
    if not len(rows):
        return detections
    posterior: PosteriorClassifier = classifier
    of_track = estimates.type_probability[detections.estimate[rows]]
    log_probability, reported = detections.type_log_probability.copy(), detections.reported_type.copy()
    log_probability[rows] = posterior.revised(log_probability[rows], of_track)
    reported[rows] = posterior.reported(log_probability[rows])
    return evolve(detections, type_log_probability=log_probability, reported_type=reported)


def measured_lines_of_sight(
    sites: SensorStates, seen_as: Exposures, sigma_rad: FloatArray, words: NDArray[np.uint64]
) -> FloatArray:
    """Return unit vectors (n, 3) in ECEF with their errors: the sensor's bias, and two normal errors across each.

    `sigma_rad` (n,) is the spread of each along both axes; `words` (n,) are the dice, raw. The true direction is that
    to where the target was when the light left it.
    """
    first, second = normal_pairs(words)
    direction = _directions(seen_as)
    if sites.bias is not None:
        direction = sites.bias.applied(*direction, seen_as.sensor, seen_as.sensor_ecef_m)
    return _rows(*_tilted(*direction, first * sigma_rad, second * sigma_rad))


def _directions(seen_as: Exposures) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the components of the true unit vectors from sensor to target."""
    per_m = 1.0 / seen_as.range_m
    target_m, sensor_m = seen_as.target_ecef_m, seen_as.sensor_ecef_m
    x, y, z = ((target_m[:, axis] - sensor_m[:, axis]) * per_m for axis in range(3))
    return x, y, z


def _tilted(
    x: FloatArray, y: FloatArray, z: FloatArray, first_rad: FloatArray, second_rad: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors moved by small angles along two directions across them.

    The two directions are those of growing longitude and latitude of the vector about the Earth's axis: a scene that is
    turned as a whole about that axis is measured alike. Along the axis, where there is no longitude, it counts as 0.
    """
    level = np.sqrt(x * x + y * y)
    on_axis = level == 0.0
    per_level = 1.0 / (level + on_axis)
    cosine, sine = x * per_level + on_axis, y * per_level
    outward = z * second_rad
    moved_x = x - sine * first_rad - cosine * outward
    moved_y = y + cosine * first_rad - sine * outward
    moved_z = z + level * second_rad
    per_length = 1.0 / np.sqrt(moved_x * moved_x + moved_y * moved_y + moved_z * moved_z)
    return moved_x * per_length, moved_y * per_length, moved_z * per_length


def _rows(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    rows = np.empty((len(x), 3))
    rows[:, 0], rows[:, 1], rows[:, 2] = x, y, z
    return rows
