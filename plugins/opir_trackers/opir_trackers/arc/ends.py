"""Launch, burnout and impact of the arcs of `kepler-arc`."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import matvec
from opir_core.flight import kepler_impact, propagate_kepler
from opir_core.geometry import (
    ecef_to_geodetic,
    eci_to_ecef,
    eci_to_ecef_state,
    intersection_with_ellipsoid,
    local_axes,
)
from opir_core.plugin import TARGET_TYPES
from opir_trackers.arc.fit import STEPS, ArcFits, solved
from opir_trackers.launch_points import LaunchPoints
from opir_trackers.lines_of_sight import LinesOfSight, emission_s
from opir_trackers.sensors import SensorSchedule

#: Median burn time of a boost of each of `TARGET_TYPES`, s, and the standard deviation of its
#: logarithm. Notional.
_BURN_S = np.array([{"ICBM": 210.0, "IRBM": 120.0, "SRBM": 65.0}[kind] for kind in TARGET_TYPES])
_BURN_LOG_SIGMA = 0.2


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
    whose boosts would be over by now are the less likely. `seen` (n, sensors) are the sensors that
    see each boost.
    """
    from scipy.special import log_ndtr

    elapsed = np.maximum(elapsed_s, 1e-3)[:, None]
    log = log_ndtr(np.log(_BURN_S / elapsed) / _BURN_LOG_SIGMA)
    weight = share * np.exp(log - log.max(axis=1, keepdims=True))
    rate = visible @ (schedule.detection_probability / schedule.period_s[:, None])
    looks = weight * rate * np.maximum(_BURN_S, elapsed)
    expected: FloatArray = looks.sum(axis=1) / weight.sum(axis=1)
    return expected


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
    ground = intersection_with_ellipsoid(lines.origin_ecef_m, lines.direction_ecef)
    range_m = np.sqrt(np.sum((ground - lines.origin_ecef_m) ** 2, axis=1))
    left_s = emission_s(lines.time_s, range_m, light_time)
    late_s, doubt_s = latency_s(schedule)
    begun_s = np.full(count, np.inf)
    np.fmin.at(begun_s, owner, left_s)
    met = np.flatnonzero(np.isfinite(range_m))
    firsts = met[
        np.unique(
            np.stack([owner, lines.sensor.astype(np.int64)], axis=1)[met], axis=0, return_index=True
        )[1]
    ]
    firsts = firsts[
        left_s[firsts] <= begun_s[owner[firsts]] + (late_s + doubt_s)[lines.sensor[firsts]]
    ]
    first_lines = lines.take(firsts)
    row = owner[firsts]
    place = ground[firsts]
    axes = local_axes(place)
    flat, spread = _on_ground(
        axes, first_lines.direction_ecef, range_m[firsts] * first_lines.sigma_rad
    )
    moves = np.concatenate([np.broadcast_to(np.eye(2), spread.shape), flat[:, :, None]], axis=2)
    weighed = moves.transpose(0, 2, 1) @ np.linalg.inv(spread).astype(np.float64, copy=False)
    information = np.zeros((count, 3, 3))
    pull = np.zeros((count, 3))
    about = np.full((count, 3), np.nan)
    information[:, 2, 2] = site_m**-2
    about[row[::-1]] = place[::-1]
    offset = matvec(axes, place - about[row])[:, :2]
    np.add.at(information, row, weighed @ moves)
    np.add.at(pull, row, matvec(weighed, offset))
    when = np.full(count, np.nan)
    wait_s = np.full(count, np.nan)
    order = np.argsort(-left_s[firsts], kind="stable")
    when[row[order]] = (left_s[firsts] - late_s[first_lines.sensor])[order]
    wait_s[row[order]] = doubt_s[first_lines.sensor][order]
    return _pooled(about, information, pull, when, wait_s)


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
    spread = np.linalg.inv(information[rows]).astype(np.float64, copy=False)
    spread = 0.5 * (spread + spread.transpose(0, 2, 1))
    shift = matvec(spread, pull[rows])[:, :2]
    spread = spread[:, :2, :2]
    axes = local_axes(about[rows])
    place = ecef_to_geodetic(about[rows] + shift[:, :1] * axes[:, 0] + shift[:, 1:] * axes[:, 1])
    points.place[rows] = np.stack([place.latitude_rad, place.longitude_rad, when[rows]], axis=1)
    covariance_ = np.zeros((len(rows), 3, 3))
    covariance_[:, :2, :2] = spread
    covariance_[:, 2, 2] = np.square(wait_s[rows])
    points.covariance[rows] = covariance_
    return points


def states_at(arcs: ArcFits, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ECEF states (n, 6) at times (n,) and covariances (n, 6, 6), scaled where the arc fits
    badly.

    The covariance is that of the noise, times the reduced χ² where this exceeds 1.
    """
    _, covariance, misfit = solved(arcs.normal())
    freedom = np.maximum(np.where(arcs.seen.sum(axis=1) < 2, 3, 2) * arcs.looks - 6, 1)
    covariance = covariance * np.maximum(misfit / freedom, 1.0)[:, None, None]
    trials = arcs.state[:, None] + np.concatenate([np.zeros((1, 6)), np.diag(STEPS)])
    flown = propagate_kepler(trials[:, :, :3], trials[:, :, 3:], (time_s - arcs.epoch_s)[:, None])
    state = np.concatenate(eci_to_ecef_state(*flown, time_s[:, None]), axis=2)
    slope = ((state[:, 1:] - state[:, :1]) / STEPS[:, None]).transpose(0, 2, 1)
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
