"""Narrow fields in a low orbit that wide ones cue, against the wide ones alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import opir_core as opir

SCENE: dict[str, Any] = {
    "scene": "cued",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 340.0,
    "sensors": [{"constellation": "SBIRS-GEO"}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 55.0, "lon_deg": 83.0, "time_s": 10.0},
            "aim": {"lat_deg": 20.0, "lon_deg": -157.0},
        }
    ],
    "detection": "snr",
    "atmosphere": "lowtran",
    "background": "earth",
    "tracker": "imm",
}
CUED = {"sensors": [*SCENE["sensors"], {"constellation": "LEO-NARROW"}], "director": "cue"}


def run(seed: int, **changes: Any) -> opir.Run:
    return opir.simulate(opir.scene_from_mapping({**SCENE, "seed": seed, **changes}))


def error_m(of: opir.Run, after_s: float) -> float:
    """Return the error of the nearest track's position at a time since burnout, inf without one."""
    tick_s = np.floor(of.plan.targets.burnout_s[:1] + after_s)
    rows = np.flatnonzero(of.tracks.tick_s == tick_s[0])
    (true_m,) = of.plan.targets.position_ecef_m(np.zeros(1, dtype=np.int32), tick_s)
    errors = np.linalg.norm(of.tracks.state[rows, :3] - true_m, axis=1)
    return float(np.nanmin(np.append(errors, np.inf)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32, 33])
def test_cued_fields_follow_better_and_beyond_burnout(seed: int) -> None:
    wide, cued = run(seed), run(seed, **CUED)
    assert 3.0 * error_m(cued, 0.0) <= error_m(wide, 0.0) < np.inf
    assert error_m(cued, 60.0) < 200.0
    assert not any(record.refusal for record in cued.commands)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [41, 42])
def test_a_coast_that_narrow_fields_see_is_no_burn(seed: int) -> None:
    cued = run(seed, **CUED)
    since_s = cued.tracks.tick_s - cued.plan.targets.burnout_s[0]
    burns = cued.tracks.probability_burning
    assert np.mean(burns[(since_s > -60.0) & (since_s < 0.0)]) > 0.95
    assert np.mean(burns[since_s > 15.0]) < 0.05


def test_nobody_is_seen_by_narrow_fields_without_a_director() -> None:
    unled = run(31, sensors=CUED["sensors"], detection="constant", duration_s=120.0)
    assert len(unled.detections)
    assert not np.count_nonzero(unled.detections.sensor >= 4)


def test_a_stare_adds_up_light_and_a_sector_is_looked_over_more_slowly() -> None:
    """Four times the light: twice the signal over its noise, at half the rate."""
    places = {"model": "round-robin", "places_deg": [[55.0, 83.0]]}
    scene = {**SCENE, "seed": 1, "duration_s": 90.0, "tracker": "none"}
    scene["sensors"] = [{"constellation": "LEO-NARROW", "modes": "notional"}]
    snr = {}
    period_s = {}
    for mode in ("spot", "stare", "sector"):
        of = run(**{**scene, "director": {**places, "mode": mode}})
        sensor = np.bincount(of.detections.sensor).argmax()
        rows = np.flatnonzero(of.detections.sensor == sensor)
        snr[mode] = np.median(of.detections.snr[rows])
        period_s[mode] = np.median(np.diff(of.detections.time_ns[rows])) * 1e-9
    assert period_s == pytest.approx({"spot": 0.2, "stare": 0.4, "sector": 2.4})
    assert snr["stare"] / snr["spot"] == pytest.approx(2.0, rel=0.2)
    assert snr["sector"] / snr["spot"] == pytest.approx(1.0, rel=0.2)


@pytest.mark.slow
def test_windows_change_no_byte_of_modes_with_false_alarms(tmp_path: Path) -> None:
    narrow = {
        "constellation": "LEO-NARROW",
        "modes": "notional",
        "threshold_sigma": 6.0,
        "confirmation_detections": 1,
        "reporting": {"downlink": {"mean_s": 3.0, "sigma_s": 1.0}},
    }
    scene = {
        **SCENE,
        "seed": 1,
        "duration_s": 70.0,
        "classification": "spectral",
        "sensors": [*SCENE["sensors"], narrow],
        "director": {"model": "cue", "mode": "stare", "search_mode": "sector"},
    }
    written = []
    for window_s in (None, 3.3):
        of = opir.simulate(opir.scene_from_mapping(scene), window_s=window_s)
        assert of.summary["counts"]["noise_detections"] > 5
        folder = tmp_path / str(window_s)
        folder.mkdir()
        of.save(folder / "e.jsonl")
        written.append([path.read_bytes() for path in sorted(folder.glob("*s.jsonl"))])
        written[-1].append((folder / "e.jsonl").read_bytes())
    assert written[0] == written[1]
