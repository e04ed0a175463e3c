"""The response of a filter of pixels to a point source, in its centre and beside it, in closed form.

The output of a filter w for a source displaced by d from where the filter looks, averaged over the
direction of d and over the source's place on its pixel, is

    g(d) = 1/(2π) ∫ k dk T(k) J0(k d) < W(k) sinc²(k_x/2) sinc²(k_y/2) >

with the transfer T of the spot, W of the filter, one sinc for the pixel and one for the place on it
(cosines instead of it for the worst place, a corner), averaged over directions of k. g(0) is the
share of the source's light that the filter passes. A difference of two frames subtracts g(d) / g(0)
of the source's light in the earlier frame. Lengths are in pixels.
"""

import math

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike
from scipy.special import j0

from opir_core.arrays import FloatArray
from opir_photons.columns import floats
from opir_photons.radiometry.clutter import FrameDifference
from opir_photons.radiometry.point_spread import EVEN, PointSpread, filter_transfer, radial_nodes

#: Pixels beyond the filter at which a table of responses to displaced spots ends.
_MARGIN = 3.0


@frozen(eq=False)
class FilteredSpot:
    """The mean output of a filter for a displaced spot of unit energy: `weight` (q,) of J0 at
    `wavenumber` (q,).
    """

    wavenumber: FloatArray
    weight: FloatArray
    width: int

    @classmethod
    def of(cls, weights: FloatArray, spread: PointSpread, phase: str = "mean") -> "FilteredSpot":
        """Return the output of a filter (m, m) over all places of a spot on its pixel (`mean`), or
        on a corner.
        """
        limit = max(spread.limit, 2.0 * EVEN)
        wavenumber, step = radial_nodes(limit, 2.0 * len(weights) + _MARGIN)
        transfer, x, y = filter_transfer(weights, wavenumber, limit)
        pixel = np.sinc(0.5 * x / np.pi) * np.sinc(0.5 * y / np.pi)
        place = pixel if phase == "mean" else np.cos(0.5 * x) * np.cos(0.5 * y)
        window = (transfer.real * (pixel * place)).mean(axis=1) * spread.transfer(wavenumber)
        return cls(wavenumber, window * wavenumber * step / (2.0 * np.pi), len(weights))

    def response(
        self, displacement: ArrayLike = 0.0, frames: FrameDifference | None = None
    ) -> FloatArray:
        """Return the mean outputs (…) for displacements (…), pixels, in unknown directions.

        `frames` are two frames whose drift and registration errors add to the displacement.
        """
        distance = floats(displacement)[..., None]
        weight = self.weight
        if frames is not None:
            drift = j0(self.wavenumber * (frames.drift_per_s * frames.lag_s))
            weight = weight * drift * np.exp(-np.square(self.wavenumber * frames.registration))
        return np.asarray((j0(self.wavenumber * distance) * weight).sum(axis=-1))

    def own_past(self, frames: FrameDifference) -> "OwnPast":
        """Return the share of a source's light that the difference of two frames subtracts, by
        displacement.
        """
        reach = (
            len(self) / math.sqrt(2.0)
            + _MARGIN
            + frames.drift_per_s * frames.lag_s
            + 3.0 * frames.registration
        )
        place = np.linspace(0.0, reach, 2001)
        blocks = [self.response(block, frames) for block in np.array_split(place, 20)]
        return OwnPast(place, np.concatenate(blocks) / float(self.response()))

    def __len__(self) -> int:
        return self.width


@frozen(eq=False)
class OwnPast:
    """A table of g(d) / g(0) at displacements, pixels, in equal steps; 0 beyond."""

    displacement: FloatArray
    share: FloatArray

    @property
    def reach(self) -> float:
        """The displacement, pixels, from which nothing is subtracted."""
        return float(self.displacement[-1])

    def at(self, displacement: FloatArray) -> FloatArray:
        """Return the shares (n,) at displacements (n,), pixels."""
        return np.interp(displacement, self.displacement, self.share, right=0.0)


def ensquared_airy_energy(spread: PointSpread, pixels: int = 1, phase: str = "mean") -> float:
    """Return the share of a spot's energy in a square of pixels about it: mean over its places on a
    pixel, or worst.

    Of the true pattern with its rings; `ensquared_energy` is that of a Gaussian.
    """
    return float(FilteredSpot.of(np.ones((pixels, pixels)), spread, phase).response())
