"""The steps of an integration, kept as polynomials and looked up by arc and time.

States of many arcs at any time of their flight, from the steps of one integration.
"""

from typing import Protocol

import numpy as np
from attrs import define, field, frozen
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.dop853 import Acceleration, Step, StepStart, extended, nested
from opir_core.flight.forces import J2, ForceModel, forces_of
from opir_core.flight.propagation import TOLERANCE_M


class ArcStates(Protocol):
    """Arcs whose states can be asked for."""

    def state(self, arc: ArrayLike, time_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, (..., 3), of arcs, by number, at times since their starts, s.

        Numbers and times broadcast against one another; numbers count through the leading axes of the starts in C
        order. `nan` outside an arc's duration, and where the arc has no state. A number out of range is an IndexError.
        """
        ...


def dense_arcs(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    forces: ForceModel = J2,
    *,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> ArcStates:
    """Return arcs over the durations, s, of either sign, that answer for every time between start and end.

    Arguments are those of `propagate`. Positions are within about `tolerance_m` everywhere: steps are taken at a
    tolerance 16 times as tight as `propagate`'s, for within a step the polynomials are that much less accurate than at
    its end.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        return _kepler_arcs(position_m, velocity_m_s, duration_s, forces.gravity.mu_m3_s2)
    from opir_core.flight.blocks import columns_of, integrations

    finer = np.asarray(tolerance_m, dtype=np.float64) / _FINER
    columns = columns_of(position_m, velocity_m_s, duration_s, finer, forces)
    recorder = SegmentRecorder()
    for part, integration in integrations(columns, forces, recorder):
        recorder.first_arc = part.start
        integration.ends()
    return recorder.arcs(columns.duration.size)


#: How much less accurate positions within a step are than at its end.
_FINER = 16.0


@frozen(eq=False)
class KeplerArcs:
    """Two-body arcs, in closed form."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    duration_s: FloatArray
    mu_m3_s2: float

    def state(self, arc: ArrayLike, time_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, as `ArcStates.state` does."""
        from opir_core.flight.kepler import propagate_kepler

        arcs, time = queries(arc, time_s, self.duration_s.size)
        within = is_within(time, self.duration_s[arcs])
        time = np.where(within, time, np.nan)
        return propagate_kepler(self.position_m[arcs], self.velocity_m_s[arcs], time, self.mu_m3_s2)


def queries(arc: ArrayLike, time_s: ArrayLike, count: int) -> tuple[RowArray, FloatArray]:
    """Return numbers of arcs and times broadcast together; raise IndexError for a number that is not below `count`."""
    arcs, time = np.broadcast_arrays(np.asarray(arc, dtype=np.intp), np.asarray(time_s, dtype=np.float64))
    if arcs.size and (int(arcs.min()) < 0 or int(arcs.max()) >= count):
        raise IndexError(f"arc numbers must be from 0 to {count - 1}")
    return arcs, time


def is_within(time_s: FloatArray, duration_s: FloatArray) -> NDArray[np.bool_]:
    """Return whether times, s, lie between zero and the durations, s, of either sign."""
    inside: NDArray[np.bool_] = (time_s * np.sign(duration_s) >= 0.0) & (np.abs(time_s) <= np.abs(duration_s))
    return inside


def _kepler_arcs(position_m: ArrayLike, velocity_m_s: ArrayLike, duration_s: ArrayLike, mu: float) -> KeplerArcs:
    from opir_core.flight.kepler import flat_states

    position, velocity, duration, _ = flat_states(position_m, velocity_m_s, duration_s)
    return KeplerArcs(position, velocity, duration, mu)


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
        start: StepStart,
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
