"""Forecasts of launched tracks, in columns."""

from typing import Self

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray, ObjectArray
from opir_core.interfaces import Columns


@frozen(eq=False, repr=False)
class LaunchForecasts(Columns):
    """Forecasts of tracks (n,), given that they were launched.

    `given_launch` (n, H) are over the hypotheses: zero but for launches and `none`, each row sums
    to one. `impact` and its moments are those of the most probable condition, whose
    `impact_regions` come first. The probabilities are of a present burn, of another one later, of
    coming down, and of an orbit without another burn. `end` is the code of `Tracks.end`: nothing
    new can come of some tracks.
    """

    given_launch: FloatArray
    impact: FloatArray
    impact_covariance: FloatArray
    impact_sigmas: FloatArray
    impact_regions: ObjectArray
    probability_burning: FloatArray
    probability_relights: FloatArray
    probability_comes_down: FloatArray
    in_orbit: FloatArray
    end: IntArray

    @classmethod
    def without_impacts(
        cls,
        given_launch: FloatArray,
        burning: FloatArray,
        relights: FloatArray,
        comes_down: FloatArray,
        in_orbit: FloatArray,
    ) -> Self:
        """Return forecasts without impacts, with the probabilities (n,) of a present burn, of another
        one later, of coming down, and of an orbit.
        """
        count = len(given_launch)
        regions = np.empty(count, dtype=np.object_)
        regions.fill(())
        return cls(
            given_launch,
            np.full((count, 3), np.nan),
            np.full((count, 3, 3), np.nan),
            np.full((count, 3), np.nan),
            regions,
            burning,
            relights,
            comes_down,
            in_orbit,
            np.zeros(count, dtype=np.int64),
        )
