"""Mixtures: what an undecided pairing makes of a track's state.

A track with two or more possible partners is at the crossing with each of them, with the
probability of that pairing. The reported state has the mean and covariance of that mixture; between
two pairings its parts keep their velocities.
"""

import numpy as np
from attrs import frozen
from opir_estimation import COAST, ModeEstimates, information_root, square_root

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces import Columns


@frozen(eq=False, repr=False)
class Mixtures(Columns):
    """Tracks with undecided pairings at a time: shifts of the mean (n, 6) and spread (n, 6, 6),
    inertial, m and m/s.

    `probability` (n,) is that of the pairing that the track follows.
    """

    number: IntArray
    time_s: FloatArray
    shift: FloatArray
    spread: FloatArray
    probability: FloatArray

    @classmethod
    def empty(cls) -> "Mixtures":
        """Return no mixtures."""
        none = np.empty(0)
        return cls(np.empty(0, dtype=np.int64), none, np.empty((0, 6)), np.empty((0, 6, 6)), none)

    @classmethod
    def of(
        cls,
        number: IntArray,
        time_s: float,
        track: IntArray,
        probability: FloatArray,
        offset: FloatArray,
    ) -> "Mixtures":
        """Return the mixtures of tracks `number` (n,) with rivals (m,), `offset` (m, 6) from the
        tracks' own states.
        """
        count = len(number)
        shift = np.zeros((count, 6))
        square = np.zeros((count, 6, 6))
        np.add.at(shift, track, probability[:, None] * offset)
        np.add.at(
            square, track, probability[:, None, None] * offset[:, :, None] * offset[:, None, :]
        )
        spread = square - shift[:, :, None] * shift[:, None, :]
        own_probability = 1.0 - np.bincount(track, probability, count)
        return cls(
            number,
            np.full(count, time_s),
            shift,
            spread,
            own_probability.astype(np.float64, copy=False),
        )

    def mixed(self, estimates: ModeEstimates, number: IntArray, time_s: float) -> ModeEstimates:
        """Return the estimates of tracks `number` (n,), ascending, at a time, as mixtures where
        they are.
        """
        if not self.number.size:
            return estimates
        present = np.flatnonzero(np.isin(self.number, number))
        rows = np.searchsorted(number, self.number[present])
        move = np.tile(np.eye(6), (len(present), 1, 1))
        move[:, range(3), range(3, 6)] = (time_s - self.time_s[present])[:, None]
        shift = (move @ self.shift[present][:, :, None])[:, :, 0]
        selected = estimates.take(rows)
        spread = move @ self.spread[present] @ move.transpose(0, 2, 1)
        return estimates.put(rows, widened(selected.moved_by(shift), spread))


def widened(estimates: ModeEstimates, added: FloatArray) -> ModeEstimates:
    """Return the moments of estimates (n rows) with covariances (n, 6, 6) of position and velocity
    added.
    """
    value, vector = np.linalg.eigh(added)
    side = np.zeros((len(added), estimates.boost_mean.shape[1], COAST))
    side[:, :COAST] = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    boost, coast = (
        information_root(
            np.concatenate([square_root.inverse_root(root), side[:, : root.shape[1]]], axis=2)
        )
        for root in (estimates.boost_root, estimates.coast_root)
    )
    means = estimates.boost_mean, boost, estimates.coast_mean, coast
    return ModeEstimates(estimates.weight, *means, estimates.detection_rate)
