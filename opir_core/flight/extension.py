"""The states within steps already taken: DOP853's continuous extension of order 7."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.flight import dop853
from opir_core.flight.stepping import Acceleration, Stages, Start, Step


class Extension(NamedTuple):
    """Positions and velocities in steps as polynomials: first values, and seven terms of shape (7, 3, n) each.

    With u the fraction of the step and w = 1 - u, a value is first + u (t0 + w (t1 + u (t2 + w (t3 + u (t4 + w (t5 +
    u t6)))))) (Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.6).
    """

    position: FloatArray
    velocity: FloatArray
    position_terms: FloatArray
    velocity_terms: FloatArray

    def at(self, fraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, at fractions (n,) of the steps."""
        position = nested(self.position_terms, fraction)
        position += self.position
        velocity = nested(self.velocity_terms, fraction)
        velocity += self.velocity
        return position, velocity


def nested(terms: FloatArray, fraction: FloatArray) -> FloatArray:
    """Return u (t0 + w (t1 + u (t2 + ...))), the change since the start of the step; terms are (7, ..., n)."""
    rest = 1.0 - fraction
    value: FloatArray = terms[6] * fraction
    for order in (5, 4, 3, 2, 1, 0):
        value += terms[order]
        value *= rest if order % 2 else fraction
    return value


def extended(right_side: Acceleration, start: Start, step: Step, h: FloatArray) -> Extension:
    """Return the extension of steps: three more accelerations each."""
    stages = Stages(right_side, start, h, list(step.stages))
    for stage in range(dop853.STAGES + 1, len(dop853.NODES)):
        stages.append(stage)
    moved, gained = step.position - start.position, step.velocity - start.velocity
    position, velocity = np.empty((7, *moved.shape)), np.empty((7, *moved.shape))
    position[:3] = _low_terms(moved, h * start.velocity, h * step.velocity)
    velocity[:3] = _low_terms(gained, h * start.acceleration, h * step.acceleration)
    for order, weights in enumerate(dop853.EXTENSION_POSITION):
        position[3 + order] = stages.h2_sum(weights)
    for order, weights in enumerate(dop853.EXTENSION_VELOCITY):
        velocity[3 + order] = stages.h_sum(weights)
    return Extension(start.position, start.velocity, position, velocity)


def _low_terms(
    change: FloatArray, first_slope: FloatArray, last_slope: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    return change, first_slope - change, 2.0 * change - first_slope - last_slope
