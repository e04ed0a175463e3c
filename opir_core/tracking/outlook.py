"""Where tracks are about a time, and how surely: positions and covariances at the times of looks."""

from typing import NamedTuple

import numpy as np

from opir_core.records import FloatArray, IntArray
from opir_core.tracking.filter.motion import BOOST, followed, weights_at


class Outlook(NamedTuple):
    """Tracks about a time: derivatives (n, 5, 3) of the position and the spread S (n, 12, 12) of the state."""

    time_s: float
    derivative: FloatArray
    side: FloatArray

    def positions(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of tracks (m,) at times (m,)."""
        if len(self.derivative) == 1:
            lone: FloatArray = weights_at(time_s - self.time_s) @ self.derivative[0]
            return lone
        return followed(self.derivative[track], weights_at(time_s - self.time_s))

    def position_sides(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return A (m, 3, 12) with A Aᵀ the covariance of the position of tracks (m,) at times (m,)."""
        weight = weights_at(time_s - self.time_s)[:, :, None, None]
        blocks = self.side.reshape(len(self.side), 4, 3, BOOST)
        total: FloatArray = blocks[track, 0]
        for order in range(1, 4):
            total += blocks[track, order] * weight[:, order]
        return total

    def seen_covariances(self, track: IntArray, time_s: FloatArray, rows: FloatArray) -> FloatArray:
        """Return the covariances (m, 2, 2) of what rows (m, 2, 3) make of the positions of tracks (m,) at times (m,).

        Many looks a track are cheaper by way of the position's covariance than by its sides.
        """
        if len(self.side) == 1:
            side = (weights_at(time_s - self.time_s)[:, :4] @ self.side.reshape(4, 3 * BOOST)).reshape(-1, 3, BOOST)
            seen = rows @ side
            spread: FloatArray = seen @ seen.transpose(0, 2, 1)
        else:
            spread = (rows @ self.position_covariances(track, time_s)) @ rows.transpose(0, 2, 1)
        spread[:, 1, 0] = spread[:, 0, 1]
        return spread

    def position_covariances(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return the covariances (m, 3, 3) of the positions of tracks (m,) at times (m,): polynomials of degree 6.

        Many looks a track are cheaper this way than by `position_sides`; rounding is of the largest term's size.
        """
        since = (time_s - self.time_s)[:, None]
        terms = self._covariance_terms()
        total: FloatArray = terms[-1][track]
        for term in terms[-2::-1]:
            total *= since
            total += term[track]
        return total.reshape(len(track), 3, 3)

    def _covariance_terms(self) -> list[FloatArray]:
        """Return the coefficients (n, 9) of the powers of time in the covariance of the position, lowest first."""
        blocks = self.side.reshape(len(self.side), 4, 3, BOOST)
        used = blocks[:, :, :, np.any(self.side, axis=(0, 1))] if len(self.side) else blocks
        top = 4 if np.any(blocks[:, 2:]) else 2
        scaled = used * np.array([1.0, 1.0, 0.5, 1.0 / 6.0])[:, None, None]
        terms = [np.zeros((len(self.side), 3, 3)) for _ in range(2 * top - 1)]
        for row in range(top):
            for column in range(top):
                terms[row + column] += scaled[:, row] @ scaled[:, column].transpose(0, 2, 1)
        return [term.reshape(len(term), 9) for term in terms]

    def reach_m(self, span_s: float) -> FloatArray:
        """Return bounds (n,) on the standard deviation of each track's position, all axes together, over a span.

        The span ends at the outlook's time. The spread of each derivative is bounded on its own.
        """
        spread = np.sqrt(np.sum(self.side.reshape(len(self.side), 4, -1) ** 2, axis=2))
        bound: FloatArray = np.sum(spread * weights_at(np.array([span_s]))[:, :4], axis=1)
        return bound
