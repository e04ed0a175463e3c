"""P_d of ratio gates to within 1e-10, many times faster than to the last bit.

The integral over the signal y of the reference band is divided where a side of a gate begins or
ceases to matter: a side with a pass probability within 1e-11 of 0 or 1 is constant, and the
integral with constant sides is a normal one. Between the cuts the integrand is smooth on the scale
of the slopes of the other sides, which determines the number of Gauss-Legendre nodes
(docs/design/gate_nodes.py). No logarithms are used.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from scipy.special import ndtr

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_photons.radiometry.quadrature import legendre

#: Standard deviations beyond which a tail, of 1e-11, is omitted.
_FAR = 6.8

#: Numbers of Gauss-Legendre nodes, and the panel widths up to which they suffice; the last is for
#: four bands.
NODES = np.array([12, 20, 32, 64])
WIDTHS = np.array([5.4, 9.8, 17.7])


@frozen(eq=False)
class Gates:
    """The limits of `opir_photons.detection.RatioGates`."""

    threshold: float
    coincidence: float
    lower: FloatArray
    upper: FloatArray
    tolerance: float = 0.0
    reference: int = 0

    @property
    def others(self) -> list[int]:
        """The numbers of the other bands."""
        return [band for band in range(len(self.lower)) if band != self.reference]

    def slopes(self, noise: FloatArray, air: FloatArray | None = None) -> FloatArray:
        """Return the slopes (n, 2 (B - 1)) of the gates' sides, in units of noise (n, B): lower
        ones, then upper ones.

        `air` (n, 2 (B - 1)) are factors on the bounds: the least and the largest that the
        atmosphere may put on the ratio of two bands.
        """
        bands = self.others
        scale = noise[:, self.reference, None] / noise[:, bands]
        sides = np.concatenate([scale * self.lower[bands], scale * self.upper[bands]], axis=1)
        return sides if air is None else sides * air

    def sides(self, slopes: FloatArray, band: int) -> tuple[FloatArray, FloatArray]:
        """Return the slopes (n,) of the lower and of the upper side of a band's gate."""
        place = self.others.index(band)
        return slopes[:, place], slopes[:, len(self.lower) - 1 + place]

    def gate(
        self, reference: FloatArray, slopes: FloatArray, band: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return the limits of the open gate of a band, for signals (n, …) of the reference
        band.
        """
        shape = (-1, *(1 for _ in reference.shape[1:]))
        lower, upper = (slope.reshape(shape) for slope in self.sides(slopes, band))
        low = lower * reference - self.tolerance * np.hypot(1.0, lower)
        # Without an upper bound 0 · inf is nan.
        with np.errstate(invalid="ignore"):
            high = upper * reference + self.tolerance * np.hypot(1.0, upper)
        return np.maximum(low, self.coincidence), np.where(np.isfinite(upper), high, np.inf)


def crossing(level: FloatArray, slope: FloatArray, tolerance: FloatArray | float) -> FloatArray:
    """Return the points at which sides slope · y + tolerance · √(1 + slope²) reach levels; -inf
    without a bound.
    """
    is_bound = (slope > 0.0) & np.isfinite(slope)
    bound = np.where(is_bound, slope, 1.0)
    return np.where(is_bound, (level - tolerance * np.hypot(1.0, bound)) / bound, -np.inf)


class GateLooks(NamedTuple):
    """Expected signals (n,) and (others, n); slopes of the gates' sides (others, n), and their
    varying ranges.

    A lower side varies from `low_from` on, an upper one up to `high_until`; the slope of constant
    sides is 0.
    """

    reference: FloatArray
    expected: FloatArray
    low: FloatArray
    high: FloatArray
    low_from: FloatArray
    high_until: FloatArray
    start: FloatArray
    stop: FloatArray


class GatePanels(NamedTuple):
    """Panels (p,) of looks: row of the look, limits, and whether each side (2 · others, p) varies,
    lower sides first.

    `width` is the length in units of the scale of the integrand.
    """

    looks: GateLooks
    row: IntArray
    start: FloatArray
    stop: FloatArray
    moves: BoolArray
    width: FloatArray

    def take(self, rows: IntArray) -> "GatePanels":
        """Return some of the panels."""
        return self._replace(
            row=self.row[rows],
            start=self.start[rows],
            stop=self.stop[rows],
            moves=self.moves[:, rows],
            width=self.width[rows],
        )


def fast_probability(
    rule: Gates, snr: FloatArray, slopes: FloatArray, margins: FloatArray
) -> FloatArray:
    """Return P_d (n,) for signals (n, B) and slopes (n, 2 · others) with margins (n, 1 + 3 ·
    others).
    """
    panels = panels_of(looks_of(rule, snr, slopes, margins[:, 1:] < _FAR))
    # Panels without a varying side need no quadrature.
    size = np.searchsorted(WIDTHS, panels.width) * panels.moves.any(axis=0)
    code = (1 << np.arange(len(panels.moves))) @ panels.moves * len(NODES) + size
    chance = np.empty(len(code))
    order = np.argsort(code, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(code[order])) + 1):
        count = int(NODES[size[group[0]]]) if len(group) else 1
        # Few enough nodes at once to stay in the processor's cache.
        step = 16384 // count
        for begin in range(0, len(group), step):
            rows = group[begin : begin + step]
            chance[rows] = _integral(rule, panels.take(rows), count)
    return np.clip(np.bincount(panels.row, chance, minlength=len(snr)), 0.0, 1.0)


def looks_of(
    rule: Gates, snr: FloatArray, slopes: FloatArray, is_uncertain: BoolArray
) -> GateLooks:
    """Return looks with the ranges over which the sides of their gates vary; `is_uncertain` (n, 3 ·
    others) are conditions that may hold or not.
    """
    reference = snr[:, rule.reference]
    expected = snr[:, rule.others].T
    lower = slopes[:, : len(expected)].T
    upper = slopes[:, len(expected) :].T
    low = np.where(is_uncertain[:, 1::3].T, lower, 0.0)
    high = np.where(is_uncertain[:, 2::3].T & np.isfinite(upper), upper, 0.0)
    shut, open_ = (np.maximum(expected + margin, rule.coincidence) for margin in (-_FAR, _FAR))
    low_from, low_until = (_met(level, low, -rule.tolerance, np.inf) for level in (shut, open_))
    high_from, high_until = (_met(level, high, rule.tolerance, -np.inf) for level in (shut, open_))
    start = np.maximum(rule.threshold, reference - _FAR)
    start = np.maximum(start, high_from.max(axis=0, initial=-np.inf))
    # Above a threshold beyond the expected signal the density decreases faster than from its peak.
    falling = np.maximum(start - reference, 0.0)
    reach = _FAR * _FAR / (np.sqrt(falling * falling + _FAR * _FAR) + falling)
    stop = np.minimum(np.maximum(reference, start) + reach, low_until.min(axis=0, initial=np.inf))
    stop = np.maximum(stop, start)
    return GateLooks(reference, expected, low, high, low_from, high_until, start, stop)


def _met(level: FloatArray, slope: FloatArray, tolerance: float, never: float) -> FloatArray:
    """Return the points at which sides reach levels; `never` for a slope of 0."""
    return np.where(slope > 0.0, crossing(level, slope, tolerance), never)


def panels_of(looks: GateLooks) -> GatePanels:
    """Return the panels of looks, divided where sides begin or cease to vary."""
    cuts = np.clip(np.concatenate([looks.low_from, looks.high_until]), looks.start, looks.stop)
    edges = np.sort(np.concatenate([looks.start[None], cuts, looks.stop[None]]), axis=0)
    panel, row = np.nonzero(edges[1:] > edges[:-1])
    start = edges[panel, row]
    stop = edges[panel + 1, row]
    middle = 0.5 * (start + stop)
    moves = np.concatenate([middle > looks.low_from[:, row], middle < looks.high_until[:, row]])
    slopes = np.where(moves, np.concatenate([looks.low, looks.high])[:, row], 0.0)
    width = (stop - start) * np.sqrt(1.0 + np.square(slopes).sum(axis=0))
    return GatePanels(looks, row, start, stop, moves, width)


def _integral(rule: Gates, panels: GatePanels, count: int) -> FloatArray:
    """Return the integrals (p,) over panels in which the same sides vary."""
    passing = ndtr(panels.looks.expected[:, panels.row] - rule.coincidence)
    is_moving = panels.moves[:, 0].reshape(2, -1).any(axis=0)
    if np.any(is_moving):
        half = 0.5 * (panels.stop - panels.start)
        place, weight = legendre(count)
        nodes = 0.5 * (panels.start + panels.stop) + half * place[:, None]
        integral = _summed(_density(rule, nodes, panels, passing), weight) * half
    else:
        reference = panels.looks.reference[panels.row]
        integral = ndtr(reference - panels.start) - ndtr(reference - panels.stop)
    for band in np.flatnonzero(~is_moving):
        integral *= passing[band]
    return integral


def _density(rule: Gates, nodes: FloatArray, panels: GatePanels, passing: FloatArray) -> FloatArray:
    """Return the density (m, p) at nodes (m, p) of signals with other bands inside the gates with a
    varying side.
    """
    looks = panels.looks
    row = panels.row
    off = nodes - looks.reference[row]
    density: FloatArray = np.exp(-0.5 * off * off) * (0.5 / np.pi) ** 0.5
    lows, highs = panels.moves[:, 0].reshape(2, -1)
    for band in np.flatnonzero(lows | highs):
        expected = looks.expected[band, row]
        inside = passing[band]
        if lows[band]:
            low = _side(rule, looks.low[band, row], -1.0, nodes)
            inside = ndtr(expected - low)
        if highs[band]:
            high = _side(rule, looks.high[band, row], 1.0, nodes)
            inside = np.maximum(inside - ndtr(expected - high), 0.0)
        density *= inside
    return density


def _side(rule: Gates, slope: FloatArray, sign: float, nodes: FloatArray) -> FloatArray:
    """Return a side of a gate at nodes (m, p)."""
    side: FloatArray = slope * nodes
    if rule.tolerance:
        side += sign * rule.tolerance * np.hypot(1.0, slope)
    return side


def _summed(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return weighted sums (n,) over nodes (m, n), added node by node: the order does not depend on
    the rows.
    """
    total: FloatArray = values[0] * weight[0]
    for value, share in zip(values[1:], weight[1:].tolist(), strict=True):
        total += value * share
    return total
