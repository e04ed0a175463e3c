"""Priors of how each kind of source moves, as Gaussian mixtures over the coefficients of a cubic.

The coefficients are position, velocity, acceleration and jerk at the first detection, east, north
and up over the ground, in SI units. Each mixture component is a mean m and a root S: coefficients
are m + S z, with z standard normal. All components share the horizontal spread `WIDE_M` of the
position, which stands for "anywhere in view".
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_trackers.configs import HypothesesConfig
from opir_trackers.launch_points import AT_ONCE, BEFORE_S, Ground, grounds
from opir_trackers.onset.motion_statistics import BOLIDE, GROUND, LAUNCH, NONE, ORDERS

#: Horizontal standard deviation of positions about the reference point of a track, m, wider than
#: its error.
WIDE_M = 100e3

#: The part of the Earth that a geostationary satellite sees, down to the horizon, m².
_IN_VIEW_M2 = (
    2.0 * np.pi * EARTH_EQUATORIAL_RADIUS_M**2 * (1.0 - EARTH_EQUATORIAL_RADIUS_M / 42.164e6)
)

#: Log of the probability density of a position in view over that at the centre of the horizontal
#: spread.
LOG_IN_VIEW = float(np.log(2.0 * np.pi * WIDE_M**2 / _IN_VIEW_M2))

#: Net upward accelerations at lift-off, m/s², and their prior probabilities: a geometric grid over
#: 2 to 40 m/s²; standard deviations along and across as shares of the mean; notional.
_LIFT_M_S2 = (3.0, 6.5, 14.0, 30.0)
_LIFT_SHARE = (0.2, 0.3, 0.3, 0.2)
_LIFT_SIGMA = 0.4
_ASIDE_SIGMA = 0.2

#: Growth of the acceleration, 1/s, and the standard deviation of the jerk as a rate of the specific
#: force, 1/s: growth of 1 to 3 % a second, and a thrust that turns by 1 to 2 ° a second; notional.
_GROWTH_PER_S = 0.02
_TURN_PER_S = 0.03
_GRAVITY_M_S2 = 9.8

#: Edges of the intervals of the time from lift-off to the first detection, s.
_EDGES_S = BEFORE_S * np.linspace(0.0, 1.0, 9) ** 2

#: Launches first seen in flight, some 12, 25, 50, 100, 200 and 400 s after lift-off: mean and
#: standard deviation of height, m, upward velocity, m/s, and upward acceleration, m/s²; standard
#: deviation of the velocity aside; notional.
_IN_FLIGHT = (
    ((600.0, 500.0), (100.0, 50.0), (8.0, 6.0), 60.0),
    ((2500.0, 2e3), (200.0, 100.0), (8.0, 6.0), 150.0),
    ((10e3, 6e3), (400.0, 200.0), (8.0, 6.0), 400.0),
    ((40e3, 20e3), (800.0, 350.0), (8.0, 8.0), 900.0),
    ((120e3, 50e3), (1200.0, 700.0), (2.0, 10.0), 2500.0),
    ((200e3, 80e3), (500.0, 700.0), (0.0, 10.0), 4000.0),
)

#: Standard deviations of the acceleration aside, m/s², and of the jerk, m/s³, of launches in
#: flight; notional.
_TILTED_M_S2 = 10.0
_UNSTEADY_M_S3 = 0.5

#: Mean and standard deviation of the height of bolides, m, and standard deviations aside and
#: upwards of velocity, m/s, deceleration, m/s², and jerk, m/s³. CNEOS: brightest at 35.2 km
#: [22-61], entered at 17.3 km/s [11.8-30.2], in any direction; the rest is notional.
_BOLIDE = ((40e3, 20e3), (11e3, 11e3), (3e3, 3e3), (3e3, 3e3))

#: Objects that are none of these: share, then heights and rates as of bolides; notional. Vehicles,
#: ships, glints and edges of clouds creep over the ground: two or three for a hundred thousand
#: fires.
_CREEPING = (0.0025, ((20.0, 2.0), (0.05, 0.05), (0.003, 0.003)))

#: Flashes of lightning, which are most of them, in and above clouds; mean time for which they are
#: bright, s.
_FLASH = (0.7375, ((10e3, 4e3), (10.0, 10.0), (0.0, 0.0), (0.0, 0.0)))
_FLASH_S = 0.5

#: Balloons and other lights that stand aloft or drift with the wind; what enters the air from an
#: orbit; anything else.
_ALOFT = (
    (0.0025, ((10e3, 8e3), (30.0, 5.0), (0.2, 0.1), (0.01, 0.01))),
    (0.05, ((80e3, 25e3), (5e3, 500.0), (30.0, 15.0), (1.0, 1.0))),
    (0.01, ((60e3, 60e3), (2e3, 2e3), (30.0, 30.0), (3.0, 3.0))),
)

#: Aircraft, which have speed where a launch has none: mean and standard deviation of the height, m;
#: of subsonic and supersonic ones the share, speed, m/s, and its standard deviations along and
#: across the course.
_AIRCRAFT_M = (8e3, 6e3)
_AIRCRAFT = ((0.8, 230.0, (60.0, 90.0)), (0.2, 450.0, (120.0, 180.0)))

#: Flights of aircraft: share; standard deviations of the climb, m/s; of the acceleration, m/s², and
#: the jerk, m/s³, along and across the course, and upwards. Straight on, as many as launches: one
#: sensor alone can hardly tell both; with turns or a gain of speed.
_FLIGHTS = (
    (0.1, 15.0, ((0.2, 0.2, 0.1), (0.01, 0.01, 0.01))),
    (0.1, 60.0, ((2.0, 6.0, 3.0), (0.5, 0.5, 0.5))),
)


class _Component(NamedTuple):
    group: int
    weight: float
    mean: FloatArray
    root: FloatArray
    interval: int = -1
    fades_s: float = np.inf


@frozen(eq=False)
class MotionPriors:
    """The components (c,) of all priors: group, log weight within the group, mean (c, 12) and root
    (c, 12, 12).

    `interval` (c,) is that of `edges_s` for launches from rest, -1 for others; their weights need
    the scan period. `fades_s` (c,) is the mean time for which they are bright, infinite for what
    burns or flies on.
    """

    group: IntArray
    log_weight: FloatArray
    mean: FloatArray
    root: FloatArray
    interval: IntArray
    fades_s: FloatArray
    edges_s: FloatArray

    @classmethod
    def of(cls, config: HypothesesConfig) -> "MotionPriors":
        """Return the priors of a tracker's settings."""
        kinds = grounds(config.inland_share)
        parts = [*_standing(config.ground_drift_m_s, kinds), *_others(kinds)]
        parts.append(_drawn(BOLIDE, 1.0, *_BOLIDE)._replace(fades_s=config.bolide_s))
        parts += [
            *_from_rest(1.0 - config.in_flight_share, kinds),
            *_in_flight(config.in_flight_share),
        ]
        parts = [part for part in parts if part.weight > 0.0]
        return cls(
            group=np.array([part.group for part in parts]),
            log_weight=np.log([part.weight for part in parts]),
            mean=np.array([part.mean for part in parts]),
            root=np.array([part.root for part in parts]),
            interval=np.array([part.interval for part in parts]),
            fades_s=np.array([part.fades_s for part in parts]),
            edges_s=_EDGES_S,
        )

    def log_weights(self, pause_s: FloatArray, age_s: FloatArray) -> FloatArray:
        """Return the log weights (n, c) of the components for tracks whose sensors look every
        `pause_s` (n,).

        Half of the launches are detected at once, after an exponential time of this mean; others
        after a uniform time, as for the launch points. What is still bright at an age (n,), s, is
        the less probably what fades.
        """
        soon = -np.diff(np.exp(-self.edges_s / pause_s[:, None]), axis=1)
        late = np.diff(self.edges_s) / BEFORE_S
        since = np.log(AT_ONCE * soon + (1.0 - AT_ONCE) * late)
        known = np.concatenate([since, np.zeros((len(pause_s), 1))], axis=1)
        return np.asarray(self.log_weight + known[:, self.interval] - age_s[:, None] / self.fades_s)


def _standing(drift_m_s: float, kinds: Sequence[Ground]) -> list[_Component]:
    still = ((drift_m_s, drift_m_s), (0.0, 0.0), (0.0, 0.0))
    return _on_ground(GROUND, 1.0, kinds, still)


def _others(kinds: Sequence[Ground]) -> list[_Component]:
    share, rates = _CREEPING
    flash_share, flash = _FLASH
    return [
        _drawn(NONE, flash_share, *flash)._replace(fades_s=_FLASH_S),
        *_on_ground(NONE, share, kinds, rates),
        *(_drawn(NONE, share, *spread) for share, spread in _ALOFT),
        *_aircraft(),
    ]


def _aircraft() -> list[_Component]:
    """Return the priors of each kind of aircraft, flight and course."""
    parts = []
    courses = np.arange(8) * (np.pi / 4.0)
    for flight, (share, speed_m_s, sigmas_m_s), course in product(_FLIGHTS, _AIRCRAFT, courses):
        flown, climb_m_s, rates = flight
        sine = np.sin(course)
        cosine = np.cos(course)
        axes = np.array([[sine, cosine, 0.0], [cosine, -sine, 0.0], [0.0, 0.0, 1.0]])
        mean = np.zeros((ORDERS, 3))
        root = np.zeros((ORDERS, 3, ORDERS, 3))
        mean[0, 2] = _AIRCRAFT_M[0]
        mean[1] = speed_m_s * axes[0]
        spreads = (WIDE_M, WIDE_M, _AIRCRAFT_M[1]), (*sigmas_m_s, climb_m_s), *rates
        for order, sigmas in enumerate(spreads):
            root[order, :, order] = axes * sigmas
        weight = flown * share / len(courses)
        parts.append(_Component(NONE, weight, mean.ravel(), root.reshape(3 * ORDERS, -1)))
    return parts


def _on_ground(
    group: int, weight: float, kinds: Sequence[Ground], rates: Sequence[tuple[float, float]]
) -> list[_Component]:
    return [
        _drawn(group, weight * kind.share, (kind.mean_m, kind.sigma_m), *rates) for kind in kinds
    ]


def _from_rest(share: float, kinds: Sequence[Ground]) -> list[_Component]:
    return [
        _lifted(share * of_lift * kind.share, lift, number, kind)
        for lift, of_lift in zip(_LIFT_M_S2, _LIFT_SHARE, strict=True)
        for number in range(len(_EDGES_S) - 1)
        for kind in kinds
    ]


def _lifted(weight: float, lift_m_s2: float, interval: int, ground: Ground) -> _Component:
    """Return the prior of launches from rest on the ground in an interval of time before the first
    detection.

    Their parameters are place, acceleration, jerk, and the time of lift-off within the interval,
    linearised.
    """
    first_s, last_s = _EDGES_S[interval : interval + 2].tolist()
    since_s = 0.5 * (first_s + last_s)
    spread_s = (last_s - first_s) / np.sqrt(12.0)
    # Position, velocity, acceleration and jerk at the first detection from acceleration and jerk at
    # lift-off.
    of_lift = np.array([0.5 * since_s**2, since_s, 1.0, 0.0])
    of_jerk = np.array([since_s**3 / 6.0, 0.5 * since_s**2, since_s, 1.0])
    jerk = _GROWTH_PER_S * lift_m_s2
    upwards = of_lift * lift_m_s2 + of_jerk * jerk
    mean = np.zeros((ORDERS, 3))
    root = np.zeros((ORDERS, 3, 3 * ORDERS))
    mean[:, 2] = upwards
    mean[0, 2] += ground.mean_m
    root[0, range(3), range(3)] = WIDE_M, WIDE_M, ground.sigma_m
    along = lift_m_s2 * np.array([_ASIDE_SIGMA, _ASIDE_SIGMA, _LIFT_SIGMA])
    root[:, range(3), range(3, 6)] = of_lift[:, None] * along
    root[:, range(3), range(6, 9)] = (_TURN_PER_S * (lift_m_s2 + _GRAVITY_M_S2)) * of_jerk[:, None]
    root[:-1, 2, 9] = spread_s * upwards[1:]
    return _Component(LAUNCH, weight, mean.ravel(), root.reshape(3 * ORDERS, -1), interval)


def _in_flight(share: float) -> list[_Component]:
    parts = []
    for *upwards, aside_m_s in _IN_FLIGHT:
        mean = np.zeros((ORDERS, 3))
        root = np.full((ORDERS, 3), _UNSTEADY_M_S3)
        root[:3, :2] = np.array([WIDE_M, aside_m_s, _TILTED_M_S2])[:, None]
        mean[:3, 2], root[:3, 2] = np.array(upwards).T
        parts.append(
            _Component(LAUNCH, share / len(_IN_FLIGHT), mean.ravel(), np.diag(root.ravel()))
        )
    return parts


def _drawn(group: int, weight: float, *spread: tuple[float, float]) -> _Component:
    """Return a component of given height (mean, standard deviation) and rates (deviations aside and
    upwards).
    """
    height, *rates = spread
    mean = np.zeros((ORDERS, 3))
    root = np.zeros((ORDERS, 3))
    mean[0, 2] = height[0]
    root[0] = (WIDE_M, WIDE_M, height[1])
    root[1:] = [(aside, aside, upwards) for aside, upwards in rates]
    return _Component(group, weight, mean.ravel(), np.diag(root.ravel()))
