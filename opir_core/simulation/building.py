"""Stage of the engine: detections with their type, confidence and id, and their truth, from
hits.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import frozen

from opir_core.arrays import ByteArray, FloatArray, IntArray, WordArray
from opir_core.interfaces.columns import Filling
from opir_core.interfaces.detection_models import DetectionProbability, Measured
from opir_core.interfaces.records import ClassifierInputs, Detections, DetectionTruth, Exposures
from opir_core.planning.looks import LookGeometry, blocks
from opir_core.planning.plan import Plan
from opir_core.random_streams.detection_ids import stream_key_words, uuid8_words
from opir_core.random_streams.pair_streams import PairStreams, RowDraws, WindowNumbers
from opir_core.simulation.measurement import (
    Classification,
    classifier_inputs,
    measured_lines_of_sight,
)
from opir_core.simulation.observation import Hits, Observation
from opir_core.simulation.output_checks import checked_measured, checked_types

if TYPE_CHECKING:
    from opir_core.planning.faults import SensorFaults


@frozen(eq=False, kw_only=True, repr=False)
class BuildDetections:
    """Takes `hits`, `numbers`, `measured` and `order`; gives `detections` and `truth`, in this
    order.

    `pair_type` (pairs,) are the reported types of a classifier that goes by pairs, None for one
    that uses measurements; `id_keys` (pairs, 2) are the keys of the detection ids, `band_totals`
    (sensors,) the sensors' numbers of bands.
    """

    geometry: LookGeometry
    detection: DetectionProbability
    classification: Classification
    pair_type: ByteArray | None
    id_keys: WordArray
    band_totals: IntArray
    faults: "SensorFaults | None"

    @classmethod
    def of(cls, plan: Plan, geometry: LookGeometry, streams: PairStreams) -> "BuildDetections":
        """Return the stage of a plan; a classifier that goes by pairs is asked once, here."""
        scene = plan.scene
        pairs = plan.pairs
        types = len(plan.reported_types)
        codes = plan.classifier.pair_type(pairs.sensor, pairs.target, streams.of_pairs())
        return cls(
            geometry=geometry,
            detection=plan.detection,
            classification=Classification.of(plan),
            pair_type=None
            if codes is None
            else checked_types(codes, len(pairs), types, "pair_type"),
            id_keys=stream_key_words(scene.seed, scene.name, scene.epoch_us, plan.scan_names()),
            band_totals=np.array([len(sensor.bands) for sensor in plan.sensors], dtype=np.int64),
            faults=plan.faults,
        )

    @property
    def most_bands(self) -> int:
        """The largest number of bands of a sensor."""
        return int(self.band_totals.max())

    def __call__(self, window: Observation) -> None:
        """Build the detections in blocks of rows whose columns stay in the processor's cache."""
        order = window.order
        measured = window.measured
        # Column by column: gathering rows of all columns at once touches more pages than the
        # processor caches.
        hits = window.hits.take(order)
        measured = None if measured is None else measured.take(order)
        none = np.full(len(hits), -1, dtype=np.int64)
        times = {"time_ns": hits.time_ns, "reported_ns": hits.time_ns}
        columns = {
            **times,
            "scan": hits.scan,
            "detection_count": hits.count,
            "track": none,
            "estimate": none,
        }
        detections = Filling(Detections, len(hits), columns | _measured_columns(measured))
        truth = Filling(DetectionTruth, len(hits), {"probability": hits.probability})
        for rows in blocks(len(hits)):
            of_rows = None if measured is None else measured.take(rows)
            block, block_truth = self._block(hits.take(rows), window.numbers, of_rows)
            detections.put(block)
            truth.put(block_truth)
        window.detections = detections.record()
        window.truth = truth.record()

    def _block(
        self, hits: Hits, numbers: WindowNumbers, measured: Measured | None
    ) -> tuple[Detections, DetectionTruth]:
        """Return the detections of a block of hits, and their truth; the model measures what is not
        `measured` yet.
        """
        rng = numbers.of(hits.row, hits.pair, hits.direction_words)
        states = self.geometry.states
        time_s = hits.time_ns.astype(np.float64) * 1e-9
        if self.faults is not None:
            time_s -= self.faults.clock_s(self.geometry.pairs.sensor[hits.pair], time_s)
        exposed = self.geometry.exposures(hits.pair, hits.scan, time_s=time_s)
        if measured is None:
            measured = checked_measured(
                self.detection.measure(exposed, rng), len(hits), self.most_bands
            )
        total = self.band_totals[exposed.sensor]
        sightings = classifier_inputs(
            measured,
            exposed.time_s,
            exposed.sensor,
            exposed.target,
            exposed.range_m,
            exposed.elevation_sine,
            total,
            hits.count,
        )
        sigma_rad = measured.line_of_sight_sigma_rad
        if sigma_rad is None:
            sigma_rad = states.sigma_rad.take(exposed.sensor)
        detections = self._detections(exposed, sightings, sigma_rad, hits, rng)
        truth = DetectionTruth(
            exposed.target,
            exposed.emission_time_s,
            exposed.range_m,
            exposed.elevation_sine,
            hits.probability,
        )
        return detections, truth

    def _detections(
        self,
        exposed: Exposures,
        sightings: ClassifierInputs,
        sigma_rad: FloatArray,
        hits: Hits,
        rng: RowDraws,
    ) -> Detections:
        none = np.full(len(hits), -1, dtype=np.int64)
        columns = {
            "time_ns": hits.time_ns,
            "sensor": exposed.sensor,
            "scan": exposed.scan,
            "detection_id": uuid8_words(self.id_keys[hits.pair], exposed.scan),
            "bands": sightings.bands,
            "detection_count": hits.count,
            **self._sights(exposed, sigma_rad, hits),
            "snr": sightings.snr,
            "track": none,
            "estimate": none,
            "line_of_sight_sigma_rad": sigma_rad,
            "band_irradiance_w_m2": sightings.band_irradiance_w_m2,
            "reported_ns": hits.time_ns,
        }
        codes = None if self.pair_type is None else self.pair_type.take(hits.pair)
        return self.classification.detections(columns, sightings, rng, codes)

    def _sights(self, exposed: Exposures, sigma_rad: FloatArray, hits: Hits) -> dict[str, Any]:
        """Return the columns of measured lines of sight, and of the positions that sensors state."""
        states = self.geometry.states
        faults = self.faults
        sensor = exposed.sensor
        words = hits.direction_words
        if faults is None:
            direction = measured_lines_of_sight(states, exposed, sigma_rad, words)
            return {"line_of_sight_ecef": direction, "sensor_ecef_m": exposed.sensor_ecef_m}
        stated_s = hits.time_ns.astype(np.float64) * 1e-9
        true_sigma_rad = sigma_rad * faults.noise(sensor, stated_s)
        direction = measured_lines_of_sight(states, exposed, true_sigma_rad, words)
        return {
            "line_of_sight_ecef": faults.turned(direction, sensor, exposed.sensor_ecef_m, stated_s),
            "sensor_ecef_m": states.positions(sensor, stated_s),
        }


def _measured_columns(measured: Measured | None) -> dict[str, Any]:
    """Return the columns of detections that are those of their measurements."""
    names = ("bands", "snr", "line_of_sight_sigma_rad", "band_irradiance_w_m2")
    columns = {name: getattr(measured, name, None) for name in names}
    return {name: column for name, column in columns.items() if column is not None}
