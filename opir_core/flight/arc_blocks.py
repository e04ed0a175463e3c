"""Arcs of a call as columns, cut into blocks that fit a cache, and the forces on the arcs of a block."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.altitude_events import AltitudeEvents, Seams
from opir_core.flight.atmosphere_density import air_layers
from opir_core.flight.dop853 import Acceleration
from opir_core.flight.forces import Drag, Forces
from opir_core.flight.gravity_and_drag import Gravity, GravityAndDrag
from opir_core.flight.integration import Integration, Recorder

#: Arcs per block: few enough for the stages of a step to stay in a second-level cache.
_BLOCK = 1024

#: The floor of the only layer without air, m.
_BOTTOMLESS_M = -1e9

#: A height change per step that is no bound, m.
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
    """Return the arguments of a call, broadcast and flattened.

    `ValueError` where a state is not a vector of three, shapes do not fit or a tolerance is not positive.
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
    """Yield the blocks of the arcs, each with its integration."""
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
        """Return the heights at which steps must end, or None without air and impact height."""
        if self.has_air:
            seams = Seams(self._air.floors_m, self._air.strides_m, self._air.stride_shares)
        elif np.any(block.target > -np.inf):
            seams = Seams(np.array([_BOTTOMLESS_M]), np.array([_BOUNDLESS_M]), np.zeros(1))
        else:
            return None
        return AltitudeEvents(seams, block.target, block.duration < 0.0)
