"""The test scene of conformance tests: a small scene of edge cases, run with the component under
test.

Three sensors, one of them moving, high over the pole; launches across the antimeridian, close to
the pole, in full view, and on the far side of the Earth, out of view of the geostationary sensors.
"""

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

import numpy as np
from attrs import frozen

from opir_core import DetectionTruth, Plan, compile_plan, plan_windows
from opir_core.arrays import IntArray
from opir_core.planning import Looks
from opir_core.plugin import (
    ClassifierInputs,
    Detections,
    Encoder,
    EncoderContext,
    Exposures,
    Host,
    RandomDraws,
)
from opir_core.random_streams import PairStreams, WindowNumbers
from opir_core.reading import scene_from_mapping

#: A scene file as plain values.
SceneFile = Mapping[str, Any]

_POLAR_ORBIT = {
    "circular": {
        "altitude_km": 30000.0,
        "inclination_deg": 90.0,
        "raan_deg": 0.0,
        "arg_latitude_deg": 85.0,
    }
}

SENSORS: tuple[Mapping[str, Any], ...] = (
    {"model": "generic-scanner", "id": "BENCH-1", "orbital_slot_deg": -100.0},
    {
        "model": "generic-scanner",
        "id": "BENCH-2",
        "orbital_slot_deg": 180.0,
        "scan_period_ms": 700.0,
    },
    {
        "model": "generic-scanner",
        "id": "BENCH-3",
        "orbit": _POLAR_ORBIT,
        "bands": {"MWIR": [4.2, 4.45]},
    },
)

NEIGHBOUR_SENSOR = {"model": "generic-scanner", "id": "NEIGHBOUR", "orbital_slot_deg": -140.0}


def launch(
    name: str, kind: str, start: tuple[float, float], aim: tuple[float, float], time_s: float
) -> dict[str, Any]:
    """Return the block of a target of the model `ballistic`; positions are (lat_deg, lon_deg)."""
    return {
        "id": name,
        "type": kind,
        "launch": {"lat_deg": start[0], "lon_deg": start[1], "time_s": time_s},
        "aim": {"lat_deg": aim[0], "lon_deg": aim[1]},
    }


#: In full view; across the antimeridian; close to the pole; hidden from all but the polar sensor.
TARGETS: tuple[Mapping[str, Any], ...] = (
    launch("IN-VIEW", "ICBM", (34.7, -120.6), (9.0, 167.7), 2.0),
    launch("ANTIMERIDIAN", "SRBM", (10.0, 179.9), (10.0, -176.0), 10.0),
    launch("POLE", "IRBM", (89.5, 40.0), (65.0, -150.0), 5.0),
    launch("FAR-SIDE", "IRBM", (30.0, 60.0), (10.0, 60.0), 0.0),
)

NEIGHBOUR_TARGET = launch("NEIGHBOUR", "ICBM", (35.5, -119.0), (5.0, 160.0), 4.0)


def bench_scene(**changes: Any) -> dict[str, Any]:
    """Return the test scene as plain values; `changes` replace its keys."""
    scene: dict[str, Any] = {
        "scene": "bench",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 90.0,
        "seed": 20260401,
        "sensors": list(SENSORS),
        "targets": list(TARGETS),
        "detection": "constant",
        "classification": "paper",
        "confidence": "weighted",
        "tracker": "none",
    }
    return {**scene, **changes}


def bench_host(plugins: Iterable[str]) -> Host:
    """Return a host of all installed plugins and of the given plugin modules."""
    host = Host.discover()
    for name in plugins:
        host.register(import_module(name))
    return host


@frozen(eq=False)
class BenchRun:
    """A run: its plan, all detections with their truth, and the events as lines."""

    plan: Plan
    detections: Detections
    truth: DetectionTruth
    lines: tuple[bytes, ...]

    def lines_of(self, sensors: Iterable[str], targets: Iterable[str]) -> tuple[bytes, ...]:
        """Return the events of some sensors: those of some targets, by ids, and false alarms."""
        sensor_ids = frozenset(sensors)
        target_ids = frozenset(targets)
        ids = self.plan.targets.ids
        rows = zip(
            self.detections.sensor.tolist(), self.truth.target.tolist(), self.lines, strict=True
        )
        return tuple(
            line
            for sensor, target, line in rows
            if self.plan.sensors[sensor].id in sensor_ids
            and (target < 0 or ids[target] in target_ids)
        )


def planned(scene: SceneFile, host: Host) -> Plan:
    """Return the plan of a scene of plain values."""
    return compile_plan(scene_from_mapping(dict(scene), host=host), host)


def bench_run(scene: SceneFile, host: Host, *, window_s: float | None = None) -> BenchRun:
    """Return the run of a scene; its events are those of the encoder `forge`."""
    return bench_run_of(planned(scene, host), window_s=window_s)


def bench_run_of(plan: Plan, *, window_s: float | None = None) -> BenchRun:
    """Return the run of a plan; its events are those of the encoder `forge`."""
    encoder = encoder_of(plan)
    windows = list(plan_windows(plan, window_s))
    return BenchRun(
        plan,
        Detections.concatenate(window.detections for window in windows),
        DetectionTruth.concatenate(window.truth for window in windows),
        tuple(line for window in windows for line in encoder.encode(window).splitlines()),
    )


def encoder_of(plan: Plan, name: str = "forge") -> Encoder:
    """Return an encoder for a plan's detections."""
    component = plan.host.component("opir_event_encoders", name)
    context = EncoderContext(
        sensors=plan.sensors,
        epoch_us=plan.scene.epoch_us,
        reported_types=plan.reported_types,
        hypotheses=plan.hypothesis_names,
    )
    return Encoder.adopt(component.build(component.config(), context))


@frozen(eq=False)
class LookTable:
    """All looks of a plan with a visible target: read-only exposures, and the random draws of each
    row.
    """

    exposures: Exposures
    numbers: WindowNumbers
    streams: PairStreams
    row: IntArray
    pair: IntArray

    @classmethod
    def of(cls, plan: Plan) -> "LookTable":
        """Return the looks of a plan."""
        streams = PairStreams(plan.scene.seed, plan.pair_names())
        geometry = plan.look_geometry()
        looks = Looks.between(plan.pairs, 0, plan.end_ns)
        row = np.flatnonzero(geometry.visible(looks.pair, looks.scan))
        pair = looks.pair[row]
        table = geometry.exposures(pair, looks.scan[row])
        numbers = WindowNumbers(streams, looks.active, looks.first_scan, looks.scans)
        return cls(table.freeze(), numbers, streams, row, pair)

    def draws(self, rows: Any) -> RandomDraws:
        """Return the random draws of some of the looks."""
        return self.numbers.of(self.row[rows], self.pair[rows])


def classifier_inputs(plan: Plan, looks: LookTable) -> ClassifierInputs:
    """Return classifier inputs in which each look detects, with all combinations of bands, counts
    and SNR.
    """
    exposed = looks.exposures
    rows = np.arange(len(looks.exposures))
    totals = np.array([len(sensor.bands) for sensor in plan.sensors], dtype=np.int64)[
        exposed.sensor
    ]
    counts = rows % totals + 1
    return ClassifierInputs(
        time_s=exposed.time_s,
        sensor=exposed.sensor,
        target=exposed.target,
        range_m=exposed.range_m,
        elevation_sine=exposed.elevation_sine,
        bands=((1 << counts) - 1).astype(np.uint8),
        band_count=counts,
        band_total=totals,
        detection_count=(1 + rows % 1000).astype(np.int32),
        snr=np.where(rows % 3 == 0, np.nan, 3.0 + rows % 40),
        band_irradiance_w_m2=np.where(
            np.arange(totals.max()) < totals[:, None], 1e-12 * (1.0 + rows[:, None] % 5), np.nan
        ),
        band_noise_w_m2=np.where(
            np.arange(totals.max()) < totals[:, None], 1e-13 * (1.0 + rows[:, None] % 7), 1.0
        ),
    ).freeze()
