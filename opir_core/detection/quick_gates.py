"""The chance of a rule of ratio gates to within 1e-10, several times as fast as to the last bit.

The integral over the signal y of the reference band goes over all y that come oftener than 1e-11, and has only those
sides of gates in it that fail oftener than 1e-11. Nothing is kept by logarithms.
"""

from typing import Protocol

import numpy as np

from opir_core.detection.panels import Panels
from opir_core.records import BoolArray, FloatArray, IntArray

#: So many standard deviations are left out of a tail, of 1e-11.
_FAR = 6.8
#: Panels for gates no steeper than the noise, and how often they are doubled for steep ones.
_PANELS, _MOST_DOUBLINGS = 2, 5
#: Rows integrated at once: few enough for their nodes to stay in the processor's cache.
_ROWS = 512


class Gates(Protocol):
    """A rule of ratio gates: see `opir_core.detection.ratio_gates.RatioGates`."""

    @property
    def threshold(self) -> float:
        """The reference band's threshold."""

    @property
    def coincidence(self) -> float:
        """The other bands' threshold."""

    @property
    def reference(self) -> int:
        """The number of the reference band."""

    @property
    def others(self) -> list[int]:
        """The numbers of the other bands."""

    @property
    def lower(self) -> FloatArray:
        """Least ratios (B,) to the reference band."""

    @property
    def upper(self) -> FloatArray:
        """Greatest ratios (B,) to the reference band."""


def quick_chances(rule: Gates, snr: FloatArray, noise: FloatArray, margins: FloatArray) -> FloatArray:
    """Return P_d (n,) for signals (n, B) in noise (n, B) that meet their conditions by margins (n, 1 + 3 · others)."""
    chance, others = np.empty(len(snr)), rule.others
    near = margins[:, 1:] < _FAR
    steep = np.stack([noise[:, rule.reference] / noise[:, band] for band in others])
    reference = snr[:, rule.reference]
    start = np.maximum(rule.threshold, reference - _FAR)
    for band, each in zip(others, steep, strict=True):
        start = np.maximum(start, _meeting(rule, rule.upper[band], each))
    # Behind a threshold beyond the expected signal the density falls faster than a normal one does from its peak.
    falling = np.maximum(start - reference, 0.0)
    stop = np.maximum(reference, start) + _FAR * _FAR / (np.sqrt(falling * falling + _FAR * _FAR) + falling)
    kinks = np.stack([_meeting(rule, rule.lower[band], each) for band, each in zip(others, steep, strict=True)], axis=1)
    is_bent = np.any((kinks > start[:, None]) & (kinks < stop[:, None]), axis=1)
    code = near @ (1 << np.arange(near.shape[1])) * 16 + 8 * is_bent + _doublings(rule, steep, near)
    order = np.argsort(code, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(code[order])) + 1):
        for first in range(0, len(group), _ROWS):
            rows = group[first : first + _ROWS]
            if not len(rows):
                continue
            count = _PANELS << int(code[rows[0]] % 8)
            bends = kinks[rows] if is_bent[rows[0]] else np.empty((len(rows), 0))
            panels = Panels.over(start[rows], stop[rows], count, bends)
            density = _density(rule, panels.nodes(), snr[rows], steep[:, rows], near[rows[0]])
            chance[rows] = panels.integral(density)
    return np.clip(chance, 0.0, 1.0)


def _density(rule: Gates, nodes: FloatArray, snr: FloatArray, steep: FloatArray, near: BoolArray) -> FloatArray:
    """Return the density (n, m) of signals at nodes (n, m) with all others in their gates, of one kind of rows."""
    from scipy.special import ndtr

    off = nodes - snr[:, rule.reference, None]
    density: FloatArray = np.exp(-0.5 * off * off) * (0.5 / np.pi) ** 0.5
    for place, band in enumerate(rule.others):
        coincident, low, high = near[3 * place : 3 * place + 3]
        expected = snr[:, band, None]
        if low:
            bound = np.maximum(rule.lower[band] * steep[place, :, None] * nodes, rule.coincidence)
            inside = ndtr(expected - bound)
        elif coincident:
            inside = ndtr(expected - rule.coincidence)
        else:
            inside = np.ones((1, 1))
        if high:
            inside = np.maximum(inside - ndtr(expected - rule.upper[band] * steep[place, :, None] * nodes), 0.0)
        density *= inside
    return density


def _doublings(rule: Gates, steep: FloatArray, near: BoolArray) -> IntArray:
    """Return how often panels (n,) are doubled for the slopes of those sides of gates that count."""
    steepest = np.ones(steep.shape[1])
    for place, band in enumerate(rule.others):
        for side, bound in ((1, rule.lower[band]), (2, rule.upper[band])):
            if np.isfinite(bound) and bound > 0.0:
                steepest = np.maximum(steepest, np.where(near[:, 3 * place + side], bound * steep[place], 1.0))
    doublings: IntArray = np.clip(np.ceil(np.log2(steepest)), 0, _MOST_DOUBLINGS).astype(np.int64)
    return doublings


def _meeting(rule: Gates, bound: float, steep: FloatArray) -> FloatArray:
    """Return the signals of the reference band at which a bound on a ratio meets the coincidence threshold."""
    if not (np.isfinite(bound) and bound > 0.0):
        return np.full(len(steep), -np.inf)
    meeting: FloatArray = rule.coincidence / (steep * bound)
    return meeting
