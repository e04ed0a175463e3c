"""States of many bodies in free flight, after a time, under the forces chosen."""

from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.atmosphere_density import air_layers
from opir_core.flight.conic_impact import kepler_impact
from opir_core.flight.dop853 import Acceleration
from opir_core.flight.forces import J2, Drag, ForceModel, Forces, forces_of
from opir_core.flight.gravity_and_drag import Gravity, GravityAndDrag
from opir_core.flight.integration import ArcEnds, Integration, Recorder
from opir_core.flight.kepler import propagate_kepler
from opir_core.flight.levels import AltitudeEvents, Seams

#: Arcs a block: enough to hide numpy's overhead, few enough for the stages of a step to stay in a second-level cache.
_BLOCK = 1024

#: The floor of the one layer of a space without air, m.
_BOTTOMLESS_M = -1e9

#: A change of height in one step that bounds nothing, m.
_BOUNDLESS_M = 1e12


class ArcColumns(NamedTuple):
    """The arcs of a call, flattened: `shape` is that of the broadcast leading axes."""

    shape: tuple[int, ...]
    position: FloatArray
    velocity: FloatArray
    duration: FloatArray
    tolerance: FloatArray
    ballistic_coefficient: FloatArray
    target: FloatArray

    def block(self, part: slice) -> "ArcColumns":
        """Return some of the arcs, as copies."""
        position, velocity = self.position[:, part].copy(), self.velocity[:, part].copy()
        return ArcColumns(self.shape, position, velocity, *(column[part].copy() for column in self[3:]))


def columns_of(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    tolerance_m: ArrayLike,
    forces: Forces,
    height_m: ArrayLike = -np.inf,
) -> ArcColumns:
    """Return the arguments of a call, broadcast against one another and flattened.

    Raise ValueError where a state is not a vector of three, shapes do not fit or a tolerance is not positive.
    """
    vectors = [np.asarray(vector, dtype=np.float64) for vector in (position_m, velocity_m_s)]
    if any(vector.ndim == 0 or vector.shape[-1] != 3 for vector in vectors):
        raise ValueError(f"states need a last axis of 3, got shapes {vectors[0].shape} and {vectors[1].shape}")
    beta = 1.0 if forces.drag is None else forces.drag.ballistic_coefficient_kg_m2
    scalars = [np.asarray(scalar, dtype=np.float64) for scalar in (duration_s, tolerance_m, beta, height_m)]
    if not bool(np.all(scalars[1] > 0.0)):
        raise ValueError("tolerance_m must be positive")
    shape = np.broadcast_shapes(*(vector.shape[:-1] for vector in vectors), *(scalar.shape for scalar in scalars))
    position, velocity = (np.broadcast_to(vector, (*shape, 3)).reshape(-1, 3).T for vector in vectors)
    duration, tolerance, beta, height = (np.broadcast_to(scalar, shape).reshape(-1) for scalar in scalars)
    return ArcColumns(shape, position, velocity, np.where(np.isnan(height), np.nan, duration), tolerance, beta, height)


def integrations(
    columns: ArcColumns, forces: Forces, recorder: Recorder | None = None
) -> Iterator[tuple[slice, Integration]]:
    """Yield the parts of the arcs, and an integration for each."""
    for first in range(0, columns.duration.size, _BLOCK):
        part = slice(first, first + _BLOCK)
        block = columns.block(part)
        system = BlockSystem(forces, block.ballistic_coefficient)
        states = block.position, block.velocity
        yield part, Integration(system, states, block.duration, block.tolerance, system.levels(block), recorder)


class BlockSystem:
    """The forces on the arcs of a block."""

    def __init__(self, forces: Forces, ballistic_coefficient: FloatArray) -> None:
        self.mu_m3_s2 = forces.gravity.mu_m3_s2
        self.has_air = forces.drag is not None
        self._gravity = Gravity(forces.gravity, forces.zonal)
        if forces.drag is not None:
            self._take_up(forces.drag, ballistic_coefficient)

    def _take_up(self, drag: Drag, ballistic_coefficient: FloatArray) -> None:
        self._air = air_layers(drag.atmosphere)
        self._rotation = drag.air_rotation_rad_s
        self._log_half_inverse_beta = -np.log(2.0 * ballistic_coefficient)

    def acceleration(self, arcs: RowArray, layer: RowArray | None) -> Acceleration:
        """Return the right side for the arcs of these numbers, each in its layer of the air."""
        if not self.has_air or layer is None:
            return self._gravity
        parameters = np.take(self._air.parameters, layer, axis=1)
        return GravityAndDrag(self._gravity, parameters, self._log_half_inverse_beta[arcs], self._rotation)

    def levels(self, block: ArcColumns) -> AltitudeEvents | None:
        """Return the heights that the arcs may not step across, if there are any."""
        if self.has_air:
            seams = Seams(self._air.floors_m, self._air.strides_m, self._air.stride_shares)
        elif np.any(block.target > -np.inf):
            seams = Seams(np.array([_BOTTOMLESS_M]), np.array([_BOUNDLESS_M]), np.zeros(1))
        else:
            return None
        return AltitudeEvents(seams, block.target, block.duration < 0.0)


#: The error of position, m, that propagation allows an arc unless told otherwise.
TOLERANCE_M = 1e-3


def propagate(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    forces: ForceModel = J2,
    *,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> tuple[FloatArray, FloatArray]:
    """Return positions, m, and velocities, m/s, both (..., 3), after the durations, s, of either sign.

    States are inertial, in axes that are those of ECEF at the epoch: z is the Earth's axis. Leading axes of states,
    durations, tolerances and the ballistic coefficient broadcast against one another. `forces` is a `Forces` or
    "kepler", which is solved in closed form by `propagate_kepler`.

    Every arc is integrated by itself with adaptive steps of DOP853, so that its error of position at the end is about
    `tolerance_m` at most, as estimated: local errors of velocity times the time left, added up. Below 1e-7 m rounding
    takes over (over days: rounding grows with the time flown); above 0.1 m is taken as 0.1 m. With drag, steps end at
    the seams of the atmosphere and are bounded in height, so the onset of drag is not missed at any tolerance. A
    result does not depend, to the last bit, on which other arcs are in the call.

    The Earth's surface does not stop an arc: use `impact`. `nan` where the start or duration is not finite, where an
    arc with drag is more than 5 km below the ellipsoid at any time (there is no air model), and where an arc falls
    into the Earth's centre.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        return propagate_kepler(position_m, velocity_m_s, duration_s, forces.gravity.mu_m3_s2)

    columns = columns_of(position_m, velocity_m_s, duration_s, tolerance_m, forces)
    position, velocity = np.empty((columns.duration.size, 3)), np.empty((columns.duration.size, 3))
    for part, integration in integrations(columns, forces):
        ends = integration.ends()
        position[part], velocity[part] = ends.position.T, ends.velocity.T
    return position.reshape(*columns.shape, 3), velocity.reshape(*columns.shape, 3)


#: How long, s, arcs are followed unless told otherwise.
WITHIN_S = 86400.0


class ImpactReason(IntEnum):
    """Why there is an impact, or none."""

    IMPACT = 0
    NO_DESCENT = 1
    NOT_FINITE = 2
    BELOW_AIR = 3
    NOT_CONVERGED = 4


class ImpactStates(NamedTuple):
    """Times to impact (...), s, states there (..., 3), m and m/s, and an `ImpactReason` (...) each."""

    duration_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    reason: NDArray[np.int8]


def impact(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    height_m: ArrayLike = 0.0,
    forces: ForceModel = J2,
    *,
    within_s: ArrayLike = WITHIN_S,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> tuple[FloatArray, FloatArray]:
    """Return the times to impact (...), s, and the points of impact (..., 3), m, as `impact_states` does."""
    forces = forces_of(forces)
    if forces.is_kepler:
        return _kepler_points(position_m, velocity_m_s, height_m, within_s, forces)
    states = impact_states(position_m, velocity_m_s, height_m, forces, within_s=within_s, tolerance_m=tolerance_m)
    return states.duration_s, states.position_m


def impact_states(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    height_m: ArrayLike = 0.0,
    forces: ForceModel = J2,
    *,
    within_s: ArrayLike = WITHIN_S,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> ImpactStates:
    """Return when, where and how fast arcs first descend through the height `height_m` above the WGS 84 ellipsoid.

    States are inertial, in axes that are those of ECEF at the epoch; so is the point of impact, which the Earth's
    rotation during the flight takes elsewhere in ECEF. Leading axes broadcast. A start on or below the surface first
    has to rise through it. The event is located by cutting the step that crosses the height where it does, until it
    ends within 1e-4 s of the height; the rest is a parabola, exact to 1e-9 m. `tolerance_m` is as in `propagate`, for
    the point of impact of arcs that come down at 15° or more; shallower ones are proportionally less well determined.

    `nan` where an arc does not come down within `within_s`, and where `propagate` has none; `reason` says which.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        return _kepler_impacts(position_m, velocity_m_s, height_m, within_s, forces)

    height = np.asarray(height_m, dtype=np.float64)
    height = np.where(np.isneginf(height), np.nan, height)
    columns = columns_of(position_m, velocity_m_s, within_s, tolerance_m, forces, height)
    states = _nowhere(columns.duration.size)
    for part, integration in integrations(columns, forces):
        _put(states, part, integration.ends())
    return _shaped(states, columns.shape)


#: The reasons, by the outcome of an integration (`integration.Outcome`).
_REASONS = np.array(
    [
        ImpactReason.NOT_CONVERGED,
        ImpactReason.NO_DESCENT,
        ImpactReason.IMPACT,
        ImpactReason.NOT_FINITE,
        ImpactReason.BELOW_AIR,
        ImpactReason.NOT_CONVERGED,
    ],
    dtype=np.int8,
)


def _kepler_impacts(
    position_m: ArrayLike, velocity_m_s: ArrayLike, height_m: ArrayLike, within_s: ArrayLike, forces: Forces
) -> ImpactStates:
    duration, point = _kepler_points(position_m, velocity_m_s, height_m, within_s, forces)
    velocity = propagate_kepler(position_m, velocity_m_s, duration, forces.gravity.mu_m3_s2)[1]
    inputs = (np.asarray(each, dtype=np.float64).sum(axis=-1) for each in (position_m, velocity_m_s))
    finite = np.isfinite(sum(inputs) + np.asarray(height_m, dtype=np.float64) + np.asarray(within_s, dtype=np.float64))
    hit = ~np.isnan(duration)
    reason = np.where(hit, ImpactReason.IMPACT, np.where(finite, ImpactReason.NO_DESCENT, ImpactReason.NOT_FINITE))
    return ImpactStates(duration, point, velocity, reason.astype(np.int8))


def _kepler_points(
    position_m: ArrayLike, velocity_m_s: ArrayLike, height_m: ArrayLike, within_s: ArrayLike, forces: Forces
) -> tuple[FloatArray, FloatArray]:
    """Return times to impact (...) and points of impact (..., 3) of two-body arcs, `nan` where it takes too long."""
    duration, point = kepler_impact(position_m, velocity_m_s, height_m, forces.gravity.mu_m3_s2)
    soon = duration <= np.asarray(within_s, dtype=np.float64)
    return np.where(soon, duration, np.nan), np.where(soon[..., np.newaxis], point, np.nan)


def _nowhere(count: int) -> ImpactStates:
    return ImpactStates(np.empty(count), np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int8))


def _put(states: ImpactStates, part: slice, ends: ArcEnds) -> None:
    """Put what became of a part of the arcs in its place."""
    reason = _REASONS[ends.outcome]
    hit = reason == ImpactReason.IMPACT
    states.duration_s[part] = np.where(hit, ends.elapsed, np.nan)
    states.position_m[part] = np.where(hit, ends.position, np.nan).T
    states.velocity_m_s[part] = np.where(hit, ends.velocity, np.nan).T
    states.reason[part] = reason


def _shaped(states: ImpactStates, shape: tuple[int, ...]) -> ImpactStates:
    vectors = (states.position_m.reshape(*shape, 3), states.velocity_m_s.reshape(*shape, 3))
    return ImpactStates(states.duration_s.reshape(shape), *vectors, states.reason.reshape(shape))
