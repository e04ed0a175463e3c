"""Gauss-Legendre panels laid over intervals, one interval a row, and the inverse of what they integrate."""

import numpy as np
from attrs import frozen
from numpy.polynomial import legendre

from opir_core.arrays import FloatArray

#: Nodes in a panel.
ORDER = 16

_NODES, _WEIGHTS = legendre.leggauss(ORDER)

#: From values at the nodes to Legendre coefficients: exact for polynomials up to the panel's order.
_TO_COEFFICIENTS = np.array(
    [legendre.legval(_NODES, unit) * _WEIGHTS * (k + 0.5) for k, unit in enumerate(np.eye(ORDER))]
)
#: From values at the nodes to the coefficients of the integral from the panel's start.
_TO_INTEGRAL = np.array([legendre.legint(column, lbnd=-1.0) for column in _TO_COEFFICIENTS.T]).T

_BISECTIONS = 52


@frozen(eq=False)
class Panels:
    """Panels between `edges` (n, panels + 1), ascending; nodes are (n, panels · ORDER)."""

    edges: FloatArray

    @classmethod
    def over(cls, start: FloatArray, stop: FloatArray, count: int, kinks: FloatArray) -> "Panels":
        """Return `count` panels over intervals (n,), cut once more at each of the kinks (n, k)."""
        equal = start[:, None] + (stop - start)[:, None] * (np.arange(count + 1) / count)
        inside = np.clip(kinks, start[:, None], stop[:, None])
        return cls(np.sort(np.concatenate([equal, inside], axis=1), axis=1))

    def nodes(self) -> FloatArray:
        """Return the nodes."""
        width = np.diff(self.edges, axis=1)[:, :, None]
        nodes: FloatArray = self.edges[:, :-1, None] + width * (0.5 * (_NODES + 1.0))
        return nodes.reshape(len(self.edges), -1)

    def integral(self, values: FloatArray) -> FloatArray:
        """Return the integrals (n,) of what has these values (n, panels · ORDER) at the nodes."""
        parts = self._of_panels(values)
        total = parts[:, 0].copy()
        for panel in range(1, parts.shape[1]):
            total += parts[:, panel]
        return total

    def inverse(self, values: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return where (n,) the integral of non-negative values has grown to shares (n,) of the whole."""
        passed = np.cumsum(self._of_panels(values), axis=1)
        wanted = uniforms * passed[:, -1]
        panel = np.minimum((wanted[:, None] >= passed).sum(axis=1), passed.shape[1] - 1)
        rows = np.arange(len(panel))
        before = np.where(panel > 0, passed[rows, panel - 1], 0.0)
        inside = values.reshape(len(panel), -1, ORDER)[rows, panel]
        start, width = self.edges[rows, panel], self.edges[rows, panel + 1] - self.edges[rows, panel]
        with np.errstate(invalid="ignore", divide="ignore"):
            place = _solved(inside, (wanted - before) / (0.5 * width))
        found: FloatArray = start + width * 0.5 * (place + 1.0)
        return found

    def _of_panels(self, values: FloatArray) -> FloatArray:
        shaped = values.reshape(len(values), -1, ORDER)
        total = shaped[:, :, 0] * _WEIGHTS[0]
        for node in range(1, ORDER):
            total += shaped[:, :, node] * _WEIGHTS[node]
        panels: FloatArray = total * (0.5 * np.diff(self.edges, axis=1))
        return panels


def _solved(inside: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return where in [-1, 1] the integral from -1 of what has these values (n, ORDER) is as wanted (n,)."""
    low, high = np.full(len(wanted), -1.0), np.ones(len(wanted))
    coefficients = (inside[:, None, :] * _TO_INTEGRAL[None, :, :]).sum(axis=2).T
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        is_below = legendre.legval(middle, coefficients, tensor=False) < wanted
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    place: FloatArray = 0.5 * (low + high)
    return place
