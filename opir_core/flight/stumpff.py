"""Universal functions of two-body motion: one set of series for ellipse, parabola and hyperbola.

With `alpha` the reciprocal of the semi-major axis and `s` the universal anomaly (ds = dt / r, mu = 1), the functions
are G_n = s^n c_n(alpha s²), where c_n are Stumpff's: G0 = cos x, G1 = sin x, G2 = 1 - cos x, G3 = x - sin x with
x = sqrt(alpha) s, each over the n-th power of sqrt(alpha), and their hyperbolic twins for negative alpha (Stiefel and
Scheifele, Linear and Regular Celestial Mechanics, 1971, §11; Danby, Fundamentals of Celestial Mechanics, 2nd ed. 1988,
§6.9).
"""

from math import factorial
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

#: Single or double precision: what goes in comes out.
Real = TypeVar("Real", bound=np.floating[Any])

Functions: TypeAlias = tuple[NDArray[Real], NDArray[Real], NDArray[Real], NDArray[Real]]

#: Largest |alpha s²| that three halvings of s bring within reach of the series: a turn of an ellipse, and beyond.
_HALVINGS, _REACH = 3, 60.0

#: Halvings where three do not do: up to |sqrt(alpha) s| = 120, and to 3 900, where doubles end before.
_MORE_HALVINGS = (7, 12)

#: Taylor coefficients of c2 and c3 in -alpha h². For |alpha h²| <= 60 / 64 the first term left out is below 5e-17 of
#: the sum in double precision, below 5e-7 in single, which only serves for guesses.
_DOUBLE = tuple(tuple(1.0 / factorial(2 * k + n) for k in range(terms)) for n, terms in ((2, 9), (3, 8)))
_SINGLE = tuple(tuple(1.0 / factorial(2 * k + n) for k in range(terms)) for n, terms in ((2, 5), (3, 4)))


def universal_functions(alpha: NDArray[Real], s: NDArray[Real]) -> Functions[Real]:
    """Return G0, G1, G2, G3 at universal anomaly `s` for conics of reciprocal semi-major axis `alpha`.

    One-dimensional arrays of one length and one precision, in units with mu = 1. The error is a few last places of each
    function's largest term; what overflows is inf or nan. Only + - * are used, so the bits are the same everywhere.
    """
    functions = _by_doubling(alpha, s, _HALVINGS)
    z = np.abs(alpha * s)
    z *= s
    (at,) = (z > _REACH).nonzero()
    for halvings in _MORE_HALVINGS:
        if not at.size:
            break
        for whole, part in zip(functions, _by_doubling(alpha[at], s[at], halvings), strict=True):
            whole[at] = part
        at = at[z[at] > _REACH * 4.0 ** (halvings - _HALVINGS)]
    return functions


def _by_doubling(alpha: NDArray[Real], s: NDArray[Real], halvings: int) -> Functions[Real]:
    """Return G0..G3 from their series at s / 2^halvings and the double-angle formulas."""
    h = s.copy()
    h *= 0.5**halvings
    g0, g1, g2, g3 = _by_series(alpha, h)
    for _ in range(halvings):
        g3 *= g0
        g3 += h * g2
        g3 += g3
        g2 = g1 * g1
        g2 += g2
        g1 *= g0
        g1 += g1
        g0 = alpha * g2
        np.subtract(1.0, g0, out=g0)
        h += h
    return g0, g1, g2, g3


def _by_series(alpha: NDArray[Real], h: NDArray[Real]) -> Functions[Real]:
    square = h * h
    minus_z = alpha * square
    np.negative(minus_z, out=minus_z)
    c2, c3 = _DOUBLE if h.dtype == np.float64 else _SINGLE
    g2 = _horner(c2, minus_z)
    g2 *= square
    g3 = _horner(c3, minus_z)
    g3 *= square
    g3 *= h
    g0 = alpha * g2
    np.subtract(1.0, g0, out=g0)
    return g0, h - alpha * g3, g2, g3


def _horner(coefficients: tuple[float, ...], x: NDArray[Real]) -> NDArray[Real]:
    total = x.copy()
    total *= coefficients[-1]
    for coefficient in coefficients[-2:0:-1]:
        total += coefficient
        total *= x
    total += coefficients[0]
    return total
