"""The steps of an integration, kept as polynomials and looked up by arc and time."""

import numpy as np
from attrs import define, field, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.dense import is_within, queries
from opir_core.flight.extension import extended, nested
from opir_core.flight.stepping import Acceleration, Start, Step

#: Queries evaluated together, few enough for their coefficients to stay in a second-level cache.
_BLOCK = 512


@frozen(eq=False)
class SegmentArcs:
    """Arcs as the polynomials of their steps, the steps of one arc after another and in the order flown.

    `first`, (arcs + 1), is where each arc's steps begin; `begin_s`, (steps), when they do, and `length_s` how long
    they are, of either sign; `states`, (steps, 2, 3), position and velocity at the begin, and `terms`, (steps, 7, 2,
    3), their changes (`extension.Extension`).
    """

    first: RowArray
    begin_s: FloatArray
    length_s: FloatArray
    states: FloatArray
    terms: FloatArray

    def state(self, arc: ArrayLike, time_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, as `dense.ArcStates.state` does."""
        arcs, time = queries(arc, time_s, self.first.size - 1)
        flat = np.full((arcs.size, 2, 3), np.nan)
        for begin in range(0, arcs.size, _BLOCK):
            part = slice(begin, begin + _BLOCK)
            flat[part] = self._states(arcs.reshape(-1)[part], time.reshape(-1)[part])
        states = flat.reshape(*arcs.shape, 2, 3)
        return states[..., 0, :], states[..., 1, :]

    def _states(self, arcs: RowArray, time: FloatArray) -> FloatArray:
        first, last = self.first[arcs], self.first[arcs + 1] - 1
        states = np.full((arcs.size, 2, 3), np.nan)
        known = np.flatnonzero(last >= first)
        first, last, time = first[known], last[known], time[known]
        end = self.begin_s[last] + self.length_s[last]
        inside = is_within(time, end)
        known, time = known[inside], time[inside]
        step = self._step_at(first[inside], last[inside], time)
        fraction = ((time - self.begin_s[step]) / self.length_s[step])[:, np.newaxis, np.newaxis]
        terms = np.moveaxis(self.terms[step], 1, 0)
        states[known] = self.states[step] + nested(terms, fraction)
        return states

    def _step_at(self, first: RowArray, last: RowArray, time: FloatArray) -> RowArray:
        """Return the last step that begins no later than the time, by bisection."""
        low, high = first.copy(), last.copy()
        while np.any(low < high):
            middle = (low + high + 1) // 2
            later = np.abs(self.begin_s[middle]) > np.abs(time)
            np.copyto(high, middle - 1, where=later & (low < high))
            np.copyto(low, middle, where=~later)
        return low


@define(eq=False)
class SegmentRecorder:
    """Keeps the steps that integrations accept; `first_arc` is the number of the first arc of the one that runs."""

    first_arc: int = 0
    _kept: list[tuple[RowArray, FloatArray, FloatArray, FloatArray, FloatArray]] = field(factory=list)

    def __call__(
        self,
        index: RowArray,
        begin: FloatArray,
        h: FloatArray,
        start: Start,
        step: Step,
        accepted: BoolArray,
        right_side: Acceleration,
    ) -> None:
        """Keep the steps that were accepted."""
        extension = extended(right_side, start, step, h)
        kept = np.flatnonzero(accepted)
        states = np.stack([extension.position[:, kept].T, extension.velocity[:, kept].T], axis=1)
        both = (extension.position_terms, extension.velocity_terms)
        terms = np.stack([np.transpose(each[:, :, kept], (2, 0, 1)) for each in both], axis=2)
        self._kept.append((index[kept] + self.first_arc, begin[kept], h[kept], states, terms))

    def arcs(self, count: int) -> SegmentArcs:
        """Return what was kept as arcs, `count` in all."""
        if not self._kept:
            return SegmentArcs(np.zeros(count + 1, np.intp), *(np.empty(shape) for shape in _EMPTY))
        arc, *columns = (np.concatenate(column) for column in zip(*self._kept, strict=True))
        order = np.argsort(arc, kind="stable")
        first = np.searchsorted(arc[order], np.arange(count + 1))
        return SegmentArcs(first, *(column[order] for column in columns))


_EMPTY = ((0,), (0,), (0, 2, 3), (0, 7, 2, 3))
