"""Quantiles of the χ² distribution, without SciPy's `stats`, which takes half a second to import."""

from typing import Any

import numpy as np
from scipy.special import gammaincinv

from opir_core.arrays import FloatArray


def chi_square_quantiles(probability: Any, freedom: Any) -> FloatArray:
    """Return the quantiles of χ² distributions of `freedom` degrees at probabilities, broadcast."""
    quantile: FloatArray = 2.0 * gammaincinv(0.5 * np.asarray(freedom), np.asarray(probability))
    return quantile
