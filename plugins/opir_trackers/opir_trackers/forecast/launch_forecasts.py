"""Forecasts of launched tracks, in columns."""

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
