"""A mode's sensitivity against closed forms: noise of photons and dark current alone falls with the
square root of the time for which light is collected.
"""

from typing import Any

import numpy as np
import pytest

import opir_core as opir

pytest.importorskip("opir_photons")

#: Nothing but shot noise of dark current: no reading, no clutter, no smear, no frame difference.
PLANE: dict[str, Any] = {
    "aperture_m": 0.6,
    "integration_time_ms": 5.0,
    "subframes": 8,
    "dark_current_e_s": 1e9,
    "optics_temperature_k": 0.0,
    "read_noise_e": 0.0,
    "bits": 40,
    "well_capacity_e": 1e12,
    "registration_urad": 0.0,
    "drift_urad_s": 0.0,
    "temporal_filter": "none",
}


def snr(mode: str) -> float:
    """Return the median signal over noise of a launch in a mode, half a minute into its flight."""
    modes = {
        "own": {},
        "long": {"integration_time_ms": 45.0, "subframes": 72, "half_angle_deg": 1.0},
    }
    scene = opir.scene_from_mapping(
        {
            "scene": "dwell",
            "epoch": "2026-04-01T00:00:00Z",
            "duration_s": 80.0,
            "seed": 23,
            "sensors": [
                {
                    "model": "SBIRS-GEO",
                    "id": "S",
                    "orbital_slot_deg": -100.0,
                    "focal_plane": PLANE,
                    "modes": modes,
                }
            ],
            "targets": [
                {
                    "id": "T1",
                    "type": "ICBM",
                    "launch": {"lat_deg": 34.0, "lon_deg": -120.0, "time_s": 0.0},
                    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
                }
            ],
            "detection": "snr",
            "director": {
                "model": "round-robin",
                "places_deg": [[34.0, -120.0]],
                "dwell_s": 600.0,
                "mode": mode,
            },
        }
    )
    run = opir.simulate(scene)
    rows = (run.detections.time_s > 40.0) & (run.detections.time_s < 70.0)
    assert np.count_nonzero(rows) > 250
    return float(np.median(run.detections.snr[rows]))


def test_nine_times_the_dwell_is_three_times_the_signal_over_noise() -> None:
    assert snr("long") / snr("own") == pytest.approx(np.sqrt(45.0 / 5.0), rel=0.01)
