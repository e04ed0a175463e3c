"""What the profile fit tells of its tracks: state, launch, burnout and impact with covariances, and the type.

Estimates of a track's classes are blended by their probabilities; the covariance holds what they differ by.
"""

from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from opir_core.columns import Columns
from opir_core.flight.boost import BoostPath
from opir_core.flight.conic_impact import kepler_impact
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_eci_state, ecef_to_geodetic, eci_to_ecef, eci_to_ecef_state
from opir_core.records import FloatArray, IntArray, Tracks
from opir_core.tracking.profile_family import CLASS_TYPE, SIZE, START, paths
from opir_core.tracking.profile_fit import STEPS, Hypotheses, covariance, tiled

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel

#: A class less probable than this is left out of the blend.
_LEAST = 1e-3

#: Metres to a radian of latitude.
_RADIUS_M = 6.371e6


@frozen(eq=False)
class Told(Columns):
    """Quantities of n hypotheses: state (n, 6), launch and impact (n, 3) as latitude, longitude, rad, and time, s.

    `burnout` (n, 7) is ECEF position and velocity at the end of the burn and its time.
    """

    state: FloatArray
    launch: FloatArray
    impact: FloatArray
    burnout: FloatArray


def report(
    hypotheses: Hypotheses,
    probability: FloatArray,
    tick_s: float,
    bias_sigma_rad: FloatArray,
    forces: "ForceModel",
) -> Tracks:
    """Return the estimates at a tick of tracks whose hypotheses (n,) have these probabilities, sorted by track."""
    kept = np.flatnonzero(probability >= _LEAST)
    hypotheses, weight = hypotheses.take(kept), probability[kept]
    told, slopes = _told_with_slopes(hypotheses, tick_s, forces)
    spread = covariance(hypotheses, bias_sigma_rad)
    rests = _at_rest(hypotheses, spread, tick_s)
    number, row = np.unique(hypotheses.track, return_inverse=True)
    weight = weight / np.bincount(row, weight)[row]
    doubts = [slope @ spread @ slope.transpose(0, 2, 1) for slope in slopes]
    doubts[0] += rests
    blended = [
        _blended(getattr(told, name), more, weight, row, len(number), name in ("launch", "impact"))
        for name, more in zip(("state", "launch", "impact", "burnout"), doubts, strict=True)
    ]
    types = np.zeros((len(number), 4))
    np.add.at(types, (row, CLASS_TYPE[hypotheses.kind]), weight)
    (state, launch, impact, burnout), spreads = zip(*blended, strict=True)
    return Tracks(
        tick_s=np.full(len(number), tick_s),
        track=number,
        state=state,
        state_covariance=spreads[0],
        launch=launch,
        launch_covariance=spreads[1],
        impact=impact,
        impact_covariance=spreads[2],
        type_probability=types,
        burnout=burnout,
        burnout_covariance=spreads[3],
    )


def _at_rest(hypotheses: Hypotheses, spread: FloatArray, tick_s: float) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states at rest are less certain than their slopes say.

    A target that is estimated to start later may have started already: it then moves by the time in doubt.
    """
    start_s = hypotheses.anchor_s + hypotheses.parameters[:, START]
    doubt_s = np.sqrt(spread[:, START, START]) + _START_DOUBT_S
    waits = tick_s <= start_s + doubt_s
    sigma = np.concatenate([np.full(3, 0.5 * _ACCELERATION_M_S2), np.full(3, _ACCELERATION_M_S2)])
    times = doubt_s[:, None] ** np.array([2, 2, 2, 1, 1, 1])
    variance = np.where(waits[:, None], np.square(sigma * times), 0.0)
    more: FloatArray = variance[:, :, None] * np.eye(6)
    return more


#: How fast a boost sets out, m/s², about, and the least doubt about when it did, s.
_ACCELERATION_M_S2 = 15.0
_START_DOUBT_S = 0.05


def _told_with_slopes(hypotheses: Hypotheses, tick_s: float, forces: "ForceModel") -> tuple[Told, list[FloatArray]]:
    """Return what hypotheses tell, and how it changes with their parameters, (n, d, 9) each.

    Slopes of places are in metres east and north, and seconds.
    """
    count = len(hypotheses)
    parameters, anchors, shapes = tiled(hypotheses)
    path = paths(parameters, anchors, shapes)
    told = _told(path, tick_s)
    latitude, longitude = anchors.places(parameters)
    launch = np.stack([latitude, longitude, path.ignition_s], axis=1)
    every = [array.reshape(SIZE + 1, count, -1) for array in (told.state, launch, told.impact, told.burnout)]
    state, site, ground, burnout = ((array[1:], array[0]) for array in every)
    differences = [state[0] - state[1], _ground(*site), _ground(*ground), burnout[0] - burnout[1]]
    slopes = [np.moveaxis(array, 0, 2) / STEPS for array in differences]
    impact = every[2][0] if forces == "kepler" else _forced_impact(path, count, forces)
    return Told(every[0][0], every[1][0], impact, every[3][0]), slopes


def _told(path: BoostPath, tick_s: float) -> Told:
    count = len(path.ignition_s)
    row = np.arange(count)
    held = np.clip(tick_s, path.ignition_s, path.burnout_s)
    state = np.concatenate(path.state(row, held), axis=1)
    ended = path.state(row, path.burnout_s)
    burnout = ecef_to_eci_state(*ended, path.burnout_s)
    late = np.flatnonzero(tick_s > path.burnout_s)
    if len(late):
        flown = propagate_kepler(burnout[0][late], burnout[1][late], tick_s - path.burnout_s[late])
        state[late] = np.concatenate(eci_to_ecef_state(*flown, tick_s), axis=1)
    duration, point = kepler_impact(*burnout)
    impact = _place(eci_to_ecef(point, path.burnout_s + duration), path, duration)
    return Told(state, np.empty((count, 3)), impact, np.column_stack([*ended, path.burnout_s]))


def _forced_impact(path: BoostPath, count: int, forces: "ForceModel") -> FloatArray:
    """Return the impacts of the first `count` paths under the scene's forces."""
    from opir_core.flight.impact_event import impact

    row = np.arange(count)
    burnout = ecef_to_eci_state(*path.state(row, path.burnout_s[row]), path.burnout_s[row])
    duration, point = impact(*burnout, 0.0, forces, tolerance_m=1.0)
    return _place(eci_to_ecef(point, path.burnout_s[row] + duration), path, duration)


def _place(position_ecef_m: FloatArray, path: BoostPath, duration_s: FloatArray) -> FloatArray:
    place = ecef_to_geodetic(position_ecef_m)
    time_s = path.burnout_s[: len(duration_s)] + duration_s
    return np.stack([place.latitude_rad, place.longitude_rad, time_s], axis=1)


def _ground(points: FloatArray, about: FloatArray) -> FloatArray:
    """Return points (..., 3) as metres east and north of others, and seconds after them."""
    turn = np.remainder(points[..., 1] - about[..., 1] + np.pi, 2.0 * np.pi) - np.pi
    east, north = _RADIUS_M * np.cos(about[..., 0]) * turn, _RADIUS_M * (points[..., 0] - about[..., 0])
    return np.stack([east, north, points[..., 2] - about[..., 2]], axis=-1)


def _off_ground(away: FloatArray, about: FloatArray) -> FloatArray:
    """Return the points (n, 3) that lie metres east and north of others, and seconds after them."""
    latitude = about[:, 0] + away[:, 1] / _RADIUS_M
    longitude = about[:, 1] + away[:, 0] / (_RADIUS_M * np.maximum(np.cos(about[:, 0]), 1e-9))
    return np.stack([latitude, np.remainder(longitude + np.pi, 2.0 * np.pi) - np.pi, about[:, 2] + away[:, 2]], axis=1)


def _blended(
    values: FloatArray, spread: FloatArray, weight: FloatArray, row: IntArray, count: int, are_places: bool
) -> tuple[FloatArray, FloatArray]:
    """Return means (count, d) and covariances (count, d, d) of mixtures: `row` says which each part belongs to.

    Parts that are not known, as the impact of a flight that does not come down, count for nothing; of none, nan.
    """
    known = np.isfinite(values).all(axis=1) & np.isfinite(spread).all(axis=(1, 2))
    values, spread, weight, row = values[known], spread[known], weight[known], row[known]
    share = np.bincount(row, weight, count)
    weight = weight / share[row]
    heaviest = np.zeros(count, dtype=np.int64)
    order = np.argsort(weight, kind="stable")
    heaviest[row[order]] = order
    if not len(values):
        return np.full((count, values.shape[1]), np.nan), np.full((count, *spread.shape[1:]), np.nan)
    about = values[heaviest][row]
    away = _ground(values, about) if are_places else values - about
    mean = np.zeros((count, values.shape[1]))
    np.add.at(mean, row, weight[:, None] * away)
    apart = away - mean[row]
    total = np.zeros((count, values.shape[1], values.shape[1]))
    np.add.at(total, row, weight[:, None, None] * (spread + apart[:, :, None] * apart[:, None, :]))
    first = np.where(share[:, None] > 0.0, values[heaviest], np.nan)
    total[share <= 0.0] = np.nan
    return (_off_ground(mean, first) if are_places else first + mean), total
