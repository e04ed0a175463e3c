"""Trackers of opir on the tracking set: a scene with the set's sensors, and the set's detections
instead of its own.

A tracker knows what `set.json` says: sensors, noise, bias, P_d and the density of clutter. Nothing
is tuned to it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import opir_core as opir
from opir_core.plugin import Detections, Tracker, TrackerContext, Tracks
from opir_core.simulation.tracker_clock import ScheduledTracker

LMB = "LMB filter"
#: Settings of each tracker, given a description of a scene; by the names that the page uses.
TRACKERS = {
    "imm": lambda scene: {"model": "imm", "regions_every_s": 600.0},
    "kepler-arc": lambda scene: {"model": "kepler-arc"},
    "Stone Soup EKF, GNN": lambda scene: stone_soup(scene, "gnn"),
    "Stone Soup EKF, JPDA": lambda scene: stone_soup(scene, "jpda"),
    LMB: lambda scene: "none",
}
COVARIANCE = tuple(f"c{row}{column}" for row in range(1, 7) for column in range(row, 7))
HEADER = (
    "scene",
    "track",
    "time_s",
    "x_m",
    "y_m",
    "z_m",
    "vx_m_s",
    "vy_m_s",
    "vz_m_s",
    *COVARIANCE,
    "probability",
)
_NS = 1_000_000_000


def stone_soup(scene: Mapping[str, Any], association: str) -> dict[str, Any]:
    """Return the settings of Stone Soup's tracker: P_d and the density of clutter as the set states
    them.
    """
    sensor = scene["sensors"][0]
    density = max(sensor["clutter_per_look"] / solid_angle(sensor["clutter_half_angle_rad"]), 1.0)
    return {
        "model": "stonesoup",
        "association": association,
        "detection_probability": sensor["detection_probability"],
        "false_alarms_per_sr": density,
    }


def solid_angle(half_angle_rad: float) -> float:
    """Return the solid angle, sr, of a cone."""
    return float(2.0 * np.pi * (1.0 - np.cos(half_angle_rad)))


def opir_scene(description: Mapping[str, Any], epoch: str, tracker: Any) -> opir.Scene:
    """Return a scene of opir with the set's sensors, and one launch, which the tracker never
    sees.
    """
    sensors = [
        {
            "model": "generic-scanner",
            "id": sensor["sensor"],
            "orbit": {
                "circular": {
                    "altitude_km": 1e-3 * sensor["altitude_m"],
                    "inclination_deg": sensor["inclination_deg"],
                    "lon_asc_node_deg": sensor["node_longitude_deg"],
                    "arg_latitude_deg": sensor["argument_of_latitude_deg"],
                }
            },
            "scan_period_ms": 1e3 * sensor["period_s"],
            "line_of_sight_sigma_urad": sensor["sigma_urad"],
            "line_of_sight_bias_sigma_urad": sensor["bias_sigma_urad"],
            "field_of_regard_half_angle_deg": 8.7 if sensor["altitude_m"] > 3e7 else 60.0,
            "detection_probability": dict.fromkeys(
                ("ICBM", "IRBM", "SRBM"), sensor["detection_probability"]
            ),
        }
        for sensor in description["sensors"]
    ]
    return opir.scene_from_mapping(
        {
            "scene": description["scene"],
            "epoch": epoch,
            "duration_s": description["end_s"],
            "seed": 1,
            "light_time": False,
            "detection": "constant",
            "classification": "none",
            "sensors": sensors,
            "targets": [
                {
                    "id": "unused",
                    "type": "SRBM",
                    "launch": {"lat_deg": 0.0, "lon_deg": 0.0, "time_s": 10.0},
                    "aim": {"lat_deg": 2.0, "lon_deg": 1.0},
                }
            ],
            "tracker": tracker,
        }
    )


def detections_of(rows: Sequence[Mapping[str, str]], description: Mapping[str, Any]) -> Detections:
    """Return the set's detections of a scene as opir's."""
    count = len(rows)
    time_s, sigma, *lines = (
        np.array([float(row[name]) for row in rows])
        for name in (
            *("time_s", "sigma_urad", "sensor_x_m", "sensor_y_m", "sensor_z_m"),
            *("direction_x", "direction_y", "direction_z"),
        )
    )
    names = [sensor["sensor"] for sensor in description["sensors"]]
    sensor = np.array([names.index(row["sensor"]) for row in rows], dtype=np.int32)
    phase, period = (
        np.array([each[key] for each in description["sensors"]]) for key in ("phase_s", "period_s")
    )
    direction = np.stack(lines[3:], axis=1)
    return Detections(
        time_ns=np.round(time_s * _NS).astype(np.int64),
        sensor=sensor,
        scan=np.round((time_s - phase[sensor]) / period[sensor]).astype(np.int64),
        detection_id=np.stack([np.zeros(count), np.arange(count)], axis=1).astype(np.uint64),
        # The last type is none that was recognised.
        reported_type=np.full(count, 3, dtype=np.uint8),
        bands=np.ones(count, dtype=np.uint8),
        detection_count=np.zeros(count, dtype=np.int32),
        confidence=np.full(count, np.nan),
        line_of_sight_ecef=direction / np.sqrt(np.sum(direction**2, axis=1, keepdims=True)),
        sensor_ecef_m=np.stack(lines[:3], axis=1),
        snr=np.full(count, np.nan),
        track=np.full(count, -1, dtype=np.int64),
        estimate=np.full(count, -1, dtype=np.int64),
        line_of_sight_sigma_rad=1e-6 * sigma,
        band_irradiance_w_m2=np.empty((count, 0)),
    )


def tracks_of(
    description: Mapping[str, Any], epoch: str, detections: Detections, name: str
) -> Tracks:
    """Return the tracks of a tracker on a scene, at every tick of its own."""
    plan = opir.compile_plan(opir_scene(description, epoch, TRACKERS[name](description)))
    if name == LMB:
        from set_lmb import LmbTracker  # making the set needs no Stone Soup

        sensor = description["sensors"][0]
        density = sensor["clutter_per_look"] / solid_angle(sensor["clutter_half_angle_rad"])
        tracker = LmbTracker(
            context_of(plan, description), sensor["detection_probability"], density
        )
        return stepped(tracker, description["end_s"], detections)
    choice = plan.scene.tracker
    tracker = plan.host.component(choice.hook, choice.name, choice.path).build(
        choice.config, context_of(plan, description)
    )
    return stepped(tracker, description["end_s"], detections)


def context_of(plan: opir.Plan, description: Mapping[str, Any]) -> TrackerContext:
    """Return the context of a tracker, with the clutter of a look at the whole field of regard."""
    clutter = tuple(
        each["clutter_per_look"]
        * solid_angle(sensor.field_of_regard_half_angle_rad)
        / solid_angle(each["clutter_half_angle_rad"])
        for each, sensor in zip(description["sensors"], plan.sensors, strict=True)
    )
    return TrackerContext(
        sensors=plan.sensors,
        epoch_us=plan.scene.epoch_us,
        duration_s=plan.scene.duration_s,
        light_time=False,
        hypotheses=plan.hypotheses,
        false_alarms_per_scan=clutter,
    )


def stepped(tracker: Tracker, end_s: float, detections: Detections) -> Tracks:
    """Return the estimates of a tracker that is stepped through detections."""
    end_ns = round(end_s * _NS)
    return ScheduledTracker(tracker, end_ns).absorb(detections, 0, end_ns).tracks


def rows_of(scene: str, tracks: Tracks, tick_s: float) -> list[list[str]]:
    """Return the rows of tracks at the set's ticks, as `HEADER` names them; P(launch) is 1 where
    unknown.
    """
    at = np.flatnonzero(np.abs(tracks.tick_s / tick_s - np.round(tracks.tick_s / tick_s)) < 1e-6)
    at = at[np.isfinite(tracks.state[at]).all(axis=1)]
    upper = np.triu_indices(6)
    chance = np.where(np.isnan(tracks.probability_launch), 1.0, tracks.probability_launch)
    return [
        [
            *(scene, str(int(tracks.track[row])), f"{tracks.tick_s[row]:g}"),
            *(f"{value:.3f}" for value in tracks.state[row].tolist()),
            *(f"{value:.8g}" for value in tracks.state_covariance[row][upper].tolist()),
            f"{chance[row]:.4f}",
        ]
        for row in at.tolist()
    ]
