"""Launch, burnout and impact of the arcs of `kepler-arc`."""

from typing import NamedTuple

import numpy as np
from opir_estimation import LinesOfSight, emission_s, matvec
from opir_forecast import LaunchPoints

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import kepler_impact, propagate_kepler
from opir_core.geometry import (
    ecef_to_geodetic,
    eci_to_ecef,
    eci_to_ecef_state,
    intersection_with_ellipsoid,
    local_axes,
)
from opir_core.plugin import TARGET_TYPES
from opir_trackers.arc.fit import ArcFits, slopes_of, solved, trial_states
from opir_trackers.sensors import SensorSchedule

#: Median burn time of a boost of each of `TARGET_TYPES`, s. Notional.
_BURN_S = np.array([{"ICBM": 210.0, "IRBM": 120.0, "SRBM": 65.0}[kind] for kind in TARGET_TYPES])


class TrajectoryParameters(NamedTuple):
    """The paper's trajectory parameters, relative to the rotating Earth: (n,) each, rad and m/s."""

    azimuth_rad: FloatArray
    flight_path_angle_rad: FloatArray
    speed_m_s: FloatArray


def latency_s(schedule: SensorSchedule) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (s,) of the time from ignition to a sensor's first
    detection, s.

    Section 5.1 of the paper: T/P, for a geometric number of scans and an unknown scan phase.
    """
    chance = schedule.detection_probability.mean(axis=1)
    spread = np.sqrt((1.0 - chance) / chance**2 + 1.0 / 12.0)
    return schedule.period_s / chance, schedule.period_s * spread


def expected_looks(
    schedule: SensorSchedule, visible: BoolArray, elapsed_s: FloatArray, share: FloatArray
) -> FloatArray:
    """Return the expected number of detections (n,) of whole boosts that have lasted for
    `elapsed_s` (n,), s, so far.

    The mean over the types, of which `share` (n, types) are the probabilities by reports: those
    whose boosts would be over by now are the less likely. `visible` (n, sensors) are the sensors
    that see each boost.
    """
    from scipy.special import log_ndtr

    elapsed = np.maximum(elapsed_s, 1e-3)[:, None]
    # The logarithm of the burn time has a standard deviation of 0.2; notional.
    log = log_ndtr(np.log(_BURN_S / elapsed) / 0.2)
    weight = share * np.exp(log - log.max(axis=1, keepdims=True))
    rate = visible @ (schedule.detection_probability / schedule.period_s[:, None])
    looks = weight * rate * np.maximum(_BURN_S, elapsed)
    return looks.sum(axis=1) / weight.sum(axis=1)


def launches(
    lines: LinesOfSight,
    owner: IntArray,
    count: int,
    schedule: SensorSchedule,
    light_time: bool,
    site_m: float,
) -> LaunchPoints:
    """Return launch points of `count` tracks, where the first lines of sight of their sensors meet.

    Lines (m,) are in order of time with tracks `owner` (m,). A site is on the ellipsoid, but for a
    normal height of the standard deviation `site_m`. The time is the first emission minus the
    expected latency. A sensor whose first detection is later than expected is not used.
    """
    firsts = _first_lines(lines, owner, count, schedule, light_time)
    information = np.zeros((count, 3, 3))
    information[:, 2, 2] = site_m**-2
    pull = np.zeros((count, 3))
    about = np.full((count, 3), np.nan)
    about[firsts.track[::-1]] = firsts.place_m[::-1]
    axes = local_axes(firsts.place_m)
    moves, weight = _ground_equations(axes, firsts)
    offset = matvec(axes, firsts.place_m - about[firsts.track])[:, :2]
    np.add.at(information, firsts.track, weight @ moves)
    np.add.at(pull, firsts.track, matvec(weight, offset))
    late_s, doubt_s = latency_s(schedule)
    order = np.argsort(-firsts.emitted_s, kind="stable")
    track = firsts.track[order]
    sensor = firsts.lines.sensor[order]
    when = np.full(count, np.nan)
    wait_s = np.full(count, np.nan)
    when[track] = firsts.emitted_s[order] - late_s[sensor]
    wait_s[track] = doubt_s[sensor]
    return _pooled(about, information, pull, when, wait_s)


class _FirstLines(NamedTuple):
    """The first lines (k,) of each track's sensors: their tracks, emission times, s, and ground
    points (k, 3) and ranges.
    """

    lines: LinesOfSight
    track: IntArray
    emitted_s: FloatArray
    place_m: FloatArray
    range_m: FloatArray


def _first_lines(
    lines: LinesOfSight, owner: IntArray, count: int, schedule: SensorSchedule, light_time: bool
) -> _FirstLines:
    """Return the first lines of tracks' sensors, without those that are later than expected."""
    ground = intersection_with_ellipsoid(lines.origin_ecef_m, lines.direction_ecef)
    range_m = lines.ranges_m(ground)
    emitted_s = emission_s(lines.time_s, range_m, light_time)
    begun_s = np.full(count, np.inf)
    np.fmin.at(begun_s, owner, emitted_s)
    met = np.flatnonzero(np.isfinite(range_m))
    pairs = np.stack([owner, lines.sensor.astype(np.int64)], axis=1)[met]
    rows = met[np.unique(pairs, axis=0, return_index=True)[1]]
    late_s, doubt_s = latency_s(schedule)
    expected_s = begun_s[owner[rows]] + (late_s + doubt_s)[lines.sensor[rows]]
    rows = rows[emitted_s[rows] <= expected_s]
    return _FirstLines(lines.take(rows), owner[rows], emitted_s[rows], ground[rows], range_m[rows])


def _ground_equations(axes: FloatArray, firsts: _FirstLines) -> tuple[FloatArray, FloatArray]:
    """Return the matrices (k, 2, 3) that take east, north and height of a site to ground points of
    lines, and their transposes times the information of these points.
    """
    spread_m = firsts.range_m * firsts.lines.sigma_rad
    flat, spread = _on_ground(axes, firsts.lines.direction_ecef, spread_m)
    moves = np.concatenate([np.broadcast_to(np.eye(2), spread.shape), flat[:, :, None]], axis=2)
    information = np.linalg.inv(spread)
    return moves, moves.transpose(0, 2, 1) @ information


def _on_ground(
    axes: FloatArray, direction: FloatArray, spread_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what the height of a site moves the ground points of lines by (n, 2), east and north,
    and covariances.

    The covariances (n, 2, 2) are those of lines with a spread across them.
    """
    local = matvec(axes, direction)
    flat = -local[:, :2] / local[:, 2:]
    foot: FloatArray = np.square(spread_m)[:, None, None] * (
        np.eye(2) + flat[:, :, None] * flat[:, None, :]
    )
    return flat, foot


def _pooled(
    about: FloatArray,
    information: FloatArray,
    pull: FloatArray,
    when: FloatArray,
    wait_s: FloatArray,
) -> LaunchPoints:
    """Return the weighted mean points of tracks, from east, north and height."""
    points = LaunchPoints.nowhere(len(about))
    rows = np.flatnonzero(np.isfinite(about).all(axis=1) & np.isfinite(when))
    if not len(rows):
        return points
    spread = np.linalg.inv(information[rows])
    spread = 0.5 * (spread + spread.transpose(0, 2, 1))
    shift = matvec(spread, pull[rows])[:, :2]
    axes = local_axes(about[rows])
    place = ecef_to_geodetic(about[rows] + shift[:, :1] * axes[:, 0] + shift[:, 1:] * axes[:, 1])
    points.place[rows] = np.stack([place.latitude_rad, place.longitude_rad, when[rows]], axis=1)
    covariance = np.zeros((len(rows), 3, 3))
    covariance[:, :2, :2] = spread[:, :2, :2]
    covariance[:, 2, 2] = np.square(wait_s[rows])
    points.covariance[rows] = covariance
    return points


def states_at(arcs: ArcFits, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ECEF states (n, 6) at times (n,) and covariances (n, 6, 6), scaled where the arc fits
    badly.

    The covariance is that of the noise, times the reduced χ² where this exceeds 1.
    """
    _, covariance, misfit = solved(arcs.normal())
    equations = np.where(arcs.seen.sum(axis=1) < 2, 3, 2) * arcs.looks
    covariance = covariance * np.maximum(misfit / np.maximum(equations - 6, 1), 1.0)[:, None, None]
    trials = trial_states(arcs.state)
    flown = propagate_kepler(trials[:, :, :3], trials[:, :, 3:], (time_s - arcs.epoch_s)[:, None])
    state = np.concatenate(eci_to_ecef_state(*flown, time_s[:, None]), axis=2)
    slope = slopes_of(state)
    spread = slope @ covariance @ slope.transpose(0, 2, 1)
    return state[:, 0], 0.5 * (spread + spread.transpose(0, 2, 1))


def trajectory_parameters(state: FloatArray) -> TrajectoryParameters:
    """Return azimuth, flight path angle and speed of ECEF states (n, 6)."""
    east, north, up = matvec(local_axes(state[:, :3]), state[:, 3:]).T
    azimuth = np.remainder(np.arctan2(east, north), 2.0 * np.pi)
    return TrajectoryParameters(
        azimuth, np.arctan2(up, np.hypot(east, north)), np.sqrt(east**2 + north**2 + up**2)
    )


def impacts(arcs: ArcFits) -> FloatArray:
    """Return latitude, longitude, rad, and time, s, (n, 3) of the impacts of arcs after their last
    emission, or nan.
    """
    flown = propagate_kepler(arcs.state[:, :3], arcs.state[:, 3:], arcs.last_s - arcs.epoch_s)
    flight_s, point = kepler_impact(*flown)
    time_s = arcs.last_s + flight_s
    place = ecef_to_geodetic(eci_to_ecef(point, time_s))
    return np.stack([place.latitude_rad, place.longitude_rad, time_s], axis=1)
