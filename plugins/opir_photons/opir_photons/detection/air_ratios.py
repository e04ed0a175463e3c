"""What the atmosphere may do to the ratio of two bands of a plume at an unknown height.

A sensor knows the elevation of a line of sight where it meets the ground, not the height of what it
sees. Over all heights the ratio of transmittances τ_b / τ_r of a band and the reference band lies
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

#: Elevations, uniform in asinh(sine / 0.05) as in the table of the atmosphere; heights, uniform in
#: their square root.
_ELEVATIONS = 24
_BEND = 0.05
_HEIGHTS = 41
_TOP_M = 100e3

#: Least transmittance of the reference band: a plume dimmed a thousandfold there is far below any
#: threshold.
_FAINTEST = 1e-3

#: Transmittance of opaque air: no signal passes, and its logarithm is finite.
_OPAQUE = 1e-12


@frozen(eq=False)
class AirRatios:
    """Logarithms of the least and of the largest factor on ratios (2 (B - 1), elevations), as
    `Gates.slopes` takes.
    """

    log_factor: FloatArray

    @classmethod
    def of(cls, atmosphere: Transmittance, reference: int, others: Sequence[int]) -> "AirRatios":
        """Return the factors on the ratios of a sensor's other bands to its reference band, in air
        without clouds.
        """
        sine = _BEND * np.sinh(np.linspace(0.0, math.asinh(1.0 / _BEND), _ELEVATIONS))
        height_m = _TOP_M * np.square(np.linspace(0.0, 1.0, _HEIGHTS))
        through = checked_transmittances(
            atmosphere.clear,
            (reference, *others),
            _paths(np.repeat(sine, _HEIGHTS), np.tile(height_m, _ELEVATIONS)),
        )
        usable = through[0] >= _FAINTEST
        log_ratio = np.log(np.maximum(through[1:], _OPAQUE)) - np.log(
            np.maximum(through[0], _OPAQUE)
        )
        shape = (len(others), _ELEVATIONS, _HEIGHTS)
        # Above the atmosphere the factor is 1, whatever is usable below.
        least = np.where(usable, log_ratio, 0.0).reshape(shape).min(axis=2)
        most = np.where(usable, log_ratio, 0.0).reshape(shape).max(axis=2)
        return cls(np.concatenate([np.minimum(least, 0.0), np.maximum(most, 0.0)]))

    @property
    def is_clear(self) -> bool:
        """Whether the atmosphere changes no ratio."""
        return not self.log_factor.any()

    def at(self, elevation_sine: FloatArray) -> FloatArray:
        """Return the factors (n, 2 (B - 1)) for elevations (n,); those of the horizon below it."""
        across = np.arcsinh(np.maximum(elevation_sine, 0.0) / _BEND) * (
            (_ELEVATIONS - 1) / math.asinh(1.0 / _BEND)
        )
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
