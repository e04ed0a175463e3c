"""Dense output: states of many arcs at any time of their flight, from the steps of one
integration.
"""

import numpy as np
from attrs import define, field, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.dop853 import ColumnAcceleration, Step, StepStart, dense_output, nested
from opir_core.flight.forces import J2, ForceModel, forces_of
from opir_core.flight.integration import columns_of, integrations
from opir_core.flight.propagation import TOLERANCE_M
from opir_core.geometry.vectors import floats


def dense_arcs(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    forces: ForceModel = J2,
    *,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> "DenseArcs":
    """Return numerically integrated arcs with states at all times from 0 to the durations, s, of
    either sign.

    Arguments are those of `propagate`. Positions are within about `tolerance_m` everywhere: the
    tolerance of the steps is 16 times tighter, because the polynomials are less accurate by that
    factor within a step than at its end.
    """
    forces = forces_of(forces)
    # How much less accurate positions within a step are than at its end.
    finer = floats(tolerance_m) / 16.0
    columns = columns_of(position_m, velocity_m_s, duration_s, finer, forces)
    recorder = StepRecorder()
    for block, integration in integrations(columns, forces, recorder):
        recorder.first_arc = block.start
        integration.ends()
    return recorder.arcs(columns.duration.size)


#: Queries evaluated together, few enough for their coefficients to stay in a second-level cache.
_BLOCK = 512


@frozen(eq=False, repr=False)
class DenseArcs:
    """Arcs as the polynomials of their steps, sorted by arc and then in the order of integration.

    `start` (arcs + 1,) is the index of the first step of each arc; `begin_s` and `length_s`
    (steps,) are the start and the signed length of each step; `states` (steps, 2, 3) are position
    and velocity at the start, and `terms` (steps, 7, 2, 3) their dense output
    (`dop853.nested`).
    """

    start: RowArray
    begin_s: FloatArray
    length_s: FloatArray
    states: FloatArray
    terms: FloatArray

    def state(self, arc: ArrayLike, time_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, (..., 3), of arcs, by number, at times since
        their starts, s.

        Numbers and times broadcast; numbers count through the leading axes of the starts in C
        order. `nan` outside the duration of an arc, and where the arc has no state. `IndexError`
        for a number out of range.
        """
        count = self.start.size - 1
        arcs, time = np.broadcast_arrays(np.asarray(arc, dtype=np.intp), floats(time_s))
        if arcs.size and (int(arcs.min()) < 0 or int(arcs.max()) >= count):
            raise IndexError(f"arc numbers must be from 0 to {count - 1}")
        flat = np.full((arcs.size, 2, 3), np.nan)
        for begin in range(0, arcs.size, _BLOCK):
            block = slice(begin, begin + _BLOCK)
            flat[block] = self._states(arcs.reshape(-1)[block], time.reshape(-1)[block])
        states = flat.reshape(*arcs.shape, 2, 3)
        return states[..., 0, :], states[..., 1, :]

    def end_s(self, arc: RowArray) -> FloatArray:
        """Return the durations (m,), s, of arcs that have steps."""
        end_step = self.start[arc + 1] - 1
        return self.begin_s[end_step] + self.length_s[end_step]

    def _states(self, arcs: RowArray, time: FloatArray) -> FloatArray:
        states = np.full((arcs.size, 2, 3), np.nan)
        rows = np.flatnonzero(self.start[arcs + 1] > self.start[arcs])
        end = self.end_s(arcs[rows])
        inside = (time[rows] * np.sign(end) >= 0.0) & (np.abs(time[rows]) <= np.abs(end))
        rows = rows[inside]
        time = time[rows]
        step = self._step_at(arcs[rows], time)
        fraction = ((time - self.begin_s[step]) / self.length_s[step])[:, None, None]
        terms = np.moveaxis(self.terms[step], 1, 0)
        states[rows] = self.states[step] + nested(terms, fraction)
        return states

    def _step_at(self, arcs: RowArray, time: FloatArray) -> RowArray:
        """Return the last steps that begin no later than the times, by bisection."""
        step = self.start[arcs]
        high = self.start[arcs + 1] - 1
        while np.any(step < high):
            middle = (step + high + 1) // 2
            later = np.abs(self.begin_s[middle]) > np.abs(time)
            np.copyto(high, middle - 1, where=later & (step < high))
            np.copyto(step, middle, where=~later)
        return step


@define(eq=False, repr=False)
class StepRecorder:
    """Records the accepted steps of integrations; `first_arc` is the number of the first arc of the
    current one.
    """

    first_arc: int = 0
    _steps: list[tuple[RowArray, FloatArray, FloatArray, FloatArray, FloatArray]] = field(
        factory=list
    )

    def __call__(
        self,
        index: RowArray,
        begin: FloatArray,
        h: FloatArray,
        start: StepStart,
        step: Step,
        accepted: BoolArray,
        right_side: ColumnAcceleration,
    ) -> None:
        """Record the accepted steps."""
        rows = np.flatnonzero(accepted)
        states = np.stack([start.position[:, rows].T, start.velocity[:, rows].T], axis=1)
        terms = np.moveaxis(dense_output(right_side, start, step, h)[..., rows], -1, 0)
        self._steps.append((index[rows] + self.first_arc, begin[rows], h[rows], states, terms))

    def arcs(self, count: int) -> DenseArcs:
        """Return the recorded steps as `count` arcs."""
        if not self._steps:
            shapes = ((0,), (0,), (0, 2, 3), (0, 7, 2, 3))
            return DenseArcs(np.zeros(count + 1, np.intp), *(np.empty(shape) for shape in shapes))
        arc, *columns = (np.concatenate(column) for column in zip(*self._steps, strict=True))
        order = np.argsort(arc, kind="stable")
        start = np.searchsorted(arc[order], np.arange(count + 1))
        return DenseArcs(start, *(column[order] for column in columns))
