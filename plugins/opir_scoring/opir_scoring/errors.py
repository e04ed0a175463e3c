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
    the state ellipsoids (`on_normal_scale`). The bounds are for a known thrust, the free ones for
    an unknown one (`opir_scoring.bound`). `impact_m` is the error of the impact predicted at the
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
    parts = (
        _errors_of(evidence, each, tracks.take(target == each), owners)
        for each in np.unique(target).tolist()
    )
    return StateErrors.concatenate(parts)


def _errors_of(
    evidence: RunEvidence, target: int, tracks: Tracks, owners: Ownership
) -> StateErrors:
    everyone = np.full(len(tracks), target, dtype=np.int32)
    true = true_states_ecef(evidence.plan, everyone, tracks.tick_s)
    known = np.isfinite(true).all(axis=1) & np.isfinite(tracks.state).all(axis=1)
    tracks = tracks.take(known)
    true = true[known]
    owner = np.searchsorted(owners.track, tracks.track)
    error = tracks.state - true
    looks = np.flatnonzero(evidence.target == target)
    plan = evidence.plan
    time_s = evidence.time_s[looks]
    sensor = np.empty((len(looks), 3))
    for number in np.unique(evidence.sensor[looks]).tolist():
        rows = np.flatnonzero(evidence.sensor[looks] == number)
        sensor[rows] = plan.sensors[number].orbit.position_ecef_m(time_s[rows])
    held = np.clip(time_s, plan.targets.ignition_s[target], plan.targets.end_s[target])
    position = plan.targets.position_ecef_m(np.full(len(looks), target, dtype=np.int32), held)
    turns = bias_turns(plan.sensors, evidence.sensor[looks], sensor)
    looks_seen = DetectedLooks(time_s, position, sensor, evidence.sigma_rad[looks], turns)
    known_thrust, free_thrust = (
        position_and_velocity(bound(tracks.tick_s, looks_seen))
        for bound in (state_bound, free_bound)
    )
    return StateErrors(
        target=np.full(len(tracks), target, dtype=np.int64),
        since_s=tracks.tick_s - evidence.plan.targets.ignition_s[target],
        seen_s=tracks.tick_s - (evidence.time_s[looks[0]] if len(looks) else np.nan),
        is_stereo=owners.is_stereo[owner],
        is_biased=owners.is_biased[owner],
        position_m=np.linalg.norm(error[:, :3], axis=1),
        velocity_m_s=np.linalg.norm(error[:, 3:], axis=1),
        position_energy_m=energy_scores(
            error, tracks.state_covariance, tracks.state_sigmas, slice(0, 3)
        ),
        velocity_energy_m_s=energy_scores(
            error, tracks.state_covariance, tracks.state_sigmas, slice(3, 6)
        ),
        nees=on_normal_scale(nees(error, tracks.state_covariance), tracks.state_sigmas, 6),
        position_bound_m=known_thrust[0],
        velocity_bound_m_s=known_thrust[1],
        position_free_bound_m=free_thrust[0],
        velocity_free_bound_m_s=free_thrust[1],
        impact_m=_impact_error(tracks, evidence.plan.targets.truth()[target]),
    )


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
    biased = [
        each
        for each in np.unique(sensor).tolist()
        if sensors[each].line_of_sight_bias_sigma_rad > 0.0
    ]
    turns = np.zeros((len(sensor), 2 * len(biased), 3))
    for number, each in enumerate(biased):
        rows = np.flatnonzero(sensor == each)
        axes = local_axes(sensor_ecef_m[rows])[:, :2]
        turns[rows, 2 * number : 2 * number + 2] = sensors[each].line_of_sight_bias_sigma_rad * axes
    return turns


def point_errors(evidence: RunEvidence, owners: Ownership) -> PointErrors:
    """Return the errors of the last launch and impact estimates of each target with a track."""
    tracks = evidence.tracks.take(last_rows(evidence, owners))
    owner = np.searchsorted(owners.track, tracks.track)
    target = owners.target[owner]
    truth = evidence.plan.targets.truth()
    launch, impact = (
        [place_of(truth[number].get(name)) for number in target.tolist()]
        for name in ("launch", "impact")
    )
    ignition_s = evidence.plan.targets.ignition_s[target]
    impact_s = np.array([_time(truth[number].get("impact")) for number in target.tolist()])
    launch_error, impact_error = (
        ground_error(point, np.array(place, dtype=np.float64).reshape(-1, 3))
        for point, place in ((tracks.launch, launch), (tracks.impact, impact))
    )
    return PointErrors(
        target=target,
        is_stereo=owners.is_stereo[owner],
        is_biased=owners.is_biased[owner],
        launch_m=np.linalg.norm(launch_error, axis=1),
        launch_energy_m=energy_scores(launch_error, tracks.launch_covariance[:, :2, :2]),
        launch_nees=nees(launch_error, tracks.launch_covariance[:, :2, :2]),
        launch_time_s=tracks.launch[:, 2] - ignition_s,
        impact_m=np.linalg.norm(impact_error, axis=1),
        impact_nees=on_normal_scale(
            nees(impact_error, tracks.impact_covariance[:, :2, :2]), tracks.impact_sigmas
        ),
        impact_time_s=tracks.impact[:, 2] - impact_s,
    )


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


#: Beyond this distance, m, the geodesic is used: within it a plane is wrong by 3 cm.
_FLAT_M = 20e3


def ground_error(point: FloatArray, place: FloatArray) -> FloatArray:
    """Return estimated minus true points (n, 2), m east and north at the estimate, with the
    geodesic's length.

    The true point is placed at the geodesic's bearing and length: in the tangent plane an error of
    8000 km would be one of 6000 km.
    """
    latitude = point[:, 0]
    longitude = point[:, 1]
    here = geodetic_to_ecef(latitude, longitude, np.zeros(len(point)))
    there = geodetic_to_ecef(place[:, 0], place[:, 1], np.zeros(len(place)))
    axes = east_north_up_axes(latitude, longitude)
    error: FloatArray = np.einsum("nij,nj->ni", axes[:, :2], here - there)
    far = np.flatnonzero(np.linalg.norm(here - there, axis=1) > _FLAT_M)
    way = geodesic_inverse(latitude[far], longitude[far], place[far, 0], place[far, 1])
    error[far] = -way.distance_m[:, None] * np.stack(
        [np.sin(way.bearing_rad), np.cos(way.bearing_rad)], axis=1
    )
    return error
