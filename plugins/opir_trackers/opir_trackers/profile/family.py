"""The family of boosts that the tracker `boost-profile` fits: parameters, their priors by class, and the paths.

A path has ten parameters: where (east and north of an anchor on the ground) and when it starts, its lean from the
vertical at a reference time as a vector (its direction the heading, so that nothing is singular while the flight is
still vertical), and logarithms over the medians of the class, of what looks see of a burn that goes on
(`coordinates`). The priors are of natural parameters: turn, burnout speed, burn time, speed shape, pitch
exponent and the pitch start's share of the burn.

The coordinates in which boosts are fitted: what looks see of a burn that goes on, apart from what they do not.

Burnout speed, burn time, speed shape and turn, as the classes have their priors, are seen only together before the burn
ends: looks tell the acceleration at the start, how fast it grows, and how far the path leans at some time. In the
former the posterior is long, thin and bent, and no normal distribution; in the latter it is nearly one, for what bent
it was the choice of parameters (Bates and Watts, "Relative curvature measures of nonlinearity", J. R. Statist. Soc. B
42, 1980, 1: parameter-effects curvature).

Columns of `parameters`, as in `family`: east and north, m, and start, s, as they are; the lean from the
vertical at the reference time, as a vector, rad; and logarithms, zero at the class's medians: of the acceleration at
the start, of the burn time, of the rate at which acceleration grows, of the pitch exponent, of the time of the pitch
start. The natural parameters have in these places the turn, and logarithms over medians of burnout speed, burn time,
speed shape, pitch exponent and the pitch start's share of the burn.

The priors of the classes of boosts, from what a scene says of them.
"""

import math
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.flight.boost import LaunchSite, launch_site
from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces.columns import Columns
from opir_core.scene.scene import TARGET_TYPES
from opir_trackers.configs import BoostPriorsConfig
from opir_trackers.profile import course
from opir_trackers.profile.course import Courses

EAST, NORTH, START, TURN_EAST, TURN_NORTH, SPEED, BURN, SHAPE, PITCH, LIFT = range(10)
SIZE = 10

#: The reference time at which the lean is a parameter, over the class's burn time.
REFERENCE = 0.4

#: No pitch start comes later in the burn than this share.
LAST_LIFT = 0.5

#: The power of the mean that stands for the lesser of two pitch starts: 1.5 % below either of them at twice the other.
_SHARP = 4.0

#: The least of the turn's share that is reached at the reference time.
_LEAST_LEAN = 1e-3


class Natural(NamedTuple):
    """Natural parameters (n, 10) and how they change with the fitted ones.

    `by_burn` and `by_rate` (n,) are the slopes of the logarithm of burnout speed by those of burn time and growth rate;
    `lean` (n,) is the share of the turn that is reached at the reference time, `lean_slope` (n, 3) its logarithm's
    slopes by the logarithms of burn time, pitch exponent and pitch start.
    """

    parameters: FloatArray
    by_burn: FloatArray
    by_rate: FloatArray
    lean: FloatArray
    lean_slope: FloatArray

    def slope(self) -> FloatArray:
        """Return the slopes (n, 10, 10) of natural parameters, by row, by fitted ones, by column."""
        found = np.zeros((len(self.lean), SIZE, SIZE))
        found[:, np.arange(SIZE), np.arange(SIZE)] = 1.0
        found[:, SPEED, BURN], found[:, SPEED, SHAPE] = self.by_burn, self.by_rate
        found[:, SHAPE, BURN], found[:, LIFT, BURN] = 1.0, -1.0
        for turn in (TURN_EAST, TURN_NORTH):
            found[:, turn, turn] = 1.0 / self.lean
            found[:, turn, [BURN, PITCH, LIFT]] = -self.parameters[:, turn, None] * self.lean_slope
        return found


def natural(parameters: FloatArray, priors: "Priors") -> Natural:
    """Return the natural parameters of fitted ones (n, 10), of classes with priors of one row each."""
    found = parameters.copy()
    found[:, SHAPE] += parameters[:, BURN]
    found[:, LIFT] -= parameters[:, BURN]
    shape = priors.speed_shape * np.exp(found[:, SHAPE])
    found[:, SPEED] += parameters[:, BURN] + _growth(shape) - _growth(priors.speed_shape)
    by_rate = shape * (1.0 / -np.expm1(-shape) - 1.0 / shape)
    lean, slope = _leans(found, priors)
    found[:, [TURN_EAST, TURN_NORTH]] /= lean[:, None]
    return Natural(found, 1.0 + by_rate, by_rate, lean, slope)


def fitted(parameters: FloatArray, priors: "Priors") -> FloatArray:
    """Return the fitted parameters (n, 10) of natural ones, of classes with priors of one row each."""
    found = parameters.copy()
    found[:, SHAPE] -= parameters[:, BURN]
    found[:, LIFT] += parameters[:, BURN]
    shape = priors.speed_shape * np.exp(parameters[:, SHAPE])
    found[:, SPEED] -= parameters[:, BURN] + _growth(shape) - _growth(priors.speed_shape)
    found[:, [TURN_EAST, TURN_NORTH]] *= _leans(parameters, priors)[0][:, None]
    return found


def _growth(shape: FloatArray) -> FloatArray:
    """Return the logarithms (n,) of the burnout speed over what the acceleration at the start alone would come to."""
    grown: FloatArray = np.log(np.expm1(shape) / shape)
    return grown


def _leans(parameters: FloatArray, priors: "Priors") -> tuple[FloatArray, FloatArray]:
    """Return the share (n,) of the turn reached at the reference time, of natural parameters, and its slopes (n, 3)."""
    reference = REFERENCE * np.exp(-parameters[:, BURN])
    latest, wanted = LAST_LIFT * reference, priors.lift * np.exp(parameters[:, LIFT])
    # The lesser of both, without a corner: in one a fit that follows slopes goes to and fro.
    lift = (wanted**-_SHARP + latest**-_SHARP) ** (-1.0 / _SHARP)
    # A burn so short that it is over by the reference time has turned all it turns.
    is_open = reference < 1.0
    rest = np.where(is_open, 1.0 - lift, 1.0)
    share = np.where(is_open, (reference - lift) / rest, 1.0)
    exponent = priors.pitch_exponent * np.exp(parameters[:, PITCH])
    angle = 0.5 * np.pi * share**exponent
    by_angle = angle / np.tan(angle) * exponent
    slope = np.stack(
        [
            -by_angle / rest * is_open,
            by_angle * np.log(share),
            by_angle * (lift / rest - lift / (reference - lift)) * (lift / wanted) ** _SHARP,
        ],
        axis=1,
    )
    return np.maximum(np.sin(angle), _LEAST_LEAN), slope


__all__ = (
    "BURN",
    "EAST",
    "LIFT",
    "NORTH",
    "PITCH",
    "SHAPE",
    "SIZE",
    "SPEED",
    "START",
    "TURN_EAST",
    "TURN_NORTH",
    "Anchors",
    "Family",
    "Places",
    "Priors",
)

#: The standard deviation of the prior of place, m: the anchor is below the first line of sight.
PLACE_SIGMA_M = 50e3

#: The vague prior of each component of the turn, rad.
VAGUE_TURN_RAD = 2.0

#: A turn shorter than this has no direction to speak of, rad.
STRAIGHT_RAD = 1e-3

#: Metres to a radian of latitude.
RADIUS_M = 6.371e6


@frozen(eq=False)
class Priors(Columns):
    """Priors of n hypotheses, (n,) each: medians, and standard deviations of logarithms; the turn's is in rad.

    `hidden_s` is for how long boosts are not seen at first (`start`).
    """

    burn_s: FloatArray
    speed_m_s: FloatArray
    speed_shape: FloatArray
    pitch_exponent: FloatArray
    lift: FloatArray
    turn_rad: FloatArray
    burn_sigma: FloatArray
    speed_sigma: FloatArray
    shape_sigma: FloatArray
    pitch_sigma: FloatArray
    lift_sigma: FloatArray
    turn_sigma_rad: FloatArray
    hidden_s: FloatArray

    def information(self) -> FloatArray:
        """Return the diagonals (n, 10) of what is linear in natural parameters; the turn's length is not."""
        sigma = np.ones((len(self.burn_s), SIZE))
        sigma[:, [EAST, NORTH]], sigma[:, START] = PLACE_SIGMA_M, self.hidden_s
        sigma[:, [TURN_EAST, TURN_NORTH]] = VAGUE_TURN_RAD
        sigma[:, SPEED], sigma[:, BURN], sigma[:, SHAPE] = self.speed_sigma, self.burn_sigma, self.shape_sigma
        sigma[:, PITCH], sigma[:, LIFT] = self.pitch_sigma, self.lift_sigma
        return 1.0 / np.square(sigma)


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
        latitude = self.latitude_rad + parameters[:, NORTH] / RADIUS_M
        limit = 0.5 * np.pi - 1e-9
        return np.clip(latitude, -limit, limit), self.longitude_rad + parameters[:, EAST] / self.across_m()

    def across_m(self) -> FloatArray:
        """Return metres to a radian of longitude, (n,)."""
        return RADIUS_M * np.maximum(np.cos(self.latitude_rad), 1e-6)


class Places(NamedTuple):
    """Where paths are: ECEF positions and velocities (m, 3), and the position's slopes by the parameters (m, 10, 3)."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    slope: FloatArray


@frozen(eq=False)
class Family:
    """The paths of n hypotheses."""

    courses: Courses
    site: LaunchSite
    up: FloatArray
    heading: FloatArray
    right: FloatArray
    radius_m: FloatArray
    start_s: FloatArray
    turn_east: FloatArray
    turn_north: FloatArray
    across_m: FloatArray
    natural: Natural

    @classmethod
    def of(cls, parameters: FloatArray, anchors: Anchors, priors: Priors) -> "Family":
        """Return the paths of parameters (n, 10)."""
        turn = np.hypot(parameters[:, TURN_EAST], parameters[:, TURN_NORTH])
        azimuth = np.arctan2(parameters[:, TURN_EAST], parameters[:, TURN_NORTH])
        site = launch_site(*anchors.places(parameters), 0.0)
        plane = site.plane(azimuth)
        found = natural(parameters, priors)
        scales = np.exp(found.parameters[:, SPEED:])
        courses = Courses.of(
            priors.speed_m_s * scales[:, 0],
            priors.burn_s * scales[:, 1],
            priors.speed_shape * scales[:, 2],
            priors.pitch_exponent * scales[:, 3],
            np.maximum(turn / found.lean, STRAIGHT_RAD),
            np.minimum(priors.lift * scales[:, 4], LAST_LIFT),
            plane.radius_m,
        )
        sine, cosine = np.sin(azimuth)[:, None], np.cos(azimuth)[:, None]
        right = cosine * site.axes[:, 0] - sine * site.axes[:, 1]
        start_s = anchors.time_s + parameters[:, START]
        return cls(
            courses, site, plane.up, plane.heading, right, plane.radius_m, start_s, sine[:, 0], cosine[:, 0],
            anchors.across_m(), found,
        )  # fmt: skip

    @property
    def burnout_s(self) -> FloatArray:
        """Return the scene times (n,) at which the burns end."""
        end_s: FloatArray = self.start_s + self.courses.burn_s
        return end_s

    def end_slope(self) -> FloatArray:
        """Return the slopes (n, 10) of logarithms of times to the ends of burns, counted from where starts stand."""
        slope = np.zeros((len(self.start_s), SIZE))
        slope[:, START], slope[:, BURN] = 1.0 / self.courses.burn_s, 1.0
        return slope

    def with_end(self, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return covariances (n, 10) of parameters, of which `spread` (n, 10, 10) is known, with that logarithm.

        Beside them are its variances (n,).
        """
        slope = self.end_slope()
        gain: FloatArray = np.sum(spread * slope[:, None], axis=2)
        return gain, np.sum(gain * slope, axis=1)

    def places(self, row: IntArray, time_s: FloatArray) -> Places:
        """Return where rows (m,) are at scene times (m,): at rest before the start, burning on after the end."""
        elapsed = time_s - self.start_s[row]
        read = self.courses.read(row, elapsed)
        up, heading, right, radius = self.up[row], self.heading[row], self.right[row], self.radius_m[row]
        sine, cosine = np.sin(read.swept_rad), np.cos(read.swept_rad)
        half = np.sin(0.5 * read.swept_rad)
        rise = read.height_m * cosine - 2.0 * radius * half * half
        along = (radius + read.height_m) * sine
        position = self.site.launch_m[row] + rise[:, None] * up + along[:, None] * heading
        tilt = read.lean_rad + read.swept_rad
        velocity = read.speed_m_s[:, None] * (np.cos(tilt)[:, None] * up + np.sin(tilt)[:, None] * heading)
        reach = radius + read.height_m
        by_height, by_sweep = (self._by_fitted(row, each) for each in (read.height_slope, read.swept_slope))
        rises = by_height * cosine[:, None] - by_sweep * (reach * sine)[:, None]
        alongs = by_height * sine[:, None] + by_sweep * (reach * cosine)[:, None]
        by_course = rises[:, :, None] * up[:, None] + alongs[:, :, None] * heading[:, None]
        slope = np.empty((len(row), SIZE, 3))
        slope[:, SPEED : PITCH + 1] = by_course[:, : course.PITCH + 1]
        slope[:, LIFT] = by_course[:, course.LIFT]
        slope[:, START] = -velocity
        sideways = (along / (self.courses.turn_rad * self.natural.lean)[row])[:, None] * right
        to_east, to_north = self.turn_east[row][:, None], self.turn_north[row][:, None]
        slope[:, TURN_EAST] = to_east * by_course[:, course.TURN] + to_north * sideways
        slope[:, TURN_NORTH] = to_north * by_course[:, course.TURN] - to_east * sideways
        self._shift(slope, row, position, rise, along)
        return Places(position, velocity, slope)

    def _by_fitted(self, row: IntArray, slope: FloatArray) -> FloatArray:
        """Return slopes (m, 6) of courses by fitted parameters, from those by natural ones; a lean's by its length."""
        found, by_lean = slope.copy(), self.natural.lean_slope * self.courses.turn_rad[:, None]
        turn = slope[:, course.TURN]
        found[:, course.BURN] += slope[:, course.SPEED] * self.natural.by_burn[row]
        found[:, course.BURN] += slope[:, course.SHAPE] - slope[:, course.LIFT]
        found[:, course.SHAPE] += slope[:, course.SPEED] * self.natural.by_rate[row]
        for place, column in enumerate((course.BURN, course.PITCH, course.LIFT)):
            found[:, column] -= turn * by_lean[row, place]
        found[:, course.TURN] = turn / self.natural.lean[row]
        return found

    def _shift(
        self, slope: FloatArray, row: IntArray, position: FloatArray, rise: FloatArray, along: FloatArray
    ) -> None:
        """Write how positions move with the start: with longitude about the Earth's axis, with latitude in a plane."""
        slope[:, EAST, 0] = -position[:, 1] / self.across_m[row]
        slope[:, EAST, 1] = position[:, 0] / self.across_m[row]
        slope[:, EAST, 2] = 0.0
        north = self.site.axes[row, 1]
        level = along * self.turn_north[row]
        by_latitude = (self.site.meridian_radius_m[row] + rise)[:, None] * north - level[:, None] * self.up[row]
        slope[:, NORTH] = by_latitude / RADIUS_M


def priors_of(config: BoostPriorsConfig) -> Priors:
    """Return the priors, one row a target type."""
    rows = []
    for kind in TARGET_TYPES:
        prior = getattr(config, kind)
        rows.append(
            (
                prior.burn_s,
                prior.speed_m_s,
                prior.speed_shape,
                prior.pitch_exponent,
                prior.pitch_start_share,
                math.radians(prior.turn_deg),
                prior.burn_sigma,
                prior.speed_sigma,
                prior.shape_sigma,
                prior.pitch_sigma,
                prior.start_sigma,
                math.radians(prior.turn_sigma_deg),
                config.hidden_s,
            )
        )
    return Priors(*np.array(rows, dtype=np.float64).T)
