"""Polynomials through knots, one a piece of a pair's looks."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray


class Curves(NamedTuple):
    """Polynomials over scans: `coefficients` (5, k), lowest power first, of (scan - middle) · per_scan."""

    middle: FloatArray
    per_scan: FloatArray
    coefficients: FloatArray

    @classmethod
    def through(cls, scan: IntArray, values: FloatArray) -> "Curves":
        """Return the curves through values (5, k) at rising scans (5, k)."""
        middle, per_scan = _scaled(scan)
        at = (scan - middle) * per_scan
        # Newton's divided differences, and from them the powers.
        newton = values.copy()
        for order in range(1, len(at)):
            newton[order:] = (newton[order:] - newton[order - 1 : -1]) / (at[order:] - at[:-order])
        coefficients = np.zeros(values.shape)
        for order in range(len(at) - 1, -1, -1):
            coefficients[1:] = coefficients[:-1] - at[order] * coefficients[1:]
            coefficients[0] = newton[order] - at[order] * coefficients[0]
        return cls(middle, per_scan, coefficients)

    @classmethod
    def straight(cls, scan: IntArray, values: FloatArray, powers: int) -> "Curves":
        """Return straight lines through values (2, k) at scans (2, k), which may be one."""
        coefficients = np.zeros((powers, values.shape[1]))
        coefficients[0] = 0.5 * (values[0] + values[1])
        coefficients[1] = 0.5 * (values[1] - values[0])
        return cls(*_scaled(scan), coefficients)

    def joined(self, other: "Curves", order: IntArray) -> "Curves":
        """Return these curves and others, in an order."""
        return Curves(*(np.concatenate(both, axis=-1)[..., order] for both in zip(self, other, strict=True)))

    def each_at(self, scan: IntArray) -> FloatArray:
        """Return the value (k,) of each curve at one scan (k,)."""
        place = (scan - self.middle) * self.per_scan
        value: FloatArray = self.coefficients[-1].copy()
        for coefficient in self.coefficients[-2::-1]:
            value *= place
            value += coefficient
        return value

    def at(self, used: IntArray, times: IntArray, scan: IntArray) -> FloatArray:
        """Return the values (n,) at scans (n,), so many `times` (m,) of each of the curves `used` (m,)."""
        place = np.subtract(scan, np.repeat(self.middle[used], times), dtype=np.float64)
        place *= np.repeat(self.per_scan[used], times)
        value = np.repeat(self.coefficients[-1, used], times)
        for coefficient in self.coefficients[-2::-1]:
            value *= place
            value += np.repeat(coefficient[used], times)
        return value


def _scaled(scan: IntArray) -> tuple[FloatArray, FloatArray]:
    return 0.5 * (scan[0] + scan[-1]), 2.0 / np.maximum(scan[-1] - scan[0], 1)
