"""Spatial filters over the pixels of a frame: weights, and the gains of a point source and of
noise.

A filter is a square array of weights (m, m) in units of pixels, applied where the centre of the
array is nearest to the spot. Widths of spots are standard deviations per axis, `pixel_rad` is the
IFOV of a pixel, both rad. Source of the filters: D. A. Scribner and others, in The Infrared and
Electro-Optical Systems Handbook, vol. 8 (1993), chapter 4.
"""

import math

import numpy as np
from scipy.special import erf

from opir_core.arrays import FloatArray
from opir_photons.radiometry.quadrature import unit_legendre

FILTERS = ("sum", "surround", "matched")


def filter_weights(kind: str, pixels: int, sigma_rad: float, pixel_rad: float) -> FloatArray:
    """Return the weights (m, m) of a spatial filter over a core of `pixels` × `pixels` pixels.

    `sum` adds the core (m = pixels); `surround` subtracts from it the mean of a ring of pixels
    around it, one pixel away (m = pixels + 4); `matched` weighs the core and two pixels around it
    with the spot's mean shares, less their mean (m = pixels + 4). The last two have the sum 0: they
    pass no uniform background.
    """
    if kind == "sum":
        return np.ones((pixels, pixels))
    width = pixels + 4
    if kind == "surround":
        weights = np.full((width, width), -(pixels**2) / (4.0 * (width - 1)))
        weights[1:-1, 1:-1] = 0.0
        weights[2:-2, 2:-2] = 1.0
        return weights
    if kind == "matched":
        shares = mean_shares(width, sigma_rad, pixel_rad)
        return np.asarray(shares - shares.mean())
    raise ValueError(f"filter: {kind!r} is not one of {', '.join(FILTERS)}")


def mean_shares(width: int, sigma_rad: float, pixel_rad: float) -> FloatArray:
    """Return the mean shares (m, m) of a spot's energy in the pixels of a square about it, over
    sub-pixel phases.
    """
    place = _places(width)
    spread = sigma_rad / pixel_rad
    # From this width on, in pixels, the quadrature is exact to rounding.
    if spread > 1.0:
        along = _of_wide_spot(place, spread)
    else:
        outer, central, inner = (_mean_edge(place + step, spread) for step in (1.0, 0.0, -1.0))
        along = outer - 2.0 * central + inner
    return np.outer(along, along)


def _of_wide_spot(place: FloatArray, spread: float) -> FloatArray:
    """Return the mean shares (m,) along one axis: the normal density under the triangle of a
    pixel's places.

    By quadrature: of wide spots the difference of integrals would cancel.
    """
    nodes, weights = unit_legendre(12)
    off = (place[:, None] + np.concatenate([-nodes, nodes])) / spread
    weight = np.tile(weights * (1.0 - nodes), 2)
    return (np.exp(-0.5 * off * off) * weight).sum(axis=1) / (spread * math.sqrt(2.0 * math.pi))


def corner_shares(width: int, sigma_rad: float, pixel_rad: float) -> FloatArray:
    """Return the shares (m, m) of a spot half a pixel off the centre of the square along both axes:
    the worst phase.
    """
    scale = math.sqrt(2.0) * max(sigma_rad / pixel_rad, np.finfo(np.float64).tiny)
    place = _places(width) - 0.5
    along = 0.5 * (erf((place + 0.5) / scale) - erf((place - 0.5) / scale))
    return np.outer(along, along)


def _places(width: int) -> FloatArray:
    """Return the centres (m,) of pixels in a square's frame, pixels."""
    return np.arange(width, dtype=np.float64) - 0.5 * (width - 1)


def _mean_edge(at: FloatArray, spread: float) -> FloatArray:
    """Return the integrals of the normal distribution of a spread up to places, less half of
    these.
    """
    if spread == 0.0:
        return 0.5 * np.abs(at)
    scaled = at / (math.sqrt(2.0) * spread)
    return np.asarray(
        0.5 * at * erf(scaled) + spread * np.exp(-scaled * scaled) / math.sqrt(2.0 * math.pi)
    )


def signal_gain(
    weights: FloatArray, sigma_rad: float, pixel_rad: float, phase: str = "mean"
) -> float:
    """Return a filter's output for a spot of unit energy: the `mean` over sub-pixel phases, or at
    the `worst`.
    """
    shares = mean_shares if phase == "mean" else corner_shares
    return float((weights * shares(len(weights), sigma_rad, pixel_rad)).sum())


def noise_gain(weights: FloatArray) -> float:
    """Return a filter's output variance for white noise of unit variance in each pixel: Σ w²."""
    return float(np.square(weights).sum())
