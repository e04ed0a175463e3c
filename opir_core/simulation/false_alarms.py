"""What noise alone makes: looks at nothing that cross the threshold, at the rate that the threshold implies.

Their number is Poisson, with the mean P_fa times resolution cells times looks; each is somewhere in the field of
regard, uniformly over its solid angle. No cell is visited. A sensor's exceedances come from its own streams, block of
scans by block of scans, so that neither windows nor other sensors or targets change them.
"""

from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray, WordArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
from opir_core.errors import ModelError
from opir_core.geometry import intersection_with_ellipsoid
from opir_core.geometry.vectors import components, length
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.optional import FalseAlarmModel
from opir_core.interfaces.protocols import Measured
from opir_core.interfaces.records import ClassifierInputs, Detections, DetectionTruth
from opir_core.planning.plan import Plan
from opir_core.planning.sensor_states import SensorStates
from opir_core.random_streams.detection_ids import stream_key_words, uuid8_words
from opir_core.random_streams.noise_streams import PLACE_WORDS, Drawn, SensorNoise
from opir_core.scene.scene import UNKNOWN_TYPE
from opir_core.simulation.measurement import judged

_BITS_SET = np.array([value.bit_count() for value in range(256)], dtype=np.int64)


@frozen(eq=False)
class _Placed(Columns):
    """A window's exceedances: when, by which sensor, in which direction, and the numbers of each."""

    time_ns: IntArray
    sensor: IndexArray
    scan: IntArray
    detection_id: WordArray
    line_of_sight_ecef: FloatArray
    sensor_ecef_m: FloatArray
    uniforms: FloatArray


@frozen(eq=False)
class FalseAlarms:
    """A window's exceedances as detections with their truth, sensor by sensor; `order` (n,) sorts them by time."""

    detections: Detections
    truth: DetectionTruth
    order: IntArray

    def alone(self) -> tuple[Detections, DetectionTruth]:
        """Return them sorted by time, then sensor: what a window is in which no target is detected."""
        return self.detections.take(self.order), self.truth.take(self.order)

    def places(self, time_ns: IntArray, sensor: IndexArray, order: IntArray) -> IntArray:
        """Return the exceedances' rows among all detections, where targets' times and sensors (n,) come in an order.

        At the same moment a sensor's own targets come first.
        """
        own = self.detections
        start_ns = min(int(time_ns.min()), int(own.time_ns.min()))
        sensors = max(int(sensor.max()), int(own.sensor.max())) + 1
        keys, own_keys = (
            ((times - start_ns) * sensors + of_sensor).take(sorted_by)
            for times, of_sensor, sorted_by in ((time_ns, sensor, order), (own.time_ns, own.sensor, self.order))
        )
        places = np.empty(len(own_keys), dtype=np.int64)
        places[self.order] = np.searchsorted(keys, own_keys, side="right") + np.arange(len(own_keys))
        return places


class FalseAlarmGenerator:
    """Makes a run's exceedances, window by window."""

    def __init__(self, plan: Plan, sites: SensorStates) -> None:
        model = plan.detection
        if not isinstance(model, FalseAlarmModel):
            raise ModelError("a detection model with rate_per_scan also needs words and measure_noise")
        self._plan, self._sites, self._model = plan, sites, model
        self._rate = model.rate_per_scan
        self._band_totals = np.array([len(sensor.bands) for sensor in plan.sensors])
        names, seed = noise_names(plan), plan.scene.seed
        self._sensors = {
            number: SensorNoise(
                plan.sensors[number], number, names[number], seed, float(self._rate[number]), model.words
            )
            for number in np.flatnonzero(self._rate > 0.0).tolist()
        }
        self._keys = stream_key_words(plan.scene, [(name, "\x1fnoise") for name in names])
        self._period_ns = np.array([sensor.scan.period_ns for sensor in plan.sensors], dtype=np.int64)
        half_angle = np.array([sensor.field_of_regard_half_angle_rad for sensor in plan.sensors])
        self._most_fall = 2.0 * np.square(np.sin(0.5 * half_angle))

    def between(self, start_ns: int, end_ns: int) -> "FalseAlarms | None":
        """Return the exceedances in [start, end) of scene time; None where none is."""
        parts = [sensor.near(start_ns, end_ns) for sensor in self._sensors.values()]
        found = [part for part in parts if len(part)]
        placed = self._placed(Drawn.concatenate(found), start_ns, end_ns) if found else None
        return self._told(placed) if placed is not None and len(placed) else None

    def _placed(self, drawn: Drawn, start_ns: int, end_ns: int) -> _Placed:
        """Return those that come in the window, where and when they are."""
        sensor, scan, uniforms = drawn.sensor, drawn.scan, drawn.uniforms
        begin_ns = scan * self._period_ns.take(sensor)
        at_m = self._sites.positions(sensor, begin_ns.astype(np.float64) * 1e-9)
        height_m = np.sqrt(np.square(at_m).sum(axis=1))
        direction = _directions(at_m, height_m, self._most_fall.take(sensor), uniforms)
        time_ns = begin_ns + self._phase_ns(sensor, at_m, at_m + direction * height_m[:, None])
        ids = uuid8_words(self._keys.take(sensor, axis=0), drawn.serial)
        placed = _Placed(time_ns, sensor, scan, ids, direction, at_m, uniforms[:, PLACE_WORDS:])
        kept = np.flatnonzero((time_ns >= start_ns) & (time_ns < end_ns))
        return placed if len(kept) == len(scan) else placed.take(kept)

    def _phase_ns(self, sensor: IndexArray, at_m: FloatArray, seen_m: FloatArray) -> IntArray:
        """Return when in their scans sensors (n,), which come in order, look at places (n, 3)."""
        phase_ns = np.empty(len(sensor), dtype=np.int64)
        edges = [0, *(np.flatnonzero(np.diff(sensor)) + 1).tolist(), len(sensor)]
        for rows in map(slice, edges[:-1], edges[1:]):
            phase_ns[rows] = self._sensors[int(sensor[rows.start])].phase_ns(at_m[rows], seen_m[rows])
        return phase_ns

    def _told(self, noise: _Placed) -> "FalseAlarms":
        measured = self._model.measure_noise(noise.sensor, noise.uniforms)
        sightings = self._sightings(noise, measured)
        rows = len(noise.time_ns)
        none, unknown = np.full(rows, -1, dtype=np.int64), np.full(rows, np.nan)
        sigma_rad = measured.line_of_sight_sigma_rad
        reported_type, log_probability = self._judged(sightings)
        detections = Detections(
            time_ns=noise.time_ns,
            sensor=noise.sensor,
            scan=noise.scan,
            detection_id=noise.detection_id,
            reported_type=reported_type,
            bands=measured.bands,
            detection_count=sightings.detection_count,
            confidence=self._plan.confidence.confidence(sightings),
            line_of_sight_ecef=noise.line_of_sight_ecef,
            sensor_ecef_m=noise.sensor_ecef_m,
            snr=measured.snr,
            track=none,
            estimate=none,
            line_of_sight_sigma_rad=self._sites.sigma_rad[noise.sensor] if sigma_rad is None else sigma_rad,
            band_irradiance_w_m2=sightings.band_irradiance_w_m2,
            type_log_probability=log_probability,
        )
        truth = DetectionTruth(none.astype(np.int32), unknown, unknown, unknown, unknown)
        # Sensors come in their order, which a stable sort keeps at each moment.
        return FalseAlarms(detections, truth, np.argsort(noise.time_ns, kind="stable"))

    def _sightings(self, noise: _Placed, measured: Measured) -> ClassifierInputs:
        """Return what classifiers and confidence models see: the line of sight is taken to end on the ground."""
        rows = len(noise.time_ns)
        ground = intersection_with_ellipsoid(noise.sensor_ecef_m, noise.line_of_sight_ecef)
        hits = np.isfinite(ground[:, 0])
        range_m, sine = _seen_from(ground, noise.sensor_ecef_m)
        irradiance = measured.band_irradiance_w_m2
        return ClassifierInputs(
            time_s=noise.time_ns.astype(np.float64) * 1e-9,
            sensor=noise.sensor,
            target=np.full(rows, -1, dtype=np.int32),
            range_m=np.where(hits, range_m, length(*components(noise.sensor_ecef_m))),
            elevation_sine=np.where(hits, np.maximum(sine, 0.0), 0.0),
            bands=measured.bands,
            band_count=_BITS_SET[measured.bands],
            band_total=self._band_totals[noise.sensor],
            detection_count=np.ones(rows, dtype=np.int32),
            snr=measured.snr,
            band_irradiance_w_m2=np.empty((rows, 0)) if irradiance is None else irradiance,
            band_noise_w_m2=np.empty((rows, 0)) if measured.band_noise_w_m2 is None else measured.band_noise_w_m2,
        )

    def _judged(self, sightings: ClassifierInputs) -> tuple[NDArray[np.uint8], FloatArray]:
        """Return what classifiers say that judge by measurements; those that go by pairs know no such pair."""
        nobody = np.empty(0, dtype=np.int32)
        if self._plan.classifier.pair_type(nobody, nobody, _NoDice()) is not None:
            return np.full(len(sightings), UNKNOWN_TYPE, dtype=np.uint8), np.empty((len(sightings), 0))
        return judged(self._plan.classifier, sightings, _NoDice(len(sightings)))


@frozen
class _NoDice:
    """Dice for classifiers that ask for them where there is no pair: always one half."""

    rows: int = 0

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        return np.full((self.rows, words), 0.5)

    def normals(self, purpose: str, count: int = 1) -> FloatArray:
        return np.zeros((self.rows, count))

    def pair_uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        return np.full((self.rows, words), 0.5)

    def take(self, rows: Any) -> "_NoDice":
        return _NoDice(len(np.arange(self.rows)[rows]))


def _directions(at_m: FloatArray, height_m: FloatArray, most_fall: FloatArray, uniforms: FloatArray) -> FloatArray:
    """Return directions (n, 3) spread uniformly over the solid angles of cones about nadir; 1 - cosine (n,) at edges.

    1 - cosine is uniform over a cone; its sine follows without cancellation.
    """
    fall = most_fall * uniforms[:, 1]
    off, turn = np.sqrt(fall * (2.0 - fall)), 2.0 * np.pi * uniforms[:, 2]
    x, y, z = (at_m[:, axis] / -height_m for axis in range(3))
    # East of the sensor; over a pole, where none is, along the first axis.
    level = np.sqrt(x * x + y * y)
    on_axis = level == 0.0
    per_level = 1.0 / (level + on_axis)
    east_x, east_y = on_axis - y * per_level, x * per_level
    along_east, along_north, down = off * np.cos(turn), off * np.sin(turn), 1.0 - fall
    unit = np.empty_like(at_m)
    unit[:, 0] = x * down + east_x * along_east - z * east_y * along_north
    unit[:, 1] = y * down + east_y * along_east + z * east_x * along_north
    unit[:, 2] = z * down + (x * east_y - y * east_x) * along_north
    return unit


def _seen_from(ground_ecef_m: FloatArray, sensor_ecef_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ranges (n,) of sensors from places on the ellipsoid, and the sines of their elevation there."""
    (x, y, z), away = components(ground_ecef_m), components(sensor_ecef_m - ground_ecef_m)
    z = z * (EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M) ** 2
    range_m = length(*away)
    return range_m, (x * away[0] + y * away[1] + z * away[2]) / (range_m * length(x, y, z))


def noise_names(plan: Plan) -> list[str]:
    """Return the names that the sensors' exceedances go by: their ids, with their generations where scans are anew."""
    generations = plan.scan_generations or (0,) * len(plan.sensors)
    both = zip(plan.sensors, generations, strict=True)
    return [f"{sensor.id}@{generation}" if generation else sensor.id for sensor, generation in both]
