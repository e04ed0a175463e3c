"""Priors of how each kind of source moves, as Gaussian mixtures over the coefficients of a cubic.

The coefficients are position, velocity, acceleration and jerk at the first detection, east, north
and up over the ground, in SI units. Each mixture component is a mean m and a root S: coefficients
are m + S z, with z standard normal. All components share the horizontal spread `WIDE_M` of the
position, which stands for "anywhere in view".
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_forecast import AT_ONCE, BEFORE_S, Ground, grounds

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_trackers.configs import HypothesesConfig
from opir_trackers.onset.motion_statistics import BOLIDE, FACTORIALS, GROUND, LAUNCH, NONE, ORDERS

#: The record of aircraft that breathe air, 3529.6 km/h (FAI, 28 July 1976), m/s.
FASTEST_AIRCRAFT_M_S = 980.0

#: Horizontal standard deviation of positions about the reference point of a track, m, wider than
#: its error.
WIDE_M = 100e3

#: The surface in view of a geostationary satellite, down to the horizon, m².
VIEW_M2 = 2.0 * np.pi * EARTH_EQUATORIAL_RADIUS_M**2 * (1.0 - EARTH_EQUATORIAL_RADIUS_M / 42.164e6)

#: Log of the probability density of a position there over that at the centre of the horizontal
#: spread.
LOG_IN_VIEW = float(np.log(2.0 * np.pi * WIDE_M**2 / VIEW_M2))

#: Mean and standard deviation, or standard deviations aside and upwards.
_Pair = tuple[float, float]


#: Mean and standard deviation of the height, m, and standard deviations aside and upwards of
#: velocity, m/s, acceleration, m/s², and jerk, m/s³.
_Spread = tuple[_Pair, _Pair, _Pair, _Pair]


#: Mean and standard deviation of the height of aircraft, m, and the speed of an airliner, m/s: what
#: has taken off gains it.
_ALOFT_M = (8e3, 6e3)
_CRUISE_M_S = 240.0


class StraightFlight(NamedTuple):
    """Flights on a course: their share; mean speed and standard deviations along and across the
    course, m/s; that of the climb, m/s; mean acceleration along the course and standard deviations
    along, across and upwards, m/s²; that of the jerk, m/s³; mean and standard deviation of the
    height, m, by default those of the ground; whether one sensor alone tells them from launches no
    more than from other flights, and is not asked.
    """

    share: float
    speed_m_s: tuple[float, float, float]
    climb_m_s: float
    gain_m_s2: tuple[float, float, float, float]
    jerk_m_s3: float
    height_m: _Pair | None = None
    needs_height: bool = False


@frozen
class MotionLaw:
    """How sources move; notional where no source is given."""

    #: Net upward accelerations at lift-off, m/s², and their prior probabilities: a geometric grid
    #: over 2 to 40 m/s².
    lifts_m_s2: tuple[_Pair, ...] = ((3.0, 0.2), (6.5, 0.3), (14.0, 0.3), (30.0, 0.2))

    #: Standard deviations of that along and across, as shares of the mean.
    lift_sigma: float = 0.4
    aside_sigma: float = 0.2

    #: Growth of the acceleration, 1/s, and the standard deviation of the jerk as a rate of the
    #: specific force, 1/s: growth of 1 to 3 % a second, and a thrust that turns by 1 to 2 ° a
    #: second.
    growth_per_s: float = 0.02
    turn_per_s: float = 0.03

    #: Launches first seen in flight, some 12, 25, 50, 100, 200 and 400 s after lift-off: mean and
    #: standard deviation of height, m, upward velocity, m/s, and upward acceleration, m/s².
    in_flight: tuple[tuple[_Pair, _Pair, _Pair], ...] = (
        ((600.0, 500.0), (100.0, 50.0), (8.0, 6.0)),
        ((2500.0, 2e3), (200.0, 100.0), (8.0, 6.0)),
        ((10e3, 6e3), (400.0, 200.0), (8.0, 6.0)),
        ((40e3, 20e3), (800.0, 350.0), (8.0, 8.0)),
        ((120e3, 50e3), (1200.0, 700.0), (2.0, 10.0)),
        ((200e3, 80e3), (500.0, 700.0), (0.0, 10.0)),
    )

    #: Standard deviations of their velocities aside, m/s.
    aside_m_s: tuple[float, ...] = (60.0, 150.0, 400.0, 900.0, 2500.0, 4000.0)

    #: Standard deviations of their acceleration aside, m/s², and of their jerk, m/s³.
    tilted_m_s2: float = 10.0
    unsteady_m_s3: float = 0.5

    #: Launches from the air: mean and standard deviation of the height, m; mean speed, m/s, and
    #: accelerations along the course and upwards, m/s², in a pull-up of 1 to 4 g; standard deviations
    #: along and across the course and upwards of velocity, acceleration and jerk, m/s³: the end of the
    #: pull-up.
    air_m: _Pair = (11e3, 3e3)
    air_m_s: float = 240.0
    air_pull_m_s2: _Pair = (15.0, 22.0)
    air_sigmas: tuple[tuple[float, ...], ...] = (
        (30.0, 80.0, 10.0),
        (6.0, 2.0, 6.0),
        (2.0, 0.5, 2.0),
    )

    #: Bolides. CNEOS: brightest at 35.2 km [22-61], entered at 17.3 km/s [11.8-30.2], in any
    #: direction.
    bolide: _Spread = ((40e3, 20e3), (11e3, 11e3), (3e3, 3e3), (3e3, 3e3))

    #: Share of vehicles, ships, glints and edges of clouds, which creep over the ground, among
    #: other objects, and standard deviations of their rates: two or three for a hundred thousand
    #: fires.
    creeping_share: float = 0.17
    creeping: tuple[_Pair, ...] = ((20.0, 2.0), (0.05, 0.05), (0.003, 0.003))

    #: Flashes of lightning, in and above clouds, and the mean time for which they are bright, s.
    flash: _Spread = ((10e3, 4e3), (10.0, 10.0), (0.0, 0.0), (0.0, 0.0))
    flash_s: float = 0.5

    #: What enters the air from an orbit, at 7 to 8 km/s, and what the air has slowed.
    reentries: tuple[StraightFlight, ...] = (
        StraightFlight(
            0.7, (7.2e3, 700.0, 1.8e3), 300.0, (-10.0, 12.0, 8.0, 12.0), 1.0, (85e3, 15e3)
        ),
        StraightFlight(
            0.3, (4e3, 1.5e3, 1.5e3), 400.0, (-40.0, 25.0, 10.0, 15.0), 2.0, (60e3, 12e3)
        ),
    )

    #: Bolides that graze the air, one in twenty, which shine on.
    grazers: tuple[StraightFlight, ...] = (
        StraightFlight(0.05, (17e3, 6e3, 7e3), 1e3, (0.0, 10.0, 10.0, 20.0), 2.0, (80e3, 20e3)),
    )

    #: Shares among others of balloons and other lights that stand aloft or drift with the wind; of
    #: anything else.
    aloft: tuple[tuple[float, _Spread], ...] = (
        (0.17, ((10e3, 8e3), (30.0, 5.0), (0.2, 0.1), (0.01, 0.01))),
        (0.66, ((60e3, 60e3), (2e3, 2e3), (30.0, 30.0), (3.0, 3.0))),
    )

    #: Take-offs: a thrust of 0.6 to 1.1 of the weight on afterburner less drag, from rest to some 90
    #: m/s (Raymer, "Aircraft Design", 2018, 17.8).
    take_offs: tuple[StraightFlight, ...] = (
        StraightFlight(1.0, (50.0, 25.0, 15.0), 5.0, (4.5, 1.0, 0.5, 0.3), 0.05),
    )

    #: Flights of aircraft, subsonic and supersonic: straight on, climbing after take-off, with turns
    #: or a gain of speed, and turning at several times the weight. One sensor alone can hardly tell
    #: what flies straight on from a launch.
    flights: tuple[StraightFlight, ...] = (
        StraightFlight(0.31, (230.0, 60.0, 90.0), 15.0, (0.0, 0.2, 0.2, 0.1), 0.01, _ALOFT_M),
        StraightFlight(0.09, (450.0, 120.0, 180.0), 15.0, (0.0, 0.2, 0.2, 0.1), 0.01, _ALOFT_M),
        StraightFlight(
            0.10, (170.0, 70.0, 90.0), 100.0, (0.0, 0.3, 0.3, 0.3), 0.02, (2e3, 2e3), True
        ),
        StraightFlight(0.31, (230.0, 60.0, 90.0), 60.0, (0.0, 2.0, 6.0, 3.0), 0.5, _ALOFT_M),
        StraightFlight(0.09, (450.0, 120.0, 180.0), 60.0, (0.0, 2.0, 6.0, 3.0), 0.5, _ALOFT_M),
        StraightFlight(0.10, (330.0, 100.0, 140.0), 60.0, (0.0, 3.0, 20.0, 5.0), 1.0, _ALOFT_M),
    )


LAW = MotionLaw()

#: Ages of tracks, s, up to which aircraft are known to have flown as aircraft.
AGES_S = np.array([0.0, 10.0, 20.0, 40.0, 80.0])

#: Edges of the intervals of the time from lift-off to the first detection, s.
_EDGES_S = BEFORE_S * np.linspace(0.0, 1.0, 9) ** 2


#: Standard deviations of height, velocity and acceleration of what need not fly as an aircraft.
_UNBOUND = np.full(7, np.inf)


class _Component(NamedTuple):
    group: int
    weight: float
    mean: FloatArray
    root: FloatArray
    interval: int = -1
    fades_s: float = np.inf
    bounds: FloatArray = _UNBOUND
    needs_height: bool = False


@frozen(eq=False)
class MotionPriors:
    """The components (c,) of all priors: group, log weight within the group, mean (c, 12) and root
    (c, 12, 12).

    `interval` (c,) is that of `edges_s` for launches from rest, -1 for others; their weights need
    the scan period. `fades_s` (c,) is the mean time for which they are bright, infinite for what
    burns or flies on. `bounds` (c, 7) are standard deviations of height, velocity and acceleration
    that last, infinite for none. One sensor alone leaves out what `needs_height` (c,).
    """

    group: IntArray
    log_weight: FloatArray
    mean: FloatArray
    root: FloatArray
    interval: IntArray
    fades_s: FloatArray
    bounds: FloatArray
    needs_height: BoolArray
    edges_s: FloatArray

    @classmethod
    def of(
        cls, config: HypothesesConfig, rates: Mapping[str, float] | None = None
    ) -> "MotionPriors":
        """Return the priors of a tracker's settings, with rates of their own."""
        kinds = grounds(config.inland_share)
        still = ((config.ground_drift_m_s,) * 2, (0.0, 0.0), (0.0, 0.0))
        components = [
            *_on_ground(GROUND, 1.0, kinds, still),
            *_others(rates or config.rates(), kinds),
            _drawn(BOLIDE, 1.0, *LAW.bolide)._replace(fades_s=config.bolide_s),
            *_from_rest((1.0 - config.in_flight_share) * (1.0 - config.air_share), kinds),
            *_from_air((1.0 - config.in_flight_share) * config.air_share),
            *_in_flight(config.in_flight_share),
        ]
        likely = [component for component in components if component.weight > 0.0]
        columns = map(np.array, zip(*likely, strict=True))
        group, weight, mean, root, interval, fades_s, bounds, needs_height = columns
        return cls(
            group, np.log(weight), mean, root, interval, fades_s, bounds, needs_height, _EDGES_S
        )

    def at(self, age_s: float) -> "MotionPriors":
        """Return the priors of tracks of an age: aircraft have still the height, speed and
        accelerations of aircraft, on any course. What has gained more by then is none.
        """
        rows = np.isfinite(self.bounds[:, 0]).nonzero()[0]
        mean = self.mean[rows]
        root = self.root[rows]
        lag = np.subtract.outer(np.arange(ORDERS), np.arange(ORDERS))
        # Derivatives at the age from those at the first detection.
        later = np.where(lag <= 0, age_s ** np.abs(lag) / FACTORIALS[np.abs(lag)], 0.0)
        state = np.kron(later, np.eye(3))[2:9] / self.bounds[rows][:, :, None]
        expected = np.array([_ALOFT_M[0], *np.zeros(6)]) / self.bounds[rows]
        surprise = expected - (state @ mean[:, :, None])[:, :, 0]
        shared = state @ root
        factor = np.linalg.cholesky(np.eye(mean.shape[1]) + shared.mT @ shared)
        root = root @ np.linalg.inv(factor).mT
        pull = root.mT @ (state.mT @ surprise[:, :, None])
        means = self.mean.copy()
        means[rows] += (root @ pull)[:, :, 0]
        roots = self.root.copy()
        roots[rows] = root
        return evolve(self, mean=means, root=roots)

    def log_weights(self, pause_s: FloatArray, age_s: FloatArray) -> FloatArray:
        """Return the log weights (n, c) of the components for tracks whose sensors look every
        `pause_s` (n,).

        Half of the launches are detected at once, after an exponential time of this mean; others
        after a uniform time, as for the launch points. What is still bright at an age (n,), s, is
        the less probably what fades.
        """
        soon = -np.diff(np.exp(-self.edges_s / pause_s[:, None]), axis=1)
        uniform = np.diff(self.edges_s) / BEFORE_S
        since = np.log(AT_ONCE * soon + (1.0 - AT_ONCE) * uniform)
        intervals = np.concatenate([since, np.zeros((len(pause_s), 1))], axis=1)
        return self.log_weight + intervals[:, self.interval] - age_s[:, None] / self.fades_s


def none_per_day(rates: Mapping[str, float]) -> float:
    """Return the rate of all that is no ground source, bolide or launch, 1/day."""
    aloft = rates["aircraft_per_day"] + rates["take_offs_per_day"] + rates["reentries_per_day"]
    return rates["flashes_per_day"] + aloft + rates["others_per_day"]


def _others(rates: Mapping[str, float], kinds: Sequence[Ground]) -> list[_Component]:
    """Return the priors of what is neither noise, on the ground, a bolide nor a launch."""
    share = 1.0 / none_per_day(rates)
    rest = rates["others_per_day"] * share
    flashes = _drawn(NONE, rates["flashes_per_day"] * share, *LAW.flash)
    return [
        flashes._replace(fades_s=LAW.flash_s),
        *_on_ground(NONE, rest * LAW.creeping_share, kinds, LAW.creeping),
        *(_drawn(NONE, rest * weight, *spread) for weight, spread in LAW.aloft),
        *_on_courses(rates["reentries_per_day"] * share, LAW.reentries, kinds),
        *_on_courses(rates["bolides_per_day"] * share, LAW.grazers, kinds),
        *_aircraft(rates["aircraft_per_day"] * share, LAW.flights, kinds),
        *_aircraft(rates["take_offs_per_day"] * share, LAW.take_offs, kinds),
    ]


def _aircraft(
    weight: float, flights: Sequence[StraightFlight], kinds: Sequence[Ground]
) -> list[_Component]:
    """Return the priors of flights of aircraft, which last."""
    return [
        component._replace(bounds=_lasting(flight), needs_height=flight.needs_height)
        for flight in flights
        for component in _on_courses(weight, [flight], kinds)
    ]


def _lasting(flight: StraightFlight) -> FloatArray:
    """Return standard deviations (7,) of height, velocity and acceleration of flights of aircraft at
    any time, on any course.
    """
    speed = max(np.hypot(flight.speed_m_s[0], flight.speed_m_s[1]), _CRUISE_M_S)
    gain = max(flight.gain_m_s2[:3])
    velocity = (speed, speed, flight.climb_m_s)
    return np.array([_ALOFT_M[1], *velocity, gain, gain, flight.gain_m_s2[3]])


def _on_courses(
    weight: float, flights: Sequence[StraightFlight], kinds: Sequence[Ground]
) -> list[_Component]:
    """Return the priors of each kind of flight, course and height."""
    courses = _course_axes()
    return [
        _flown(weight * height.share / len(courses), flight, axes, height)
        for flight in flights
        for axes in courses
        for height in (kinds if flight.height_m is None else [Ground(1.0, *flight.height_m)])
    ]


def _flown(weight: float, flight: StraightFlight, axes: FloatArray, height: Ground) -> _Component:
    """Return the prior of flights with the axes (3, 3) of a course, from a height."""
    speed, *sigmas = flight.speed_m_s
    gain, *unsteady = flight.gain_m_s2
    mean = np.zeros((ORDERS, 3))
    mean[0, 2] = height.mean_m
    mean[1] = speed * axes[0]
    mean[2] = gain * axes[0]
    spreads = (
        (WIDE_M, WIDE_M, height.sigma_m),
        (*sigmas, flight.climb_m_s),
        unsteady,
        (flight.jerk_m_s3,) * 3,
    )
    return _Component(NONE, weight * flight.share, mean.ravel(), _course_root(axes, spreads))


def _course_axes() -> FloatArray:
    """Return the axes (8, 3, 3) along and across each of eight courses, and up, as rows."""
    courses = np.arange(8) * (np.pi / 4.0)
    return np.array(
        [
            [[sine, cosine, 0.0], [cosine, -sine, 0.0], [0.0, 0.0, 1.0]]
            for sine, cosine in zip(np.sin(courses), np.cos(courses), strict=True)
        ]
    )


def _course_root(axes: FloatArray, spreads: Sequence[Sequence[float]]) -> FloatArray:
    """Return the root (12, 12) of coefficients with standard deviations along axes (3, 3)."""
    root = np.zeros((ORDERS, 3, ORDERS, 3))
    for order, spread in enumerate(spreads):
        root[order, :, order] = axes * spread
    return root.reshape(3 * ORDERS, -1)


def _on_ground(
    group: int, weight: float, kinds: Sequence[Ground], rates: Sequence[_Pair]
) -> list[_Component]:
    return [
        _drawn(group, weight * kind.share, (kind.mean_m, kind.sigma_m), *rates) for kind in kinds
    ]


def _from_rest(share: float, kinds: Sequence[Ground]) -> list[_Component]:
    return [
        _lifted(share * lift_share * kind.share, lift, number, kind)
        for lift, lift_share in LAW.lifts_m_s2
        for number in range(len(_EDGES_S) - 1)
        for kind in kinds
    ]


def _lifted(weight: float, lift_m_s2: float, interval: int, ground: Ground) -> _Component:
    """Return the prior of launches from rest on the ground in an interval of time before the first
    detection.

    Their parameters are place, acceleration, jerk, and the time of lift-off within the interval,
    linearised.
    """
    start_s, end_s = _EDGES_S[interval : interval + 2].tolist()
    since_s = 0.5 * (start_s + end_s)
    # Position, velocity, acceleration and jerk at the first detection from acceleration and jerk at
    # lift-off.
    of_lift = np.array([0.5 * since_s**2, since_s, 1.0, 0.0])
    of_jerk = np.array([since_s**3 / 6.0, 0.5 * since_s**2, since_s, 1.0])
    upwards = of_lift * lift_m_s2 + of_jerk * (LAW.growth_per_s * lift_m_s2)
    mean = np.zeros((ORDERS, 3))
    mean[:, 2] = upwards
    mean[0, 2] += ground.mean_m
    root = _lift_root(lift_m_s2, of_lift, of_jerk, ground.sigma_m)
    root[:-1, 2, 9] = (end_s - start_s) / np.sqrt(12.0) * upwards[1:]
    return _Component(LAUNCH, weight, mean.ravel(), root.reshape(3 * ORDERS, -1), interval)


def _lift_root(
    lift_m_s2: float, of_lift: FloatArray, of_jerk: FloatArray, height_sigma_m: float
) -> FloatArray:
    """Return the root (4, 3, 12) of a launch whose place, acceleration and jerk vary."""
    axes = range(3)
    lift_sigmas = lift_m_s2 * np.array([LAW.aside_sigma, LAW.aside_sigma, LAW.lift_sigma])
    root = np.zeros((ORDERS, 3, 3 * ORDERS))
    root[0, axes, axes] = WIDE_M, WIDE_M, height_sigma_m
    root[:, axes, range(3, 6)] = of_lift[:, None] * lift_sigmas
    root[:, axes, range(6, 9)] = (LAW.turn_per_s * (lift_m_s2 + 9.8)) * of_jerk[:, None]
    return root


def _in_flight(share: float) -> list[_Component]:
    components = []
    weight = share / len(LAW.in_flight)
    for upwards, aside_m_s in zip(LAW.in_flight, LAW.aside_m_s, strict=True):
        mean = np.zeros((ORDERS, 3))
        root = np.full((ORDERS, 3), LAW.unsteady_m_s3)
        root[:3, :2] = np.array([WIDE_M, aside_m_s, LAW.tilted_m_s2])[:, None]
        mean[:3, 2], root[:3, 2] = np.array(upwards).T
        components.append(_Component(LAUNCH, weight, mean.ravel(), np.diag(root.ravel())))
    return components


def _from_air(share: float) -> list[_Component]:
    """Return the priors of launches from the air, by course."""
    along_m_s2, upwards_m_s2 = LAW.air_pull_m_s2
    height_m, height_sigma_m = LAW.air_m
    rates = np.array(
        [(0.0, 0.0, height_m), (LAW.air_m_s, 0.0, 0.0), (along_m_s2, 0.0, upwards_m_s2)]
    )
    sigmas = ((WIDE_M, WIDE_M, height_sigma_m), *LAW.air_sigmas)
    courses = _course_axes()
    means = [np.append(rates @ axes, np.zeros(3)) for axes in courses]
    return [
        _Component(LAUNCH, share / len(courses), mean, _course_root(axes, sigmas))
        for mean, axes in zip(means, courses, strict=True)
    ]


def _drawn(group: int, weight: float, height: _Pair, *rates: _Pair) -> _Component:
    """Return a component of given height and rates."""
    mean = np.zeros((ORDERS, 3))
    mean[0, 2] = height[0]
    root = np.zeros((ORDERS, 3))
    root[0] = (WIDE_M, WIDE_M, height[1])
    root[1:] = [(aside, aside, upwards) for aside, upwards in rates]
    return _Component(group, weight, mean.ravel(), np.diag(root.ravel()))
