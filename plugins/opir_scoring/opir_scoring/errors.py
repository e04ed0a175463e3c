"""Errors of tracks against truth, row by row: per tick and target, and of launch and impact
points.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.geometry import east_north_up_axes, geodesic_inverse, geodetic_to_ecef, local_axes
from opir_core.interfaces import Columns
from opir_core.plugin import Sensor, Tracks
from opir_scoring.bound import DetectedLooks, free_bound, position_and_velocity, state_bound
from opir_scoring.containments import nees, on_normal_scale
from opir_scoring.evidence import Ownership, RunEvidence, rows_in_force, true_states_ecef
from opir_scoring.proper_scores import energy_scores


@frozen(eq=False, repr=False)
class StateErrors(Columns):
    """One row per tick of a target's track in force, while the truth is known.

    `since_s` counts from the target's ignition, `seen_s` from its first detection; errors and
    bounds are in m and m/s; `nees` has six degrees of freedom and includes the reported radii of
    the state ellipsoids. The bounds are for a known thrust, the free ones for an unknown one.
    `impact_m` is the error of the impact predicted at the
    tick, along the ground. The energies are energy scores of position and velocity
    (`energy_scores`), with the reported radii too.
    """

    target: IntArray
    since_s: FloatArray
    seen_s: FloatArray
    is_stereo: BoolArray
    is_biased: BoolArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    position_energy_m: FloatArray
    velocity_energy_m_s: FloatArray
    nees: FloatArray
    position_bound_m: FloatArray
    velocity_bound_m_s: FloatArray
    position_free_bound_m: FloatArray
    velocity_free_bound_m_s: FloatArray
    impact_m: FloatArray


@frozen(eq=False, repr=False)
class PointErrors(Columns):
    """One row per target with a track: errors of its last launch and impact estimates, two degrees
    of freedom.

    Distances are along the ground, m; times are s, estimated minus true; nan without an estimate.
    `impact_nees` includes the reported radii of the impact ellipses (`on_normal_scale`).
    `launch_energy_m` is the energy score of the launch point, on the ground.
    """

    target: IntArray
    is_stereo: BoolArray
    is_biased: BoolArray
    launch_m: FloatArray
    launch_energy_m: FloatArray
    launch_nees: FloatArray
    launch_time_s: FloatArray
    impact_m: FloatArray
    impact_nees: FloatArray
    impact_time_s: FloatArray


def state_errors(evidence: RunEvidence, owners: Ownership) -> StateErrors:
    """Return the errors of all targets' tracks in force, by target and tick."""
    tracks = evidence.tracks.take(rows_in_force(evidence, owners))
    target = owners.target[np.searchsorted(owners.track, tracks.track)]
    return StateErrors.concatenate(
        _errors_of(evidence, number, tracks.take(target == number), owners)
        for number in np.unique(target).tolist()
    )


def _errors_of(
    evidence: RunEvidence, target: int, tracks: Tracks, owners: Ownership
) -> StateErrors:
    targets = np.full(len(tracks), target, dtype=np.int32)
    true = true_states_ecef(evidence.plan, targets, tracks.tick_s)
    is_known = np.isfinite(true).all(axis=1) & np.isfinite(tracks.state).all(axis=1)
    tracks = tracks.take(is_known)
    owner = np.searchsorted(owners.track, tracks.track)
    error = tracks.state - true[is_known]
    looks = _detected_looks(evidence, target)
    bound_m, bound_m_s = position_and_velocity(state_bound(tracks.tick_s, looks))
    free_bound_m, free_bound_m_s = position_and_velocity(free_bound(tracks.tick_s, looks))
    stated = (error, tracks.state_covariance, tracks.state_sigmas)
    return StateErrors(
        target=np.full(len(tracks), target, dtype=np.int64),
        since_s=tracks.tick_s - evidence.plan.targets.ignition_s[target],
        seen_s=tracks.tick_s - (looks.look_s[0] if len(looks.look_s) else np.nan),
        is_stereo=owners.is_stereo[owner],
        is_biased=owners.is_biased[owner],
        position_m=np.linalg.norm(error[:, :3], axis=1),
        velocity_m_s=np.linalg.norm(error[:, 3:], axis=1),
        position_energy_m=energy_scores(*stated, slice(0, 3)),
        velocity_energy_m_s=energy_scores(*stated, slice(3, 6)),
        nees=on_normal_scale(nees(error, tracks.state_covariance), tracks.state_sigmas, 6),
        position_bound_m=bound_m,
        velocity_bound_m_s=bound_m_s,
        position_free_bound_m=free_bound_m,
        velocity_free_bound_m_s=free_bound_m_s,
        impact_m=_impact_error(tracks, evidence.plan.targets.truth()[target]),
    )


def _detected_looks(evidence: RunEvidence, target: int) -> DetectedLooks:
    """Return the looks that detected a target, with true positions."""
    plan = evidence.plan
    rows = np.flatnonzero(evidence.target == target)
    time_s = evidence.time_s[rows]
    sensor = evidence.sensor[rows]
    sensor_m = _sensors_m(plan.sensors, sensor, time_s)
    clipped_s = np.clip(time_s, plan.targets.ignition_s[target], plan.targets.end_s[target])
    targets = np.full(len(rows), target, dtype=np.int32)
    position_m = plan.targets.position_ecef_m(targets, clipped_s)
    turns = bias_turns(plan.sensors, sensor, sensor_m)
    return DetectedLooks(time_s, position_m, sensor_m, evidence.sigma_rad[rows], turns)


def _sensors_m(sensors: Sequence[Sensor], sensor: IndexArray, time_s: FloatArray) -> FloatArray:
    position_m = np.empty((len(sensor), 3))
    for number in np.unique(sensor).tolist():
        rows = np.flatnonzero(sensor == number)
        position_m[rows] = sensors[number].orbit.position_ecef_m(time_s[rows])
    return position_m


def _impact_error(tracks: Tracks, truth: Mapping[str, Any]) -> FloatArray:
    """Return the ground distances (n,), m, of predicted impacts from the true one; nan without a
    prediction.
    """
    place = np.broadcast_to(np.array(place_of(truth.get("impact"))), (len(tracks), 3))
    return np.linalg.norm(ground_error(tracks.impact, place), axis=1)


def bias_turns(
    sensors: Sequence[Sensor], sensor: IndexArray, sensor_ecef_m: FloatArray
) -> FloatArray:
    """Return the rotations (n, p, 3), rad, of looks' sensors (n,) by one standard deviation of each
    bias.

    As in `opir_core.planning.pointing_bias`: about east and north of the sensor position (n, 3).
    """
    sigmas = [sensors[number].line_of_sight_bias_sigma_rad for number in range(len(sensors))]
    biased = [number for number in np.unique(sensor).tolist() if sigmas[number] > 0.0]
    turns = np.zeros((len(sensor), 2 * len(biased), 3))
    for place, number in enumerate(biased):
        rows = np.flatnonzero(sensor == number)
        axes = local_axes(sensor_ecef_m[rows])[:, :2]
        turns[rows, 2 * place : 2 * place + 2] = sigmas[number] * axes
    return turns


def point_errors(evidence: RunEvidence, owners: Ownership) -> PointErrors:
    """Return the errors of the last launch and impact estimates of each target with a track."""
    tracks = evidence.tracks.take(last_rows(evidence, owners))
    owner = np.searchsorted(owners.track, tracks.track)
    target = owners.target[owner]
    truth = evidence.plan.targets.truth()
    truths = [truth[number] for number in target.tolist()]
    impact_s = np.array([_time(true.get("impact")) for true in truths])
    launch_error = ground_error(tracks.launch, _places(truths, "launch"))
    impact_error = ground_error(tracks.impact, _places(truths, "impact"))
    launch_covariance = tracks.launch_covariance[:, :2, :2]
    impact_nees = nees(impact_error, tracks.impact_covariance[:, :2, :2])
    return PointErrors(
        target=target,
        is_stereo=owners.is_stereo[owner],
        is_biased=owners.is_biased[owner],
        launch_m=np.linalg.norm(launch_error, axis=1),
        launch_energy_m=energy_scores(launch_error, launch_covariance),
        launch_nees=nees(launch_error, launch_covariance),
        launch_time_s=tracks.launch[:, 2] - evidence.plan.targets.ignition_s[target],
        impact_m=np.linalg.norm(impact_error, axis=1),
        impact_nees=on_normal_scale(impact_nees, tracks.impact_sigmas),
        impact_time_s=tracks.impact[:, 2] - impact_s,
    )


def _places(truths: Sequence[Mapping[str, Any]], name: str) -> FloatArray:
    places = [place_of(truth.get(name)) for truth in truths]
    return np.array(places, dtype=np.float64).reshape(-1, 3)


def last_rows(evidence: RunEvidence, owners: Ownership) -> IntArray:
    """Return the rows of the run's tracks that were in force last, one per launch with a track, by
    launch.
    """
    rows = rows_in_force(evidence, owners)
    target = owners.target[np.searchsorted(owners.track, evidence.tracks.track[rows])]
    return rows[np.append(np.diff(target) != 0, True)] if len(rows) else rows


def place_of(point: object) -> tuple[float, float, float]:
    """Return latitude, longitude, rad, and height, m, of a point of the truth; nan if missing."""
    if not isinstance(point, dict):
        return np.nan, np.nan, np.nan
    return np.radians(point["lat_deg"]), np.radians(point["lon_deg"]), point.get("height_m", 0.0)


def _time(point: object) -> float:
    return float(point["time_s"]) if isinstance(point, dict) and "time_s" in point else np.nan


def ground_error(point: FloatArray, place: FloatArray) -> FloatArray:
    """Return estimated minus true points (n, 2), m east and north at the estimate, with the
    geodesic's length.

    The true point is placed at the geodesic's bearing and length: in the tangent plane an error of
    8000 km would be one of 6000 km.
    """
    latitude = point[:, 0]
    longitude = point[:, 1]
    offset_m = geodetic_to_ecef(latitude, longitude, np.zeros(len(point))) - geodetic_to_ecef(
        place[:, 0], place[:, 1], np.zeros(len(place))
    )
    axes = east_north_up_axes(latitude, longitude)
    error: FloatArray = np.einsum("nij,nj->ni", axes[:, :2], offset_m)
    # Within this distance, m, a plane is wrong by 3 cm.
    rows = np.flatnonzero(np.linalg.norm(offset_m, axis=1) > 20e3)
    error[rows] = _geodesic_error(point[rows], place[rows])
    return error


def _geodesic_error(point: FloatArray, place: FloatArray) -> FloatArray:
    geodesic = geodesic_inverse(point[:, 0], point[:, 1], place[:, 0], place[:, 1])
    bearing = geodesic.bearing_rad
    direction = np.stack([np.sin(bearing), np.cos(bearing)], axis=1)
    return -geodesic.distance_m[:, None] * direction
