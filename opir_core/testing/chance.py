"""Intervals and distribution tests of contracts: 99.9 % two-sided, in closed form, so that SciPy is not needed."""

import math

import numpy as np

from opir_core.arrays import FloatArray

#: The standard normal's 99.95 % point: what lies beyond it, on either side, has probability 0.1 %.
Z_999 = 3.2905267314919255


def excess_of_count(seen: float, chances: FloatArray) -> float:
    """Return how far a count lies from what independent chances (n,) give, in units of its 99.9 % half width.

    The half width is that of the normal with the count's variance (Poisson binomial), with half a count for its being
    whole; at or below 1 is inside.
    """
    spread = math.sqrt(float(np.sum(chances * (1.0 - chances))))
    return max(abs(seen - float(np.sum(chances))) - 0.5, 0.0) / max(Z_999 * spread, 1e-9)


def excess_of_rate(seen: float, due: float) -> float:
    """Return how far a count lies from the Poisson distribution's mean, in units of its 99.9 % half width (normal)."""
    return max(abs(seen - due) - 0.5, 0.0) / max(Z_999 * math.sqrt(due), 1e-9)


def excess_of_distribution(values: FloatArray) -> float:
    """Return the Kolmogorov-Smirnov distance of values (n,) from uniform on [0, 1], in units of its 99.9 % point.

    Stephens' form of the point for finite n (J. R. Stat. Soc. B 32, 1970): D (sqrt n + 0.12 + 0.11 / sqrt n) <= 1.950.
    """
    count = len(values)
    if count == 0:
        return 0.0
    ordered = np.sort(values)
    steps = np.arange(count + 1) / count
    distance = float(max(np.max(steps[1:] - ordered), np.max(ordered - steps[:-1])))
    return distance * (math.sqrt(count) + 0.12 + 0.11 / math.sqrt(count)) / 1.950
