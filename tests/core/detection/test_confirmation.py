"""False alarms confirmed over scans: the closed form against cells and scans drawn one by one."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import binom

from opir_core.detection.confirmation import false_confirmation_probability, gate_radius_cells


def drawn_share(chance: float, needed: int, radius: np.ndarray, seed: int) -> tuple[int, int]:
    """Return how many false alarms are confirmed, of how many: points drawn in a plane, scan by scan."""
    rng, side, scans, margin = np.random.default_rng(seed), 300.0, 400, float(radius.max(initial=0.0))
    drawn = [rng.random((rng.poisson(chance * side * side), 2)) * side for _ in range(scans)]
    trees = [cKDTree(points) for points in drawn]
    confirmed = total = 0
    for scan in range(len(radius), scans):
        inner = drawn[scan][np.all((drawn[scan] > margin) & (drawn[scan] < side - margin), axis=1)]
        hits = np.zeros(len(inner), dtype=np.int64)
        for back, reach in enumerate(radius, start=1):
            hits += trees[scan - back].query_ball_point(inner, reach, return_length=True) > 0
        confirmed, total = confirmed + int(np.sum(hits >= needed - 1)), total + len(inner)
    return confirmed, total


@pytest.mark.parametrize(("needed", "scans"), [(1, 1), (2, 2), (2, 3), (3, 4), (4, 6)])
def test_false_alarms_are_confirmed_as_often_as_the_closed_form_says(needed: int, scans: int) -> None:
    radius = gate_radius_cells(np.arange(1, scans), 0.2, 5.6e-5, 3.6e7, 8000.0)
    chance = 2e-3
    confirmed, total = drawn_share(chance, needed, radius, seed=needed + 10 * scans)
    share = false_confirmation_probability(chance, needed, radius)
    # Neighbours share their gates: twice the binomial spread is allowed, at 99.9 %.
    least, most = binom.interval(0.999, total, share)
    assert least - (total * share - least) <= confirmed <= most + (most - total * share)


def test_gates_grow_by_the_way_of_the_fastest_source() -> None:
    # 8 km/s for 10 s are 80 km, 40 cells of 2 km.
    assert gate_radius_cells([0, 1, 2], 10.0, 2e3 / 3.6e7, 3.6e7, 8000.0) == pytest.approx([1.0, 41.0, 81.0])


def test_small_chances_are_not_lost() -> None:
    radius = np.array([2.0, 3.0])
    # Three detections in three scans: both gates must be hit.
    exact = (1e-12 * np.pi * 4.0) * (1e-12 * np.pi * 9.0)
    assert false_confirmation_probability(1e-12, 3, radius) == pytest.approx(exact, rel=1e-9)
