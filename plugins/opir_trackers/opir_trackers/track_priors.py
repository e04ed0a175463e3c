"""What a track is taken to know before its first update, and the filter a scene's settings ask for."""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.estimation.lines_of_sight import turned
from opir_core.estimation.motion import BOOST, COAST, Motion
from opir_core.flight.forces import Drag, Forces, forces_of
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.interfaces.contexts import TrackerContext
from opir_trackers.configs import StereoFilterConfig
from opir_trackers.filter.dynamics import Dynamics
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.filter.thrust import Thrust
from opir_trackers.initiation import HIGHER_M, TrackInitiator
from opir_trackers.triangulation import FIRST_HEIGHT_M, GRAZING

#: Specific force of a boost before anything is known of it: straight up, and how far from that with any jerk, m/s².
FIRST_FORCE_M_S2 = 20.0
FIRST_FORCE_SIGMA_M_S2 = 20.0

#: How fast it may change, m/s³.
FIRST_JERK_SIGMA_M_S3 = 0.5

#: The chance that a target that comes into sight is burning.
_BURNING = 0.98

#: Where no sensor sees bodies that do not burn: how likely a slice gives a coasting track a ray all the same, of noise
#: or of the last moments of its burn.
_STRAY = 0.01

#: A burning target goes unseen for up to so many scans of the slowest sensor, and that says how often it is seen.
_PAUSE_SCANS = 4.0


def filter_of(config: StereoFilterConfig, context: TrackerContext) -> ImmFilter:
    """Return the filter for the scene's forces and the modes its settings name."""
    forces = forces_of(context.forces)
    free = Forces(zonal=forces.zonal, gravity=forces.gravity)
    return ImmFilter(
        boost=_boost_of(config, free),
        coast=_coast_of(config, free, forces.drag),
        boost_s=config.boost_s if config.motion == "boost-coast" else np.inf,
        coast_s=config.coast_s if config.motion == "boost-coast" else np.inf,
        cold_chance=1.0 if any(sensor.follows_bodies for sensor in context.sensors) else _STRAY,
        pause_s=_PAUSE_SCANS * max((sensor.scan.period_ns * 1e-9 for sensor in context.sensors), default=0.0),
    )


def _coast_of(config: StereoFilterConfig, forces: Forces, drag: Drag | None) -> Dynamics:
    fall = Motion(COAST, config.coast_noise_m_s, forces)
    if drag is None:
        return fall
    from opir_trackers.filter.dynamics import DraggedFall

    return DraggedFall(fall, drag)


def _boost_of(config: StereoFilterConfig, forces: Forces) -> Dynamics:
    if config.boost_model == "jerk":
        return Motion(BOOST, config.jerk_noise_m_s3, forces)
    thrust = config.thrust
    tilt_rad = float(np.radians(thrust.tilt_deg))
    return Thrust(tilt_rad, thrust.tilt_s, thrust.noise_m_s2, thrust.growth_noise_per_s, forces)


def first_bank(begun: TrackInitiator, time_s: float, config: StereoFilterConfig) -> ModeEstimates:
    """Return the estimates (n,) at a time of tracks that are about to get their first rays: priors only."""
    count = len(begun)
    now = np.full(count, time_s)
    axes = prior_axes(begun)
    inertial = np.stack([turned(axes[:, row], now) for row in range(3)], axis=1)
    position = turned(begun.position_ecef_m, now)
    velocity = EARTH_ROTATION_RAD_S * np.stack([-position[:, 1], position[:, 0], np.zeros(count)], axis=1)
    force = FIRST_FORCE_M_S2 * inertial[:, 2]
    rate, sigmas = _first_rates(config)
    place, speed = prior_sides(begun)
    deviation = np.concatenate([np.repeat(speed[:, None], 3, axis=1), np.tile(sigmas, (count, 1))], axis=1)
    mean = np.concatenate([position, velocity, force, np.tile(rate, (count, 1))], axis=1)
    size = mean.shape[1]
    root = np.zeros((count, size, size))
    root[:, :3, :3] = _upper(inertial, place)
    root[:, range(3, size), range(3, size)] = 1.0 / deviation
    burning = {"boost-coast": _BURNING, "boost": 1.0, "coast": 0.0}[config.motion]
    weight = np.tile([burning, 1.0 - burning], (count, 1))
    coast_mean, coast_root = mean[:, :COAST].copy(), root[:, :COAST, :COAST].copy()
    return ModeEstimates(weight, mean, root, coast_mean, coast_root, np.zeros((count, 3)))


def prior_sides(begun: TrackInitiator) -> tuple[FloatArray, FloatArray]:
    """Return standard deviations (n, 3) of position and (n,) of speed before the first update, in local east-north-up.

    A place seen by one sensor is within 30 km along the ground and 5 km in height, and slow: 400 m/s. Where its ray
    grazes the ground that height shifts it by more: up to 250 km along the horizon, at which the Earth's curve, too, is
    5 km. A place seen by several may be at any height, and is the faster the higher it is: 300 m/s and half as much
    again as a steady 20 m/s² straight up would have gathered. Of launches side by side, whose rays meet one another's
    at many heights, those near the ground were taken: it is within that height, or 3 km.
    """
    height = np.maximum(ecef_to_geodetic(begun.position_ecef_m).height_m, 0.0)
    alone = begun.sensors == 1
    place = np.where(alone[:, None], [30e3, 30e3, HIGHER_M], [20e3, 20e3, 20e3])
    shift = HIGHER_M / np.maximum(begun.sine, GRAZING)
    place[:, :2] = np.maximum(place[:, :2], np.where(alone, shift, 0.0)[:, None])
    beside = np.flatnonzero(begun.is_of_parts & ~alone)
    place[beside, 2] = np.clip(height[beside], FIRST_HEIGHT_M, 20e3)
    return place, np.where(alone, 400.0, 300.0 + 1.5 * np.sqrt(40.0 * height))


def prior_axes(begun: TrackInitiator) -> FloatArray:
    """Return the local axes (n, 3, 3), rows east, north and up, in ECEF."""
    axes: FloatArray = local_axes(begun.position_ecef_m)
    return axes


def _first_rates(config: StereoFilterConfig) -> tuple[FloatArray, FloatArray]:
    """Return what is first taken for the state after the specific force, and the deviations of both."""
    thrust = config.thrust
    if config.boost_model == "jerk":
        return np.zeros(3), np.repeat([FIRST_FORCE_SIGMA_M_S2, FIRST_JERK_SIGMA_M_S3], 3)
    deviation = np.append(np.repeat(thrust.force_sigma_m_s2, 3), thrust.growth_sigma_per_s)
    return np.array([thrust.growth_per_s]), deviation


def _upper(axes: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return upper triangular roots (n, 3, 3) of information with deviations (n, 3) along the rows of axes."""
    from opir_core.estimation.square_root import triangular

    return triangular(axes / sigma[:, :, None])
