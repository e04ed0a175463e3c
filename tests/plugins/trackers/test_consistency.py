"""Covariances of states and launch points are neither too small nor too large: NEES with two-sided
bounds.

Sixteen launches of three classes from the equator to 40 degrees, each in a direction of its own,
before two sensors without bias. Errors of six numbers each: the mean NEES / 6 of all is within 0.63
and 1.46 with 99.9 %, χ² of 96 degrees, if covariances are exact; filters with process noise for
manoeuvres that these flights do not make are below one. Four times the covariance is a quarter of
it.
"""

import numpy as np
import pytest
from opir_scoring.evidence import true_states_ecef
from symmetric_scenes import launch, simulated
from tracks_alike import east_north_time, mahalanobis

import opir_core as opir
from opir_core.arrays import FloatArray, IntArray
from opir_core.plugin import Tracks

#: Ranges of the classes, degrees of a great circle, about.
REACH_DEG = {"ICBM": 65.0, "IRBM": 20.0, "SRBM": 5.0}
TICKS_S = (20.0, 30.0)


def run_of(tracker: str, seed: int = 1) -> opir.Run:
    """Return a run of launches on a grid of 4 by 4."""
    rng = np.random.default_rng(seed)
    targets = []
    for number in range(16):
        latitude = -30.0 + 20.0 * (number // 4)
        longitude = -135.0 + 15.0 * (number % 4) + 3.3 * (number // 4)
        kind = list(REACH_DEG)[number % 3]
        north, east = REACH_DEG[kind] * np.array([np.cos(2.4 * number), np.sin(2.4 * number)])
        aim = (
            float(np.clip(latitude + north, -75.0, 75.0)),
            longitude + east / np.cos(np.radians(latitude)),
        )
        aim = aim[0], float((aim[1] + 180.0) % 360.0 - 180.0)
        targets.append(
            launch(f"T{number}", kind, (latitude, longitude, float(rng.uniform(2.0, 4.0))), aim)
        )
    scanner = {
        "model": "generic-scanner",
        "line_of_sight_bias_sigma_urad": 0.0,
        "scan_period_ms": 500,
    }
    slots_deg = {"WEST": -150.0, "EAST": -80.0}
    return simulated(
        {
            "scene": "consistency",
            "epoch": "2026-04-01T03:00:00Z",
            "duration_s": 30,
            "seed": seed,
            "detection": "constant",
            "sensors": [
                {**scanner, "id": name, "orbital_slot_deg": slot}
                for name, slot in slots_deg.items()
            ],
            "targets": targets,
            "tracker": tracker,
        }
    )


def at_ticks(run: opir.Run) -> tuple[Tracks, IntArray]:
    """Return the rows of some ticks, and the target of each, that most of its detections are of."""
    tracks = run.tracks.take(np.flatnonzero(np.isin(run.tracks.tick_s, TICKS_S)))
    labels = run.detections.track
    owner = {
        track: np.bincount(run.truth.target[labels == track]).argmax()
        for track in np.unique(tracks.track)
    }
    return tracks, np.array([owner[track] for track in tracks.track], dtype=np.int32)


def launch_nees(run: opir.Run) -> FloatArray:
    """Return the NEES / 3 of launch points and times."""
    tracks, target = at_ticks(run)
    known = np.isfinite(tracks.launch).all(axis=1)
    assert np.count_nonzero(known) > 10
    truth = run.plan.targets.truth()
    sites = [
        [*np.radians([row["launch"]["lat_deg"], row["launch"]["lon_deg"]]), row["ignition_s"]]
        for row in truth
    ]
    off = east_north_time(np.array(sites)[target[known]], tracks.launch[known])
    return mahalanobis(off, tracks.launch_covariance[known]) ** 2 / 3.0


@pytest.fixture(scope="module")
def run() -> opir.Run:
    return run_of("imm")


@pytest.mark.parametrize(
    "part", [slice(0, 6), slice(0, 3), slice(3, 6)], ids=["state", "position", "velocity"]
)
def test_states_are_as_far_off_as_they_say(run: opir.Run, part: slice) -> None:
    tracks, target = at_ticks(run)
    error = (tracks.state - true_states_ecef(run.plan, target, tracks.tick_s))[:, part]
    assert len(error) == 32
    square = mahalanobis(error, tracks.state_covariance[:, part, part]) ** 2 / error.shape[1]
    assert 0.5 < square.mean() < 1.46


def test_launches_are_as_far_off_as_they_say(run: opir.Run) -> None:
    """Their prior is of launches that may be seen up to 80 s late from sites on high land: none of
    these is either.
    """
    assert 0.12 < launch_nees(run).mean() < 0.5
