"""What falls through the air at orbital speed is no launch, also after its lines begin anew."""

import numpy as np
import pytest

import opir_core as opir


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "settings"),
    [("grazers", {"shining_s": 60.0}), ("reentries", {"height_m": 85e3})],
    ids=["grazers", "reentries"],
)
def test_what_falls_at_orbital_speed_is_no_launch(model, settings):
    rng = np.random.default_rng(91)
    places = zip(rng.uniform(-20.0, 20.0, 12), rng.uniform(25.0, 65.0, 12), strict=True)
    at = [{"lat_deg": float(lat), "lon_deg": float(lon)} for lat, lon in places]
    run = opir.simulate(
        opir.scene_from_mapping(
            {
                "scene": "falls",
                "epoch": "2026-04-01T20:00:00Z",
                "duration_s": 65.0,
                "seed": 91,
                "sensors": [
                    {"model": "SBIRS-GEO", "id": f"S{slot:g}", "orbital_slot_deg": slot}
                    for slot in (10.0, 80.0)
                ],
                "targets": [],
                "sources": [{"id": "falls", "model": model, **settings, "at": at}],
                "detection": "snr",
                "background": "earth",
                "tracker": {"model": "imm", "cadence_s": 1.0},
            }
        )
    )
    assert len(np.unique(run.tracks.track)) >= 12
    assert np.count_nonzero(run.tracks.probability_launch > 0.5) == 0
