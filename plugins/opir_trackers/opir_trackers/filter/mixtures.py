"""The estimates of the stereo filter: of each track both modes and how probable they are, as columns."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.motion import BOOST, COAST
from opir_core.interfaces.columns import Columns, names_of


@frozen(eq=False)
class ModeEstimates(Columns):
    """The estimates of tracks, one row each, all at one time: mean and root of information of each mode, and weights.

    `weight` (n, 2) are the probabilities of boost and coast; `pace` (n, 3) the looks that detected and the time, s,
    over which they are counted, both fading, and the time since the last of them, s.
    """

    weight: FloatArray
    boost_mean: FloatArray
    boost_root: FloatArray
    coast_mean: FloatArray
    coast_root: FloatArray
    pace: FloatArray

    @classmethod
    def empty(cls) -> "ModeEstimates":
        """Return the bank of no tracks."""
        boost, coast = np.empty((0, BOOST)), np.empty((0, COAST))
        roots = np.empty((0, BOOST, BOOST)), np.empty((0, COAST, COAST))
        return cls(np.empty((0, 2)), boost, roots[0], coast, roots[1], np.empty((0, 3)))

    @property
    def likelier_position_m(self) -> FloatArray:
        """Return the inertial positions (n, 3) of the likelier mode of each track."""
        return np.where(self.weight[:, 1:] > self.weight[:, :1], self.coast_mean[:, :3], self.boost_mean[:, :3])

    def put(self, rows: IntArray, part: "ModeEstimates") -> "ModeEstimates":
        """Return the bank with its rows (m,) replaced by those of another."""
        columns = []
        for name in names_of(ModeEstimates):
            column = getattr(self, name).copy()
            column[rows] = getattr(part, name)
            columns.append(column)
        return ModeEstimates(*columns)
