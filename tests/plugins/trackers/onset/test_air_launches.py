"""Launches from the air are recognised: they have a height and a speed where others stand."""

import numpy as np
import pytest

import opir_core as opir

IGNITION_S = 5.0


def first_known_s(air_share, count=16, seed=31):
    """Return when P(launch) of launches from the air first passes 0.95, s since ignition."""
    rng = np.random.default_rng(seed)
    targets = [
        {
            "id": f"A{row}",
            "model": "air-launch",
            "type": "SRBM",
            "heading_deg": float(rng.uniform(0.0, 360.0)),
            "speed_m_s": float(rng.uniform(200.0, 270.0)),
            "climb_deg": float(rng.uniform(30.0, 65.0)),
            "launch": {
                "lat_deg": float(rng.uniform(-20.0, 20.0)),
                "lon_deg": float(rng.uniform(25.0, 65.0)),
                "height_m": float(rng.uniform(9e3, 13e3)),
                "time_s": IGNITION_S,
            },
        }
        for row in range(count)
    ]
    scene = opir.scene_from_mapping(
        {
            "scene": "air-launches",
            "epoch": "2026-04-01T20:00:00Z",
            "duration_s": 26.0,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{slot:g}", "orbital_slot_deg": slot}
                for slot in (10.0, 80.0)
            ],
            "targets": targets,
            "detection": "snr",
            "tracker": {"model": "imm", "hypotheses": {"air_share": air_share}},
        }
    )
    run = opir.simulate(scene)
    owners = dict(zip(run.detections.track.tolist(), run.truth.target.tolist(), strict=True))
    times_s = np.full(count, np.inf)
    for row in np.flatnonzero(run.tracks.probability_launch > 0.95).tolist():
        target = owners[int(run.tracks.track[row])]
        times_s[target] = min(times_s[target], float(run.tracks.tick_s[row]) - IGNITION_S)
    return times_s


def test_launches_from_the_air_are_recognised_sooner_where_they_are_expected():
    unexpected = first_known_s(0.0)
    usual = first_known_s(0.01)
    expected = first_known_s(0.5)
    # By then none of them flies as an aircraft does.
    assert np.all(unexpected <= 20.0)
    assert np.mean(usual <= 15.0) >= 0.75
    assert np.all(expected <= 15.0)
    assert np.median(expected) < np.median(usual) <= np.median(unexpected)


@pytest.mark.parametrize("share", [-0.1, 1.1])
def test_a_share_that_is_none_is_refused(share):
    with pytest.raises(opir.SceneError, match="air_share"):
        first_known_s(share, count=1)
