"""States of many arcs at any time of their flight, from the steps of one integration."""

from typing import Protocol

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray, RowArray
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
    from opir_core.flight.segments import SegmentRecorder

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
