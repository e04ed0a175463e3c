"""Universal functions of two-body motion: one set of series for ellipse, parabola and hyperbola.

With `alpha` the reciprocal of the semi-major axis and `s` the universal anomaly (ds = dt / r, mu = 1), the functions are
G_n = s^n c_n(alpha s²), where c_n are Stumpff's: G0 = cos, G1 = sin, G2 = 1 - cos, G3 = x - sin, each divided by the
matching power of sqrt(alpha), and their hyperbolic twins for negative alpha (Stiefel and Scheifele, Linear and Regular
Celestial Mechanics, 1971, §11; Danby, Fundamentals of Celestial Mechanics, 2nd ed. 1988, §6.9).
"""

from math import factorial

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Largest |alpha s²| that two halvings of s bring within reach of the series below.
_REACH = 27.0

#: Taylor coefficients in -alpha h²; the first term left out is below 1e-17 of the sum for |alpha h²| <= 27 / 16.
_C2 = tuple(1.0 / factorial(2 * k + 2) for k in range(10))
_C3 = tuple(1.0 / factorial(2 * k + 3) for k in range(9))


def universal_functions(alpha: Floats, s: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return G0, G1, G2, G3 at universal anomaly `s` for conics of reciprocal semi-major axis `alpha`.

    Arrays of one shape; units such that mu = 1. Relative error of each is a few 1e-16 of its largest term. Overflow gives
    inf or nan, never a wrong number. Only + - * are used, so the result is the same on every machine.
    """
    far = np.abs(alpha * s * s) > _REACH
    if not far.any():
        return _by_doubling(alpha, s, 2)
    functions = _by_doubling(alpha, np.where(far, 0.0, s), 2)
    for whole, part in zip(functions, _far(alpha[far], s[far]), strict=True):
        whole[far] = part
    return functions


def _far(alpha: Floats, s: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return G0..G3 where two halvings do not suffice: seven reach |alpha s²| = 27 · 1024, twelve the end of the doubles."""
    further = np.abs(alpha * s * s) > _REACH * 1024.0
    functions = _by_doubling(alpha, s, 7)
    if further.any():
        for whole, part in zip(functions, _by_doubling(alpha[further], s[further], 12), strict=True):
            whole[further] = part
    return functions


def _by_doubling(alpha: Floats, s: Floats, halvings: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Return G0..G3 from their series at s / 2^halvings and the double-angle formulas."""
    h = s * 0.5**halvings
    g0, g1, g2, g3 = _by_series(alpha, h)
    for _ in range(halvings):
        g3 = h * g2 + g0 * g3
        g3 += g3
        g2 = g1 * g1
        g2 += g2
        g1 = g1 * g0
        g1 += g1
        g0 = 1.0 - alpha * g2
        h = h + h
    return g0, g1, g2, g3


def _by_series(alpha: Floats, h: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    square = h * h
    minus_z = -alpha * square
    g2 = square * _horner(_C2, minus_z)
    g3 = square * _horner(_C3, minus_z)
    g3 *= h
    return 1.0 - alpha * g2, h - alpha * g3, g2, g3


def _horner(coefficients: tuple[float, ...], x: Floats) -> Floats:
    total = x * coefficients[-1]
    for coefficient in coefficients[-2:0:-1]:
        total += coefficient
        total *= x
    total += coefficients[0]
    return total
