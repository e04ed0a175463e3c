"""Lines of sight of the tracking set: who looks when, what is detected, with which error.

A look of a sensor falls at `phase_s` plus whole periods and covers everything above its horizon. A
burning target is detected with probability P_d, a dark one never. The error of a direction is
normal, isotropic across the line; light takes no time. A bias turns all directions of a sensor by
two constant small angles, about east and north at the sensor. Clutter is uniform in solid angle
within a cone about the middle of the launches.
"""

from typing import NamedTuple

import numpy as np
from set_cases import CLUTTER_KM, WIDE
from set_flights import Paths, burns, directions, flown

#: Detections needed before a target is scored, and how long it is after its last burnout, s.
NEEDED = 3
SCORED_S = 20.0
#: Step of the times at which tracks are scored, s.
TICK_S = 5.0


class Sights(NamedTuple):
    """Detections (n,) by time, then sensor: ECEF positions of sensor and target and directions (n,
    3).

    `launch` is -1 for clutter, whose target position is nan.
    """

    time_s: np.ndarray
    sensor: np.ndarray
    sensor_m: np.ndarray
    direction: np.ndarray
    launch: np.ndarray
    target_m: np.ndarray


class Truth(NamedTuple):
    """Flights of a scene: paths, burns (s) of each launch, ticks (k,), and which are scored
    (launches, k).
    """

    paths: tuple[Paths, ...]
    burns_s: tuple[np.ndarray, ...]
    tick_s: np.ndarray
    is_scored: np.ndarray


def end_s(scene):
    """Return the end of a scene: a whole tick after the last one that may be scored."""
    last = max(burns(launch.row, launch.stages)[-1, 1] for launch in scene.launches)
    return float(TICK_S * (np.ceil((last + SCORED_S) / TICK_S) + 1))


def observed(scene):
    """Return the flights of a scene and what its sensors detect."""
    until_s = end_s(scene)
    paths = tuple(flown(launch.row[None], launch.stages, until_s) for launch in scene.launches)
    burning = tuple(burns(launch.row, launch.stages) for launch in scene.launches)
    parts = []
    for number, sensor in enumerate(scene.sensors):
        time_s = np.round(np.arange(sensor.phase_s, until_s, sensor.period_s), 6)
        parts.append(_sights_of(scene, number, sensor, time_s, paths, burning))
    every = Sights(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    # Within a look the order says nothing: by the direction.
    order = np.lexsort((every.direction[:, 0], every.sensor, every.time_s))
    sights = Sights(*(column[order] for column in every))
    tick_s = np.arange(TICK_S, until_s + 1e-6, TICK_S)
    scored = np.array(
        [_scored(sights.time_s[sights.launch == k], row, tick_s) for k, row in enumerate(burning)]
    )
    return Truth(paths, burning, tick_s, scored), sights


def _scored(seen_s, burns_s, tick_s):
    """Return at which ticks (k,) a launch is scored, given the times of its detections."""
    if len(seen_s) < NEEDED:
        return np.zeros(len(tick_s), dtype=np.bool_)
    return (tick_s >= seen_s[NEEDED - 1]) & (tick_s <= burns_s[-1, 1] + SCORED_S)


def _looks_at(path, burns_s, time_s, place, sensor, rng):
    """Return which looks of a sensor detect a launch, and where it is then."""
    position = path.states(time_s)[0, :, :3]
    is_hot = np.any((time_s[:, None] >= burns_s[:, 0]) & (time_s[:, None] < burns_s[:, 1]), axis=1)
    is_above = np.sum(position * (place - position), axis=1) > 0.0
    is_seen = rng.uniform(size=len(time_s)) < sensor.detection_probability
    rows = np.flatnonzero(is_hot & is_above & is_seen)
    return rows, position[rows]


def _sights_of(scene, number, sensor, time_s, paths, burning):
    """Return the detections of one sensor, launch by launch and then the clutter."""
    rng = scene.rng
    place = sensor.position_m(time_s)
    bias = rng.normal(0.0, 1.0, 2) * sensor.true_bias_sigma_rad
    looks = [
        _looks_at(path, burns_s, time_s, place, sensor, rng)
        for path, burns_s in zip(paths, burning, strict=True)
    ]
    look, position = (np.concatenate(column) for column in zip(*looks, strict=True))
    launch = np.repeat(np.arange(len(looks)), [len(rows) for rows, _ in looks])
    line = position - place[look]
    axis = line / np.sqrt(np.sum(line * line, axis=1, keepdims=True))
    sigma = np.full(len(look), sensor.sigma_rad)
    sigma[rng.uniform(size=len(look)) < scene.case.wide_share] *= WIDE
    seen = turned(_noisy(axis, sigma, rng), place[look], bias)
    when, stray = _clutter(scene, sensor, place, rng)
    return Sights(
        np.concatenate([time_s[look], time_s[when]]),
        np.full(len(look) + len(when), number),
        np.concatenate([place[look], place[when]]),
        np.round(np.concatenate([seen, stray]), 10),
        np.concatenate([launch, np.full(len(when), -1)]),
        np.concatenate([position, np.full((len(when), 3), np.nan)]),
    )


def _noisy(axis, sigma_rad, rng):
    """Return directions (n, 3) with normal errors, isotropic across them."""
    error = rng.normal(size=(len(axis), 3)) * sigma_rad[:, None]
    moved = axis + error - np.sum(error * axis, axis=1, keepdims=True) * axis
    return moved / np.sqrt(np.sum(moved * moved, axis=1, keepdims=True))


def horizon_axes(place_m):
    """Return the unit vectors (n, 3) east and north at positions (n, 3), on a sphere."""
    east = np.stack([-place_m[:, 1], place_m[:, 0], np.zeros(len(place_m))], axis=1)
    east /= np.sqrt(np.sum(east * east, axis=1, keepdims=True))
    north = np.cross(place_m, east)
    return east, north / np.sqrt(np.sum(north * north, axis=1, keepdims=True))


def turned(direction, place_m, bias_rad):
    """Return directions (n, 3) of sensors at positions (n, 3), turned by angles (2,) about east and
    north there.
    """
    east, north = horizon_axes(place_m)
    moved = direction + np.cross(bias_rad[0] * east + bias_rad[1] * north, direction)
    return moved / np.sqrt(np.sum(moved * moved, axis=1, keepdims=True))


def clutter_half_angle_rad(scene, sensor):
    """Return the half angle of the cone that a sensor has clutter in, from its position at the
    epoch.
    """
    offset = middle_m(scene) - sensor.position_m(np.zeros(1))[0]
    return float(np.arctan(1e3 * CLUTTER_KM / np.sqrt(np.sum(offset * offset))))


def middle_m(scene):
    """Return the ECEF position (3,) of the middle of the launches, on a sphere."""
    latitude, longitude = (np.array([angle]) for angle in scene.middle)
    return np.asarray(6371e3 * directions(latitude, longitude, np.zeros(1))[0][0])


def _clutter(scene, sensor, place, rng):
    """Return the looks (n,) and directions (n, 3) of clutter."""
    when = np.repeat(np.arange(len(place)), rng.poisson(sensor.clutter_per_look, len(place)))
    line = middle_m(scene) - place[when]
    axis = line / np.sqrt(np.sum(line * line, axis=1, keepdims=True))
    least = np.cos(clutter_half_angle_rad(scene, sensor))
    along = rng.uniform(least, 1.0, len(when))
    turn = rng.uniform(0.0, 2.0 * np.pi, len(when))
    one = np.cross(axis, [0.0, 0.0, 1.0])
    one /= np.sqrt(np.sum(one * one, axis=1, keepdims=True))
    other = np.cross(axis, one)
    out = np.sqrt(1.0 - along * along)[:, None]
    aside = np.cos(turn)[:, None] * one + np.sin(turn)[:, None] * other
    return when, along[:, None] * axis + out * aside
