"""A scene for studies: one launch, one sensor, no tracker; a run takes milliseconds."""

SCENE = {
    "scene": "short",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 20.0,
    "seed": 100,
    "sensors": [{"model": "DSP", "id": "D", "orbital_slot_deg": -135.0}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 1.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}
PERIOD = "sensors[*].scan_period_ms"
