"""The point spread of a diffraction-limited, blurred telescope, in wavenumbers.

The Airy pattern of a circular aperture is exact there and ends at the cutoff k_c = 2π D p / λ
(radians per pixel of width p): its transfer is (2/π) (acos x - x √(1 - x²)) with x = k / k_c (J. W.
Goodman, Introduction to Fourier Optics, 3rd ed., 2005, section 6.3). Blur and jitter multiply it by
a Gaussian. Lengths are in pixels.
"""

import math

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_photons.radiometry.quadrature import legendre

#: Wavenumber, per pixel, up to which panels of a quadrature are even in logarithm.
EVEN = 0.25


@frozen
class PointSpread:
    """A spot: the cutoff of its aperture, radians per pixel (inf for a perfect one), and a Gaussian
    blur, pixels.
    """

    cutoff: float
    blur: float

    @classmethod
    def of(
        cls, wavelength_um: float, aperture_m: float, blur_rad: float, pixel_rad: float
    ) -> "PointSpread":
        """Return the spot of an aperture and a Gaussian blur per axis on pixels of an angular
        width.
        """
        return cls(
            2.0 * math.pi * aperture_m * pixel_rad / (wavelength_um * 1e-6), blur_rad / pixel_rad
        )

    @property
    def limit(self) -> float:
        """The wavenumber, radians per pixel, above which the spot's transfer is 0."""
        # A Gaussian is 0 beyond six of its widths; a blur below 0.05 pixels is not resolved.
        return min(self.cutoff, 6.0 / max(self.blur, 0.05))

    def transfer(self, wavenumber: FloatArray) -> FloatArray:
        """Return the transfer at wavenumbers, radians per pixel: 1 at 0."""
        share = np.minimum(wavenumber / self.cutoff, 1.0)
        airy = (2.0 / np.pi) * (np.arccos(share) - share * np.sqrt(1.0 - share * share))
        return np.asarray(airy * np.exp(-0.5 * np.square(wavenumber * self.blur)))


def filter_transfer(
    weights: FloatArray, wavenumber: FloatArray, limit: float
) -> tuple[NDArray[np.complex128], FloatArray, FloatArray]:
    """Return the transfer (q, a) of a filter of pixels (m, m), and the wavenumbers (q, a) along
    both axes.

    Over half a turn of directions, enough of them for wavenumbers (q,) up to `limit`; the other
    half mirrors it.
    """
    count = math.ceil(0.75 * limit * (len(weights) + 1)) + 16
    angle = np.pi * np.arange(count) / count
    x = wavenumber[:, None] * np.cos(angle)
    y = wavenumber[:, None] * np.sin(angle)
    place = np.arange(len(weights)) - 0.5 * (len(weights) - 1)
    along, across = (np.exp(1j * axis[..., None] * place) for axis in (x, y))
    return np.asarray(((along @ weights) * across).sum(axis=-1)), x, y


def radial_nodes(limit: float, farthest: float) -> tuple[FloatArray, FloatArray]:
    """Return the nodes (q,) and weights of panels up to a wavenumber that resolve waves over a
    distance, pixels.
    """
    # A field is uniform below the least wavenumber, per pixel.
    least = 1e-9
    folds = math.ceil(math.log(EVEN / least))
    low = np.geomspace(least, EVEN, 2 * folds + 1)
    # Displacements of hundreds of pixels decorrelate frames without being resolved.
    panels = min(math.ceil((limit - EVEN) * max(farthest, 4.0) / math.pi), 1500)
    edges = np.concatenate([low, np.linspace(EVEN, limit, panels + 1)[1:]])
    nodes, weights = legendre(6)
    half = 0.5 * np.diff(edges)[:, None]
    middle = 0.5 * (edges[1:] + edges[:-1])[:, None]
    return (middle + half * nodes).ravel(), (half * weights).ravel()
