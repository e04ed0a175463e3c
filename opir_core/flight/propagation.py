"""Free flight under forces: states after a time, and impacts, of many arcs at once."""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.conic_impact import kepler_impact
from opir_core.flight.forces import J2, ForceModel, Forces, forces_of
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry.vectors import FloatPair, floats

#: The default tolerance of position, m.
TOLERANCE_M = 1e-3


def propagate(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    forces: ForceModel = J2,
    *,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> FloatPair:
    """Return positions, m, and velocities, m/s, both (..., 3), after the durations, s, of either
    sign.

    States are inertial, in the axes of ECEF at the epoch: z is the Earth's axis. Leading axes of
    states, durations, tolerances and the ballistic coefficient broadcast. `forces` is a `Forces` or
    "kepler" (closed form).

    Every arc has its own adaptive steps of DOP853. The estimated error of position at the end is at
    most about `tolerance_m`: the sum of local errors of velocity times the time left. Below 1e-7 m
    rounding dominates; above 0.1 m counts as 0.1 m. With drag, steps end at the boundaries of
    atmospheric layers and are bounded in height, so the onset of drag is not missed at any
    tolerance. An arc has the same bits in any company.

    The surface of the Earth does not stop an arc: use `impact`. `nan` where the start or duration
    is not finite, where an arc with drag is more than 5 km below the ellipsoid at any time (no air
    model), and where an arc falls into the Earth's centre.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        return propagate_kepler(position_m, velocity_m_s, duration_s, forces.gravity.mu_m3_s2)
    columns, _, integrations = _integrated(
        position_m, velocity_m_s, duration_s, tolerance_m, forces
    )
    position = np.empty((columns.duration.size, 3))
    velocity = np.empty((columns.duration.size, 3))
    for rows, integration in integrations:
        ends = integration.ends()
        position[rows] = ends.position.T
        velocity[rows] = ends.velocity.T
    return position.reshape(*columns.shape, 3), velocity.reshape(*columns.shape, 3)


def _integrated(*arguments: Any) -> Any:
    """Return the columns of arcs, the rows of those that have come down, and the integrations of
    their blocks.

    Two-body arcs never import these.
    """
    from opir_core.flight.integration import columns_of, come_down, integrations

    columns = columns_of(*arguments)
    landed = come_down(columns)
    columns.duration[landed] = 0.0
    return columns, landed, integrations(columns, arguments[4])


#: The default longest time of flight, s.
WITHIN_S = 86400.0


class ImpactReason(IntEnum):
    """Reasons for an impact, or for none."""

    IMPACT = 0
    NO_DESCENT = 1
    NOT_FINITE = 2
    BELOW_AIR = 3
    NOT_CONVERGED = 4


class ImpactStates(NamedTuple):
    """Times to impact (...), s, states there in ECI (..., 3), m and m/s, and an `ImpactReason`
    (...) each.
    """

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
) -> FloatPair:
    """Return times to impact (...), s, and points of impact (..., 3), m, in ECI, as
    `impact_states_eci` does.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        return _kepler_points(position_m, velocity_m_s, height_m, within_s, forces)
    states = impact_states_eci(
        position_m, velocity_m_s, height_m, forces, within_s=within_s, tolerance_m=tolerance_m
    )
    return states.duration_s, states.position_m


def impact_states_eci(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    height_m: ArrayLike = 0.0,
    forces: ForceModel = J2,
    *,
    within_s: ArrayLike = WITHIN_S,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> ImpactStates:
    """Return times and states of the first descents of arcs through the height `height_m` above the
    WGS 84 ellipsoid.

    States are inertial, in the axes of ECEF at the start, and so is the point of impact:
    `opir_core.geometry.eci_to_ecef` of it and its `duration_s` is the place on the ground, hundreds
    of kilometres further west. Leading axes broadcast. A start below the height that descends has
    come down: time 0, at the start. One that ascends, as from a launch site below the ellipsoid,
    must first rise through the height. The step that crosses the height is shortened until it ends
    within 1e-4 s of it; the rest is a parabola, exact to 1e-9 m. `tolerance_m` is as in
    `propagate`, for the impact point of arcs that descend at 15° or more, and proportionally larger
    below.

    `nan`, with its `reason`, without a descent within `within_s`, and where `propagate` returns
    none.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        return _kepler_impacts(position_m, velocity_m_s, height_m, within_s, forces)
    height = floats(height_m)
    height = np.where(np.isneginf(height), np.nan, height)
    columns, landed, integrations = _integrated(
        position_m, velocity_m_s, within_s, tolerance_m, forces, height
    )
    count = columns.duration.size
    shape = columns.shape
    duration = np.empty(count)
    position = np.empty((count, 3))
    velocity = np.empty((count, 3))
    reason = np.empty(count, np.int8)
    for rows, integration in integrations:
        ends = integration.ends()
        reason[rows] = _REASONS[ends.outcome]
        hit = reason[rows] == ImpactReason.IMPACT
        duration[rows] = np.where(hit, ends.elapsed, np.nan)
        position[rows], velocity[rows] = (
            np.where(hit, column, np.nan).T for column in (ends.position, ends.velocity)
        )
    duration[landed] = 0.0
    reason[landed] = ImpactReason.IMPACT
    position[landed] = columns.position[:, landed].T
    velocity[landed] = columns.velocity[:, landed].T
    vectors = position.reshape(*shape, 3), velocity.reshape(*shape, 3)
    return ImpactStates(duration.reshape(shape), *vectors, reason.reshape(shape))


#: The reasons, by the `IntegrationResult` of an integration.
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
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    height_m: ArrayLike,
    within_s: ArrayLike,
    forces: Forces,
) -> ImpactStates:
    duration, point = _kepler_points(position_m, velocity_m_s, height_m, within_s, forces)
    velocity = propagate_kepler(position_m, velocity_m_s, duration, forces.gravity.mu_m3_s2)[1]
    inputs = (floats(vectors).sum(axis=-1) for vectors in (position_m, velocity_m_s))
    finite = np.isfinite(sum(inputs) + floats(height_m) + floats(within_s))
    hit = ~np.isnan(duration)
    reason = np.where(
        hit, ImpactReason.IMPACT, np.where(finite, ImpactReason.NO_DESCENT, ImpactReason.NOT_FINITE)
    )
    return ImpactStates(duration, point, velocity, reason.astype(np.int8))


def _kepler_points(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    height_m: ArrayLike,
    within_s: ArrayLike,
    forces: Forces,
) -> FloatPair:
    """Return times to impact (...) and points of impact (..., 3) of two-body arcs, `nan` for longer
    times.
    """
    duration, point = kepler_impact(position_m, velocity_m_s, height_m, forces.gravity.mu_m3_s2)
    soon = duration <= floats(within_s)
    return np.where(soon, duration, np.nan), np.where(soon[..., np.newaxis], point, np.nan)
