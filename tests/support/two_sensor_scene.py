"""A launch over the Pacific before two scanning satellites."""

from typing import Any


def two_sensor_scene(**changes: Any) -> dict[str, Any]:
    """Return the mapping of the scene, with other values of its keys and with further keys."""
    return {
        "scene": "two-sensors",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "seed": 3,
        "sensors": [
            {"model": "generic-scanner", "id": "WEST", "orbital_slot_deg": -150.0},
            {"model": "generic-scanner", "id": "EAST", "orbital_slot_deg": -90.0},
        ],
        "targets": [
            {
                "id": "T1",
                "type": "ICBM",
                "launch": {"lat_deg": 34.0, "lon_deg": -120.0, "time_s": 0.0},
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
            }
        ],
        **changes,
    }
