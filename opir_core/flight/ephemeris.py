"""Trajectories and orbits as piecewise quintic polynomials: fitted once to a tolerance, evaluated
in bulk.

A segment interpolates position and velocity of the motion at its ends and its middle (Hermite), so
that neighbours agree in both. Its error is estimated at six points between the nodes; a segment
with too large an error is split. Evaluation is element by element: a result depends on its own
target and time alone.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, RowArray
from opir_core.errors import ModelError
from opir_core.flight.rows import TrailingRows
from opir_core.geometry.vectors import FloatPair, floats

#: Targets (m,) and times (m,) to positions and velocities (m, 3), element by element.
Motion = Callable[[RowArray, FloatArray], FloatPair]

#: Points of error estimation: the extremes of (x³ - x)², the error of a smooth motion, and 0.71,
#: where that of a motion with a power 3/2 at an end is largest; the true largest error is within 5
#: % of the largest there.
_ERROR_NODES = np.array([-0.71, -(3.0**-0.5), -0.25, 0.25, 3.0**-0.5, 0.71])


#: Segments fitted in one call of the motion.
_FIT_BLOCK = 1024


@frozen(eq=False, repr=False)
class HermiteSegments(TrailingRows):
    """Polynomial segments of trajectories, sorted by target, then time.

    Columns (s,): `target`, and the span `start_s` to `end_s`. Position is the sum of
    `coefficients[5 - k]` (6, 3, s) times x^k, where x runs from -1 to 1 over the span.
    """

    target: RowArray
    start_s: FloatArray
    end_s: FloatArray
    coefficients: FloatArray

    def __len__(self) -> int:
        return len(self.target)


def merged_segments(groups: Sequence[HermiteSegments]) -> HermiteSegments:
    """Return the segments of all parts, sorted by target, then time."""
    merged = HermiteSegments.concatenate(groups)
    return merged.take(np.lexsort((merged.start_s, merged.target)))


def fitted_segments(
    motion: Motion, target: RowArray, start_s: FloatArray, end_s: FloatArray, tolerance_m: float
) -> HermiteSegments:
    """Return segments that fit the motion of the targets over the spans (m,) to within the
    tolerance.

    A motion that is not finite within a span, or too rough for the tolerance, is a `ModelError`.
    """
    done = []
    # Rounds of splitting after which a fit is rejected: segments are then at most 2^-40 of the
    # span.
    for _ in range(40):
        coefficients = np.empty((6, 3, len(target)))
        error_m = np.empty(len(target))
        for start in range(0, len(target), _FIT_BLOCK):
            rows = slice(start, start + _FIT_BLOCK)
            coefficients[..., rows], error_m[rows] = _fit_block(
                motion, target[rows], start_s[rows], end_s[rows]
            )
        # A segment is accepted if its estimated error is at most this share of the tolerance; a
        # split aims for half of it.
        fits = error_m <= 0.8 * tolerance_m
        done.append(
            HermiteSegments(target, start_s, end_s, coefficients).take(np.flatnonzero(fits))
        )
        if fits.all():
            return merged_segments(done)
        # Split into 2 to 8 parts: a smooth motion's error has the sixth power of length.
        counts = (
            np.ceil((error_m[~fits] / (0.5 * tolerance_m)) ** (1.0 / 6.0))
            .clip(2, 8)
            .astype(np.intp)
        )
        target, start_s, end_s = _split(target[~fits], start_s[~fits], end_s[~fits], counts)
    raise ModelError(
        f"the motion of target {target[0]} near {start_s[0]} s cannot be followed to within"
        f" {tolerance_m} m"
    )


def _split(
    target: RowArray, start_s: FloatArray, end_s: FloatArray, counts: RowArray
) -> tuple[RowArray, FloatArray, FloatArray]:
    """Return spans cut into numbers of equal parts."""
    parent = np.repeat(np.arange(len(counts)), counts)
    rank = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts)
    of = counts[parent]
    step_s = (end_s - start_s)[parent] / of
    edges = (start_s[parent] + rank * step_s, start_s[parent] + (rank + 1) * step_s)
    return target[parent], edges[0], np.where(rank + 1 == of, end_s[parent], edges[1])


def _fit_block(
    motion: Motion, target: RowArray, start_s: FloatArray, end_s: FloatArray
) -> FloatPair:
    middle_s = 0.5 * (start_s + end_s)
    half_s = 0.5 * (end_s - start_s)
    times_s = np.stack([start_s, middle_s, end_s, *(middle_s + x * half_s for x in _ERROR_NODES)])
    position, velocity = _sampled(motion, target, times_s)
    coefficients = _hermite_quintic(position[:3], velocity[:3] * half_s)
    error = np.zeros(len(target))
    for x, exact in zip(_ERROR_NODES, position[3:], strict=True):
        miss = horner(coefficients, x) - exact
        error = np.maximum(error, np.sqrt(miss[0] ** 2 + miss[1] ** 2 + miss[2] ** 2))
    return coefficients, error


def _sampled(motion: Motion, target: RowArray, times_s: FloatArray) -> list[FloatArray]:
    """Return positions and velocities (k, 3, m) at times (k, m); `ModelError` where they are not
    finite.
    """
    states = motion(np.tile(target, len(times_s)), times_s.ravel())
    finite = np.isfinite(states).all(axis=(0, 2))
    if not finite.all():
        row = int(np.argmin(finite))
        raise ModelError(
            f"the motion of target {target[row % len(target)]} is not finite at {times_s.flat[row]}"
            f" s"
        )
    return [column.reshape(*times_s.shape, 3).mT for column in states]


def horner(coefficients: FloatArray, x: float) -> FloatArray:
    """Return polynomials with coefficients (6, ...), highest power first, at x."""
    value: FloatArray = coefficients[0]
    for coefficient in coefficients[1:]:
        value = value * x + coefficient
    return value


def _hermite_quintic(p: FloatArray, d: FloatArray) -> FloatArray:
    """Return coefficients of the quintic with values p and derivatives d (3, ...) at -1, 0 and
    1.
    """
    even = 0.5 * (p[2] + p[0]) - p[1]
    odd = 0.5 * (p[2] - p[0])
    even_slope = 0.5 * (d[2] - d[0])
    odd_slope = 0.5 * (d[2] + d[0])
    c4 = 0.5 * even_slope - even
    c5 = 0.5 * odd_slope + d[1] - 1.5 * odd
    return np.stack([c5, c4, odd - d[1] - c5, even - c4, d[1], p[1]])


#: Points evaluated per block, few enough to stay in the cache.
_BLOCK = 65536

#: Bins of the time lookup per segment.
_BINS_PER_SEGMENT = 16


#: Breakpoints closer than this to another, or to an end, count as the same: an orbital velocity
#: covers 8 um in it.
_ONE_BREAK_S = 1e-9

#: From columns (..., s) over segments or targets to columns (..., m) over points.
_Spread = Callable[[Any], Any]


@frozen(eq=False)
class Ephemeris:
    """Positions of n targets in their spans `start_s` to `end_s` (n,), to `tolerance_m`; nan
    outside.

    The frame is that of the motion it was built from. Position and velocity are continuous within a
    span. Velocities are the derivatives of those positions: at 1 cm, within 1 mm/s in free flight
    and 2 cm/s on a boost, but for the second after pitch-over (0.6 m/s).
    """

    start_s: FloatArray
    end_s: FloatArray
    tolerance_m: float
    segments: HermiteSegments
    #: By target: start, end and lookup bins a second (3, n), and the first bin (n,); by bin: the
    #: first segment in it.
    _spans: FloatArray
    _first_bin: RowArray
    _bin_segment: RowArray
    #: By segment: when the next one starts, inf at the last (s,); middle time and 2/length (2, s).
    _next_s: FloatArray
    _scales: FloatArray

    def __len__(self) -> int:
        return len(self.start_s)

    @staticmethod
    def build(
        motion: Motion,
        start_s: ArrayLike,
        end_s: ArrayLike,
        breakpoints_s: ArrayLike | None = None,
        tolerance_m: float = 0.01,
    ) -> "Ephemeris":
        """Return the ephemeris of a motion over spans (n,) of a length above zero.

        `motion(target, time_s)` takes index and time columns (m,) and returns positions and
        velocities (m, 3), element by element. `breakpoints_s` (n, k) are times at which it is not
        smooth; those outside a span are ignored. `ModelError` for a motion that is not finite, or
        too rough for the tolerance.
        """
        start, end = np.broadcast_arrays(*(np.atleast_1d(floats(v)) for v in (start_s, end_s)))
        if not (np.isfinite(start) & np.isfinite(end) & (start < end)).all():
            raise ValueError("every span of an ephemeris must start before it ends")
        if not tolerance_m > 0.0:
            raise ValueError(
                f"the tolerance of an ephemeris must be above zero, not {tolerance_m} m"
            )
        inner = np.empty((len(start), 0)) if breakpoints_s is None else floats(breakpoints_s)
        cuts = _cuts_s(start[:, None], inner, end[:, None])
        target, gap = np.nonzero(cuts[:, :-1] < cuts[:, 1:])
        lower = cuts[target, gap]
        upper = cuts[target, gap + 1]
        return _indexed(fitted_segments(motion, target, lower, upper, tolerance_m), tolerance_m)

    @staticmethod
    def joined(ephemerides: Sequence["Ephemeris"]) -> "Ephemeris":
        """Return the ephemeris of targets from consecutive parts of their spans."""
        for ephemeris, continuation in pairwise(ephemerides):
            if not np.array_equal(ephemeris.end_s, continuation.start_s):
                raise ValueError(
                    "each part of a joined ephemeris must start when the one before it ends"
                )
        return _indexed(
            merged_segments([ephemeris.segments for ephemeris in ephemerides]),
            max(ephemeris.tolerance_m for ephemeris in ephemerides),
        )

    def position_m(self, target: ArrayLike, time_s: ArrayLike) -> FloatArray:
        """Return positions (..., 3) of targets at times, which broadcast; nan outside a target's
        span.
        """
        return self._evaluated(target, time_s, (_position,))[0]

    def state(self, target: ArrayLike, time_s: ArrayLike) -> FloatPair:
        """Return positions (..., 3), m, and velocities (..., 3), m/s, of targets at times, which
        broadcast.
        """
        position, velocity = self._evaluated(target, time_s, (_position, _velocity))
        return position, velocity

    def _evaluated(
        self, target: ArrayLike, time_s: ArrayLike, columns: "Sequence[_Column]"
    ) -> list[FloatArray]:
        """Return one (..., 3) array for each of the columns, computed block by block."""
        rows, times = np.broadcast_arrays(np.asarray(target), floats(time_s))
        if rows.size and not (rows.min() >= 0 and rows.max() < len(self)):
            raise IndexError(f"target index outside 0 to {len(self) - 1}")
        shape = rows.shape
        rows = rows.reshape(-1)
        times = times.reshape(-1)
        out = [np.empty((len(rows), 3)) for _ in columns]
        for start in range(0, len(rows), _BLOCK):
            block = slice(start, start + _BLOCK)
            spread, x = self._located(rows[block].astype(np.intp, copy=False), times[block])
            for array, column in zip(out, columns, strict=True):
                for axis, values in enumerate(column(self, spread, x)):
                    array[block, axis] = values
        return [array.reshape(*shape, 3) for array in out]

    def _located(self, target: RowArray, time_s: FloatArray) -> tuple[_Spread, FloatArray]:
        """Return the function from segments to points, and times in segments: -1 to 1, nan outside
        the span.
        """
        of_target = _spread(target)
        start_s, end_s, bins_per_s = of_target(self._spans)
        inside = (time_s >= start_s) & (time_s <= end_s)
        everywhere = bool(inside.all())
        time_s = time_s if everywhere else np.where(inside, time_s, start_s)
        bin_ = ((time_s - start_s) * bins_per_s).astype(np.intp)
        bin_ += of_target(self._first_bin)
        spread = _spread(self._stepped(self._bin_segment.take(bin_), time_s))
        middle_s, per_half_length = spread(self._scales)
        x = (time_s - middle_s) * per_half_length
        return spread, x if everywhere else np.where(inside, x, np.nan)

    def _stepped(self, segment: RowArray, time_s: FloatArray) -> RowArray:
        """Return the segments that contain the times, from the first segments in their lookup
        bins.
        """
        rows = (time_s >= self._next_s.take(segment)).nonzero()[0]
        while rows.size:
            segment[rows] += 1
            rows = rows[time_s[rows] >= self._next_s[segment[rows]]]
        return segment


def _cuts_s(start_s: FloatArray, inner_s: FloatArray, end_s: FloatArray) -> FloatArray:
    """Return the times (n, k + 2) at which spans are cut, ascending; breakpoints (n, k) outside a
    span, or close to another or to an end, fall on that.
    """
    inner_s = np.clip(inner_s, start_s, end_s)
    cuts = np.sort(np.concatenate([start_s, inner_s, end_s], axis=1), axis=1)
    _join_close(cuts)
    cuts[:, 1:-1] = np.where(end_s - cuts[:, 1:-1] < _ONE_BREAK_S, end_s, cuts[:, 1:-1])
    return cuts


def _join_close(cuts: FloatArray) -> None:
    """Move each cut (n, k) but the last onto the one before it where they count as the same, from
    the first on.
    """
    step = np.diff(cuts[:, :-1], axis=1)
    rows = np.flatnonzero(((step > 0.0) & (step < _ONE_BREAK_S)).any(axis=1))
    moved = cuts[rows]
    for later in (np.flatnonzero((step[rows] < _ONE_BREAK_S).any(axis=0)) + 1).tolist():
        is_close = moved[:, later] - moved[:, later - 1] < _ONE_BREAK_S
        moved[:, later] = np.where(is_close, moved[:, later - 1], moved[:, later])
    cuts[rows] = moved


_Column = Callable[[Ephemeris, _Spread, FloatArray], FloatArray]


def _position(ephemeris: Ephemeris, spread: _Spread, x: FloatArray) -> FloatArray:
    """Return positions (3, m), by Horner's rule."""
    leading, *coefficients = ephemeris.segments.coefficients
    value: FloatArray = spread(leading)
    for coefficient in coefficients:
        value *= x
        value += spread(coefficient)
    return value


def _velocity(ephemeris: Ephemeris, spread: _Spread, x: FloatArray) -> FloatArray:
    """Return velocities (3, m): the derivative by Horner's rule, from x to time."""
    leading, *coefficients = ephemeris.segments.coefficients[:-1]
    value: FloatArray = 5.0 * spread(leading)
    for power, coefficient in zip((4.0, 3.0, 2.0, 1.0), coefficients, strict=True):
        value *= x
        value += power * spread(coefficient)
    value *= spread(ephemeris._scales[1])
    return value


def _spread(index: RowArray) -> _Spread:
    """Return the function that takes columns at these indices; long runs of an index are repeated,
    not gathered.
    """
    edges = (index[1:] != index[:-1]).nonzero()[0]
    # Runs of equal indices at least this long, on average, are repeated rather than gathered; the
    # values are the same.
    if 4 * (len(edges) + 1) > len(index):
        return lambda columns: columns.take(index, axis=-1)
    ends = np.append(edges, len(index) - 1)
    heads = index[ends]
    counts = ends.copy()
    counts[1:] -= ends[:-1]
    counts[0] += 1
    return lambda columns: columns.take(heads, axis=-1).repeat(counts, axis=-1)


def _indexed(segments: HermiteSegments, tolerance_m: float) -> Ephemeris:
    """Return the ephemeris of segments sorted by target and time, with the first segment in each
    lookup bin.

    Bins are uniform; one more than fit into the span catches its very end.
    """
    head = np.flatnonzero(np.diff(segments.target, prepend=-1))
    count = np.diff(head, append=len(segments))
    tail = head + count - 1
    start_s = segments.start_s[head]
    end_s = segments.end_s[tail]
    bins_per_s = _BINS_PER_SEGMENT * count / (end_s - start_s)
    bins = _BINS_PER_SEGMENT * count + 1
    first_bin = np.cumsum(bins) - bins
    earliest = np.ceil(
        (segments.start_s - start_s[segments.target]) * bins_per_s[segments.target]
    ).astype(np.intp)
    bin_segment = np.zeros(bins.sum(), dtype=np.intp)
    np.maximum.at(bin_segment, first_bin[segments.target] + earliest, np.arange(len(segments)))
    spans = np.stack([start_s, end_s, bins_per_s])
    next_s = segments.end_s.copy()
    next_s[tail] = np.inf
    scales = np.stack(
        [0.5 * (segments.start_s + segments.end_s), 2.0 / (segments.end_s - segments.start_s)]
    )
    first_segment = np.maximum.accumulate(bin_segment)
    return Ephemeris(
        start_s, end_s, tolerance_m, segments, spans, first_bin, first_segment, next_s, scales
    )
