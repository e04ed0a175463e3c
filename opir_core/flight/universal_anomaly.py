"""Kepler's equation in universal variables, solved for arrays of any conics at once.

Units are those of each state: its distance and its circular speed are 1, so r0 = 1 and mu = 1. A state is then two numbers,
`sigma` = r·v and `alpha` = 1 / a, and Kepler's equation is  t = G1 + sigma G2 + G3  with the universal functions of
`stumpff`. Its derivatives in s are r = G0 + sigma G1 + G2 >= 0, r' = sigma G0 + (1 - alpha) G1 and r'' = 1 - alpha r: it rises
monotonically, so a bracket always exists (Danby, Fundamentals of Celestial Mechanics, 2nd ed. 1988, §6.9).
"""

import numpy as np
from numpy.typing import NDArray

from opir_core.flight.stumpff import Floats, universal_functions

_FAST_STEPS = 8
_SAFE_STEPS = 400
_EPSILON = float(np.finfo(float).eps)

#: A step this small, on the scale on which r changes, leaves an error below 1e-16 after the closing correction.
_SMALL_STEP = 1e-3


def solve(sigma: Floats, alpha: Floats, duration: Floats) -> Floats:
    """Return rows s, G0, G1, G2 after `duration` >= 0, one-dimensional arrays in the units of each state; nan if not found.

    For closed orbits `duration` is at most about one period. Every element is solved by itself: its result has the same
    bits in any company.
    """
    solution = np.full((4, sigma.size), np.nan)
    where = np.arange(sigma.size)
    s = _first_guess(sigma, alpha, duration)
    for _ in range(_FAST_STEPS):
        g = universal_functions(alpha, s)
        step, scale = _laguerre_step(g, sigma, alpha, duration)
        small = np.abs(step) * scale <= _SMALL_STEP
        at = np.flatnonzero(small)
        solution[:, where[at]] = _closed(tuple(x[at] for x in g), sigma[at], alpha[at], duration[at], s[at], step[at])
        left = np.flatnonzero(~small)
        if not left.size:
            return solution
        s = np.abs(s + step)[left]
        where, sigma, alpha, duration = where[left], sigma[left], alpha[left], duration[left]
    solution[:, where] = _solve_bracketed(s, sigma, alpha, duration)
    return solution


def _first_guess(sigma: Floats, alpha: Floats, duration: Floats) -> Floats:
    return duration / (1.0 + np.cbrt(duration * duration / 6.0))


def _laguerre_step(
    g: tuple[Floats, ...], sigma: Floats, alpha: Floats, duration: Floats
) -> tuple[Floats, Floats]:
    """Return Laguerre's step (degree 5: Conway, Celestial Mechanics 39, 1986) and the reciprocal length on which r changes."""
    g0, g1, g2, g3 = g
    residual = g1 + sigma * g2 + g3 - duration
    r = g0 + sigma * g1 + g2
    slope = sigma * g0 + (1.0 - alpha) * g1
    step = -5.0 * residual / (r + np.sqrt(np.abs(16.0 * r * r - 20.0 * residual * slope)))
    scale = (np.abs(slope) + np.sqrt(np.abs((1.0 - alpha * r) * r))) / r
    return step, scale


def _closed(
    g: tuple[Floats, ...], sigma: Floats, alpha: Floats, duration: Floats, s: Floats, step: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return s, G0, G1, G2 after one last correction, of fifth order, carried into the functions by their addition theorem."""
    g0, g1, g2, g3 = g
    residual = g1 + sigma * g2 + g3 - duration
    r = g0 + sigma * g1 + g2
    slope = sigma * g0 + (1.0 - alpha) * g1
    bend = 1.0 - alpha * r
    for _ in range(2):
        step = -residual / (r + step * (slope / 2.0 + step * (bend / 6.0 - step * (alpha * slope / 24.0))))
    z = alpha * step * step
    d0 = 1.0 - z * (0.5 - z / 24.0)
    d1 = step * (1.0 - z * (1.0 / 6.0 - z / 120.0))
    d2 = step * step * (0.5 - z / 24.0)
    return s + step, g0 * d0 - alpha * g1 * d1, g1 * d0 + g0 * d1, g2 + g1 * d1 + g0 * d2


def _solve_bracketed(s: Floats, sigma: Floats, alpha: Floats, duration: Floats) -> Floats:
    """Return rows s, G0, G1, G2 for the few that Laguerre's method left: bisection, with Laguerre's step where it helps."""
    low, high = _bracket(sigma, alpha, duration)
    s = np.where((s > low) & (s < high), s, 0.5 * (low + high))
    done: NDArray[np.bool_] = np.zeros(s.shape, bool)
    width = high - low
    for _ in range(_SAFE_STEPS):
        g = universal_functions(alpha, s)
        residual = g[0] * 0.0 + g[1] + sigma * g[2] + g[3] - duration
        noise = 2.0 * _EPSILON * (g[1] + np.abs(sigma) * g[2] + g[3] + duration)
        low = np.where(residual < 0.0, s, low)
        high = np.where(residual < 0.0, high, s)
        done |= (np.abs(residual) <= noise) | (high - low <= 2.0 * _EPSILON * high)
        if done.all():
            break
        step, _scale = _laguerre_step(g, sigma, alpha, duration)
        trial = s + step
        good = (trial > low) & (trial < high) & (high - low < 0.7 * width)
        width = np.where(good, high - low, 0.5 * (high - low))
        s = np.where(done, s, np.where(good, trial, 0.5 * (low + high)))
    g = universal_functions(alpha, s)
    return np.where(done, np.stack([s, g[0], g[1], g[2]]), np.nan)


def _bracket(sigma: Floats, alpha: Floats, duration: Floats) -> tuple[Floats, Floats]:
    """Return bounds of the anomaly: on a closed orbit one turn, else doubled until the time is passed."""
    closed = alpha > 0.0
    high = np.where(closed, 2.0 * np.pi / np.sqrt(np.where(closed, alpha, 1.0)) * 1.0000001, np.cbrt(duration) + duration * 1e-3)
    low = np.zeros_like(high)
    short = np.flatnonzero(~closed)
    for _ in range(2100):
        if not short.size:
            break
        g0, g1, g2, g3 = universal_functions(alpha[short], high[short])
        short = short[g1 + sigma[short] * g2 + g3 < duration[short]]
        low[short] = high[short]
        high[short] *= 2.0
    return low, high
