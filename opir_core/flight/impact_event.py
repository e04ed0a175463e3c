"""Where and when bodies in free flight come down on the Earth."""

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.forces import J2, ForceModel, Forces, forces_of
from opir_core.flight.propagation import TOLERANCE_M

if TYPE_CHECKING:
    from opir_core.flight.integration import ArcEnds

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
    from opir_core.flight.blocks import columns_of, integrations

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
    from opir_core.flight.kepler import propagate_kepler

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
    from opir_core.flight.conic_impact import kepler_impact

    duration, point = kepler_impact(position_m, velocity_m_s, height_m, forces.gravity.mu_m3_s2)
    soon = duration <= np.asarray(within_s, dtype=np.float64)
    return np.where(soon, duration, np.nan), np.where(soon[..., np.newaxis], point, np.nan)


def _nowhere(count: int) -> ImpactStates:
    return ImpactStates(np.empty(count), np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int8))


def _put(states: ImpactStates, part: slice, ends: "ArcEnds") -> None:
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
