"""The whole tracker `imm` on many drawn flights at once: association, initiation, filter and
impacts.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve
from drawn_flights import SLOTS_RAD, Seeing, seen
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.tracker import imm_tracker

from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.records import Detections, Tracks
from opir_core.planning.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.scene.scene import TARGET_TYPES, UNKNOWN_TYPE

#: SBIRS-GEO: scan period, s, error, rad, and chance of detection by type.
PERIOD_S = 0.1
SIGMA_RAD = 20e-6
CHANCES = dict(zip(TARGET_TYPES, (0.80, 0.72, 0.60), strict=True))


class Tick(NamedTuple):
    """A tick: the tracks, and how many detections tracks and flights share."""

    time_s: float
    reported: Tracks
    shared: np.ndarray


def sensors_of(chances=CHANCES, bias_rad=0.0):
    """Return two SBIRS-GEO that say that they have these chances and biases."""
    blocks = [
        {"model": "SBIRS-GEO", "id": f"S{number}", "orbital_slot_deg": float(np.degrees(slot))}
        for number, slot in enumerate(SLOTS_RAD)
    ]
    scene = {
        "scene": "followed",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 1.0,
        "seed": 1,
        "sensors": blocks,
    }
    launch = {"lat_deg": 0.0, "lon_deg": 0.0, "time_s": 0.0}
    target = {"id": "T", "type": "SRBM", "launch": launch, "aim": {"lat_deg": 2.0, "lon_deg": 2.0}}
    plan = compile_plan(scene_from_mapping({**scene, "targets": [target]}))
    settings = {"detection_probability": chances, "line_of_sight_bias_sigma_rad": bias_rad}
    return tuple(evolve(sensor, **settings) for sensor in plan.sensors)


def detections_of(rays):
    """Return rays as detections that say nothing of the type."""
    count = len(rays)
    total = np.zeros(count, dtype=np.int64)
    return Detections(
        time_ns=np.round(rays.time_s * 1e9).astype(np.int64),
        sensor=rays.sensor,
        scan=rays.scan,
        detection_id=np.zeros((count, 2), dtype=np.uint64),
        reported_type=np.full(count, UNKNOWN_TYPE, dtype=np.uint8),
        bands=np.zeros(count, dtype=np.uint8),
        detection_count=np.zeros(count, dtype=np.int32),
        confidence=np.full(count, np.nan),
        line_of_sight_ecef=rays.direction_ecef,
        sensor_ecef_m=rays.origin_ecef_m,
        snr=np.full(count, np.nan),
        track=total - 1,
        estimate=total - 1,
        line_of_sight_sigma_rad=rays.sigma_rad,
        band_irradiance_w_m2=np.empty((count, 0)),
    )


def followed(truth, seeing, seed, until_s, sensors=None, forces="kepler", forecast="regions"):
    """Yield the ticks, one a second, of the tracker that sees flights; of one sensor only the first
    one's looks.
    """
    sensors = sensors or sensors_of()
    owner, rays = seen(truth, seeing, seed)
    rows = np.flatnonzero(rays.sensor < len(sensors))
    owner = owner[rows]
    rays = rays.take(rows)
    context = TrackerContext(sensors=sensors, epoch_us=0, duration_s=1e3, forces=forces)
    tracker = imm_tracker(ImmConfig(forecast=forecast), context)
    detections = detections_of(rays)
    shared = np.zeros((0, len(truth) + 1))
    cut = 0
    for tick in range(1, int(until_s) + 1):
        end = int(np.searchsorted(detections.time_ns, tick * 1_000_000_000))
        window = detections.take(slice(cut, end))
        label = tracker.associate(window)
        more = max(int(label.max(initial=-1)) + 1 - len(shared), 0)
        shared = np.concatenate([shared, np.zeros((more, len(truth) + 1))])
        np.add.at(shared, (label[label >= 0], owner[cut:end][label >= 0]), 1.0)
        reported = tracker.step(float(tick), evolve(window, track=label))
        cut = end
        yield Tick(float(tick), reported, shared)


def rows_of(tracks, shared):
    """Return the rows (flights,) of the tracks that share most detections with each flight, -1 for
    none.
    """
    rows = np.flatnonzero(tracks.track < len(shared))
    hits = shared[tracks.track[rows], :-1]
    if not len(rows):
        return np.full(shared.shape[1] - 1, -1)
    return np.where(hits.max(axis=0) > 0.0, rows[np.argmax(hits, axis=0)], -1)


def last_reported(truth, seeing, seed, after_s, forces="kepler"):
    """Return the reports on flights, one row each, a time after the last burn; each of them has a
    track.
    """
    *_, report = followed(truth, seeing, seed, truth.burnout_s.max() + after_s, forces=forces)
    rows = rows_of(report.reported, report.shared)
    assert (rows >= 0).all()
    return report.reported.take(rows)


def usual(kind):
    """Return how SBIRS-GEO see a type."""
    return Seeing(PERIOD_S, SIGMA_RAD, CHANCES[kind])
