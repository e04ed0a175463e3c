"""A scene whose tracks are scored: one ICBM, seen by two SBIRS-GEO, followed by `imm`."""

SCENE = {
    "scene": "score",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 90.0,
    "seed": 7,
    "sensors": [
        {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -150.0},
        {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": -90.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
    "tracker": "imm",
}
