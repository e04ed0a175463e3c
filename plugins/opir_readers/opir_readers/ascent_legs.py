"""Legs of kinematic ascents: powered flight by programs on a great circle, free fall, burns against
the flight.
"""

import math
from collections.abc import Callable, Iterator
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
from opir_readers.celestial_frames import earth_rotation_m_s, turned

#: Steps of integration and of the states of a leg, s.
_STEP_S = 1.0

#: Steps of a leg, and states of a fall, are at least as many.
_LEAST = 8

#: Returns thrust acceleration, m/s², and flight path angle, rad, at a time since the ignition of a
#: burn.
Program = Callable[[float], tuple[float, float]]

#: Returns the thrust acceleration (3,), m/s², at a position and a velocity.
Thrust = Callable[[FloatArray, FloatArray], FloatArray]

#: Returns the change of a state (k,) per second, at a time and a state.
Rate = Callable[[float, FloatArray], FloatArray]


class AscentLeg(NamedTuple):
    """A smooth stretch of a flight: times since lift-off (n,), ECEF positions and velocities
    (n, 3); whether it burns.
    """

    time_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    burns: bool

    @property
    def end(self) -> tuple[float, FloatArray, FloatArray]:
        """Return time, position and velocity (3,) of the last state."""
        return float(self.time_s[-1]), self.position_m[-1], self.velocity_m_s[-1]


def height_of(position_m: FloatArray) -> float:
    """Return the height of one position above the ellipsoid along its radius, m, to 40 m below 100
    km.
    """
    radius = math.sqrt(float(position_m @ position_m))
    return radius - EARTH_EQUATORIAL_RADIUS_M * (
        1.0 - EARTH_FLATTENING * (float(position_m[2]) / radius) ** 2
    )


def _times_s(duration_s: float, step_s: float = _STEP_S) -> FloatArray:
    """Return times (n,) since the start of a leg, s, about a step apart."""
    return np.linspace(0.0, duration_s, max(round(duration_s / step_s), _LEAST) + 1)


def powered(
    start_s: float,
    position_m: FloatArray,
    velocity_m_s: FloatArray,
    speed_m_s: float,
    burn_s: float,
    program: Program,
) -> AscentLeg:
    """Return a burn on the great circle from a position in the direction of a velocity, by its
    program; speeds are over the Earth.
    """
    radius = float(np.linalg.norm(position_m))
    up = position_m / radius
    along = velocity_m_s / np.linalg.norm(velocity_m_s)
    along = along - np.dot(along, up) * up
    along /= np.linalg.norm(along)

    def rate(time_s: float, state: FloatArray) -> FloatArray:
        speed, radius, _ = state.tolist()
        thrust, angle = program(time_s)
        rise = np.sin(angle)
        gain = thrust - EARTH_MU_M3_S2 / radius**2 * rise
        return np.array([gain, speed * rise, speed * np.cos(angle) / radius])

    time_s = _times_s(burn_s)
    speed, radii, turn = integrated(rate, time_s, np.array([speed_m_s, radius, 0.0])).T[..., None]
    angle = np.array([program(time)[1] for time in time_s.tolist()])[:, None]
    outward = np.cos(turn) * up + np.sin(turn) * along
    onward = np.cos(turn) * along - np.sin(turn) * up
    velocity = np.asarray(speed * (np.sin(angle) * outward + np.cos(angle) * onward))
    return AscentLeg(start_s + time_s, np.asarray(radii * outward), velocity, True)


def coast(leg: AscentLeg, duration_s: float) -> AscentLeg:
    """Return a free fall on a two-body arc, in a frame at rest, from the end of a leg."""
    start_s, position, velocity = leg.end
    since_s = _times_s(duration_s, 5.0)
    inertial = velocity + earth_rotation_m_s(position)
    turns = [("z", EARTH_ROTATION_RAD_S * since_s)]
    positions, velocities = (
        turned(vectors, turns)
        for vectors in propagate_kepler(position[None], inertial[None], since_s)
    )
    return AscentLeg(
        start_s + since_s, positions, velocities - earth_rotation_m_s(positions), False
    )


def thrusting(leg: AscentLeg, duration_s: float, thrust: Thrust) -> AscentLeg:
    """Return a burn under a thrust, gravity, rotation and air, from the end of a leg."""
    start_s, position, velocity = leg.end
    time_s = _times_s(duration_s)
    states = integrated(_rate(thrust), time_s, np.concatenate([position, velocity]))
    return AscentLeg(start_s + time_s, states[:, :3], states[:, 3:], True)


def falling(
    leg: AscentLeg, is_over: Callable[[FloatArray, FloatArray], bool], longest_s: float = 1200.0
) -> AscentLeg:
    """Return a fall through the air from the end of a leg, until the last step before it is over,
    by position and velocity.
    """
    rate = _rate(lambda _, velocity: 0.0 * velocity)
    step_s = np.array([0.0, _STEP_S])
    start_s, position, velocity = leg.end
    state = np.concatenate([position, velocity])
    states = list[FloatArray]()
    while len(states) * _STEP_S < longest_s and not (
        len(states) > _LEAST and is_over(state[:3], state[3:])
    ):
        states.append(state)
        state = integrated(rate, step_s, state)[-1]
    fall = np.array(states)
    return AscentLeg(
        start_s + _STEP_S * np.arange(len(fall), dtype=np.float64), fall[:, :3], fall[:, 3:], False
    )


def stopping(leg: AscentLeg, burn_s: float) -> AscentLeg:
    """Return a burn that brings a target to rest on a straight line, at a constant deceleration."""
    start_s, position, velocity = leg.end
    share = np.linspace(0.0, 1.0, max(round(burn_s / _STEP_S), _LEAST) + 1)[:, None]
    way = position + burn_s * (share - 0.5 * share * share) * velocity
    return AscentLeg(start_s + burn_s * share[:, 0], way, (1.0 - share) * velocity, True)


def resting(leg: AscentLeg, duration_s: float) -> AscentLeg:
    """Return a time at rest where a leg ends."""
    start_s, position, _ = leg.end
    since_s = np.linspace(0.0, duration_s, _LEAST + 1)
    place = np.broadcast_to(position, (len(since_s), 3))
    return AscentLeg(start_s + since_s, place, np.zeros(place.shape), False)


def integrated(rate: Rate, time_s: FloatArray, state: FloatArray) -> FloatArray:
    """Return states (n, k) at times (n,) by the classical Runge-Kutta method."""
    return np.array([state, *_runge_kutta(rate, time_s, state)])


def _runge_kutta(rate: Rate, time_s: FloatArray, state: FloatArray) -> Iterator[FloatArray]:
    for start, end in zip(time_s[:-1].tolist(), time_s[1:].tolist(), strict=True):
        step = end - start
        middle = 0.5 * (start + end)
        k1 = rate(start, state)
        k2 = rate(middle, state + 0.5 * step * k1)
        k3 = rate(middle, state + 0.5 * step * k2)
        k4 = rate(end, state + step * k3)
        state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        yield state


def _rate(thrust: Thrust) -> Rate:
    """Return the rate of position and velocity (6,): gravity, rotation, air and a thrust.

    Air has 1.225 kg/m³ at the ground and a scale height of 7500 m; m/(C_d A) of the booster is
    2000 kg/m², which is notional.
    """

    def rate(_: float, state: FloatArray) -> FloatArray:
        position = state[:3]
        velocity = state[3:]
        radius = math.sqrt(float(position @ position))
        speed = math.sqrt(float(velocity @ velocity))
        air = 1.225 * math.exp(-max(height_of(position), 0.0) / 7500.0)
        turning = np.array([position[0], position[1], 0.0]) * EARTH_ROTATION_RAD_S**2
        aside = 2.0 * EARTH_ROTATION_RAD_S * np.array([velocity[1], -velocity[0], 0.0])
        pull = -EARTH_MU_M3_S2 / radius**3 * position + turning + aside
        drag = -0.5 * air * speed / 2000.0 * velocity
        return np.concatenate([velocity, pull + drag + thrust(position, velocity)])

    return rate
