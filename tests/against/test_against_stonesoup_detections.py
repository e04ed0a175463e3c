"""Detections that Stone Soup's measurement model makes are tracked as events of the same lines of
sight.
"""

import json
from datetime import datetime, timedelta

import numpy as np
from json_lines import json_lines
from opir_readers.detections.times import unix_ns
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
from stonesoup.types.array import StateVector
from stonesoup.types.state import State

from opir_core import compile_plan, scene_from_mapping
from opir_core.cli.main import main
from opir_core.geometry import azimuth_elevation_range

EPOCH = datetime(2026, 4, 1, 12)
SIGMA_RAD = 1e-5
SENSORS = [
    {"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -135.0},
    {"model": "SBIRS-GEO", "id": "EAST", "orbital_slot_deg": -100.0},
]
SCENE = {
    "scene": "stonesoup",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60,
    "tracker": "kepler-arc",
    "light_time": False,
    "sensors": SENSORS,
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10},
            "aim": {"lat_deg": 9, "lon_deg": 167.7},
        }
    ],
}


def detections():
    """Return time, sensor, its place, and elevation and bearing from Stone Soup, of each look, in
    order.
    """
    plan = compile_plan(scene_from_mapping(SCENE))
    events = []
    for number, sensor in enumerate(plan.sensors):
        origin = sensor.orbit.position_ecef_m(np.zeros(1))[0]
        noise = np.diag([SIGMA_RAD**2] * 2)
        model = CartesianToElevationBearing(
            3, (0, 1, 2), noise, translation_offset=StateVector(origin), seed=5 + number
        )
        for time_s in np.arange(15.0 + 0.25 * number, 55.0, 0.5).tolist():
            place = plan.targets.position_ecef_m(np.zeros(1, np.int32), np.array([time_s]))[0]
            elevation, bearing = model.function(State(StateVector(place)), noise=True)[:, 0]
            events.append(
                (
                    EPOCH + timedelta(seconds=time_s),
                    sensor.id,
                    origin,
                    float(elevation),
                    float(bearing),
                )
            )
    return sorted(events, key=lambda row: row[0])


def tracks_of(path, tmp_path):
    scene = tmp_path / "sensors.json.yaml"
    scene.write_text(json.dumps({key: value for key, value in SCENE.items() if key != "targets"}))
    out = tmp_path / "tracked.jsonl"
    assert main(["track", str(path), "--sensors", str(scene), "--out", str(out), "-q"]) == 0
    rows = json_lines(tmp_path / "tracked.tracks.jsonl")
    return np.array([[row["time_s"], row["track_id"], *row["position_ecef_m"]] for row in rows])


def test_detections_of_stonesoup_are_tracked_as_events(tmp_path):
    made = detections()
    lines = ["time_utc,sensor,los_x_ecef,los_y_ecef,los_z_ecef,sigma_urad"]
    events = []
    for when, sensor, origin, elevation, bearing in made:
        # The axes of Stone Soup's model are those of ECEF: bearing from x to y, elevation towards
        # z.
        level = np.cos(elevation)
        line = np.array([level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation)])
        lines.append(
            ",".join([when.isoformat(), sensor, *map(repr, line.tolist()), repr(SIGMA_RAD * 1e6)])
        )
        seen = azimuth_elevation_range(origin, origin + 1e7 * line)
        events.append(
            {
                "timestamp": f"{when.isoformat()}Z",
                "sensor_id": sensor,
                "azimuth_deg": float(np.degrees(seen.azimuth_rad)),
                "elevation_deg": float(np.degrees(seen.elevation_rad)),
                "line_of_sight_sigma_urad": SIGMA_RAD * 1e6,
            }
        )
    (tmp_path / "stonesoup.csv").write_text("\n".join([*lines, ""]))
    (tmp_path / "events.jsonl").write_text("\n".join(map(json.dumps, events)))
    own, reference = (
        tracks_of(tmp_path / name, tmp_path) for name in ("stonesoup.csv", "events.jsonl")
    )
    assert len(own) > 20
    np.testing.assert_array_equal(own[:, :2], reference[:, :2])
    # Angles at 36 000 km in degrees and back: rounding of 1e-15 of a line of sight.
    np.testing.assert_allclose(own[:, 2:], reference[:, 2:], rtol=0.0, atol=1e-2)
    # And they are of the flight, whose burn kepler-arc follows with a lag.
    plan = compile_plan(scene_from_mapping(SCENE))
    true = plan.targets.position_ecef_m(np.zeros(len(own), np.int32), own[:, 0])
    assert np.linalg.norm(own[:, 2:] - true, axis=1).max() < 10e3
    assert unix_ns(events[0]["timestamp"], "") == unix_ns(lines[1].split(",")[0], "")
