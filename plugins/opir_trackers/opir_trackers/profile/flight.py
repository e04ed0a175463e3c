"""What a fitted boost comes to: its state at a tick, the end of its burn and its impact, with their slopes."""

from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.flight.conic_impact import kepler_impact
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_eci_state, ecef_to_geodetic, eci_to_ecef, eci_to_ecef_state
from opir_core.interfaces.columns import Columns
from opir_trackers.profile.family import BURN, RADIUS_M, SIZE, START, Family

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel

#: Steps of differences: of time, s; of burnout states, m, m/s, s.
_TIME_STEP_S = 0.02
_STEPS = np.array([10.0, 10.0, 10.0, 0.05, 0.05, 0.05, 0.01])

#: Points and weights of Gauss and Hermite's rule of three nodes.
HERMITE_NODES = np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0])
HERMITE_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0


@frozen(eq=False)
class Moments(Columns):
    """Means (n, d) and covariances (n, d, d)."""

    mean: FloatArray
    covariance: FloatArray

    @classmethod
    def unknown(cls, count: int, size: int) -> "Moments":
        """Return nan for all."""
        return cls(np.full((count, size), np.nan), np.full((count, size, size), np.nan))


def burnouts(family: Family, spread: FloatArray) -> tuple[Moments, FloatArray]:
    """Return the ends of burns, ECEF position, velocity and time (n, 7), and slopes by the parameters (n, 7, 10)."""
    end_s, count = family.burnout_s, len(spread)
    mean, slope, before = _state(family, end_s, also_s=end_s - 2.0 * _TIME_STEP_S)
    by_end = np.zeros((count, SIZE))
    by_end[:, START], by_end[:, BURN] = 1.0, family.courses.burn_s
    rate = np.concatenate([mean[:, 3:], (mean[:, 3:] - before) / (2.0 * _TIME_STEP_S)], axis=1)
    slope = slope + rate[:, :, None] * by_end[:, None]
    slope = np.concatenate([slope, by_end[:, None]], axis=1)
    return Moments(np.column_stack([mean, end_s]), through(slope, spread)), slope


def states(
    family: Family, spread: FloatArray, tick_s: float, ends: Moments, slope: FloatArray, forces: "ForceModel" = "kepler"
) -> Moments:
    """Return the states (n, 6) at a tick: on the burn, or in free flight from the ends of burns, under forces.

    Covariances are those of the two-body problem: they differ by far less than the states.
    """
    mean, by_parameters = sloped_states(family, tick_s, ends, slope)
    late = np.flatnonzero(tick_s > family.burnout_s)
    if len(late) and forces != "kepler":
        # In air too dense to be followed, and below the ground, there is only the two-body flight.
        forced = _flown(ends.mean[late], tick_s, forces)
        known = np.asarray(np.isfinite(forced).all(axis=1))
        mean[late] = np.where(known[:, None], forced, mean[late])
    return Moments(mean, through(by_parameters, spread))


def sloped_states(family: Family, tick_s: float, ends: Moments, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the states (n, 6) at a tick, in the two-body problem, and their slopes by the parameters (n, 6, 10)."""
    mean, by_parameters, _ = _state(family, np.minimum(np.maximum(tick_s, family.start_s), family.burnout_s))
    late = np.flatnonzero(tick_s > family.burnout_s)
    if len(late):
        mean[late] = _flown(ends.mean[late], tick_s)
        moved = _stepped(ends.mean[late])
        flown = _flown(moved.reshape(-1, 7), tick_s).reshape(7, -1, 6)
        by_end = np.moveaxis((flown - mean[late]) / _STEPS[:, None, None], 0, 2)
        by_parameters[late] = by_end @ slope[late]
    return mean, by_parameters


def burning_states(family: Family, row: IntArray, tick_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return states (m, 6) at a tick of rows (m,) whose burns go on, slopes (m, 6, 10), accelerations (m, 3)."""
    at = np.full(len(row), tick_s)
    mean, slope, before = _state(family, at, also_s=at - 2.0 * _TIME_STEP_S, row=row)
    return mean, slope, (mean[:, 3:] - before) / (2.0 * _TIME_STEP_S)


def sloped_impacts(ends: Moments, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return impacts (n, 3), as `impacts` does, in free flight, and slopes (n, 3, 10) of east, north and time."""
    every = landed(np.concatenate([ends.mean[None], _stepped(ends.mean)]).reshape(-1, 7)).reshape(8, -1, 3)
    by_end = np.moveaxis(on_ground(every[1:], every[0]) / _STEPS[:, None, None], 0, 2)
    return every[0], by_end @ slope


def impacts(ends: Moments, slope: FloatArray, spread: FloatArray, forces: "ForceModel") -> Moments:
    """Return impacts (n, 3): latitude and longitude, rad, and time, s; covariances over east, north, m, and s.

    The mean and covariance are those of nine points in the plane of the ground, by Gauss and Hermite, which holds what
    the flight bends: the points are what the impact's linear part, one standard deviation at a time, comes from. nan
    where one of them does not come down.
    """
    count = len(ends.mean)
    middle, linear = sloped_impacts(ends, slope)
    cloud, weights = _cloud(ends, slope, spread, linear)
    away = on_ground(landed(cloud.reshape(-1, 7)).reshape(-1, count, 3), middle)
    mean = np.sum(weights[:, None, None] * away, axis=0)
    apart = away - mean
    covariance = np.sum(weights[:, None, None, None] * apart[..., :, None] * apart[..., None, :], axis=0)
    # The ground's two directions hold all of the place; of the time, the linear part says what is left.
    total = through(linear, spread)
    left = total[:, 2, 2] - np.einsum("ni,nij,nj->n", total[:, 2, :2], _inverse(total[:, :2, :2]), total[:, :2, 2])
    covariance[:, 2, 2] += np.maximum(left, 0.0)
    centre = middle if forces == "kepler" else forced_impacts(ends.mean, forces)
    return Moments(off_ground(mean, centre), covariance)


def _cloud(ends: Moments, slope: FloatArray, spread: FloatArray, linear: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ends of burns (9, n, 7) and weights (9,)."""
    ground = through(linear[:, :2], spread)
    value, axis = np.linalg.eigh(np.where(np.isfinite(ground), ground, 0.0))
    scale = 1.0 / np.sqrt(np.maximum(value, 1e-6))
    # One standard deviation along each principal axis of the ellipse on the ground, in terms of the parameters.
    side = spread @ linear[:, :2].transpose(0, 2, 1) @ axis * scale[:, None]
    by_side = slope @ side
    first, second = (grid.ravel() for grid in np.meshgrid(HERMITE_NODES, HERMITE_NODES, indexing="ij"))
    weights = np.outer(HERMITE_WEIGHTS, HERMITE_WEIGHTS).ravel()
    cloud = ends.mean + first[:, None, None] * by_side[:, :, 0] + second[:, None, None] * by_side[:, :, 1]
    return cloud, weights


def _state(
    family: Family, time_s: FloatArray, also_s: FloatArray | None = None, row: IntArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return states (n, 6) at times on the burn (n,), their slopes (n, 6, 10), and velocities (n, 3) at other times.

    Times are those of rows (n,), of all if none are told.
    """
    count = len(time_s)
    row = np.arange(count) if row is None else row
    times = [time_s, time_s - _TIME_STEP_S, time_s + _TIME_STEP_S, *([] if also_s is None else [also_s])]
    places = family.places(np.tile(row, len(times)), np.concatenate(times))
    here, before, after = (places.slope[part * count : (part + 1) * count] for part in range(3))
    slope = np.concatenate([here, (after - before) / (2.0 * _TIME_STEP_S)], axis=2).transpose(0, 2, 1)
    state = np.concatenate([places.position_m[:count], places.velocity_m_s[:count]], axis=1)
    return state, slope, places.velocity_m_s[3 * count :]


def _stepped(ends: FloatArray) -> FloatArray:
    """Return ends of burns (7, n, 7), each with one of its columns moved by its step."""
    moved: FloatArray = ends + (np.eye(7) * _STEPS)[:, None]
    return moved


def _flown(ends: FloatArray, tick_s: float, forces: "ForceModel" = "kepler") -> FloatArray:
    inertial = ecef_to_eci_state(ends[:, :3], ends[:, 3:6], ends[:, 6])
    if forces == "kepler":
        flown = propagate_kepler(*inertial, tick_s - ends[:, 6])
    else:
        from opir_core.flight.propagation import propagate

        flown = propagate(*inertial, tick_s - ends[:, 6], forces, tolerance_m=1.0)
    return np.concatenate(eci_to_ecef_state(*flown, np.full(len(ends), tick_s)), axis=1)


def landed(ends: FloatArray) -> FloatArray:
    """Return where and when (n, 3) free flights from ends of burns (n, 7) come down, in the two-body problem."""
    inertial = ecef_to_eci_state(ends[:, :3], ends[:, 3:6], ends[:, 6])
    return _place(*kepler_impact(*inertial), ends)


def forced_impacts(ends: FloatArray, forces: "ForceModel") -> FloatArray:
    """Return where and when (n, 3) free flights from ends of burns (n, 7) come down under forces."""
    from opir_core.flight.propagation import impact

    inertial = ecef_to_eci_state(ends[:, :3], ends[:, 3:6], ends[:, 6])
    return _place(*impact(*inertial, 0.0, forces, tolerance_m=1.0), ends)


def _place(duration_s: FloatArray, point_m: FloatArray, ends: FloatArray) -> FloatArray:
    when = ends[:, 6] + duration_s
    place = ecef_to_geodetic(eci_to_ecef(point_m, when))
    return np.stack([place.latitude_rad, place.longitude_rad, when], axis=1)


def through(slope: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the covariances (n, r, r) that those of parameters (n, 10, 10) bring about, by slopes (n, r, 10)."""
    covariance = slope @ spread @ slope.transpose(0, 2, 1)
    even: FloatArray = 0.5 * (covariance + covariance.transpose(0, 2, 1))
    return even


def _inverse(matrix: FloatArray) -> FloatArray:
    determinant = np.maximum(matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] ** 2, 1e-300)
    inverse = np.empty_like(matrix)
    inverse[:, 0, 0], inverse[:, 1, 1] = matrix[:, 1, 1], matrix[:, 0, 0]
    inverse[:, 0, 1] = inverse[:, 1, 0] = -matrix[:, 0, 1]
    return inverse / determinant[:, None, None]


def on_ground(points: FloatArray, about: FloatArray) -> FloatArray:
    """Return points (..., 3) as metres east and north of others, and seconds after them.

    East and north are those of the point `about` on a sphere, along great circles: what is far stays as far as it is.
    """
    turn = points[..., 1] - about[..., 1]
    here, there = about[..., 0], points[..., 0]
    east = np.cos(there) * np.sin(turn)
    north = np.cos(here) * np.sin(there) - np.sin(here) * np.cos(there) * np.cos(turn)
    up = np.sin(here) * np.sin(there) + np.cos(here) * np.cos(there) * np.cos(turn)
    across = np.hypot(east, north)
    scale = RADIUS_M * np.where(across > 1e-12, np.arctan2(across, up) / np.maximum(across, 1e-12), 1.0)
    return np.stack([scale * east, scale * north, points[..., 2] - about[..., 2]], axis=-1)


def off_ground(away: FloatArray, about: FloatArray) -> FloatArray:
    """Return the points (..., 3) that lie metres east and north of others, and seconds after them."""
    angle = np.hypot(away[..., 0], away[..., 1]) / RADIUS_M
    azimuth = np.arctan2(away[..., 0], away[..., 1])
    here = about[..., 0]
    sine = np.sin(here) * np.cos(angle) + np.cos(here) * np.sin(angle) * np.cos(azimuth)
    latitude = np.arcsin(np.clip(sine, -1.0, 1.0))
    turn = np.arctan2(np.sin(azimuth) * np.sin(angle) * np.cos(here), np.cos(angle) - np.sin(here) * sine)
    longitude = np.remainder(about[..., 1] + turn + np.pi, 2.0 * np.pi) - np.pi
    return np.stack([latitude, longitude, about[..., 2] + away[..., 2]], axis=-1)
