"""The family of boosts that the tracker `boost-profile` fits: parameters, their priors by class, and the paths.

A path has nine parameters: where (east and north of an anchor on the ground) and when it starts, the turn it makes from
the vertical as a vector (its length the burnout angle from the vertical, its direction the heading, so that nothing is
singular while the flight is still vertical), and the logarithms of burnout speed, burn time, speed shape and pitch
exponent over those of the class.
"""

import numpy as np
from attrs import frozen

from opir_core.columns import Columns
from opir_core.flight.ascent import ascent_of_shape
from opir_core.flight.boost import BoostPath, LaunchSite, boost_path, launch_site
from opir_core.flight.profiles import PROFILES_BY_TYPE, boost_profiles
from opir_core.geometry import ecef_to_geodetic
from opir_core.records import FloatArray, IntArray
from opir_core.scene import TARGET_TYPES

#: The classes, by name, and the type of each as a code into `TARGET_TYPES`.
CLASSES = tuple(name for kind in TARGET_TYPES for name in PROFILES_BY_TYPE[kind])
CLASS_TYPE = np.array([code for code, kind in enumerate(TARGET_TYPES) for _ in PROFILES_BY_TYPE[kind]])

EAST, NORTH, START, TURN_EAST, TURN_NORTH, SPEED, BURN, SHAPE, PITCH = range(9)
SIZE = 9

#: Standard deviations of the prior, notional: place, m; start, s; then logarithms of speed, burn time, speed shape and
#: pitch exponent. The turn's length has its own, rad; its direction has none.
PLACE_SIGMA_M = 50e3
START_SIGMA_S = 15.0
SHARE_SIGMA = {SPEED: 0.25, BURN: 0.05, SHAPE: 0.03, PITCH: 0.03}
TURN_SIGMA_RAD = 0.12

#: The vague prior of each component of the turn, rad.
VAGUE_TURN_RAD = 2.0


@frozen(eq=False)
class Shapes(Columns):
    """The nominal values of the classes of n hypotheses, (n,) each."""

    burn_s: FloatArray
    pitch_start_s: FloatArray
    speed_shape: FloatArray
    pitch_exponent: FloatArray
    speed_m_s: FloatArray
    turn_rad: FloatArray

    @classmethod
    def of(cls, number: IntArray) -> "Shapes":
        """Return the shapes of classes by number."""
        profiles = [boost_profiles()[CLASSES[each]] for each in number.tolist()]
        rows = [
            (
                profile.burn_time_s,
                profile.pitch_start_s,
                profile.speed_shape,
                profile.pitch_exponent,
                profile.burnout_speed_m_s,
                0.5 * np.pi - profile.burnout_flight_path_angle_rad,
            )
            for profile in profiles
        ]
        return cls(*np.array(rows, dtype=np.float64).reshape(-1, 6).T)


@frozen(eq=False)
class Anchors(Columns):
    """What parameters count from: points on the ground (n, 3) in ECEF and scene times (n,)."""

    latitude_rad: FloatArray
    longitude_rad: FloatArray
    time_s: FloatArray

    @classmethod
    def at(cls, position_ecef_m: FloatArray, time_s: FloatArray) -> "Anchors":
        """Return the anchors below positions."""
        place = ecef_to_geodetic(position_ecef_m)
        return cls(np.asarray(place.latitude_rad), np.asarray(place.longitude_rad), time_s)

    def places(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return latitudes and longitudes (n,) of starts."""
        radius = 6.371e6
        latitude = self.latitude_rad + parameters[:, NORTH] / radius
        limit = 0.5 * np.pi - 1e-9
        across = radius * np.maximum(np.cos(self.latitude_rad), 1e-6)
        return np.clip(latitude, -limit, limit), self.longitude_rad + parameters[:, EAST] / across


def prior_mean(count: int) -> FloatArray:
    """Return the means (n, 9) of the priors."""
    return np.zeros((count, SIZE))


def prior_information() -> FloatArray:
    """Return the information (9, 9) of the prior that is linear in the parameters; the turn's length is not."""
    sigma = np.ones(SIZE)
    sigma[[EAST, NORTH]], sigma[START] = PLACE_SIGMA_M, START_SIGMA_S
    sigma[[TURN_EAST, TURN_NORTH]] = VAGUE_TURN_RAD
    for index, share in SHARE_SIGMA.items():
        sigma[index] = share
    return np.diag(1.0 / np.square(sigma))


def paths(parameters: FloatArray, anchors: Anchors, shapes: Shapes) -> BoostPath:
    """Return the paths of n hypotheses with parameters (n, 9)."""
    turn = np.hypot(parameters[:, TURN_EAST], parameters[:, TURN_NORTH])
    azimuth = np.arctan2(parameters[:, TURN_EAST], parameters[:, TURN_NORTH])
    scale = np.exp(parameters[:, BURN])
    course = ascent_of_shape(
        shapes.burn_s * scale,
        shapes.pitch_start_s * scale,
        shapes.speed_shape * np.exp(parameters[:, SHAPE]),
        shapes.pitch_exponent * np.exp(parameters[:, PITCH]),
        turn,
    )
    latitude, longitude = anchors.places(parameters)
    site: LaunchSite = launch_site(latitude, longitude, 0.0)
    speed = shapes.speed_m_s * np.exp(parameters[:, SPEED])
    return boost_path(site, anchors.time_s + parameters[:, START], azimuth, speed, course)


def drawn_out(path: BoostPath, row: IntArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (m, 3) of rows (m,) at any times: at rest before the start, straight after.

    The straight line after burnout bends by 5 m in the first second; what lies after is told by the free flight.
    """
    held = np.clip(time_s, path.ignition_s[row], path.burnout_s[row])
    position, velocity = path.state(row, held)
    late = np.maximum(time_s - path.burnout_s[row], 0.0)
    return position + velocity * late[:, None], velocity
