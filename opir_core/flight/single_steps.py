"""One DOP853 step of one arc in plain numbers: the arithmetic of `stepping` in its order, so to the same bits.

For a few arcs numpy's calls cost more than its arithmetic; Python's own numbers are then several times as fast.
"""

from math import nan, sqrt
from typing import NamedTuple

from opir_core.flight import dop853
from opir_core.flight.gravity import Alone

Vector = tuple[float, float, float]


class SingleStep(NamedTuple):
    """Where a step ends, the accelerations at its stages by component, and the estimated error of velocity, m/s."""

    position: Vector
    velocity: Vector
    stages: tuple[list[float], list[float], list[float]]
    velocity_error: float


_LOST = SingleStep((nan,) * 3, (nan,) * 3, ([nan] * 13, [nan] * 13, [nan] * 13), nan)


def single_step(
    acceleration: Alone, needs_velocity: bool, position: Vector, velocity: Vector, first: Vector, h: float
) -> SingleStep:
    """Return a step of length h, s, from a state and the acceleration there; all nan where it meets a singularity."""
    try:
        return _step(acceleration, needs_velocity, position, velocity, first, h)
    except (ZeroDivisionError, ValueError):
        return _LOST


def _step(
    acceleration: Alone, needs_velocity: bool, position: Vector, velocity: Vector, first: Vector, h: float
) -> SingleStep:
    stages = [first[0]], [first[1]], [first[2]]
    hh, drift = h * h, (h * velocity[0], h * velocity[1], h * velocity[2])
    here, speed = position, velocity
    for stage in range(1, dop853.STAGES + 1):
        node, weights = dop853.NODES[stage], dop853.POSITION_WEIGHTS[stage]
        here = (drift[0] * node + position[0], drift[1] * node + position[1], drift[2] * node + position[2])
        if weights:
            here = _moved(here, _sum(weights, stages), hh)
        if needs_velocity or stage == dop853.STAGES:
            speed = _moved(velocity, _sum(dop853.VELOCITY_WEIGHTS[stage], stages), h)
        for component, value in zip(stages, acceleration(*here, *speed), strict=True):
            component.append(value)
    return SingleStep(here, speed, stages, _velocity_error(stages, h))


def _sum(weights: dop853.Row, stages: tuple[list[float], list[float], list[float]]) -> Vector:
    xs, ys, zs = stages
    first, weight = weights[0]
    x, y, z = xs[first] * weight, ys[first] * weight, zs[first] * weight
    for stage, weight in weights[1:]:
        x += xs[stage] * weight
        y += ys[stage] * weight
        z += zs[stage] * weight
    return x, y, z


def _moved(vector: Vector, change: Vector, factor: float) -> Vector:
    return vector[0] + change[0] * factor, vector[1] + change[1] * factor, vector[2] + change[2] * factor


def _velocity_error(stages: tuple[list[float], list[float], list[float]], h: float) -> float:
    fifth, third = (_square(_sum(weights, stages), h) for weights in (dop853.ERROR_5, dop853.ERROR_3))
    return fifth / (sqrt(fifth + 0.01 * third) or 1.0)


def _square(vector: Vector, h: float) -> float:
    x, y, z = vector[0] * h, vector[1] * h, vector[2] * h
    return x * x + y * y + z * z
