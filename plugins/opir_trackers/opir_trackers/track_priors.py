"""The prior of new tracks, and the filter that a scene's settings describe."""

from typing import Any

import numpy as np
from attrs import frozen
from opir_estimation import (
    COAST,
    FIRST_HEIGHT_M,
    GRAZING_SINE,
    Dynamics,
    FreeBurn,
    FreeThrust,
    ImmFilter,
    ModeEstimates,
    Motion,
    MotionModel,
    NewStage,
    PredictedMeasurements,
    Thrust,
    dot,
    earth_rotated,
    ground_velocities,
)
from opir_forecast import FirstMotion

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight import Drag, Forces, forces_of, height_and_up
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.plugin import TrackerContext
from opir_trackers.configs import ImmConfig, ThrustConfig
from opir_trackers.initiation import HIGHER_M, SPEED_SIGMA_M_S, STEADY_M_S2, TrackCandidates
from opir_trackers.parts import PartContext, made_part

#: Prior specific force of a boost, upwards, m/s².
FIRST_FORCE_M_S2 = 20.0

#: Of a target that one sensor alone sees, prior mean of the climb and standard deviations of the
#: velocity over the ground, east-north-up, m/s: within 40 s of launch at a net 2 to 15 m/s²
#: upwards, a third of it across. Notional.
FIRST_CLIMB_M_S = 150.0
_SPEEDS_M_S = (200.0, 200.0, 300.0)

#: Prior standard deviation of the position of a candidate of several sensors, on each axis, m.
FARTHER_M = 20e3


@frozen
class TrackLaw:
    """Probabilities of the modes of tracks."""

    #: Prior probability that a new target is burning.
    burns: float = 0.98

    #: Probability of a detection per slice of a coasting track where no sensor detects bodies:
    #: false alarms or the end of the burn.
    coast_detection: float = 0.01

    #: A burning target may go undetected for up to this many scans of the slowest sensor; this
    #: counts in its detection rate.
    pause_scans: float = 4.0

    #: Squared innovation of the position of both modes along the velocity, in standard deviations,
    #: at which a free burn is started: one slice in 50 exceeds it by chance (χ² of 3 degrees of
    #: freedom).
    surprise: float = 10.0

    #: Standard deviations of the force on a source that stands, m/s², and of its growth, 1/s: next
    #: to none.
    standing_sigma: float = 0.01


LAW = TrackLaw()


def filter_of(config: ImmConfig, context: TrackerContext) -> ImmFilter:
    """Return the filter for the scene's forces and the configured modes."""
    forces = forces_of(context.forces)
    free = Forces(zonal=forces.zonal, gravity=forces.gravity)
    thrust = config.thrust
    switches = config.modes == "boost-coast"
    follows_bodies = any(sensor.follows_bodies for sensor in context.sensors)
    period_s = [sensor.scan.period_ns * 1e-9 for sensor in context.sensors]
    return ImmFilter(
        boost=made_part(
            MotionModel, "motion", PartContext(tracker=context, settings=config, forces=free)
        ),
        coast=_coast_of(config, free, forces.drag),
        boost_s=config.boost_s if switches else np.inf,
        coast_s=config.coast_s if switches else np.inf,
        coast_detection=1.0 if follows_bodies else LAW.coast_detection,
        scan_s=min(period_s, default=0.0),
        pause_s=LAW.pause_scans * max(period_s, default=0.0),
        residual_share=0.0 if follows_bodies else thrust.residual_share,
        stage=stage_of(thrust),
        free=_free_of(thrust, free),
    )


def thrust_motion(_config: Any, context: PartContext) -> Thrust:
    """Return the motion model `thrust`."""
    return _boost_of(context.settings.thrust, context.forces)


def needed_scans_of(config: ImmConfig, context: TrackerContext) -> int:
    """Return M of M-of-N track initiation."""
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in context.sensors])
    return config.needed_scans or needed_scans(period_s)


def needed_scans(period_s: FloatArray) -> int:
    """Return M of M-of-N track initiation for sensors with scan periods (n,), s.

    A track is reported after 2 M detections. M is 4 if the fastest sensor makes four scans in 4 s,
    else 2. At 10 s per scan four scans are most of a burn: of 30
    launches before two sensors 21 were tracked, after 74 s in the median; with M = 2 all, after 31
    s. What it costs: no false track in two hours with sensors that confirm their detections over
    scans. Where every false alarm is reported (two scanners, 17 a scan), 29 tracks of noise have
    enough detections in ten minutes; all are recognised as noise, and none is reported.
    """
    return 4 if 4.0 * float(period_s.min(initial=np.inf)) <= 4.0 else 2


def stage_of(thrust: ThrustConfig) -> NewStage:
    """Return what a new stage begins with: what a new track begins with."""
    force = thrust.force_sigma_m_s2
    growth = (thrust.growth_per_s, thrust.growth_sigma_per_s)
    tilt = float(np.tan(np.radians(thrust.tilt_deg)))
    return NewStage(FIRST_FORCE_M_S2, force, *growth, thrust.stage_s, tilt)


def _boost_of(thrust: ThrustConfig, forces: Forces) -> Thrust:
    tilt_rad = float(np.radians(thrust.tilt_deg))
    return Thrust(tilt_rad, thrust.tilt_s, thrust.noise_m_s2, thrust.growth_noise_per_s, forces)


def _free_of(thrust: ThrustConfig, forces: Forces) -> FreeBurn:
    motion = FreeThrust(thrust.free_noise_m_s2, thrust.growth_noise_per_s, forces)
    return FreeBurn(motion, thrust.free_sigma_m_s2, thrust.free_share, thrust.free_s, LAW.surprise)


def _coast_of(config: ImmConfig, forces: Forces, drag: Drag | None) -> Dynamics:
    fall = Motion(COAST, config.coast_noise_m_s, forces)
    if drag is None:
        return fall
    from opir_estimation import AtmosphericDescent

    return AtmosphericDescent(fall, drag)


def _climbs_m_s(candidates: TrackCandidates) -> FloatArray:
    """Return prior mean climbs (n,): of several sensors the lines say it."""
    climb = np.maximum(FIRST_CLIMB_M_S, 0.5 * candidates.speed_m_s)
    return np.where(candidates.sensors == 1, climb, 0.0)


def prior_estimates(candidates: TrackCandidates, time_s: float, config: ImmConfig) -> ModeEstimates:
    """Return the prior estimates (n,) of new tracks at a time."""
    count = len(candidates)
    times_s = np.full(count, time_s)
    axes = prior_axes(candidates)
    inertial = np.stack([earth_rotated(axes[:, row], times_s) for row in range(3)], axis=1)
    up = inertial[:, 2]
    position = earth_rotated(candidates.position_ecef_m, times_s)
    velocity = ground_velocities(position) + _climbs_m_s(candidates)[:, None] * up
    growth = np.full((count, 1), config.thrust.growth_per_s)
    mean = np.concatenate([position, velocity, FIRST_FORCE_M_S2 * up, growth], axis=1)
    root = _prior_roots(candidates, inertial, config.thrust)
    return _in_both_modes(mean, root, np.zeros_like(position), config)


def _prior_roots(candidates: TrackCandidates, axes: FloatArray, thrust: ThrustConfig) -> FloatArray:
    """Return the information roots (n, 10, 10) of new tracks, with inertial axes (n, 3, 3), rows
    east, north and up.
    """
    sigmas = [thrust.force_sigma_m_s2] * 3 + [thrust.growth_sigma_per_s]
    size = COAST + len(sigmas)
    place, speed = prior_sigmas(candidates)
    root = np.zeros((len(axes), size, size))
    root[:, :3, :3] = _information_roots(axes, place)
    root[:, 3:COAST, 3:COAST] = _information_roots(axes, speed)
    root[:, range(COAST, size), range(COAST, size)] = 1.0 / np.array(sigmas)
    return root


def _in_both_modes(
    mean: FloatArray, root: FloatArray, detection_rate: FloatArray, config: ImmConfig
) -> ModeEstimates:
    """Return boosts (n, 10) and their coasts, with prior mode probabilities."""
    burning = {"boost-coast": LAW.burns, "boost": 1.0, "coast": 0.0}[config.modes]
    weight = np.tile([burning, 1.0 - burning], (len(mean), 1))
    coast = (mean[:, :COAST].copy(), root[:, :COAST, :COAST].copy())
    return ModeEstimates(weight, mean, root, *coast, detection_rate)


def standing_estimates(
    estimates: ModeEstimates,
    position_m: FloatArray,
    covariance: FloatArray,
    speed_sigma_m_s: float,
    config: ImmConfig,
) -> ModeEstimates:
    """Return estimates (n,) of sources that stand on the ground, in place of those of their tracks.

    `position_m` (n, 3) and `covariance` (n, 3, 3) are inertial. In the boost mode a force balances
    the weight.
    """
    mean = estimates.boost_mean.copy()
    cubed = dot(position_m, position_m)[:, None] ** 1.5
    mean[:, :3] = position_m
    mean[:, 3:6] = ground_velocities(position_m)
    mean[:, 6:9] = EARTH_MU_M3_S2 / cubed * position_m
    mean[:, 6:8] -= EARTH_ROTATION_RAD_S**2 * position_m[:, :2]
    root = _standing_roots(covariance, speed_sigma_m_s, mean.shape[1])
    return _in_both_modes(mean, root, estimates.detection_rate, config)


def _standing_roots(covariance: FloatArray, speed_sigma_m_s: float, size: int) -> FloatArray:
    """Return information roots (n, size, size) of sources at positions with covariances (n, 3, 3)
    that stand on the ground.
    """
    root = np.zeros((len(covariance), size, size))
    root[:, :3, :3] = np.linalg.cholesky(np.linalg.inv(covariance)).mT
    root[:, range(3, 6), range(3, 6)] = 1.0 / speed_sigma_m_s
    root[:, range(6, size), range(6, size)] = 1.0 / LAW.standing_sigma
    return root


def prior_sigmas(candidates: TrackCandidates) -> tuple[FloatArray, FloatArray]:
    """Return prior standard deviations (n, 3) of position and (n, 3) of velocity, east-north-up.

    For a candidate of one sensor: 30 km along the ground, 5 km in height, and `_SPEEDS_M_S` about a
    climb: a line of sight alone does not say whether its target climbs or descends. Where its line
    grazes the ground the height shifts it by more: up to 250 km along the horizon, where the
    curvature of the Earth is 5 km too. Where its speed across the line is known to be higher,
    height and velocity have the standard deviations of the height by speed and of the speed. A
    candidate of several sensors may be at any height; its speed grows with the height: 300 m/s plus
    1.5 times the speed from a steady 20 m/s² upwards. Of neighbouring launches, with intersections
    at many heights, those near the ground were chosen: the height is within its own value, or 3 km.
    """
    height = np.maximum(ecef_to_geodetic(candidates.position_ecef_m).height_m, 0.0)
    alone = candidates.sensors == 1
    place = np.full((len(alone), 3), FARTHER_M)
    place[alone] = _lone_sigmas_m(candidates)[alone]
    beside = np.flatnonzero(candidates.is_of_parts & ~alone)
    place[beside, 2] = np.clip(height[beside], FIRST_HEIGHT_M, FARTHER_M)
    fast = np.maximum(candidates.speed_m_s[:, None], _SPEEDS_M_S)
    return place, np.where(alone[:, None], fast, _speed_sigmas(height)[:, None])


def _lone_sigmas_m(candidates: TrackCandidates) -> FloatArray:
    """Return prior standard deviations (n, 3) of positions that a single sensor sees."""
    height = np.maximum(candidates.height_by_speed_m, HIGHER_M)
    shift = np.maximum(height / np.maximum(candidates.sine, GRAZING_SINE), 30e3)
    return np.stack([shift, shift, height], axis=1)


def _speed_sigmas(height_m: FloatArray) -> FloatArray:
    return SPEED_SIGMA_M_S + 1.5 * np.sqrt(2.0 * STEADY_M_S2 * height_m)


def first_motion(
    predicted: PredictedMeasurements, first_s: FloatArray, alone: BoolArray, thrust: ThrustConfig
) -> FirstMotion:
    """Return what `prior_estimates` assume of motions (n,) at first detections at `first_s` (n,).

    Heights are those of predictions; `alone` (n,) marks tracks of one sensor.
    """
    position = predicted.positions(np.arange(len(first_s)), first_s)
    radius = np.sqrt(dot(position, position))
    height = height_and_up(np.ascontiguousarray(position.T), 1.0 / radius)[0]
    raised = np.maximum(height, 0.0)
    # As `prior_sigmas` for a candidate of one sensor that its speed has placed at this height.
    fast = np.where(height > HIGHER_M, np.sqrt(2.0 * STEADY_M_S2 * raised), 0.0)
    place = np.where(alone, np.maximum(height, HIGHER_M), FARTHER_M)
    speed = np.where(alone, np.maximum(fast, _SPEEDS_M_S[2]), _speed_sigmas(raised))
    force = thrust.force_sigma_m_s2
    growth = np.hypot(thrust.growth_sigma_per_s * FIRST_FORCE_M_S2, thrust.growth_per_s * force)
    net = FIRST_FORCE_M_S2 - EARTH_MU_M3_S2 / (radius * radius)
    climb = np.where(alone, np.maximum(FIRST_CLIMB_M_S, 0.5 * fast), 0.0)
    jerk = thrust.growth_per_s * FIRST_FORCE_M_S2
    return FirstMotion(height, climb, net, jerk, (place, speed, force, float(growth)))


def prior_axes(candidates: TrackCandidates) -> FloatArray:
    """Return the local axes (n, 3, 3), rows east, north and up, in ECEF."""
    return local_axes(candidates.position_ecef_m)


def _information_roots(axes: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return upper triangular information roots (n, 3, 3) with standard deviations (n, 3) along the
    rows of axes.
    """
    from opir_estimation.square_root import triangular

    return triangular(axes / sigma[:, :, None])
