"""GOSPA: the axioms of a metric, and cases computed by hand."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_scoring import gospa

from examples import examples

counts = st.integers(0, 5)


def points(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-10.0, 10.0, (count, 2))


@examples(60)
@given(st.integers(0, 2**31), counts, counts, counts, st.sampled_from([0.5, 1.0, 2.0]))
def test_gospa_is_a_metric(seed: int, first: int, second: int, third: int, alpha: float) -> None:
    a = points(seed, first)
    b = points(seed + 1, second)
    c = points(seed + 2, third)

    def distance(x: np.ndarray, y: np.ndarray) -> float:
        return gospa(x, y, cutoff=7.0, alpha=alpha).distance

    assert distance(a, a) == 0.0
    assert distance(a, b) == pytest.approx(distance(b, a), rel=1e-12)
    assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9


def test_the_parts_of_gospa_by_hand() -> None:
    result = np.array([[0.0, 0.0], [100.0, 0.0]])
    true = np.array([[3.0, 4.0], [0.0, 100.0], [0.0, 200.0]])
    score = gospa(result, true, cutoff=10.0)
    assert (score.localisation, score.missed, score.false) == (25.0, 100.0, 50.0)
    assert (score.missed_count, score.false_count) == (2, 1)
    assert score.assigned.tolist() == [[0, 0]]
    assert score.distance == pytest.approx(np.sqrt(175.0))
    assert gospa(result, true, cutoff=10.0, alpha=1.0).distance == pytest.approx(
        np.sqrt(25.0 + 100.0 + 100.0)
    )


@pytest.mark.parametrize(
    "bad", [{"cutoff": 0.0}, {"cutoff": np.inf}, {"cutoff": 1.0, "order": 0.5}]
)
def test_bad_parameters_are_reported(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be"):
        gospa(points(0, 2), points(1, 2), **bad)
    with pytest.raises(ValueError, match="alpha"):
        gospa(points(0, 2), points(1, 2), cutoff=1.0, alpha=3.0)
