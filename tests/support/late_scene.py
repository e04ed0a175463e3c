"""A short scene of sensors with reporting latency."""

import opir_core as opir

NS = 1_000_000_000

#: Latencies whose reports overtake each other.
UNEVEN = {
    "on_board": {"mean_s": 0.5},
    "downlink": {"mean_s": 3.0, "sigma_s": 2.0},
    "processing": {"mean_s": 2.0},
}
CONSTANT = {"processing": {"mean_s": 7.25}}


def late_scene(*reporting, targets=2, sensor=None, **changes):
    """Return a scene of one sensor for each `reporting`; `sensor` has settings of all of them."""
    mapping = {
        "scene": "late",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60,
        "seed": 5,
        "sensors": [
            {
                "model": "generic-scanner",
                "id": f"S{number}",
                "orbital_slot_deg": -135.0 + 20.0 * number,
                "reporting": latency,
                **(sensor or {}),
            }
            for number, latency in enumerate(reporting)
        ],
        "targets": [
            {
                "id": f"T{number}",
                "type": "ICBM",
                "launch": {
                    "lat_deg": 34.7,
                    "lon_deg": -120.6 + 3.0 * number,
                    "time_s": 3.1 + 4.0 * number,
                },
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
            }
            for number in range(targets)
        ],
        "outputs": [],
    }
    return opir.scene_from_mapping({**mapping, **changes})
