"""The universal anomaly at a given time: Kepler's equation solved for arrays of any conics at once.

With alpha the reciprocal of the semi-major axis and s the universal anomaly (ds = dt / r, mu = 1),
the universal functions are G_n = s^n c_n(alpha s²) with Stumpff's c_n: G0 = cos x, G1 = sin x, G2 =
1 - cos x, G3 = x - sin x with x = sqrt(alpha) s, each over the n-th power of sqrt(alpha), and
hyperbolic for negative alpha (Stiefel and Scheifele, Linear and Regular Celestial Mechanics, 1971,
§11; Danby, Fundamentals of Celestial Mechanics, 2nd ed. 1988, §6.9).

An arc is given by its distance rho, sigma = r·v and alpha at the start. Kepler's equation is t =
rho G1 + sigma G2 + G3. Its derivatives in s are the distance r = rho G0 + sigma G1 + G2 >= 0, r' =
sigma G0 + (1 - alpha rho) G1 and r'' = 1 - alpha r: time rises monotonically with s.

A guess to about six digits in single precision (half the bytes, twice the speed) is corrected once
in double (`solve_fast`); `solve_bracketed` solves the others inside a bracket. An element has the
same bits in any company.
"""

from math import factorial
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.geometry.vectors import FloatPair


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return scalar products (n,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return vector products (3, n)."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def length(a: FloatArray) -> FloatArray:
    """Return Euclidean lengths (n,)."""
    return np.sqrt(dot(a, a))


#: Single or double precision; results have that of the arguments.
Real = TypeVar("Real", bound=np.floating[Any])

Functions: TypeAlias = tuple[NDArray[Real], NDArray[Real], NDArray[Real], NDArray[Real]]

#: The largest |alpha s²| for which three halvings of s suffice for the series: over a turn of an
#: ellipse.
_HALVINGS = 3
_REACH = 60.0


#: Taylor coefficients of c2 and c3 in -alpha h². For |alpha h²| <= 60 / 64 the first term left out
#: is below 5e-17 of the sum in double precision, below 5e-7 in single, which only serves for
#: guesses.
_DOUBLE = tuple(
    tuple(1.0 / factorial(2 * k + n) for k in range(terms)) for n, terms in ((2, 9), (3, 8))
)
_SINGLE = tuple(
    tuple(1.0 / factorial(2 * k + n) for k in range(terms)) for n, terms in ((2, 5), (3, 4))
)


def universal_functions(alpha: NDArray[Real], s: NDArray[Real]) -> Functions[Real]:
    """Return G0, G1, G2, G3 at universal anomaly `s` for conics of reciprocal semi-major axis
    `alpha`.

    One-dimensional arrays of one length and precision, in units with mu = 1. The error is a few
    units in the last place of each function's largest term; overflow is inf or nan. Only + - * are
    used: the same bits on every platform.
    """
    functions = _by_doubling(alpha, s, _HALVINGS)
    z = np.abs(alpha * s)
    z *= s
    (at,) = (z > _REACH).nonzero()
    # Halvings beyond: up to |sqrt(alpha) s| = 120, and to 3 900, beyond the range of doubles.
    for halvings in (7, 12):
        if not at.size:
            break
        for function, values in zip(
            functions, _by_doubling(alpha[at], s[at], halvings), strict=True
        ):
            function[at] = values
        at = at[z[at] > _REACH * 4.0 ** (halvings - _HALVINGS)]
    return functions


def _by_doubling(alpha: NDArray[Real], s: NDArray[Real], halvings: int) -> Functions[Real]:
    """Return G0..G3 from their series at s / 2^halvings and the double-angle formulas."""
    h = s.copy()
    h *= 0.5**halvings
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
    g1 = h - alpha * g3
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


def _horner(coefficients: tuple[float, ...], x: NDArray[Real]) -> NDArray[Real]:
    total = x.copy()
    total *= coefficients[-1]
    for coefficient in coefficients[-2:0:-1]:
        total += coefficient
        total *= x
    total += coefficients[0]
    return total


_EPSILON = float(np.finfo(float).eps)


class UniversalArcs(NamedTuple, Generic[Real]):
    """Starts of arcs, and times >= 0 of propagation; one-dimensional arrays in units with mu = 1.

    On closed orbits the time is at most a period.
    """

    rho: NDArray[Real]
    sigma: NDArray[Real]
    alpha: NDArray[Real]
    time: NDArray[Real]

    def at(self, index: RowArray) -> "UniversalArcs[Real]":
        """Return the arcs at these indices."""
        return UniversalArcs(
            self.rho[index], self.sigma[index], self.alpha[index], self.time[index]
        )


def derivatives(
    arcs: UniversalArcs[Real], functions: Functions[Real]
) -> tuple[NDArray[Real], NDArray[Real], NDArray[Real]]:
    """Return the time at the anomaly less the time of the arc, and its first two derivatives, r and
    r'.
    """
    g0, g1, g2, g3 = functions
    rho, sigma, alpha, time = arcs
    excess = rho * g1
    excess += sigma * g2
    excess += g3
    excess -= time
    r = rho * g0
    r += sigma * g1
    r += g2
    slope = alpha * rho
    np.subtract(1.0, slope, out=slope)
    slope *= g1
    slope += sigma * g0
    return excess, r, slope


def laguerre_step(arcs: UniversalArcs[Real], functions: Functions[Real]) -> NDArray[Real]:
    """Return Laguerre's step towards the anomaly, for degree 5 (Conway, Celestial Mechanics 39,
    1986, 199-211).
    """
    step, r, slope = derivatives(arcs, functions)
    step /= r
    slope /= r
    slope *= step
    slope *= 20.0
    np.subtract(16.0, slope, out=slope)
    np.abs(slope, out=slope)
    np.sqrt(slope, out=slope)
    slope += 1.0
    step *= -5.0
    step /= slope
    return step


def excess_and_noise(
    arcs: UniversalArcs[np.float64], functions: Functions[np.float64]
) -> FloatPair:
    """Return the time at the anomaly less the time of the arc, and the rounding error of the
    difference.
    """
    _, g1, g2, g3 = functions
    excess = arcs.rho * g1 + arcs.sigma * g2 + g3 - arcs.time
    return excess, 2.0 * _EPSILON * (
        arcs.rho * np.abs(g1) + np.abs(arcs.sigma) * g2 + g3 + arcs.time
    )


Singles = NDArray[np.float32]


def coarse_anomaly(arcs: UniversalArcs[np.float64]) -> FloatArray:
    """Return the anomaly at the end of each arc, by Laguerre's steps from a first guess; 0 where
    that overflows.
    """
    single = UniversalArcs(*(column.astype(np.float32) for column in arcs))
    s = _first_guess(single)
    for _ in range(3):
        s += laguerre_step(single, universal_functions(single.alpha, s))
        np.abs(s, out=s)
    s[~np.isfinite(s)] = 0.0
    return s.astype(np.float64)


def _first_guess(arcs: UniversalArcs[np.float32]) -> Singles:
    """Return a guess between the limits s = t / rho and s³ = 6 t; logarithmic far out on
    hyperbolas.
    """
    rho, sigma, alpha, time = arcs
    # The cube root to 4 %: a third of the exponent, by way of the bits of the number.
    bits: NDArray[Any] = (time * time * np.float32(1.0 / 6.0)).view(np.int32).astype(np.float32)
    bits *= np.float32(1.0 / 3.0)
    bits += np.float32(709_921_077.0)
    s = time / (rho + bits.astype(np.int32).view(np.float32))
    k = np.sqrt(np.maximum(-alpha, 0.0))
    # Above this sqrt(-alpha) s of the parabola-like guess, r grows exponentially.
    at = np.flatnonzero(k * s > 1.0)
    if at.size:
        k = k[at]
        rho = rho[at]
        sigma = sigma[at]
        time = time[at]
        s[at] = _logarithm(1.0 + 2.0 * k * k * k * time / np.abs((rho * k + sigma) * k + 1.0)) / k
    return s


def _logarithm(x: Singles) -> Singles:
    """Return the natural logarithm to 0.03: the exponent, by way of the bits of the number."""
    bits = x.view(np.int32).astype(np.float32)
    bits *= np.float32(2.0**-23)
    bits -= np.float32(127.0 - 0.043)
    bits *= np.float32(np.log(2.0))
    return bits


def solve_fast(arcs: UniversalArcs[np.float64]) -> tuple[FloatArray, BoolArray]:
    """Return rows s, G0, G1, G2 at the end of each arc, and where they are not exact: arcs close
    past the centre.
    """
    s = coarse_anomaly(arcs)
    return _corrected(arcs, s, universal_functions(arcs.alpha, s))


def solve_bracketed(arcs: UniversalArcs[np.float64]) -> tuple[FloatArray, BoolArray]:
    """Return rows s, G0, G1, G2 at the end of each arc, and which arcs have no solution; their rows
    are `nan`.

    Laguerre's steps inside a bracket, with bisection where they do not converge.
    """
    solution = np.full((4, arcs.rho.size), np.nan)
    where = np.arange(arcs.rho.size)
    low, high = _bracket(arcs)
    s = np.clip(coarse_anomaly(arcs), low, high)
    allowed = np.full_like(low, np.inf)
    # Bisection alone needs about 1 100 halvings from the largest double to the smallest.
    for _ in range(2500):
        functions = universal_functions(arcs.alpha, s)
        excess, noise = excess_and_noise(arcs, functions)
        low = np.where(excess < 0.0, s, low)
        high = np.where(excess < 0.0, high, s)
        rows, unsolved = _corrected(arcs, s, functions)
        rows[:, unsolved] = np.stack([s, *functions[:3]])[:, unsolved]
        unsolved &= ~(
            (np.abs(excess) <= noise) & (noise < np.inf) | (high - low <= 2.0 * _EPSILON * high)
        )
        solution[:, where[~unsolved]] = rows[:, ~unsolved]
        at = np.flatnonzero(unsolved)
        if not at.size:
            break
        s, allowed = _next(low, high, np.abs(excess), allowed, s + laguerre_step(arcs, functions))
        s = s[at]
        low = low[at]
        high = high[at]
        allowed = allowed[at]
        where = where[at]
        arcs = arcs.at(at)
    return solution, np.isnan(solution[0])


def _next(
    low: FloatArray, high: FloatArray, excess: FloatArray, allowed: FloatArray, trial: FloatArray
) -> FloatPair:
    """Return the next anomaly and the excess allowed there: the trial while the excess halves, else
    the midpoint.
    """
    helps = (trial > low) & (trial < high) & (excess <= allowed)
    return np.where(helps, trial, 0.5 * (low + high)), np.where(helps, 0.5 * excess, np.inf)


def _bracket(arcs: UniversalArcs[np.float64]) -> FloatPair:
    """Return bounds of the anomaly: one turn of a closed orbit, else doubled until they enclose the
    time.
    """
    closed = arcs.alpha > 0.0
    turn = (2.0 + 1e-6) * np.pi / np.sqrt(np.where(closed, arcs.alpha, 1.0))
    high = np.where(closed, turn, arcs.time / (arcs.rho + np.cbrt(arcs.time * arcs.time / 6.0)))
    low = np.zeros_like(high)
    short = np.flatnonzero(~closed & (high > 0.0))
    while short.size:
        open_arcs = arcs.at(short)
        short = short[
            excess_and_noise(open_arcs, universal_functions(open_arcs.alpha, high[short]))[0] < 0.0
        ]
        low[short] = high[short]
        high[short] *= 2.0
    return low, high


def _corrected(
    arcs: UniversalArcs[np.float64], s: FloatArray, functions: Functions[np.float64]
) -> tuple[FloatArray, BoolArray]:
    """Return rows s, G0, G1, G2 after a correction of fourth order, and where it was too large to
    be exact.
    """
    excess, r, slope = derivatives(arcs, functions)
    np.negative(excess, out=excess)
    bend = arcs.alpha * r
    np.subtract(1.0, bend, out=bend)
    step = excess / r
    unevenness = np.abs(bend)
    unevenness += np.abs(arcs.alpha) * r
    unevenness *= r
    unevenness += slope * slope
    unevenness *= step * step
    # Square of the largest step, over the scale on which r changes, for which the last correction
    # is exact to rounding.
    unsolved = ~(unevenness <= 1e-8 * (r * r))
    bend *= 1.0 / 6.0
    slope *= 0.5
    for _ in range(2):
        mean = bend * step
        mean += slope
        mean *= step
        mean += r
        step = excess / mean
    return _moved(arcs.alpha, s, functions, step), unsolved


def _moved(
    alpha: FloatArray, s: FloatArray, functions: Functions[np.float64], step: FloatArray
) -> FloatArray:
    """Return rows s, G0, G1, G2 a small step further, by the addition theorems."""
    g0, g1, g2, _ = functions
    square = step * step
    z = alpha * square
    d0 = 1.0 - 0.5 * z
    d1 = step * (1.0 - z * (1.0 / 6.0))
    rows = np.empty((4, s.size))
    np.add(s, step, out=rows[0])
    np.subtract(g0 * d0, alpha * g1 * d1, out=rows[1])
    np.add(g1 * d0, g0 * d1, out=rows[2])
    np.add(g2, g1 * d1 + g0 * (0.5 * square), out=rows[3])
    return rows
