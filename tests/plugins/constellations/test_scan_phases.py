"""Phases of looks in runs: launches on whole seconds, seeds, places, and the mean latency of random
phases.
"""

import numpy as np
import pytest

import opir_core as opir
from opir_core import Engine, compile_plan

FLEETS = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")
P_D = 0.6


def scene(sensor, ignitions_s, seed=1):
    """Return a scene of one sensor over launches 40 km apart along a parallel and down a
    meridian.
    """
    targets = [
        {
            "id": f"T{number}",
            "type": "ICBM",
            "launch": {
                "lat_deg": 30.0 + 0.25 * (number % 5),
                "lon_deg": 106.0 + 0.4 * number,
                "time_s": ignition,
            },
            "aim": {"lat_deg": 45.0, "lon_deg": -120.0},
        }
        for number, ignition in enumerate(ignitions_s)
    ]
    head = {
        "scene": "phases",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 90.0,
        "seed": seed,
        "light_time": False,
    }
    each = {"id": "S", "orbital_slot_deg": 105.0, "detection_probability": {"ICBM": 1.0}, **sensor}
    return opir.scene_from_mapping(
        {**head, "detection": "constant", "sensors": [each], "targets": targets}
    )


def first_detections_s(scene):
    """Return by target the first detection, s; nan without one."""
    window = Engine(compile_plan(scene)).advance(round(scene.duration_s * 1e9))
    first = np.full(len(scene.targets), np.nan)
    for target in range(len(first)):
        times = window.detections.time_ns[window.truth.target == target]
        first[target] = times.min() * 1e-9 if len(times) else np.nan
    return first


@pytest.mark.parametrize("model", FLEETS)
def test_launches_on_whole_seconds_have_their_own_latencies(model):
    ignitions = np.arange(24.0)
    latency = first_detections_s(scene({"model": model}, ignitions.tolist())) - ignitions
    assert len(set(np.round(latency, 6).tolist())) >= 20


@pytest.mark.parametrize("model", FLEETS)
def test_launches_at_one_instant_have_looks_at_other_times(model):
    assert len(set(first_detections_s(scene({"model": model}, [5.0] * 24)).tolist())) == 24


def test_a_slow_scanner_has_another_first_look_in_each_run():
    heritage = {"model": "DSP", "preset": "heritage"}
    first = [float(first_detections_s(scene(heritage, [10.0], seed))[0]) for seed in range(25)]
    assert len(set(np.round(first, 2).tolist())) >= 20
    assert 10.0 < min(first) < max(first) < 20.0 + 10.0


def test_the_mean_latency_is_that_of_random_phases():
    period_s = 0.2
    ignitions = np.arange(10.0)
    sensor = {"model": "DSP", "detection_probability": {"ICBM": P_D}}
    runs = (first_detections_s(scene(sensor, ignitions.tolist(), seed)) for seed in range(60))
    latency = [np.mean(first - ignitions) for first in runs]
    # The start is drawn once a run, so runs are the independent samples.
    error = 3.5 * np.std(latency, ddof=1) / np.sqrt(len(latency))
    assert np.mean(latency) == pytest.approx(period_s * (1.0 / P_D - 0.5), abs=error)
    assert error < 0.04
