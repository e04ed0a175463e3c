"""Test doubles of the parts of a simulation, and windows of given detections for tests of encoders
and sinks.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import evolve, fields, frozen

from opir_core import DetectionTruth, Plan, Scene
from opir_core.arrays import ByteArray, FloatArray, IndexArray, IntArray
from opir_core.builtin import NoTracker
from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.orbits import GeostationaryOrbit
from opir_core.planning import PairCompiler, drawn_bias, join_targets, solar_exclusions
from opir_core.plugin import (
    LAUNCH_GROUPS,
    Band,
    Classifier,
    ClassifierInputs,
    Confidence,
    DetectionProbability,
    Detections,
    Exposures,
    Host,
    Hypothesis,
    ImpactRegion,
    Measured,
    NoConfig,
    RandomDraws,
    Sensor,
    Tracker,
    Tracks,
    Trajectories,
    Window,
)
from opir_core.random_streams import id_key, uuid8_words
from opir_core.scene import UNKNOWN_TYPE, Choice, core_hypotheses
from opir_core.sensors import AlignedScan

_NS_PER_S = 1_000_000_000
_GEOSTATIONARY_RADIUS_M = 42_164_172.0
_SIGMA_RAD = 2e-5
_EARTH_RADIUS_KM = 6371.0088


def stub_window(
    count: int, *, first_scan: int = 0, estimates: Tracks | None = None, **columns: Any
) -> Window:
    """Return a window of detections of sensor 0, one a second from `first_scan` on.

    `columns` replace columns of the detections; values are broadcast. Reports are at once unless
    given.
    """
    scan = np.arange(first_scan, first_scan + count)
    detections = _detections(scan)
    columns_given = {name: _like(name, value, count) for name, value in columns.items()}
    columns_given.setdefault("reported_ns", columns_given.get("time_ns", detections.time_ns))
    detections = evolve(detections, **columns_given)
    return Window(
        start_s=float(first_scan),
        end_s=float(first_scan + count),
        looks=2 * count,
        detections=detections.freeze(),
        truth=DetectionTruth(
            target=np.zeros(count, dtype=np.int32),
            emission_time_s=np.zeros(count),
            range_m=np.full(count, 3.6e7),
            target_elevation_sine=np.full(count, 0.9),
            probability=np.full(count, 0.5),
        ).freeze(),
        tracks=Tracks.empty(),
        estimates=Tracks.empty() if estimates is None else estimates,
    )


def stub_estimates(
    count: int, hypotheses: Sequence[Hypothesis] | None = None, **columns: Any
) -> Tracks:
    """Return estimates with tick (0, 1, … s), track (0) and nan; `columns` replace columns.

    `impact_regions` is a sequence of tuples, one per row. With `hypothesis_probability`, over
    `hypotheses` (by default `core_hypotheses()`), the probabilities of launches, missiles and
    orbits are its sums.
    """
    unknown = {
        name: np.full(
            (count, *column.shape[1:]),
            np.nan if column.dtype == np.float64 else 0,
            dtype=column.dtype,
        )
        for name, column in _columns(Tracks.empty()).items()
    }
    unknown["tick_s"] = np.arange(count, dtype=np.float64)
    regions = columns.pop("impact_regions", [()] * count)
    if "hypothesis_probability" in columns:
        width = np.shape(columns["hypothesis_probability"])[-1]
        unknown["hypothesis_probability"] = np.full((count, width), np.nan)
        columns = hypothesis_sums(columns["hypothesis_probability"], hypotheses) | columns
    columns_given = {
        name: np.array(np.broadcast_to(value, unknown[name].shape), dtype=unknown[name].dtype)
        for name, value in columns.items()
    }
    columns_given.setdefault("available_s", columns_given.get("tick_s", unknown["tick_s"]))
    for row, tuple_ in enumerate(regions):
        unknown["impact_regions"][row] = tuple_
    return Tracks(**(unknown | columns_given))


def stub_hypotheses(**chances: float) -> FloatArray:
    """Return the probabilities (H,) of `core_hypotheses()`, by names with `_` for spaces; the rest
    is none of these.
    """
    names = [hypothesis.name.replace(" ", "_") for hypothesis in core_hypotheses()]
    shares = np.zeros(len(names))
    for name, chance in chances.items():
        shares[names.index(name)] = chance
    shares[-1] += 1.0 - shares.sum()
    return shares


def hypothesis_sums(
    chances: Any, hypotheses: Sequence[Hypothesis] | None = None
) -> dict[str, FloatArray]:
    """Return the sums that `Tracks` has of probabilities (..., H) of hypotheses,
    `core_hypotheses()` by default.
    """
    groups = [hypothesis.group for hypothesis in hypotheses or core_hypotheses()]
    summed = {"launch": LAUNCH_GROUPS, "missile": ("missile",), "orbit": ("orbit",)}
    return {
        f"probability_{name}": np.asarray(chances)[..., [group in members for group in groups]].sum(
            axis=-1
        )
        for name, members in summed.items()
    }


def stub_regions(
    latitude_deg: float,
    longitude_deg: float,
    radius_km: float = 100.0,
    corners: int = 64,
    **figures: Any,
) -> tuple[ImpactRegion, ...]:
    """Return round regions for `TRACK_CONTAINMENTS` about a point: geodesic circles, the 95 % one
    of `radius_km`.

    `figures` are other attributes of the regions: condition, probability, effective samples.
    """
    radii = radius_km * np.sqrt(
        np.log1p(-np.array(TRACK_CONTAINMENTS)) / np.log1p(-TRACK_CONTAINMENTS[-1])
    )
    turn = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    latitude = np.radians(latitude_deg)
    longitude = np.radians(longitude_deg)
    regions = []
    for containment, radius in zip(TRACK_CONTAINMENTS, radii.tolist(), strict=True):
        angle = radius / _EARTH_RADIUS_KM
        sine = np.sin(latitude) * np.cos(angle) + np.cos(latitude) * np.sin(angle) * np.cos(turn)
        east = longitude + np.arctan2(
            np.sin(turn) * np.sin(angle) * np.cos(latitude), np.cos(angle) - np.sin(latitude) * sine
        )
        ring = np.stack([np.arcsin(sine), np.mod(east + np.pi, 2.0 * np.pi) - np.pi], axis=1)
        ring[-1] = ring[0]
        area_km2 = 2.0 * np.pi * _EARTH_RADIUS_KM**2 * float(1.0 - np.cos(angle))
        regions.append(
            ImpactRegion(containment=containment, area_km2=area_km2, polygons=((ring,),), **figures)
        )
    return tuple(regions)


def _detections(scan: Any) -> Detections:
    count = len(scan)
    none = np.full(count, -1, dtype=np.int64)
    keys = np.tile(np.array([id_key("stub")], dtype=np.uint64), (count, 1))
    down = _rows([-1.0, 0.0, 0.0], count)
    place = _rows([_GEOSTATIONARY_RADIUS_M, 0.0, 0.0], count)
    return Detections(
        time_ns=scan * _NS_PER_S,
        sensor=np.zeros(count, dtype=np.int32),
        scan=scan,
        detection_id=uuid8_words(keys, scan),
        reported_type=np.full(count, UNKNOWN_TYPE, dtype=np.uint8),
        bands=np.ones(count, dtype=np.uint8),
        detection_count=np.arange(1, count + 1, dtype=np.int32),
        confidence=np.full(count, 0.5),
        line_of_sight_ecef=down,
        sensor_ecef_m=place,
        snr=np.full(count, np.nan),
        track=none,
        estimate=none.copy(),
        line_of_sight_sigma_rad=np.full(count, _SIGMA_RAD),
        band_irradiance_w_m2=np.empty((count, 0)),
    )


def _rows(vector: list[float], count: int) -> FloatArray:
    return np.tile(np.array(vector), (count, 1))


def _like(name: str, value: Any, count: int) -> Any:
    empty = _columns(Detections.empty())[name]
    return np.array(np.broadcast_to(value, (count, *empty.shape[1:])), dtype=empty.dtype)


def _columns(record: Detections | Tracks) -> dict[str, Any]:
    return {attribute.name: getattr(record, attribute.name) for attribute in fields(type(record))}


_NS = 1_000_000_000


@frozen(eq=False)
class VerticalTargets(Trajectories):
    """Targets that climb vertically from positions (n,) at constant speed from ignition to
    burnout.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    speed_m_s: float = 1000.0

    @property
    def type_code(self) -> ByteArray:
        """Return ICBM for all."""
        return np.zeros(len(self.ignition_s), dtype=np.uint8)

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3); nan outside ignition to burnout."""
        burning = (time_s >= self.ignition_s[target]) & (time_s <= self.burnout_s[target])
        height_m = np.where(burning, self.speed_m_s * (time_s - self.ignition_s[target]), np.nan)
        latitude = np.radians(self.latitude_deg[target])
        longitude = np.radians(self.longitude_deg[target])
        return geodetic_to_ecef(latitude, longitude, height_m)

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return the burning times."""
        return [
            {"ignition_s": ignition, "burnout_s": burnout}
            for ignition, burnout in zip(
                self.ignition_s.tolist(), self.burnout_s.tolist(), strict=True
            )
        ]


@frozen
class CertainDetection(DetectionProbability):
    """A detection model of one probability, in the first band, without SNR; constant for a pair or
    look by look.
    """

    chance: float = 1.0
    is_constant: bool = True
    needs_geometry: bool = False
    uses_seed: bool = False

    def pair_probability(self, sensor: IndexArray, target: IndexArray) -> FloatArray | None:
        """Return the probability of each pair, or None: look by look."""
        return np.full(len(sensor), self.chance) if self.is_constant else None

    def probability(self, exposures: Exposures) -> FloatArray:
        """Return the probability of each look."""
        return np.full(len(exposures), self.chance)

    def measure(self, exposures: Exposures, rng: RandomDraws) -> Measured:
        """Return the first band, and no SNR."""
        return Measured(np.ones(len(exposures), dtype=np.uint8), np.full(len(exposures), np.nan))


@frozen
class UnknownClassifier(Classifier):
    """A classifier that reports UNKNOWN."""

    def reported_type(self, sightings: ClassifierInputs, rng: RandomDraws) -> ByteArray:
        """Return UNKNOWN for all."""
        return np.full(len(sightings), UNKNOWN_TYPE, dtype=np.uint8)


@frozen
class FullConfidence(Confidence):
    """A confidence model of 1."""

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return 1 for all."""
        return np.ones(len(sightings))


#: A tracker that never steps and never associates.
SilentTracker = NoTracker


class CountingTracker(Tracker):
    """A tracker with one track per sensor, whose state is the number of detections so far; records
    its ticks.
    """

    def __init__(self, cadence_s: float = 1.0) -> None:
        self.cadence_s: float | None = cadence_s
        self.counts: dict[int, int] = {}
        self.ticks: list[tuple[float, int]] = []

    def associate(self, detections: Detections) -> IntArray:
        """Return the track of the sensor if it existed at the last tick."""
        sensors = np.array(sorted(self.counts), dtype=np.int64)
        return np.where(np.isin(detections.sensor, sensors), detections.sensor, -1).astype(np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Count the detections; return one row per sensor with detections so far."""
        self.ticks.append((tick_s, len(detections)))
        for sensor in detections.sensor.tolist():
            self.counts[sensor] = self.counts.get(sensor, 0) + 1
        rows = sorted(self.counts.items())
        state = np.zeros((len(rows), 6))
        state[:, 0] = [detections for _, detections in rows]
        track = np.array([sensor for sensor, _ in rows], dtype=np.int64)
        return stub_estimates(
            len(rows), tick_s=tick_s, track=track, state=state, type_probability=0.25
        )


def stub_sensor(id: str = "S-1", slot_deg: float = 0.0, **changes: Any) -> Sensor:  # noqa: A002
    """Return a staring sensor in a geostationary slot with 10 looks a second; `changes` set
    fields.
    """
    settings: dict[str, Any] = {
        "id": id,
        "type": "STUB",
        "orbital_slot_deg": slot_deg,
        "bands": (Band("MWIR", 4.0, 5.0),),
        "orbit": GeostationaryOrbit(slot_deg),
        "scan": AlignedScan(100_000_000),
        "field_of_regard_half_angle_rad": 0.16,
        "minimum_elevation_rad": -np.pi / 2,
        "line_of_sight_sigma_rad": 2e-5,
        "detection_probability": {"ICBM": 0.8, "IRBM": 0.8, "SRBM": 0.8},
    }
    return Sensor(**(settings | changes))


def stub_scene(*, seed: int = 0, duration_s: float = 100.0, light_time: bool = True) -> Scene:
    """Return a scene without sensors, targets and models."""
    nothing = Choice("", "stub", NoConfig(), "")
    return Scene(
        name="stub",
        epoch_us=0,
        duration_s=duration_s,
        seed=seed,
        sensors=(),
        targets=(),
        detection=nothing,
        classification=nothing,
        confidence=nothing,
        tracker=nothing,
        atmosphere=nothing,
        background=nothing,
        light_time=light_time,
    )


def stub_plan(
    sensors: Sequence[Sensor], trajectories: Any, ids: Sequence[str], scene: Scene, **parts: Any
) -> Plan:
    """Return a plan of given sensors and targets; `parts` replace the stub models."""
    targets = join_targets(ids, [trajectories], [range(len(ids))])
    end_ns = round(scene.duration_s * _NS)
    starts = [0.0] * len(sensors)
    exclusions = solar_exclusions(sensors, scene.epoch_us, scene.duration_s)
    pairs, sightlines = PairCompiler(
        sensors, targets, starts, scene.light_time, end_ns, exclusions
    ).compiled()
    models: dict[str, Any] = {
        "detection": CertainDetection(),
        "classifier": UnknownClassifier(),
        "confidence": FullConfidence(),
        "make_tracker": SilentTracker,
    }
    return Plan(
        scene=scene,
        host=Host.of(),
        sensors=tuple(sensors),
        targets=targets,
        pairs=pairs,
        sightlines=sightlines,
        bias=drawn_bias(scene.seed, sensors),
        end_ns=end_ns,
        exclusions=exclusions,
        **(models | parts),
    )
