"""Scenes at random, far from any that trackers were made on: what is reported is sound, whatever it is worth."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import opir_core as opir
from examples import examples
from opir_core.interfaces.records import Tracks

SEEN = {"launch": "launch_covariance", "impact": "impact_covariance", "burnout": "burnout_covariance"}


@st.composite
def sensors(draw: st.DrawFn) -> list[dict[str, Any]]:
    found = []
    for number in range(draw(st.integers(1, 3))):
        slot = draw(st.floats(-170.0, -60.0))
        low = {"altitude_km": draw(st.floats(500.0, 3000.0)), "inclination_deg": 80.0, "lon_asc_node_deg": slot}
        is_low = draw(st.booleans()) and draw(st.booleans())
        chance = draw(st.sampled_from([0.3, 0.7, 1.0]))
        where: dict[str, Any] = {"orbital_slot_deg": slot}
        if is_low:
            where = {"orbit": {"circular": low | {"arg_latitude_deg": draw(st.floats(0.0, 60.0))}}}
        found.append(
            {
                "model": "generic-scanner",
                "id": f"S{number}",
                **where,
                "field_of_regard_half_angle_deg": 90.0,
                "scan_period_ms": draw(st.sampled_from([100, 500, 2000, 5000])),
                "line_of_sight_sigma_urad": draw(st.sampled_from([0.01, 1.0, 20.0, 300.0])),
                "line_of_sight_bias_sigma_urad": draw(st.sampled_from([0.0, 0.0, 30.0])),
                "detection_probability": dict.fromkeys(("ICBM", "IRBM", "SRBM"), chance),
                "follows_bodies": draw(st.booleans()),
            }
        )
    return found


@st.composite
def targets(draw: st.DrawFn) -> list[dict[str, Any]]:
    aims = {"ICBM": (-30.0, 80.0), "IRBM": (-12.0, -25.0), "SRBM": (1.0, 4.0)}
    found = []
    for number in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(sorted(aims)))
        lat, lon = draw(st.floats(20.0, 40.0)), draw(st.floats(-140.0, -100.0))
        aim = {"lat_deg": lat + aims[kind][0], "lon_deg": lon + aims[kind][1]}
        launch = {"lat_deg": lat, "lon_deg": lon, "time_s": draw(st.floats(0.0, 20.0))}
        found.append({"id": f"T{number}", "type": kind, "launch": launch, "aim": aim})
    return found


TRACKERS: list[Any] = [
    "kepler-arc",
    "imm",
    {"model": "imm", "cadence_s": 3.0},
    {"model": "imm", "needed_scans": 2, "late_s": 5.0},
]


def assert_sound(covariance: np.ndarray, where: str) -> None:
    """Fail where covariances (n, d, d) are neither positive definite, each scaled to a unit diagonal, nor all nan."""
    known = np.isfinite(covariance).all(axis=(1, 2))
    assert np.isnan(covariance[~known]).all(), where
    some = covariance[known]
    assert np.array_equal(some, some.transpose(0, 2, 1)), where
    variance = np.diagonal(some, axis1=1, axis2=2)
    assert (variance > 0.0).all(), where
    sigma = np.sqrt(variance)
    assert np.linalg.eigvalsh(some / sigma[:, :, None] / sigma[:, None]).min(initial=1.0) > -1e-9, where


def assert_all_sound(tracks: Tracks, is_arc: bool) -> None:
    # A track may have no Keplerian arc yet, and an arc through a thrusting target may be as fast as it likes.
    assert is_arc or np.isfinite(tracks.state).all()
    assert is_arc or np.linalg.norm(tracks.state[:, 3:], axis=1).max(initial=0.0) < 20e3
    assert_sound(tracks.state_covariance, "state")
    for name, spread in SEEN.items():
        value, covariance = getattr(tracks, name), getattr(tracks, spread)
        reported = np.isfinite(value).all(axis=1)
        assert np.isnan(value[~reported]).all(), name
        assert_sound(covariance[reported], name)
    assert (tracks.type_probability >= 0.0).all()
    assert np.allclose(tracks.type_probability.sum(axis=1), 1.0)
    for place in (tracks.launch, tracks.impact):
        assert not np.any(np.abs(place[:, 0]) > 0.5 * np.pi)
        assert not np.any(np.abs(place[:, 1]) > np.pi)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@settings(examples(24), derandomize=True)
@given(sensors=sensors(), targets=targets(), tracker=st.sampled_from(TRACKERS), seed=st.integers(0, 1000))
def test_what_is_reported_is_sound(
    sensors: list[dict[str, Any]], targets: list[dict[str, Any]], tracker: Any, seed: int
) -> None:
    scene = {
        "scene": "any",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 70,
        "seed": seed,
        "sensors": sensors,
        "targets": targets,
        "tracker": tracker,
    }
    assert_all_sound(opir.simulate(opir.scene_from_mapping(scene)).tracks, tracker == "kepler-arc")
