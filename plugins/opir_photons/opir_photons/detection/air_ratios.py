"""The effect of the atmosphere on the ratio of two bands of a plume at an unknown height.

A sensor knows the elevation of a line of sight where it meets the ground, not the height of its
target. Over all heights the ratio of transmittances τ_b / τ_r of a band and the reference band lies
in an interval that depends on the elevation alone. Bounds on the ratio at the source times the ends
of that interval are bounds on the ratio at the aperture: the height is profiled out.
"""

import math
from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.plugin import Paths, Transmittance
from opir_photons.detection.radiometric_columns import checked_transmittances

#: Numbers of elevations, uniform in asinh(sine / 0.05) as in the table of the atmosphere, and of
#: heights, uniform in their square root.
_ELEVATIONS = 24
_HEIGHTS = 41
_BEND = 0.05


@frozen(eq=False)
class AirRatios:
    """Logarithms of the least and of the largest factor on ratios (2 (B - 1), elevations), as
    `Gates.slopes` takes.
    """

    log_factor: FloatArray

    @classmethod
    def of(cls, atmosphere: Transmittance, reference: int, bands: Sequence[int]) -> "AirRatios":
        """Return the factors on the ratios of a sensor's other `bands` to its reference band, in
        air without clouds.
        """
        sine = _BEND * np.sinh(np.linspace(0.0, math.asinh(1.0 / _BEND), _ELEVATIONS))
        height_m = 100e3 * np.square(np.linspace(0.0, 1.0, _HEIGHTS))
        paths = _paths(np.repeat(sine, _HEIGHTS), np.tile(height_m, _ELEVATIONS))
        air = checked_transmittances(atmosphere.clear, (reference, *bands), paths)
        # No signal passes opaque air, and its logarithm is finite.
        log_air = np.log(np.maximum(air, 1e-12))
        # A plume dimmed a thousandfold in the reference band is far below any threshold. Above the
        # atmosphere the factor is 1.
        log_ratio = np.where(air[0] >= 1e-3, log_air[1:] - log_air[0], 0.0)
        log_ratio = log_ratio.reshape(len(bands), _ELEVATIONS, _HEIGHTS)
        least = np.minimum(log_ratio.min(axis=2), 0.0)
        return cls(np.concatenate([least, np.maximum(log_ratio.max(axis=2), 0.0)]))

    @property
    def is_clear(self) -> bool:
        """Whether the atmosphere changes no ratio."""
        return not self.log_factor.any()

    def at(self, elevation_sine: FloatArray) -> FloatArray:
        """Return the factors (n, 2 (B - 1)) for elevations (n,); those of the horizon below it."""
        slant = np.arcsinh(np.maximum(elevation_sine, 0.0) / _BEND)
        across = slant * ((_ELEVATIONS - 1) / math.asinh(1.0 / _BEND))
        row = np.minimum(across.astype(np.int64), _ELEVATIONS - 2)
        share = across - row
        return np.exp(self._column(row) * (1.0 - share) + self._column(row + 1) * share).T

    def _column(self, row: IntArray) -> FloatArray:
        return self.log_factor.take(row, axis=1)


def _paths(sine: FloatArray, height_m: FloatArray) -> Paths:
    """Return paths over one place, to a sensor at the zenith of nobody: only height and elevation
    matter.
    """
    nowhere = np.zeros((len(sine), 3))
    nowhere[:, 0] = 6_378_137.0 + height_m
    return Paths(height_m, sine, nowhere, nowhere * 6.0, np.zeros(len(sine)))
