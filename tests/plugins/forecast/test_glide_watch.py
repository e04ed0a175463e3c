"""What is still seen and slows down glides: the watch of mean forces along the flight."""

from typing import Any

import numpy as np
import pytest
from boost_law import NAMES, OUTCOMES
from opir_forecast import BoostEstimates
from opir_forecast.glide_watch import GlideWatch
from plain_boosts import MU, RADIUS_M, SPIN
from pyproj import Geod

import opir_core as opir

HGV = NAMES.index("HGV")


def seen(
    height_m: float, speed_m_s: float, silent_s: float = 0.1, sigma_m_s: float = 30.0
) -> BoostEstimates:
    """Return the estimate of one target that flies level over the equator, through the air."""
    place = np.array([RADIUS_M + height_m, 0.0, 0.0])
    velocity = np.array([0.0, speed_m_s, 0.0]) + np.cross(SPIN, place)
    mean = np.concatenate([place, velocity, np.zeros(4)])[None]
    sigma = np.repeat([100.0, sigma_m_s, 2.0, 0.01], [3, 3, 3, 1])
    times_s = np.array([1.0])
    return BoostEstimates.of_moments(
        np.zeros(1, dtype=np.int64),
        mean,
        np.diag(sigma**2)[None],
        times_s,
        np.array([silent_s]),
        times_s,
        len(NAMES),
    )


def watched(force_m_s2: float, height_m: float = 55e3, silent_s: Any = lambda _: 0.1) -> float:
    """Return P(glide) of a target after a minute and a half with a force along its flight."""
    watch = GlideWatch.begun(np.zeros(1, dtype=np.int64))
    for time_s in range(0, 95, 5):
        estimates = seen(height_m, 5000.0 + force_m_s2 * time_s, silent_s(time_s))
        watch = watch.updated(estimates, OUTCOMES, float(time_s))
    return float(watch.probability[0])


def test_what_slows_down_as_a_glider_does_glides():
    weight = MU / (RADIUS_M + 55e3) ** 2 - 5450.0**2 / (RADIUS_M + 55e3)
    assert watched(-weight / 2.6) > 0.95


def test_what_has_glided_for_long_is_sure_to_glide():
    """Known to 3 m/s for ten minutes: each window multiplies the odds by 1e20 and more."""
    watch = GlideWatch.begun(np.zeros(1, dtype=np.int64))
    for time_s in range(0, 600, 20):
        estimates = seen(55e3, 5000.0 - 2.3 * time_s, sigma_m_s=3.0)
        watch = watch.updated(estimates, OUTCOMES, float(time_s))
    assert watch.probability[0] == pytest.approx(1.0)


@pytest.mark.parametrize("force_m_s2", [5.0, 20.0])
def test_what_is_pushed_burns(force_m_s2):
    assert watched(force_m_s2) < 0.05


def test_what_coasts_above_the_air_does_not_glide():
    assert watched(0.0, height_m=150e3) == 0.0


def test_a_silence_begins_a_window_anew():
    # Seen every other look, each time after a silence: no window ever ends.
    assert watched(-2.0, silent_s=lambda time_s: 4.0 if time_s % 10 else 0.1) == 0.0


def test_errors_of_speed_that_hide_the_force_leave_the_prior():
    """Of one sensor: the ratio of likelihoods is near 1, so the odds stay near those of a burn's
    end.
    """
    watch = GlideWatch.begun(np.zeros(1, dtype=np.int64))
    for time_s in (0.0, 20.0):
        estimates = seen(55e3, 5000.0 - 2.0 * time_s)
        root = estimates.burn_root.copy()
        root[:, :, range(3, 6), range(3, 6)] = 1.0 / 3000.0
        blurred = BoostEstimates(
            **{
                name: root if name == "burn_root" else getattr(estimates, name)
                for name in BoostEstimates.__annotations__
            }
        )
        watch = watch.updated(blurred, OUTCOMES, time_s)
    prior = OUTCOMES.groups[2] / OUTCOMES.groups.sum() * 0.1 / 0.02
    assert watch.odds[0] == pytest.approx(prior, rel=0.1)


@pytest.mark.slow
def test_gliders_are_known_a_minute_and_two_after_their_burn():
    """Of 20 gliders seen by two sensors: launches, aims and seeds are drawn."""
    rng = np.random.default_rng(5150)
    geod = Geod(ellps="WGS84")
    known = np.zeros(2)
    for seed in range(20):
        lat, lon = rng.uniform([-35.0, 130.0], [35.0, 175.0])
        to_lon, to_lat, _ = geod.fwd(lon, lat, rng.uniform(0, 360), rng.uniform(3e6, 7e6))
        sensor = {"model": "SBIRS-GEO", "scan_period_ms": 1000}
        scene = {
            "scene": "glide",
            "epoch": "2026-03-01T12:00:00Z",
            "duration_s": 300,
            "seed": seed,
            "sensors": [
                sensor | {"id": name, "orbital_slot_deg": slot}
                for name, slot in (("EAST", 160.0), ("WEST", 120.0))
            ],
            "targets": [
                {
                    "id": "G",
                    "type": "HGV",
                    "launch": {"lat_deg": lat, "lon_deg": lon, "time_s": 10.0},
                    "aim": {"lat_deg": to_lat, "lon_deg": to_lon},
                }
            ],
            "detection": {"model": "snr"},
            "tracker": {"model": "imm"},
            "outputs": [],
        }
        plan = opir.compile_plan(opir.scene_from_mapping(scene))
        tracks = opir.Engine(plan).advance(plan.end_ns).tracks
        chance = tracks.hypothesis_probability[:, plan.hypothesis_names.index("HGV")]
        for number, after_s in enumerate((60.0, 120.0)):
            moment_s = plan.targets.burnout_s[0] + after_s
            row = np.argmin(np.abs(tracks.tick_s - moment_s))
            known[number] += chance[row] > 0.9
    assert known[0] >= 17
    assert known[1] >= 19
