"""Sensors whose noise or clock is not as stated, at several rates of looks: states against the
truth.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import evidence_of_run, ownership
from opir_scoring.errors import state_errors
from scipy.stats import chi2

import opir_core as opir
from opir_core.plugin import SensorHealth

pytestmark = pytest.mark.slow

SIGMA_URAD = 20.0
DURATION_S = 120
SETTLED_S = 30.0


class Case(NamedTuple):
    """Looks a second and true noise of the sensors, and the launches before them."""

    rate: float
    scale: float = 1.0
    sensors: int = 2
    launches: int = 1


class Outcome(NamedTuple):
    """Squared errors of settled states (n,), in variances, and of positions, m, and the health."""

    nees: np.ndarray
    position_m: np.ndarray
    health: SensorHealth

    @property
    def held(self) -> float:
        return float(np.mean(self.nees <= chi2.ppf(0.95, 6)))


def plan(seed: int, case: Case, sigma_urad: float, tracker: dict[str, Any]) -> opir.Plan:
    rng = np.random.default_rng([53, seed])
    targets = []
    for row in range(case.launches):
        lat, lon = float(rng.uniform(-35.0, 35.0)), float(rng.uniform(-150.0, -95.0))
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        aim = {
            "lat_deg": lat + 24.0 * float(np.cos(azimuth)),
            "lon_deg": lon + 24.0 * float(np.sin(azimuth)),
        }
        launch = {"lat_deg": lat, "lon_deg": lon, "time_s": float(rng.uniform(2.0, 8.0))}
        targets.append({"id": f"T{row}", "type": "IRBM", "launch": launch, "aim": aim})
    sensors = [
        {
            "model": "SBIRS-GEO",
            "id": f"S{row}",
            "orbital_slot_deg": slot_deg,
            "scan_period_ms": 1000.0 / case.rate,
            "line_of_sight_sigma_urad": sigma_urad,
        }
        for row, slot_deg in enumerate((-150.0, -95.0, -125.0)[: case.sensors])
    ]
    scene = {
        "scene": "consistency",
        "epoch": "2026-04-01T18:00:00Z",
        "duration_s": float(DURATION_S),
        "seed": seed,
        "sensors": sensors,
        "targets": targets,
        "tracker": {"forecast": "none", **tracker},
    }
    if tracker["model"] == "none":
        del scene["tracker"]["forecast"]
    return opir.compile_plan(opir.scene_from_mapping(scene))


@cache
def outcome(
    seed: int,
    case: Case,
    clock_s: float = 0.0,
    stated_s: float = 0.0,
    stated_urad: float = SIGMA_URAD,
) -> Outcome:
    """Return the outcome with the first sensor's clock off; `stated_s` is the σ of clocks that
    the tracker has."""
    run = opir.run_of_plan(plan(seed, case, case.scale * SIGMA_URAD, {"model": "none"}))
    settings = {"model": "imm", **({"clock_sigma_s": stated_s} if stated_s else {})}
    tracked = plan(seed, case, stated_urad, settings)
    off_ns = np.where(run.detections.sensor == 0, np.int64(clock_s * 1e9), np.int64(0))
    stated = np.full(len(run.detections), stated_urad * 1e-6)
    detections = evolve(
        run.detections, time_ns=run.detections.time_ns + off_ns, line_of_sight_sigma_rad=stated
    )
    order = np.argsort(detections.time_ns, kind="stable")
    detections = detections.take(order)
    tracker = tracked.make_tracker()
    label = np.full(len(detections), -1)
    estimates = []
    edges = np.searchsorted(detections.time_ns, np.arange(DURATION_S + 1) * 1_000_000_000)
    for tick in range(1, DURATION_S + 1):
        rows = slice(*edges[tick - 1 : tick + 1])
        label[rows] = tracker.associate(detections.take(rows))
        estimates.append(tracker.step(float(tick), detections.take(rows)))
    evidence = evidence_of_run(
        evolve(
            run,
            detections=evolve(detections, track=label),
            truth=run.truth.take(order),
            tracks=opir.Tracks.concatenate(estimates),
        ),
        tracked,
    )
    states = state_errors(evidence, ownership(evidence))
    burn_s = (tracked.targets.burnout_s - tracked.targets.ignition_s)[states.target]
    settled = np.flatnonzero((states.since_s >= SETTLED_S) & (states.since_s <= burn_s))
    health = tracker.sensor_health()
    assert health is not None
    return Outcome(states.nees[settled], states.position_m[settled], health)


def joined(outcomes: list[Outcome]) -> Outcome:
    nees = np.concatenate([outcome.nees for outcome in outcomes])
    position_m = np.concatenate([outcome.position_m for outcome in outcomes])
    return Outcome(nees, position_m, outcomes[-1].health)


def rms(outcome: Outcome) -> float:
    return float(np.sqrt(np.mean(np.square(outcome.position_m))))


@pytest.mark.parametrize("rate", [1.0, 2.0, 10.0])
@pytest.mark.parametrize("scale", [0.3, 2.0, 5.0])
def test_states_are_as_consistent_as_with_the_stated_noise(rate: float, scale: float) -> None:
    seeds = range(4)
    found = [outcome(seed, Case(rate, scale)) for seed in seeds]
    stated = joined([outcome(seed, Case(rate)) for seed in seeds])
    all_states = joined(found)
    assert all_states.held >= 0.9
    assert 0.7 * np.mean(stated.nees) < np.mean(all_states.nees) < 1.3 * 6.0
    for one in found:
        assert one.health.noise_scale == pytest.approx(scale, rel=0.2)
        assert "which is used" in one.health.text[0]


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_a_table_in_milliradians_is_followed_and_said(rate: float) -> None:
    wrong = outcome(0, Case(rate), stated_urad=1000.0 * SIGMA_URAD)
    right = outcome(0, Case(rate))
    assert wrong.held >= 0.9
    assert rms(wrong) < 1.3 * rms(right)
    assert "noise 0.001" in wrong.health.text[0]
    assert "which is used" in wrong.health.text[0]


@pytest.mark.parametrize("sensors", [2, 3])
@pytest.mark.parametrize("clock_s", [0.1, 1.0, 5.0])
def test_a_clock_whose_sigma_is_not_stated_is_found(sensors: int, clock_s: float) -> None:
    case = Case(1.0, 1.0, sensors, 3)
    seeds = range(3)
    unstated = joined([outcome(seed, case, clock_s) for seed in seeds])
    stated = joined([outcome(seed, case, clock_s, clock_s) for seed in seeds])
    assert unstated.held >= 0.9
    assert rms(unstated) <= 1.2 * rms(stated)
    if clock_s >= 1.0:
        clocks = unstated.health.clock_s
        assert clocks[0] - clocks[1] == pytest.approx(clock_s, abs=0.2)
        assert "clock +" in unstated.health.text[0]
        assert "no sign of a bias" in unstated.health.text[0]
