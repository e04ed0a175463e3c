"""Quintic pieces of a motion, fitted to a tolerance.

A piece takes position and velocity of the motion at its two ends and its middle (Hermite interpolation), so neighbours
agree in both. Its error is judged at six points between the nodes; a piece that errs too much is split.
"""

from collections.abc import Callable, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.errors import ModelError

#: Targets (m,) and times (m,) to positions and velocities (m, 3), element by element.
Motion = Callable[[RowArray, FloatArray], tuple[FloatArray, FloatArray]]

#: Where a fit is judged: at the extremes of (x³ - x)², the error of a smooth motion, and where that of one which bends
#: like the power 3/2 at an end is largest (0.71); the true largest error is within 5 % of the largest found there.
_JUDGED_AT = np.array([-0.71, -(3.0**-0.5), -0.25, 0.25, 3.0**-0.5, 0.71])

#: A piece is kept if its judged error is at most this share of the tolerance; parts of a split one aim for half of it.
_MARGIN = 0.8

#: Pieces fitted in one call of the motion.
_BLOCK = 1024

#: Rounds of splitting after which a tolerance is out of reach: pieces have become 2^-40 of the span, or less.
_ROUNDS = 40


@frozen(eq=False)
class Pieces:
    """Polynomial pieces of trajectories, sorted by target, then time.

    Columns (s,): `target`, and the span `start_s` to `end_s`. Position is the sum of `coefficients[5 - k]` (6, 3, s)
    times x^k, where x runs from -1 to 1 over the span.
    """

    target: RowArray
    start_s: FloatArray
    end_s: FloatArray
    coefficients: FloatArray

    def __len__(self) -> int:
        return len(self.target)

    def take(self, rows: RowArray) -> "Pieces":
        """Return some of the pieces."""
        return Pieces(self.target[rows], self.start_s[rows], self.end_s[rows], self.coefficients.take(rows, axis=-1))


def merged_pieces(parts: Sequence[Pieces]) -> Pieces:
    """Return the pieces of all parts, sorted by target, then time."""
    merged = Pieces(
        np.concatenate([part.target for part in parts]),
        np.concatenate([part.start_s for part in parts]),
        np.concatenate([part.end_s for part in parts]),
        np.concatenate([part.coefficients for part in parts], axis=-1),
    )
    return merged.take(np.lexsort((merged.start_s, merged.target)))


def fitted_pieces(
    motion: Motion, target: RowArray, start_s: FloatArray, end_s: FloatArray, tolerance_m: float
) -> Pieces:
    """Return pieces that follow the motion of the targets over the spans (m,) to within the tolerance.

    A motion that is not finite within a span, or too rough for the tolerance, is a `ModelError`.
    """
    done = []
    for _ in range(_ROUNDS):
        coefficients, error_m = _fit(motion, target, start_s, end_s)
        fits = error_m <= _MARGIN * tolerance_m
        done.append(Pieces(target, start_s, end_s, coefficients).take(np.flatnonzero(fits)))
        if fits.all():
            return merged_pieces(done)
        parts = _part_counts(error_m[~fits], tolerance_m)
        target, start_s, end_s = _split(target[~fits], start_s[~fits], end_s[~fits], parts)
    raise ModelError(
        f"the motion of target {target[0]} near {start_s[0]} s cannot be followed to within {tolerance_m} m"
    )


def _part_counts(error_m: FloatArray, tolerance_m: float) -> RowArray:
    """Return into how many parts to cut pieces, 2 to 8: a smooth motion's error goes with the sixth power of length."""
    return np.ceil((error_m / (0.5 * tolerance_m)) ** (1.0 / 6.0)).clip(2, 8).astype(np.intp)


def _split(
    target: RowArray, start_s: FloatArray, end_s: FloatArray, parts: RowArray
) -> tuple[RowArray, FloatArray, FloatArray]:
    """Return spans cut into so many equal parts."""
    parent = np.repeat(np.arange(len(parts)), parts)
    rank = np.arange(len(parent)) - np.repeat(np.cumsum(parts) - parts, parts)
    of = parts[parent]
    step_s = (end_s - start_s)[parent] / of
    edges = (start_s[parent] + rank * step_s, start_s[parent] + (rank + 1) * step_s)
    return target[parent], edges[0], np.where(rank + 1 == of, end_s[parent], edges[1])


def _fit(motion: Motion, target: RowArray, start_s: FloatArray, end_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return coefficients (6, 3, m) of the pieces over spans (m,), and their judged errors (m,), m."""
    coefficients, error_m = np.empty((6, 3, len(target))), np.empty(len(target))
    for first in range(0, len(target), _BLOCK):
        rows = slice(first, first + _BLOCK)
        coefficients[..., rows], error_m[rows] = _fit_block(motion, target[rows], start_s[rows], end_s[rows])
    return coefficients, error_m


def _fit_block(
    motion: Motion, target: RowArray, start_s: FloatArray, end_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    middle_s, half_s = 0.5 * (start_s + end_s), 0.5 * (end_s - start_s)
    times_s = np.stack([start_s, middle_s, end_s, *(middle_s + x * half_s for x in _JUDGED_AT)])
    position, velocity = motion(np.tile(target, len(times_s)), times_s.ravel())
    finite = (np.isfinite(position) & np.isfinite(velocity)).all(axis=-1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise ModelError(f"the motion of target {target[row % len(target)]} is not finite at {times_s.flat[row]} s")
    p = position.reshape(*times_s.shape, 3).transpose(0, 2, 1)
    d = velocity.reshape(*times_s.shape, 3)[:3].transpose(0, 2, 1) * half_s
    coefficients = _hermite_quintic(p[:3], d)
    error = np.zeros(len(target))
    for x, judged in zip(_JUDGED_AT, p[3:], strict=True):
        miss = horner(coefficients, x) - judged
        error = np.maximum(error, np.sqrt(miss[0] ** 2 + miss[1] ** 2 + miss[2] ** 2))
    return coefficients, error


def horner(coefficients: FloatArray, x: float) -> FloatArray:
    """Return polynomials with coefficients (6, ...), highest power first, at x."""
    value: FloatArray = coefficients[0]
    for coefficient in coefficients[1:]:
        value = value * x + coefficient
    return value


def _hermite_quintic(p: FloatArray, d: FloatArray) -> FloatArray:
    """Return coefficients of the quintic with values p and derivatives d (3, ...) at -1, 0 and 1."""
    even, odd = 0.5 * (p[2] + p[0]) - p[1], 0.5 * (p[2] - p[0])
    even_slope, odd_slope = 0.5 * (d[2] - d[0]), 0.5 * (d[2] + d[0])
    c4 = 0.5 * even_slope - even
    c5 = 0.5 * odd_slope + d[1] - 1.5 * odd
    return np.stack([c5, c4, odd - d[1] - c5, even - c4, d[1], p[1]])
