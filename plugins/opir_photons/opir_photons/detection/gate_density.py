"""Density of detections by ratio gates over the signal y of the reference band, and its integrals.

The density is the normal density of y about the expected signal, times the probability of every
other band to pass the gate that y opens. It is log-concave: it has one peak, and decreases faster
than the normal density on either side. Integrals and their inverses are evaluated on Gauss-Legendre
panels, one interval per row, from logarithms of densities.
"""

from collections.abc import Iterator
from functools import cache

import numpy as np
from attrs import frozen
from numpy.polynomial import legendre
from scipy.special import log_ndtr

from opir_core.arrays import FloatArray, IntArray
from opir_photons.detection.gate_integrals import Gates, crossing
from opir_photons.radiometry import quadrature

#: Nodes per panel.
ORDER = 16

_NODES, _WEIGHTS = quadrature.legendre(ORDER)


@cache
def _to_integral() -> FloatArray:
    """Return the matrix from values at the nodes to the Legendre coefficients of the integral from
    the panel's start: exact for polynomials up to the panel's order.
    """
    to_coefficients = [
        legendre.legval(_NODES, unit) * _WEIGHTS * (k + 0.5) for k, unit in enumerate(np.eye(ORDER))
    ]
    return np.array(
        [legendre.legint(column, lbnd=-1.0) for column in np.transpose(to_coefficients)]
    ).T


@frozen(eq=False)
class Panels:
    """Panels between `edges` (n, panels + 1), ascending; nodes are (n, panels · ORDER)."""

    edges: FloatArray

    @classmethod
    def over(cls, start: FloatArray, stop: FloatArray, count: int, kinks: FloatArray) -> "Panels":
        """Return `count` equal panels over intervals (n,), divided further at the kinks (n, k)."""
        equal = start[:, None] + (stop - start)[:, None] * (np.arange(count + 1) / count)
        inside = np.clip(kinks, start[:, None], stop[:, None])
        return cls(np.sort(np.concatenate([equal, inside], axis=1), axis=1))

    def nodes(self) -> FloatArray:
        """Return the nodes."""
        width = np.diff(self.edges, axis=1)[:, :, None]
        nodes: FloatArray = self.edges[:, :-1, None] + width * (0.5 * (_NODES + 1.0))
        return nodes.reshape(len(self.edges), -1)

    def integral(self, values: FloatArray) -> FloatArray:
        """Return the integrals (n,) of functions with values (n, panels · ORDER) at the nodes."""
        integrals = self._of_panels(values)
        total = integrals[:, 0].copy()
        for panel in range(1, integrals.shape[1]):
            total += integrals[:, panel]
        return total

    def inverse(self, values: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return the points (n,) up to which the integral of non-negative values is the share
        `uniforms` (n,).
        """
        cumulative = np.cumsum(self._of_panels(values), axis=1)
        level = uniforms * cumulative[:, -1]
        panel = np.minimum((level[:, None] >= cumulative).sum(axis=1), cumulative.shape[1] - 1)
        rows = np.arange(len(panel))
        remainder = level - np.where(panel > 0, cumulative[rows, panel - 1], 0.0)
        inside = values.reshape(len(panel), -1, ORDER)[rows, panel]
        start = self.edges[rows, panel]
        width = self.edges[rows, panel + 1] - start
        with np.errstate(invalid="ignore", divide="ignore"):
            place = _solved(inside, remainder / (0.5 * width))
        return start + width * 0.5 * (place + 1.0)

    def _of_panels(self, values: FloatArray) -> FloatArray:
        shaped = values.reshape(len(values), -1, ORDER)
        total = shaped[:, :, 0] * _WEIGHTS[0]
        for node in range(1, ORDER):
            total += shaped[:, :, node] * _WEIGHTS[node]
        return total * (0.5 * np.diff(self.edges, axis=1))


def _solved(inside: FloatArray, integral: FloatArray) -> FloatArray:
    """Return the points in [-1, 1] up to which values (n, ORDER) have an integral (n,)."""
    low = np.full(len(integral), -1.0)
    high = np.ones(len(integral))
    coefficients = (inside[:, None, :] * _to_integral()[None, :, :]).sum(axis=2).T
    for _ in range(52):
        middle = 0.5 * (low + high)
        is_below = legendre.legval(middle, coefficients, tensor=False) < integral
        low = np.where(is_below, middle, low)
        high = np.where(is_below, high, middle)
    return 0.5 * (low + high)


#: Standard deviations beyond which a normal tail is below the last bit of 1.
FAR = 9.0
#: Panels for gates no steeper than the noise, and the largest number of doublings for steeper ones.
_PANELS = 3
_MAX_DOUBLINGS = 5
LOG_HALF = float(np.log(0.5))


def by_steepness(steepest: FloatArray) -> Iterator[tuple[IntArray, int]]:
    """Yield rows with the number of panels for their steepest gate."""
    doublings = np.clip(np.ceil(np.log2(steepest)), 0, _MAX_DOUBLINGS).astype(np.int64)
    for times in range(_MAX_DOUBLINGS + 1):
        rows = np.flatnonzero(doublings == times)
        if len(rows):
            yield rows, _PANELS << times


def log_integral(panels: Panels, log_values: FloatArray) -> FloatArray:
    """Return the logarithms (n,) of integrals of values given by their logarithms."""
    peak = log_values.max(axis=1)
    scale = np.where(np.isfinite(peak), peak, 0.0)
    with np.errstate(divide="ignore"):
        logarithm: FloatArray = scale + np.log(panels.integral(np.exp(log_values - scale[:, None])))
    return logarithm


def log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return ln(Q(low) - Q(high)), of normal tails; -inf where low >= high."""
    result = np.where(low < high, 0.0, -np.inf)
    edges = np.nonzero((low < high) & ((low > -FAR) | (high < FAR)))
    low = low[edges]
    high = high[edges]
    is_left = low + high < 0.0
    larger = np.where(is_left, high, -low)
    result[edges] = _log_difference(larger, np.where(is_left, low, -high))
    return result


def _log_difference(larger: FloatArray, smaller: FloatArray) -> FloatArray:
    """Return ln(Φ(larger) - Φ(smaller)) of the normal distribution Φ."""
    log_larger = log_ndtr(larger)
    fall = np.full(len(larger), -np.inf)
    close = np.flatnonzero(smaller > np.minimum(larger, 0.0) - FAR)
    fall[close] = np.minimum(log_ndtr(smaller[close]) - log_larger[close], 0.0)
    return log_larger + _log_complement(fall)


def _log_complement(log_share: FloatArray) -> FloatArray:
    """Return ln(1 - exp(x)), for x up to 0."""
    with np.errstate(divide="ignore"):
        return np.where(
            log_share < LOG_HALF, np.log1p(-np.exp(log_share)), np.log(-np.expm1(log_share))
        )


#: Decrease of a density's logarithm beyond which it is negligible.
_DROP = 39.0
#: Golden-section steps of the search for the peak, and share of an interval that each leaves.
_SECTIONS = 36
_GOLDEN = (5.0**0.5 - 1.0) / 2.0


@frozen(eq=False)
class GateDensity:
    """Densities of detections by a `rule`, for looks with expected signals `snr` (n, B) and slopes
    (n, 2 (B - 1)).
    """

    rule: Gates
    snr: FloatArray
    slopes: FloatArray

    def take(self, rows: IntArray) -> "GateDensity":
        """Return the densities of some of the looks."""
        return GateDensity(self.rule, self.snr[rows], self.slopes[rows])

    def logarithms(self, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the logarithms of the normal density at nodes (n, m) and of the probability to
        pass the gates.
        """
        log_gates = np.zeros_like(nodes)
        for band in self.rule.others:
            low, high = self.rule.gate(nodes, self.slopes, band)
            log_gates += log_between(low - self.snr[:, band, None], high - self.snr[:, band, None])
        off = nodes - self._expected[:, None]
        return -0.5 * off * off - 0.5 * np.log(2.0 * np.pi), log_gates

    def panels(self, count: int, ajar: float) -> Panels:
        """Return panels over all y of non-negligible density.

        The peak is searched where gates are shut by more than `ajar` standard deviations at their
        first opening.
        """
        opening = self._first_open()
        peak = np.maximum(self._expected, opening)
        shut = np.flatnonzero(self._gate_margin(peak) < ajar)
        peak[shut] = self.take(shut)._peak()
        # Distance of a decrease by exp(-_DROP); beyond the expected signal the density decreases
        # from the start.
        falling = np.where(peak <= opening, np.maximum(peak - self._expected, 0.0), 0.0)
        reach = 2.0 * _DROP / (np.sqrt(falling * falling + 2.0 * _DROP) + falling)
        # Near the opening of the gates the density may decrease much faster.
        edge = shut[peak[shut] - opening[shut] < reach[shut]]
        reach[edge] = self.take(edge)._fallen(peak[edge], reach[edge])
        start = np.maximum(opening, peak - np.sqrt(2.0 * _DROP))
        kinks = self._kinks()
        if count == _PANELS << _MAX_DOUBLINGS:
            kinks = np.hstack([kinks, self._crossings()])
        return Panels.over(start, np.maximum(peak + reach, start), count, kinks)

    @property
    def _expected(self) -> FloatArray:
        return self.snr[:, self.rule.reference]

    def _fallen(self, peak: FloatArray, reach: FloatArray) -> FloatArray:
        """Return the distances (n,) from the peak to negligible density, to a factor of 2, within
        `reach`.
        """
        distances = reach[:, None] * np.exp2(-np.arange(40))
        nodes = np.concatenate([peak[:, None], peak[:, None] + distances], axis=1)
        base, gates = self.logarithms(nodes)
        height = base + gates
        times = (height[:, 1:] < height[:, :1] - _DROP).sum(axis=1)
        return reach * np.exp2(-np.maximum(times - 1, 0))

    def _first_open(self) -> FloatArray:
        """Return the least signal (n,) of the reference band, at least the threshold, for which all
        gates are open.
        """
        least = np.full(len(self.snr), self.rule.threshold)
        for band in self.rule.others:
            _, upper = self._where(np.full((len(least), 1), self.rule.coincidence), band)
            least = np.maximum(least, upper[:, 0])
        return least

    def _kinks(self) -> FloatArray:
        """Return the signals (n, others) at which lower sides change from the coincidence threshold
        to the ratio.
        """
        level = np.full((len(self.snr), 1), self.rule.coincidence)
        return np.concatenate([self._where(level, band)[0] for band in self.rule.others], axis=1)

    def _crossings(self) -> FloatArray:
        """Return signals (n, k) of the reference band around which sides of gates open and shut;
        -inf for no side.
        """
        margins = np.arange(-9.0, 10.0, 3.0)
        sides: list[FloatArray] = []
        for band in self.rule.others:
            sides += self._where(self.snr[:, band, None] + margins, band)
        return np.concatenate(sides, axis=1)

    def _where(self, level: FloatArray, band: int) -> tuple[FloatArray, FloatArray]:
        """Return the signals (n, k) of the reference band with the sides of a gate at levels (n,
        k); -inf if never.
        """
        lower, upper = (slope[:, None] for slope in self.rule.sides(self.slopes, band))
        tolerance = self.rule.tolerance
        return crossing(level, lower, -tolerance), crossing(level, upper, tolerance)

    def _gate_margin(self, reference: FloatArray) -> FloatArray:
        """Return the margins (n,) of expected signals inside the gates, for signals of the
        reference band.
        """
        margin = np.full(len(reference), np.inf)
        for band in self.rule.others:
            low, high = self.rule.gate(reference, self.slopes, band)
            expected = self.snr[:, band]
            margin = np.minimum(margin, np.minimum(expected - low, high - expected))
        return margin

    def _peak(self) -> FloatArray:
        """Return the peak (n,) of the density, by golden section."""
        low = self._first_open()
        high = self._beyond_peak(low)
        rows = np.arange(len(self.snr))
        # Wide intervals, of over a hundred deviations, take further steps.
        for step in range(80):
            if step == _SECTIONS:
                rows = np.flatnonzero(high - low > 100.0 * _GOLDEN**_SECTIONS)
            if not len(rows):
                break
            low[rows], high[rows] = self.take(rows)._narrowed(low[rows], high[rows])
        return 0.5 * (low + high)

    def _beyond_peak(self, opening: FloatArray) -> FloatArray:
        """Return signals (n,) of the reference band above the peak of the density."""
        high = np.maximum(self._expected, opening) + 1.0
        for band in self.rule.others:
            least = np.maximum(self.snr[:, band, None], self.rule.coincidence)
            high = np.maximum(high, self._where(least, band)[1][:, 0] + 1.0)
        return high

    def _narrowed(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parts of the intervals (n,) that contain the peak."""
        inner = high - (high - low) * _GOLDEN
        outer = low + (high - low) * _GOLDEN
        base, gates = self.logarithms(np.stack([inner, outer], axis=1))
        # If both logarithms are -inf, the larger y is the better one.
        is_rising = ~(base[:, 0] + gates[:, 0] > base[:, 1] + gates[:, 1])
        return np.where(is_rising, inner, low), np.where(is_rising, high, outer)
