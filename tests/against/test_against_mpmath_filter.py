"""The square-root filter against 50 digits (mpmath), where covariances are ruined: nothing is lost
that matters.

benchmarks/filter_stability.py runs a hundred of these and an hour at 20 Hz.
"""

from itertools import islice

import pytest
from ill_conditioned_filters import cases, samples

EVERY = list(cases(2))
CHOSEN = [*EVERY[10:], *(case._replace(slices=6) for case in islice(EVERY, 3, 8, 2))]


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case, marks=[pytest.mark.slow] * (row % 2), id=f"{case.name}, {case.size} states"
        )
        for row, case in enumerate(CHOSEN)
    ],
)
def test_no_digit_that_matters_is_lost(case):
    for sample in samples(case, every=5):
        assert sample.smallest > 0.0
        assert sample.asymmetry == 0.0
        assert sample.covariance_error < 1e-10, "relative, in every direction of the state"
        assert sample.drift < 1e-10, "squared, in standard deviations"
