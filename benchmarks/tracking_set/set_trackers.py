"""Trackers of opir on the tracking set: a scene with the set's sensors, and the set's detections
instead of its own.

A tracker knows what `set.json` says: sensors, noise, bias, P_d and the density of clutter. Nothing
is tuned to it.
"""

import numpy as np
from opir_scoring.benchmark_tables import COVARIANCE, STATE

import opir_core as opir
from opir_core.interfaces import PartMaker
from opir_core.plugin import Detections, TrackerContext
from opir_core.simulation.tracker_clock import ScheduledTracker

LMB = "LMB filter"
#: Settings of each tracker, given a description of a scene; by the names that the page uses.
TRACKERS = {
    "imm": lambda scene: {"model": "imm", "forecast": "none"},
    "kepler-arc": lambda scene: {"model": "kepler-arc"},
    "Stone Soup EKF, GNN": lambda scene: stone_soup(scene, "gnn"),
    "Stone Soup EKF, JPDA": lambda scene: stone_soup(scene, "jpda"),
    LMB: lambda scene: "none",
}
HEADER = ("scene", "track", "time_s", *STATE, *COVARIANCE, "probability")
_NS = 1_000_000_000


def stone_soup(scene, association):
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


def solid_angle(half_angle_rad):
    """Return the solid angle, sr, of a cone."""
    return float(2.0 * np.pi * (1.0 - np.cos(half_angle_rad)))


def opir_scene(description, epoch, tracker):
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


def vectors(rows, name, axes):
    """Return the vectors (n, 3) of columns."""
    columns = [rows.column(f"{name}_{axis}") for axis in axes]
    return np.array(columns, dtype=np.float64).T


def detections_of(rows, description):
    """Return the set's detections of a scene as opir's."""
    count = len(rows)
    time_s = np.array(rows.column("time_s"))
    sensors = description["sensors"]
    numbers = {each["sensor"]: number for number, each in enumerate(sensors)}
    sensor = np.array([numbers[name] for name in rows.column("sensor")], dtype=np.int32)
    phase, period = (np.array([each[key] for each in sensors]) for key in ("phase_s", "period_s"))
    direction = vectors(rows, "direction", "xyz")
    unknown = np.full(count, -1, dtype=np.int64)
    return Detections(
        time_ns=np.round(time_s * _NS).astype(np.int64),
        sensor=sensor,
        scan=np.round((time_s - phase[sensor]) / period[sensor]).astype(np.int64),
        detection_id=np.stack([np.zeros(count), np.arange(count)], axis=1).astype(np.uint64),
        # The last type is UNKNOWN.
        reported_type=np.full(count, 3, dtype=np.uint8),
        bands=np.ones(count, dtype=np.uint8),
        detection_count=np.zeros(count, dtype=np.int32),
        confidence=np.full(count, np.nan),
        line_of_sight_ecef=direction / np.sqrt(np.sum(direction**2, axis=1, keepdims=True)),
        sensor_ecef_m=vectors(rows, "sensor", ("x_m", "y_m", "z_m")),
        snr=np.full(count, np.nan),
        track=unknown,
        estimate=unknown,
        line_of_sight_sigma_rad=1e-6 * np.array(rows.column("sigma_urad")),
        band_irradiance_w_m2=np.empty((count, 0)),
    )


def tracks_of(description, epoch, detections, name):
    """Return the tracks of a tracker on a scene, at every tick of its own."""
    plan = opir.compile_plan(opir_scene(description, epoch, TRACKERS[name](description)))
    context = context_of(plan, description)
    if name == LMB:
        from set_lmb import LmbTracker  # making the set needs no Stone Soup

        sensor = description["sensors"][0]
        density = sensor["clutter_per_look"] / solid_angle(sensor["clutter_half_angle_rad"])
        tracker = LmbTracker(context, sensor["detection_probability"], density)
    else:
        choice = plan.scene.tracker
        component = plan.host.component(choice.hook, choice.name, choice.path)
        tracker = component.build(choice.config, context)
    end_ns = round(description["end_s"] * _NS)
    return ScheduledTracker(tracker, end_ns).absorb(detections, 0, end_ns).tracks


def context_of(plan, description):
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
        parts={role: part_of(plan, choice) for role, choice in plan.scene.tracker.parts.items()},
    )


def part_of(plan, choice):
    """Return the maker of a part that the scene chose."""
    component = plan.host.component(choice.hook, choice.name, choice.path)
    return PartMaker(owner=choice.name, config=choice.config, build=component.build)


def rows_of(scene, tracks, tick_s):
    """Return the rows of tracks at the set's ticks, as `HEADER` names them; P(launch) is 1 where
    unknown.
    """
    ticks = tracks.tick_s / tick_s
    is_tick = np.abs(ticks - np.round(ticks)) < 1e-6
    rows = np.flatnonzero(is_tick & np.isfinite(tracks.state).all(axis=1))
    upper = np.triu_indices(6)
    launch = np.where(np.isnan(tracks.probability_launch), 1.0, tracks.probability_launch)
    return [
        [
            *(scene, str(int(tracks.track[row])), f"{tracks.tick_s[row]:g}"),
            *(f"{value:.3f}" for value in tracks.state[row].tolist()),
            *(f"{value:.8g}" for value in tracks.state_covariance[row][upper].tolist()),
            f"{launch[row]:.4f}",
        ]
        for row in rows.tolist()
    ]
