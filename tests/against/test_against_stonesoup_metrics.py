"""GOSPA equals that of Stone Soup (MIT licence) to rounding."""

import datetime

import numpy as np
import pytest
from opir_scoring.gospa_metric import gospa

CASES = [
    (seed, estimates, truths)
    for seed, (estimates, truths) in enumerate([(3, 3), (5, 2), (2, 6), (8, 8), (1, 0), (0, 4)])
]


def points(seed, count):
    return np.random.default_rng(seed).uniform(-3000.0, 3000.0, (count, 3))


def as_states(values):
    from stonesoup.types.state import State

    return [State(value[:, None], timestamp=datetime.datetime(2026, 4, 1)) for value in values]


@pytest.mark.parametrize(("seed", "estimates", "truths"), CASES)
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_gospa(seed, estimates, truths, order):
    from stonesoup.metricgenerator.ospametric import GOSPAMetric

    result = points(seed, estimates)
    true = points(seed + 100, truths)
    metric, _ = GOSPAMetric(c=2000.0, p=order).compute_gospa_metric(
        as_states(result), as_states(true)
    )
    reported = metric.value
    rows = gospa(result, true, cutoff=2000.0, order=order)
    assert rows.distance == pytest.approx(reported["distance"], rel=1e-12, abs=1e-9)
    assert rows.localisation == pytest.approx(reported["localisation"], rel=1e-12, abs=1e-6)
    assert rows.missed == pytest.approx(reported["missed"], rel=1e-12)
    assert rows.false == pytest.approx(reported["false"], rel=1e-12)
