"""A guess of the universal anomaly to about six digits, in single precision: half the bytes, twice the speed."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.kepler_equation import Arcs, laguerre_step
from opir_core.flight.stumpff import universal_functions

Singles = NDArray[np.float32]

_STEPS = 3
_SIXTH, _THIRD = np.float32(1.0 / 6.0), np.float32(1.0 / 3.0)

#: Where sqrt(-alpha) s of the parabola-like guess passes this, r grows like an exponential.
_EXPONENTIAL = 1.0


def coarse_anomaly(arcs: Arcs[np.float64]) -> FloatArray:
    """Return the anomaly at the end of each arc, by Laguerre's steps from a first guess; 0 where that overflows."""
    single = Arcs(*(column.astype(np.float32) for column in arcs))
    s = _first_guess(single)
    for _ in range(_STEPS):
        s += laguerre_step(single, universal_functions(single.alpha, s))
        np.abs(s, out=s)
    s[~np.isfinite(s)] = 0.0
    return s.astype(np.float64)


def _first_guess(arcs: Arcs[np.float32]) -> Singles:
    """Return a guess between the limits s = t / rho and s³ = 6 t; logarithmic far out on hyperbolas."""
    rho, sigma, alpha, time = arcs
    s = time / (rho + _cube_root(time * time * _SIXTH))
    k = np.sqrt(np.maximum(-alpha, 0.0))
    at = np.flatnonzero(k * s > _EXPONENTIAL)
    if at.size:
        k, rho, sigma, time = k[at], rho[at], sigma[at], time[at]
        s[at] = _logarithm(1.0 + 2.0 * k * k * k * time / np.abs((rho * k + sigma) * k + 1.0)) / k
    return s


def _cube_root(x: Singles) -> Singles:
    """Return the cube root to 4 %: a third of the exponent, by way of the bits of the number."""
    bits: NDArray[Any] = x.view(np.int32).astype(np.float32)
    bits *= _THIRD
    bits += np.float32(709_921_077.0)
    return bits.astype(np.int32).view(np.float32)


def _logarithm(x: Singles) -> Singles:
    """Return the natural logarithm to 0.03: the exponent, by way of the bits of the number."""
    bits = x.view(np.int32).astype(np.float32)
    bits *= np.float32(2.0**-23)
    bits -= np.float32(127.0 - 0.043)
    bits *= np.float32(np.log(2.0))
    return bits
