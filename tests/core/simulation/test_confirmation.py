"""M-of-N confirmation of a run's detections: against a loop over every look, and whatever the
windows are.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import opir_core as opir
from opir_core.simulation.confirmation import Confirmation


def looped(pair: np.ndarray, scan: np.ndarray, needed: np.ndarray, scans: np.ndarray) -> np.ndarray:
    """Return which detections are confirmed, by counting those of the same pair in the scans up to
    each one.
    """
    neighbours = [
        (pair == pair[row]) & (scan <= scan[row]) & (scan > scan[row] - scans[pair[row]])
        for row in range(len(pair))
    ]
    return np.array(
        [mask.sum() >= needed[pair[row]] for row, mask in enumerate(neighbours)], dtype=np.bool_
    )


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), edge=st.integers(0, 40))
def test_it_counts_as_a_loop_does_in_one_window_and_in_two(seed: int, edge: int) -> None:
    rng = np.random.default_rng(seed)
    needed = rng.integers(1, 5, 6)
    scans = needed + rng.integers(0, 4, 6)
    hits = np.argwhere(rng.random((6, 40)) < rng.uniform(0.05, 0.9))
    pair, scan = hits.T
    expected = looped(pair, scan, needed, scans)
    assert np.array_equal(Confirmation(needed, scans).confirmed(pair, scan), expected)
    parted = Confirmation(needed, scans)
    early_event = scan < edge
    assert np.array_equal(
        parted.confirmed(pair[early_event], scan[early_event]), expected[early_event]
    )
    assert np.array_equal(
        parted.confirmed(pair[~early_event], scan[~early_event]), expected[~early_event]
    )


def scene(**sensor: object) -> opir.Scene:
    return opir.scene_from_mapping(
        {
            "scene": "confirmed",
            "epoch": "2026-04-01T19:00:00Z",
            "duration_s": 90,
            "seed": 3,
            "sensors": [
                {
                    "model": "DSP",
                    "preset": "paper",
                    "scan_phase": "random",
                    "id": "D",
                    "orbital_slot_deg": -95.0,
                    **sensor,
                }
            ],
            "targets": [
                {
                    "id": "T",
                    "type": "IRBM",
                    "launch": {"lat_deg": 35.0, "lon_deg": -110.0, "time_s": 0.0},
                    "aim": {"lat_deg": 50.0, "lon_deg": -85.0},
                }
            ],
            "detection": "snr",
            "outputs": [],
        }
    )


def of_target(run: opir.Run) -> np.ndarray:
    rows: np.ndarray = run.detections.scan[run.truth.target == 0]
    return rows


@pytest.mark.slow
@pytest.mark.parametrize(("needed", "scans"), [(2, 3), (3, 3), (3, 5)])
def test_a_run_reports_the_confirmed_of_all_detections(needed: int, scans: int) -> None:
    # Faint enough that looks miss often; by default an IRBM is below DSP's noise in long waves.
    faint = {"threshold_sigma": 7.0, "nei_w_m2": 3e-12}
    every_detection = of_target(
        opir.simulate(scene(confirmation_detections=1, confirmation_scans=1, **faint))
    )
    run = opir.simulate(scene(confirmation_detections=needed, confirmation_scans=scans, **faint))
    none = np.zeros(len(every_detection), dtype=np.int64)
    expected = every_detection[looped(none, every_detection, np.array([needed]), np.array([scans]))]
    assert 0 < len(expected) < len(every_detection)
    assert np.array_equal(of_target(run), expected)
    # Counts go on over detections that are not reported.
    assert np.array_equal(
        run.detections.detection_count[run.truth.target == 0] - 1,
        np.searchsorted(every_detection, expected),
    )
    parted = opir.simulate(
        scene(confirmation_detections=needed, confirmation_scans=scans, **faint), window_s=1.1
    )
    assert parted.detections.detection_id.tobytes() == run.detections.detection_id.tobytes()


def test_more_detections_than_scans_are_refused() -> None:
    with pytest.raises(opir.SceneError, match="4 detections do not fit into confirmation_scans: 3"):
        scene(confirmation_detections=4)
