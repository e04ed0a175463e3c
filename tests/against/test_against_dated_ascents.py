"""When real launches began, by `imm` before scanners that report what they have confirmed.

Six ascents by their webcasts (shahar603/Telemetry-Data, public domain), two DSP as their public
descriptions say: a look in 10 s, reported once three of four looks detected it. Nothing of `imm`
was fitted to these flights.
"""

from pathlib import Path

import numpy as np
import pytest
from boost_law import ASCENTS
from opir_forecast.ascents import KINDS, LAW

import opir_core as opir

FLIGHTS = Path(__file__).parents[2] / "examples" / "ascents"
NAMES = ("crs12_stage1", "crs8", "echostar23", "fhdemo", "orbcomm2", "paz")
START_S = 40.0

#: Medians of twelve webcasts: height, m, and time since lift-off, s.
REACHED = ((7.6e3, 60.0), (24.9e3, 100.0), (58e3, 140.0))


def run_of(name: str, seed: int, cloud: dict[str, float] | None) -> opir.Run:
    """Return a run of an ascent before two scanners, until 140 s after its launch."""
    target = {"id": name, "model": "table", "type": "SLV", "start_s": START_S}
    sensor = {"model": "DSP", "preset": "heritage"}
    return opir.simulate(
        opir.scene_from_mapping(
            {
                "scene": "dated",
                "epoch": "2026-04-01T12:00:00Z",
                "duration_s": START_S + 140.0,
                "seed": seed,
                "sensors": [
                    {**sensor, "id": "WEST", "orbital_slot_deg": -125.0},
                    {**sensor, "id": "EAST", "orbital_slot_deg": -45.0},
                ],
                "targets": [{**target, "file": str(FLIGHTS / f"{name}.csv")}],
                "atmosphere": {"model": "lowtran", **({"cloud": cloud} if cloud else {})},
                "background": "earth",
                "detection": "snr",
                "tracker": "imm",
            }
        )
    )


def late_and_sigma_s(run: opir.Run) -> tuple[float, float]:
    """Return how much too late the launch is dated, and the standard deviation, s."""
    numbers = run.detections.track[run.truth.target == 0]
    number = np.bincount(numbers[numbers >= 0]).argmax()
    estimates = run.tracks.take(np.flatnonzero(run.tracks.track == number))
    last = np.flatnonzero(np.isfinite(estimates.launch[:, 2]))[-1]
    variance = estimates.launch_covariance[last, 2, 2]
    return float(estimates.launch[last, 2]) - START_S, float(np.sqrt(variance))


@pytest.mark.slow
@pytest.mark.parametrize(("top_km", "late_s"), [(None, 6.0), (7.0, 16.0), (10.0, 20.0)])
def test_real_launches_are_dated_before_scanners_that_confirm(
    top_km: float | None, late_s: float
) -> None:
    """Out of cloud they are late: a missile would be as high and as fast some 30 s sooner."""
    cloud = None if top_km is None else {"top_km": top_km}
    runs = [run_of(name, seed, cloud) for name in NAMES for seed in (61, 62)]
    late, sigma = np.array([late_and_sigma_s(run) for run in runs]).T
    assert np.mean(np.abs(late) < 1.96 * sigma) >= 0.9
    assert abs(np.median(late)) <= late_s


@pytest.mark.parametrize(("height_m", "since_s"), REACHED)
def test_launchers_of_the_law_climb_as_real_ones(height_m: float, since_s: float) -> None:
    """The median webcast is among the middle half of the law's launchers."""
    edges = np.cumsum([0, *LAW.numbers])
    orbit = slice(*edges[list(KINDS).index("orbit") :][:2].tolist())
    reached_s = ASCENTS.reaching(np.full(len(ASCENTS.log_weight), height_m))[orbit]
    low, high = np.percentile(reached_s[reached_s < 400.0], [25.0, 75.0])
    assert low < since_s < high
