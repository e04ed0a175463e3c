"""Quantiles that scores need, against another library's distribution function."""

import mpmath
import pytest
from opir_scoring import chi_square_quantiles


@pytest.mark.parametrize("freedom", [1.0, 2.0, 6.0, 40.5, 3000.0])
@pytest.mark.parametrize("probability", [1e-6, 0.025, 0.5, 0.975, 1.0 - 1e-9])
def test_a_chi_square_quantile_leaves_its_probability_below_it(probability, freedom):
    quantile = float(chi_square_quantiles(probability, freedom))
    below = mpmath.gammainc(0.5 * freedom, 0.0, 0.5 * quantile, regularized=True)
    assert float(below) == pytest.approx(probability, rel=1e-11)


def test_quantiles_are_broadcast():
    assert chi_square_quantiles([[0.1], [0.9]], [1.0, 2.0, 3.0]).shape == (2, 3)
