"""The universal anomaly at a given time: Kepler's equation solved for arrays of any conics at once.

`solved_quickly` takes every element the same way and says which it did not finish; `solved_surely` finishes those
inside a bracket. Each element is treated by itself: it has the same bits in any company.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.flight.anomaly_guess import coarse_anomaly
from opir_core.flight.kepler_equation import Arcs, derivatives, excess_and_noise, laguerre_step
from opir_core.flight.stumpff import Functions, universal_functions

#: Bisection alone needs some 1 100 halvings from the largest double to the smallest; Laguerre's steps need a few.
_SURE_STEPS = 2500
_EPSILON = float(np.finfo(float).eps)

#: Square of a step, measured against the scale on which r changes, that the closing correction takes to the last place.
_SMALL_SQUARED = 1e-8


def solved_quickly(arcs: Arcs[np.float64]) -> tuple[FloatArray, BoolArray]:
    """Return rows s, G0, G1, G2 at the end of each arc, and where they are not yet right.

    A guess in single precision and one correction in double: enough for all but arcs close past the centre.
    """
    s = coarse_anomaly(arcs)
    return _corrected(arcs, s, universal_functions(arcs.alpha, s))


def solved_surely(arcs: Arcs[np.float64]) -> tuple[FloatArray, BoolArray]:
    """Return rows s, G0, G1, G2 at the end of each arc, and where no anomaly was found: there they are `nan`.

    Laguerre's steps inside a bracket, bisection where they do not help.
    """
    solution = np.full((4, arcs.rho.size), np.nan)
    where = np.arange(arcs.rho.size)
    low, high = _bracket(arcs)
    s, allowed = np.clip(coarse_anomaly(arcs), low, high), np.full_like(low, np.inf)
    for _ in range(_SURE_STEPS):
        functions = universal_functions(arcs.alpha, s)
        excess, noise = excess_and_noise(arcs, functions)
        low, high = np.where(excess < 0.0, s, low), np.where(excess < 0.0, high, s)
        found, left = _corrected(arcs, s, functions)
        found[:, left] = np.stack([s, *functions[:3]])[:, left]
        left &= ~((np.abs(excess) <= noise) & (noise < np.inf) | (high - low <= 2.0 * _EPSILON * high))
        solution[:, where[~left]] = found[:, ~left]
        at = np.flatnonzero(left)
        if not at.size:
            break
        s, allowed = _next(low, high, np.abs(excess), allowed, s + laguerre_step(arcs, functions))
        s, low, high, allowed, where, arcs = s[at], low[at], high[at], allowed[at], where[at], arcs.at(at)
    return solution, np.isnan(solution[0])


def _next(
    low: FloatArray, high: FloatArray, excess: FloatArray, allowed: FloatArray, trial: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the next anomaly and the excess allowed there: the trial, as long as the excess keeps halving."""
    helps = (trial > low) & (trial < high) & (excess <= allowed)
    return np.where(helps, trial, 0.5 * (low + high)), np.where(helps, 0.5 * excess, np.inf)


def _bracket(arcs: Arcs[np.float64]) -> tuple[FloatArray, FloatArray]:
    """Return bounds of the anomaly: on a closed orbit one turn, else doubled until the time is passed."""
    closed = arcs.alpha > 0.0
    turn = (2.0 + 1e-6) * np.pi / np.sqrt(np.where(closed, arcs.alpha, 1.0))
    high = np.where(closed, turn, arcs.time / (arcs.rho + np.cbrt(arcs.time * arcs.time / 6.0)))
    low = np.zeros_like(high)
    short = np.flatnonzero(~closed & (high > 0.0))
    while short.size:
        part = arcs.at(short)
        short = short[excess_and_noise(part, universal_functions(part.alpha, high[short]))[0] < 0.0]
        low[short] = high[short]
        high[short] *= 2.0
    return low, high


def _corrected(arcs: Arcs[np.float64], s: FloatArray, functions: Functions[np.float64]) -> tuple[FloatArray, BoolArray]:
    """Return rows s, G0, G1, G2 after a correction of fourth order, and where it was too large to be exact."""
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
    left = ~(unevenness <= _SMALL_SQUARED * (r * r))
    bend *= 1.0 / 6.0
    slope *= 0.5
    for _ in range(2):
        mean = bend * step
        mean += slope
        mean *= step
        mean += r
        step = excess / mean
    return _moved(arcs.alpha, s, functions, step), left


def _moved(alpha: FloatArray, s: FloatArray, functions: Functions[np.float64], step: FloatArray) -> FloatArray:
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
