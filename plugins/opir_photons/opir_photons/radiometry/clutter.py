"""Clutter: the variance of a structured background behind a filter, in closed form.

The background's radiance has the two-dimensional power spectrum of a Matérn field (of von Kármán's
form): flat up to the wavenumber 1/scale and falling as k^-α above. Its correlation is that of
`structure_correlation`; for α = 3 it is exp(-r/scale), which a medium of two phases with random
borders has, like broken cloud (P. Debye, H. R. Anderson and H. Brumberger, J. Appl. Phys. 28 (1957)
679).

The variance left by a spatial filter and a difference of two frames is the integral of the spectrum
times the squared transfer functions of spot and pixel, times that of the filter, times that of the
frames' displacement: 2 (1 - J0(k d) exp(-k² s²)) for a drift by d in an unknown direction and a
registration error of s per frame and axis. For small displacements this is the structure's gradient
times the displacement, in general twice one minus the correlation. Angles, lengths on the sky and
displacements are in pixels; variances are of a field of unit variance.
"""

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike
from scipy.special import gamma, j0, kv

from opir_core.arrays import FloatArray
from opir_photons.columns import floats
from opir_photons.radiometry.point_spread import EVEN, PointSpread, filter_transfer, radial_nodes


def structure_spectrum(wavenumber: ArrayLike, scale: ArrayLike, exponent: ArrayLike) -> FloatArray:
    """Return power spectral densities P(k) = 2π (α - 2) ℓ² (1 + k² ℓ²)^(-α/2) of fields of unit
    variance.

    Outer scale ℓ in any unit of length, wavenumber k in radians per that unit, exponent α above 2;
    the variance is the integral of P over the plane of wavenumbers, over (2π)². Source: P. Guttorp
    and T. Gneiting, Biometrika 93 (2006) 989.
    """
    outer = floats(scale)
    power = floats(exponent)
    scaled = floats(wavenumber) * outer
    level = 2.0 * np.pi * (power - 2.0) * np.square(outer)
    return np.asarray(level * (1.0 + scaled * scaled) ** (-0.5 * power))


def structure_correlation(distance: ArrayLike, scale: ArrayLike, exponent: ArrayLike) -> FloatArray:
    """Return the correlations of a field at distances r: 2^(1-ν) / Γ(ν) (r/ℓ)^ν K_ν(r/ℓ) with ν =
    α/2 - 1.

    Distance and outer scale ℓ are in one unit; 1 at distance 0. The Fourier transform of
    `structure_spectrum`.
    """
    order = 0.5 * floats(exponent) - 1.0
    scaled = floats(distance) / floats(scale)
    with np.errstate(all="ignore"):
        value = 2.0 ** (1.0 - order) / gamma(order) * scaled**order * kv(order, scaled)
        # At small distances K_ν loses digits or overflows: its series is exact to rounding.
        is_small = (scaled < 1e-20) | ~np.isfinite(value) & (scaled < 1.0)
        value = np.where(is_small, _correlation_series(scaled, order), value)
        # Where the power overflows, K_ν is 0.
        value = np.where(np.isnan(value) & (scaled > 1.0), 0.0, value)
    return np.where(scaled > 0.0, value, np.where(np.isnan(scaled), scaled, 1.0))


def _correlation_series(scaled: FloatArray, order: FloatArray) -> FloatArray:
    """Return the first two terms of the series of `structure_correlation` in r/ℓ."""
    fall = gamma(1.0 - order) / gamma(1.0 + order) * (0.5 * scaled) ** (2.0 * order)
    bend = np.square(scaled) / (4.0 * np.maximum(order - 1.0, 1e-3))
    return 1.0 - np.where(order < 1.0, fall, bend)


@frozen
class FrameDifference:
    """The difference of a frame and one of `lag_s` earlier.

    Every frame is off by a registration error of standard deviation `registration` per axis,
    pixels, new from frame to frame; the line of sight drifts over the scene at `drift_per_s`,
    pixels per s, in an unknown direction.
    """

    lag_s: float
    registration: float
    drift_per_s: float

    def transfer(self, wavenumber: FloatArray) -> FloatArray:
        """Return the squared transfer function at wavenumbers per pixel: 2 (1 - J0(k d) exp(-k²
        s²)).
        """
        # The difference from 1 without cancellation.
        off = -np.expm1(-np.square(wavenumber * self.registration))
        drifted = _one_less_j0(wavenumber * (self.drift_per_s * self.lag_s))
        return np.asarray(2.0 * (off + drifted - off * drifted))


def _one_less_j0(at: FloatArray) -> FloatArray:
    """Return 1 - J0(x), by its series where x is small."""
    quarter = 0.25 * at * at
    return np.where(at < 1e-2, quarter * (1.0 - 0.25 * quarter), 1.0 - j0(at))


@frozen(eq=False)
class SpatialTransfer:
    """The mean over directions of the squared transfer functions of spot, pixel and filter.

    `wavenumber` (q,) are nodes, radians per pixel; `weight` (q,) that mean times the weight of the
    node in an integral over the plane of wavenumbers, over (2π)².
    """

    wavenumber: FloatArray
    weight: FloatArray

    @classmethod
    def of(
        cls, weights: FloatArray, spread: PointSpread, farthest: float = 0.0
    ) -> "SpatialTransfer":
        """Return the transfer of a filter (m, m) behind spots.

        `farthest` is the largest displacement, pixels, that is looked at.
        """
        limit = max(spread.limit, 2.0 * EVEN)
        wavenumber, step = radial_nodes(limit, len(weights) + farthest)
        transfer, x, y = filter_transfer(weights, wavenumber, limit)
        passed = np.abs(transfer) * (np.sinc(0.5 * x / np.pi) * np.sinc(0.5 * y / np.pi))
        window = np.square(passed).mean(axis=1) * np.square(spread.transfer(wavenumber))
        return cls(wavenumber, window * wavenumber * step / (2.0 * np.pi))

    def variance(
        self, scale: ArrayLike, exponent: float, frames: FrameDifference | None = None
    ) -> FloatArray:
        """Return the variances left of fields of outer scales (…), pixels, and an exponent."""
        weight = self.weight if frames is None else self.weight * frames.transfer(self.wavenumber)
        field = structure_spectrum(self.wavenumber, floats(scale)[..., None], exponent)
        return np.asarray((field * weight).sum(axis=-1))

    def correlation(
        self,
        scale: float,
        exponent: float,
        interval_s: ArrayLike,
        frames: FrameDifference | None = None,
        motion_per_s: float = 0.0,
    ) -> FloatArray:
        """Return the correlations (…) of the remaining clutter at one target in looks that are
        intervals (…), s, apart.

        `motion_per_s` is the target's motion over the scene, pixels per s, in an unknown direction.
        Without frames the sensor neither drifts nor jitters: structure changes only by the target's
        motion. 0 where no clutter remains.
        """
        time = floats(interval_s)
        common = self.weight * j0(motion_per_s * np.abs(time)[..., None] * self.wavenumber)
        if frames is not None:
            common = common * (
                2.0 * self._frame(frames, time)
                - self._frame(frames, time - frames.lag_s)
                - self._frame(frames, time + frames.lag_s)
            )
        field = structure_spectrum(self.wavenumber, scale, exponent)
        variance = max(float(self.variance(scale, exponent, frames)), np.finfo(np.float64).tiny)
        return np.asarray((field * common).sum(axis=-1) / variance)

    def _frame(self, frames: FrameDifference, time_s: FloatArray) -> FloatArray:
        """Return the transfer (…, q) of the displacement of two frames some time apart; 1 of a
        frame with itself.
        """
        interval_s = np.abs(time_s)[..., None]
        blurred = np.exp(-np.square(self.wavenumber * frames.registration)) * j0(
            self.wavenumber * frames.drift_per_s * interval_s
        )
        return np.where(interval_s > 0.0, blurred, 1.0)
