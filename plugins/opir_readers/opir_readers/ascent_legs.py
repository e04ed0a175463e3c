"""Legs of kinematic ascents: powered flight by programs on a great circle, free fall, burns against
the flight.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import (
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_FLATTENING,
    EARTH_MU_M3_S2,
    EARTH_ROTATION_RAD_S,
)
from opir_core.flight import propagate_kepler

#: Steps of integration and of the states of a leg, s; states of a free fall.
_STEP_S = 1.0
_COAST_STEP_S = 5.0
_ONE_STEP_S = np.array([0.0, _STEP_S])

#: Least number of states of a fall.
_LEAST = 8

#: Air of a falling booster: density at the ground, scale height, m/(C_d A). The last is notional.
_DENSITY_KG_M3 = 1.225
_SCALE_M = 7500.0
_BALLISTIC_KG_M2 = 2000.0

OMEGA = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])

#: Returns thrust acceleration, m/s², and flight path angle, rad, at a time since the ignition of a
#: burn.
Program = Callable[[float], tuple[float, float]]

#: Returns the thrust acceleration (3,), m/s², at a position and a velocity.
Thrust = Callable[[FloatArray, FloatArray], FloatArray]


class AscentLeg(NamedTuple):
    """A smooth part of a flight: times since lift-off (n,), ECEF positions and velocities (n, 3);
    whether it burns.
    """

    time_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    burns: bool


def height_of(position_m: FloatArray) -> float:
    """Return the height of one position above the ellipsoid along its radius, m, to 40 m below 100
    km.
    """
    radius = math.sqrt(float(position_m @ position_m))
    return radius - EARTH_EQUATORIAL_RADIUS_M * (
        1.0 - EARTH_FLATTENING * (float(position_m[2]) / radius) ** 2
    )


def powered(
    start_s: float,
    position_m: FloatArray,
    heading: FloatArray,
    speed_m_s: float,
    burn_s: float,
    program: Program,
) -> AscentLeg:
    """Return a burn on the great circle from a position in a direction, by its program; speeds are
    over the Earth.
    """
    radius = float(np.linalg.norm(position_m))
    up = position_m / radius
    along = heading / np.linalg.norm(heading)
    along = along - np.dot(along, up) * up
    along /= np.linalg.norm(along)

    def rate(time_s: float, state: FloatArray) -> FloatArray:
        thrust, angle = program(time_s)
        gravity = EARTH_MU_M3_S2 / state[1] ** 2
        climbs = state[0] * np.sin(angle)
        return np.array(
            [thrust - gravity * np.sin(angle), climbs, state[0] * np.cos(angle) / state[1]]
        )

    time_s = np.linspace(0.0, burn_s, max(round(burn_s / _STEP_S), 8) + 1)
    states = integrated(rate, time_s, np.array([speed_m_s, radius, 0.0]))
    speed, radii, turn = states.T
    angle = np.array([program(each)[1] for each in time_s.tolist()])
    outward = np.cos(turn)[:, None] * up + np.sin(turn)[:, None] * along
    onward = np.cos(turn)[:, None] * along - np.sin(turn)[:, None] * up
    velocity = speed[:, None] * (np.sin(angle)[:, None] * outward + np.cos(angle)[:, None] * onward)
    return AscentLeg(start_s + time_s, radii[:, None] * outward, velocity, True)


def coast(before: AscentLeg, duration_s: float) -> AscentLeg:
    """Return a free fall on a two-body arc, in a frame at rest, from the end of a leg."""
    count = max(round(duration_s / _COAST_STEP_S), 8) + 1
    since_s = np.linspace(0.0, duration_s, count)
    position = before.position_m[-1]
    velocity = before.velocity_m_s[-1]
    flown, moved = propagate_kepler(
        position[None], (velocity + np.cross(OMEGA, position))[None], since_s
    )
    turned, moving = (
        _turned(vectors, -EARTH_ROTATION_RAD_S * since_s) for vectors in (flown, moved)
    )
    return AscentLeg(before.time_s[-1] + since_s, turned, moving - np.cross(OMEGA, turned), False)


def thrusting(before: AscentLeg, duration_s: float, thrust: Thrust) -> AscentLeg:
    """Return a burn under a thrust, gravity, rotation and air, from the end of a leg."""
    time_s = np.linspace(0.0, duration_s, max(round(duration_s / _STEP_S), 8) + 1)
    states = integrated(_rate(thrust), time_s, _last(before))
    return AscentLeg(before.time_s[-1] + time_s, states[:, :3], states[:, 3:], True)


def falling(
    before: AscentLeg, is_over: Callable[[FloatArray, FloatArray], bool], longest_s: float = 1200.0
) -> AscentLeg:
    """Return a fall through the air from the end of a leg, until the last step before something is
    over.
    """
    rate = _rate(lambda _, velocity: 0.0 * velocity)
    state = _last(before)
    states = list[FloatArray]()
    while len(states) * _STEP_S < longest_s and not (
        len(states) > _LEAST and is_over(state[:3], state[3:])
    ):
        states.append(state)
        state = integrated(rate, _ONE_STEP_S, state)[-1]
    flown = np.array(states)
    return AscentLeg(
        before.time_s[-1] + _STEP_S * np.arange(len(flown)), flown[:, :3], flown[:, 3:], False
    )


def stopping(before: AscentLeg, burn_s: float) -> AscentLeg:
    """Return a burn that brings a target to rest on a straight line, at a constant deceleration."""
    share = np.linspace(0.0, 1.0, max(round(burn_s / _STEP_S), 8) + 1)[:, None]
    position = before.position_m[-1]
    velocity = before.velocity_m_s[-1]
    way = position + burn_s * (share - 0.5 * share * share) * velocity
    return AscentLeg(before.time_s[-1] + burn_s * share[:, 0], way, (1.0 - share) * velocity, True)


def resting(before: AscentLeg, duration_s: float) -> AscentLeg:
    """Return a time at rest where a leg ends."""
    since_s = np.linspace(0.0, duration_s, _LEAST + 1)
    place = np.broadcast_to(before.position_m[-1], (len(since_s), 3))
    return AscentLeg(before.time_s[-1] + since_s, place, np.zeros(place.shape), False)


def integrated(
    rate: Callable[[float, FloatArray], FloatArray], time_s: FloatArray, state: FloatArray
) -> FloatArray:
    """Return states (n, k) at times (n,) by the classical Runge-Kutta method."""
    states = [state]
    for now, later in zip(time_s[:-1].tolist(), time_s[1:].tolist(), strict=True):
        step = later - now
        middle = 0.5 * (now + later)
        first = rate(now, state)
        second = rate(middle, state + 0.5 * step * first)
        third = rate(middle, state + 0.5 * step * second)
        last = rate(later, state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + last)
        states.append(state)
    return np.array(states)


def _last(before: AscentLeg) -> FloatArray:
    """Return position and velocity (6,) at the end of a leg."""
    return np.concatenate([before.position_m[-1], before.velocity_m_s[-1]])


def _rate(thrust: Thrust) -> Callable[[float, FloatArray], FloatArray]:
    """Return what changes position and velocity (6,): gravity, rotation, air and a thrust."""

    def rate(_: float, state: FloatArray) -> FloatArray:
        position = state[:3]
        velocity = state[3:]
        radius, speed = (math.sqrt(float(each @ each)) for each in (position, velocity))
        air = _DENSITY_KG_M3 * math.exp(-max(height_of(position), 0.0) / _SCALE_M)
        turning = np.array([position[0], position[1], 0.0]) * EARTH_ROTATION_RAD_S**2
        aside = 2.0 * EARTH_ROTATION_RAD_S * np.array([velocity[1], -velocity[0], 0.0])
        pull = -EARTH_MU_M3_S2 / radius**3 * position + turning + aside
        drag = -0.5 * air * speed / _BALLISTIC_KG_M2 * velocity
        return np.concatenate([velocity, pull + drag + thrust(position, velocity)])

    return rate


def _turned(vectors: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return vectors (n, 3) turned about the Earth's axis."""
    cosine = np.cos(angle_rad)
    sine = np.sin(angle_rad)
    x, y, z = vectors.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
