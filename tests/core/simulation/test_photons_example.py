"""The whole chain from sources to detections, on the example that has all of it."""

from typing import Any

import numpy as np
import pytest
import yaml
from repository import EXAMPLES
from scipy.stats import norm, poisson

import opir_core as opir
from opir_core import Run
from opir_core.scene import UNKNOWN_TYPE

EXAMPLE = EXAMPLES / "photons.yaml"
DSP, SBIRS, NEXTGEN = range(3)


@pytest.fixture(scope="module")
def ids() -> tuple[str, ...]:
    return opir.compile_plan(opir.load_scene(EXAMPLE)).targets.ids


@pytest.fixture(scope="module")
def run() -> Run:
    return opir.simulate(opir.load_scene(EXAMPLE))


def counts(run: Run, ids: tuple[str, ...], sensor: int) -> dict[str, int]:
    """Return how often a sensor detected each thing, by id; what is nothing goes by the name of
    noise.
    """
    detections = run.truth.target[run.detections.sensor == sensor]
    numbers, times = np.unique(detections, return_counts=True)
    names = [ids[number] if number >= 0 else "noise" for number in numbers.tolist()]
    return dict(zip(names, times.tolist(), strict=True))


@pytest.mark.slow
def test_plumes_are_detected_each_by_the_sensors_that_can(run: Run, ids: tuple[str, ...]) -> None:
    for sensor in (SBIRS, NEXTGEN):
        target_counts = counts(run, ids, sensor)
        assert min(target_counts["T1"], target_counts["T2"]) > 100
    # A look in ten seconds, in air that hides the lowest looks.
    target_counts = counts(run, ids, DSP)
    assert min(target_counts["T1"], target_counts["T2"]) >= 3


def test_hot_sources_stand_in_the_truth_as_themselves(run: Run, ids: tuple[str, ...]) -> None:
    example = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    # Single frames see what is steady; the example's frame differences remove most of it.
    single = {"temporal_filter": "none"}
    sensors = [{**sensor, "focal_plane": single} for sensor in example["sensors"]]
    changes = {"sensors": sensors, "targets": [], "duration_s": 2, "outputs": []}
    steady = opir.simulate(opir.scene_from_mapping({**example, **changes}))
    target_counts = counts(steady, ids[2:], NEXTGEN)
    for block in ("fires", "flares"):
        assert any(name.startswith(f"{block}-") for name in target_counts), block
    assert counts(run, ids, NEXTGEN)["meteor-1"] > 10
    # The meteor flashes for two seconds, and nothing is seen of it outside them.
    meteor = run.truth.target == ids.index("meteor-1")
    assert np.all(np.abs(run.truth.emission_time_s[meteor] - 61.0) <= 1.0)


def test_frame_differences_remove_most_of_what_is_steady(run: Run, ids: tuple[str, ...]) -> None:
    """What is left of a fire is the registration error's share of its light: a thousandth of its
    signal.
    """
    steady = [
        number for number, name in enumerate(ids) if name.startswith(("fires", "flares", "sea"))
    ]
    for sensor in (SBIRS, NEXTGEN):
        own_rows = run.detections.sensor == sensor
        remaining = run.detections.snr[own_rows & np.isin(run.truth.target, steady)]
        assert len(remaining) == 0 or np.median(remaining) < 30.0
        assert np.median(run.detections.snr[own_rows & (run.truth.target == 0)]) > 500.0


def test_reported_missiles_are_missiles(run: Run) -> None:
    reported = run.detections.reported_type != UNKNOWN_TYPE
    for sensor in (SBIRS, NEXTGEN):
        own_rows = reported & (run.detections.sensor == sensor)
        # 885 and 2735 of 2343 and 4695 events of launches: re-entries explain the dim ones as well.
        assert own_rows.sum() > 800
        # The sensors report a type from a probability of 1/2.
        assert np.isin(run.truth.target[own_rows], (0, 1)).mean() > 0.99
    assert not np.any(
        reported & ~np.isin(run.truth.target, (0, 1)) & (run.detections.sensor == DSP)
    )


@pytest.mark.slow
def test_noise_is_nobody_in_the_truth_and_comes_at_its_rate() -> None:
    example = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    example["sensors"][DSP] |= {"preset": "paper", "confirmation_detections": 1}
    run = opir.simulate(opir.scene_from_mapping({**example, "outputs": []}))
    noise = run.truth.target < 0
    cells = 4.0 * np.pi * np.sin(np.radians(5.0)) ** 2 / 56e-6**2
    low, high = poisson.interval(0.999, norm.sf(6.0) * cells * 900)
    assert low <= (noise & (run.detections.sensor == DSP)).sum() <= high
    assert np.all(np.isnan(run.truth.probability[noise]))


def mapping(**changes: Any) -> dict[str, Any]:
    return {
        "scene": "nobody",
        "epoch": "2026-04-01T20:00:00Z",
        "duration_s": 2,
        "sensors": [
            {
                "model": "DSP",
                "preset": "paper",
                "scan_phase": "random",
                "id": "D",
                "orbital_slot_deg": -135.0,
                "confirmation_detections": 1,
            }
        ],
        "targets": [],
        "detection": "snr",
        "outputs": [],
        **changes,
    }


@pytest.mark.parametrize("exact", [False, True])
def test_a_scene_without_targets_has_only_noise(exact: bool) -> None:
    run = opir.simulate(
        opir.scene_from_mapping(mapping(detection={"model": "snr", "exact": exact}))
    )
    assert len(run.detections) > 0
    assert np.all(run.truth.target == -1)


def test_sunlight_that_water_mirrors_comes_down_through_the_air() -> None:
    sea = {"id": "sea", "model": "glints", "at": [{"lat_deg": 3.9, "lon_deg": -127.5}]}
    skies = ("clear", {"model": "lowtran", "climate": "tropical"})
    plans = [
        opir.compile_plan(opir.scene_from_mapping(mapping(sources=[sea], atmosphere=sky)))
        for sky in skies
    ]
    above = np.array([[np.cos(np.radians(-131.0)), np.sin(np.radians(-131.0)), 0.0]])
    place = np.zeros(1, np.int32)
    time_s = np.ones(1)
    zero = np.zeros(1)
    clear, dim = (
        plan.sources[0].signatures.intensity_w_sr(
            0, place, time_s, zero, plan.sources[0].signatures.aspect_rad(place, time_s, above)
        )
        for plan in plans
    )
    assert 0.0 < dim[0] < 0.95 * clear[0]
