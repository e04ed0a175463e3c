"""False alarms: looks at empty cells in which noise alone crosses the threshold.

Their number is Poisson distributed, with the mean P_fa times resolution cells times looks; their
directions are uniform over the solid angle of the field of regard. No cell is visited. A sensor's
false alarms come from streams of its own, by blocks of scans, so that neither windows nor other
sensors or targets change them.
"""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray, WordArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
from opir_core.doors import deferred
from opir_core.geometry import intersection_with_ellipsoid
from opir_core.geometry.vectors import components, length
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.detection_models import DetectionProbability, Measured
from opir_core.interfaces.records import ClassifierInputs, Detections, DetectionTruth
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.looks import LookGeometry, blocks
from opir_core.planning.plan import Plan
from opir_core.random_streams.detection_ids import stream_key_words, uuid8_words
from opir_core.random_streams.pair_streams import PLACE_WORDS, Drawn, FalseAlarmStream
from opir_core.scene.scene import UNKNOWN_TYPE
from opir_core.simulation.measurement import Classification, classifier_inputs
from opir_core.simulation.output_checks import checked_confirmation, checked_measured, checked_rates

if TYPE_CHECKING:
    from opir_core.simulation.pointing import PointedFields
    from opir_core.simulation.stuck_looks import StuckScans


@frozen(eq=False, repr=False)
class _Placed(Columns):
    """A window's false alarms: time, sensor, scan, id, direction, sensor position and random
    numbers.
    """

    time_ns: IntArray
    sensor: IndexArray
    scan: IntArray
    detection_id: WordArray
    line_of_sight_ecef: FloatArray
    sensor_ecef_m: FloatArray
    uniforms: FloatArray


@frozen(eq=False, repr=False)
class FalseAlarms:
    """A window's false alarms as detections with their truth, sensor by sensor; `order` (n,) sorts
    them by time.
    """

    detections: Detections
    truth: DetectionTruth
    order: IntArray

    def alone(self) -> tuple[Detections, DetectionTruth]:
        """Return them sorted by time, then sensor: the detections of a window without detected
        targets.
        """
        return self.detections.take(self.order), self.truth.take(self.order)

    def places(self, time_ns: IntArray, sensor: IndexArray, order: IntArray) -> IntArray:
        """Return the false alarms' rows among all detections, for the targets' times and sensors
        (n,) in an `order`.

        At equal times a sensor's targets come before its false alarms.
        """
        detections = self.detections
        start_ns = min(int(time_ns.min()), int(detections.time_ns.min()))
        sensors = max(int(sensor.max()), int(detections.sensor.max())) + 1
        keys, own_keys = (
            ((times - start_ns) * sensors + of_sensor).take(sorted_by)
            for times, of_sensor, sorted_by in (
                (time_ns, sensor, order),
                (detections.time_ns, detections.sensor, self.order),
            )
        )
        places = np.empty(len(own_keys), dtype=np.int64)
        places[self.order] = np.searchsorted(keys, own_keys, side="right") + np.arange(
            len(own_keys)
        )
        return places


class FalseAlarmGenerator:
    """Draws a run's false alarms, window by window; there are none where the Sun prevents looks."""

    def __init__(
        self,
        plan: Plan,
        model: DetectionProbability,
        geometry: LookGeometry,
        fields: "PointedFields | None" = None,
    ) -> None:
        self._model = model
        self._classification = Classification.of(plan)
        self._states = geometry.states
        scene = plan.scene
        sensors = plan.sensors
        names = plan.sensor_names()
        rate = checked_rates(model.rate_per_scan, len(sensors))
        self._streams = {
            number: FalseAlarmStream(
                sensors[number], number, names[number], scene.seed, float(rate[number]), model.words
            )
            for number in np.flatnonzero(rate > 0.0).tolist()
        }
        noise_names = [(name, "\x1fnoise") for name in names]
        self._id_keys = stream_key_words(scene.seed, scene.name, scene.epoch_us, noise_names)
        self._exclusions = {
            number: exclusion
            for number, exclusion in enumerate(plan.exclusions)
            if exclusion is not None
        }
        self._watched = {
            number: sensor for number, sensor in enumerate(sensors) if sensor.watched_s is not None
        }
        self._band_totals = np.array([len(sensor.bands) for sensor in sensors])
        self._faults = plan.faults
        self._stuck: StuckScans | None = None
        if plan.faults is not None:
            self._stuck = deferred("opir_core.simulation.stuck_looks.stuck_scans")(plan, fields)
        self._fields = fields
        self._needed = _needed(model, len(sensors))
        self._period_ns = np.array([sensor.scan.period_ns for sensor in sensors], dtype=np.int64)
        half_angle = np.array([sensor.field_of_regard_half_angle_rad for sensor in sensors])
        self._most_fall = 2.0 * np.square(np.sin(0.5 * half_angle))

    def between(self, start_ns: int, end_ns: int) -> FalseAlarms | None:
        """Return the false alarms in [start, end) of scene time, or None."""
        idle = () if self._fields is None else self._fields.idle(start_ns, end_ns)
        streams = [stream for number, stream in self._streams.items() if number not in idle]
        alarms = [stream.near(start_ns, end_ns) for stream in streams]
        drawn = [alarms_of_sensor for alarms_of_sensor in alarms if len(alarms_of_sensor)]
        if not drawn:
            return None
        near = Drawn.concatenate(drawn)
        # Most are of other windows, where a scan is longer than these.
        placed = _Placed.concatenate(
            self._placed(near.take(rows), start_ns, end_ns) for rows in blocks(len(near))
        )
        return self._measured(placed) if len(placed) else None

    def _placed(self, drawn: Drawn, start_ns: int, end_ns: int) -> _Placed:
        """Return the false alarms in the window, with directions and times."""
        sensor = drawn.sensor
        scan = drawn.scan
        uniforms = drawn.uniforms
        begin_ns = scan * self._period_ns.take(sensor)
        at_m = self._states.positions(sensor, begin_ns.astype(np.float64) * 1e-9)
        radius_m = np.sqrt(np.square(at_m).sum(axis=1))
        direction = _directions(at_m, radius_m, self._most_fall.take(sensor), uniforms)
        time_ns = begin_ns + self._phase_ns(sensor, at_m, at_m + direction * radius_m[:, None])
        ids = uuid8_words(self._id_keys.take(sensor, axis=0), drawn.serial)
        placed = _Placed(time_ns, sensor, scan, ids, direction, at_m, uniforms[:, PLACE_WORDS:])
        is_kept = (time_ns >= start_ns) & (time_ns < end_ns)
        is_kept &= self._is_seen(placed, at_m + direction * radius_m[:, None])
        rows_kept = np.flatnonzero(is_kept)
        return placed if len(rows_kept) == len(scan) else placed.take(rows_kept)

    def _is_seen(self, placed: _Placed, ahead_m: FloatArray) -> BoolArray:
        """Return at which false alarms (n,) sensors look: not outside of their spans or narrow
        fields, not blind, not beside the Sun. `ahead_m` (n, 3) are positions in their directions.
        """
        time_s = placed.time_ns.astype(np.float64) * 1e-9
        sensor = placed.sensor
        is_seen = np.ones(len(time_s), dtype=np.bool_)
        if self._faults is not None:
            is_seen &= ~self._faults.is_blind(sensor, time_s)
        if self._stuck is not None:
            is_seen &= self._stuck.is_seen(sensor, placed.sensor_ecef_m, ahead_m, time_s)
        tests: list[tuple[int, Callable[..., BoolArray]]] = [
            *((number, _watching(each)) for number, each in self._watched.items()),
            *((number, each.is_clear) for number, each in self._exclusions.items()),
        ]
        if self._fields is not None:
            inside = self._fields.is_inside
            tests += [(number, partial(inside, number)) for number in self._fields.sensors]
        for number, test in tests:
            rows = np.flatnonzero(sensor == number)
            is_seen[rows] &= test(placed.sensor_ecef_m[rows], ahead_m[rows], time_s[rows])
        return is_seen

    def _phase_ns(self, sensor: IndexArray, at_m: FloatArray, seen_m: FloatArray) -> IntArray:
        """Return the scan phases at which sensors (n,), in order, look at positions (n, 3)."""
        phase_ns = np.empty(len(sensor), dtype=np.int64)
        edges = [0, *(np.flatnonzero(np.diff(sensor)) + 1).tolist(), len(sensor)]
        for rows in map(slice, edges[:-1], edges[1:]):
            phase_ns[rows] = self._streams[int(sensor[rows.start])].phase_ns(
                at_m[rows], seen_m[rows]
            )
        return phase_ns

    def _measured(self, noise: _Placed) -> FalseAlarms:
        rows = len(noise.time_ns)
        bands = int(self._band_totals.max())
        noise_only = self._model.measure_noise(noise.sensor, noise.uniforms)
        measured = checked_measured(noise_only, rows, bands, "measure_noise")
        sightings = self._classifier_inputs(noise, measured)
        none = np.full(rows, -1, dtype=np.int64)
        unknown = np.full(rows, np.nan)
        sigma_rad = measured.line_of_sight_sigma_rad
        columns = {
            "time_ns": noise.time_ns,
            "sensor": noise.sensor,
            "scan": noise.scan,
            "detection_id": noise.detection_id,
            "bands": measured.bands,
            "detection_count": sightings.detection_count,
            "line_of_sight_ecef": noise.line_of_sight_ecef,
            "sensor_ecef_m": noise.sensor_ecef_m,
            "snr": measured.snr,
            "track": none,
            "estimate": none,
            "line_of_sight_sigma_rad": self._states.sigma_rad[noise.sensor]
            if sigma_rad is None
            else sigma_rad,
            "band_irradiance_w_m2": sightings.band_irradiance_w_m2,
            "reported_ns": noise.time_ns,
        }
        detections = self._classification.detections(
            columns, sightings, _NoDraws(rows), self._codes(rows)
        )
        truth = DetectionTruth(none.astype(np.int32), unknown, unknown, unknown, unknown)
        # Rows are in order of sensors; a stable sort keeps this order at equal times.
        return FalseAlarms(detections, truth, np.argsort(noise.time_ns, kind="stable"))

    def _classifier_inputs(self, noise: _Placed, measured: Measured) -> ClassifierInputs:
        """Return the inputs of classifiers and confidence models, with the source at the end of the
        line of sight on the ground."""
        rows = len(noise.time_ns)
        ground = intersection_with_ellipsoid(noise.sensor_ecef_m, noise.line_of_sight_ecef)
        hits = np.isfinite(ground[:, 0])
        range_m, sine = _seen_from(ground, noise.sensor_ecef_m)
        return classifier_inputs(
            measured,
            noise.time_ns.astype(np.float64) * 1e-9,
            noise.sensor,
            np.full(rows, -1, dtype=np.int32),
            np.where(hits, range_m, length(*components(noise.sensor_ecef_m))),
            np.where(hits, np.maximum(sine, 0.0), 0.0),
            self._band_totals[noise.sensor],
            self._needed.take(noise.sensor),
        )

    def _codes(self, rows: int) -> ByteArray | None:
        """Return the types of classifiers that go by pairs, UNKNOWN (rows,); None for others."""
        nobody = np.empty(0, dtype=np.int32)
        if self._classification.classifier.pair_type(nobody, nobody, _NoDraws()) is None:
            return None
        return np.full(rows, UNKNOWN_TYPE, dtype=np.uint8)


def _watching(sensor: Sensor) -> Callable[..., BoolArray]:
    """Return the test whether a sensor looks, at times alone."""
    return lambda _sensor_ecef_m, _ahead_m, time_s: sensor.is_watching(time_s)


def _needed(model: DetectionProbability, sensors: int) -> IndexArray:
    """Return the detections (sensors,) that a reported false alarm consists of."""
    if model.confirmation is not None:
        return checked_confirmation(model.confirmation, sensors)[:, 0].astype(np.int32)
    return np.ones(sensors, dtype=np.int32)


@frozen
class _NoDraws:
    """Random draws for classifiers where there is no pair: always one half."""

    rows: int = 0

    def uniforms(self, purpose: str, words: int = 1) -> FloatArray:
        return np.full((self.rows, words), 0.5)

    def normals(self, purpose: str, count: int = 1) -> FloatArray:
        return np.zeros((self.rows, count))

    pair_uniforms = uniforms

    def take(self, rows: Any) -> "_NoDraws":
        return _NoDraws(len(np.arange(self.rows)[rows]))


def _directions(
    at_m: FloatArray, radius_m: FloatArray, most_fall: FloatArray, uniforms: FloatArray
) -> FloatArray:
    """Return directions (n, 3), uniform over the solid angle of cones about nadir; `most_fall` (n,)
    is 1 - cosine of the edge.

    1 - cosine is uniform over a cone; the sine follows without cancellation.
    """
    fall = most_fall * uniforms[:, 1]
    off = np.sqrt(fall * (2.0 - fall))
    turn = 2.0 * np.pi * uniforms[:, 2]
    x, y, z = (at_m[:, axis] / -radius_m for axis in range(3))
    # East of the sensor; over a pole, the first axis.
    level = np.sqrt(x * x + y * y)
    on_axis = level == 0.0
    per_level = 1.0 / (level + on_axis)
    east_x = on_axis - y * per_level
    east_y = x * per_level
    along_east = off * np.cos(turn)
    along_north = off * np.sin(turn)
    down = 1.0 - fall
    unit = np.empty_like(at_m)
    unit[:, 0] = x * down + east_x * along_east - z * east_y * along_north
    unit[:, 1] = y * down + east_y * along_east + z * east_x * along_north
    unit[:, 2] = z * down + (x * east_y - y * east_x) * along_north
    return unit


def _seen_from(
    ground_ecef_m: FloatArray, sensor_ecef_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the ranges (n,) of sensors from points on the ellipsoid, and the sines of their
    elevation there.
    """
    (x, y, z), direction = components(ground_ecef_m), components(sensor_ecef_m - ground_ecef_m)
    z = z * (EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M) ** 2
    range_m = length(*direction)
    return range_m, (x * direction[0] + y * direction[1] + z * direction[2]) / (
        range_m * length(x, y, z)
    )
