"""Where, within a step, an arc first crosses a height: good enough to end the next attempt there."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.ellipsoidal_height import height_and_climb
from opir_core.flight.stepping import Start, Step

_HALVINGS = 4
_NEWTON_STEPS = 4


class Rise(NamedTuple):
    """Heights, m, at the two ends of steps, and how much they would change, m, in the whole step at the rates there."""

    first: FloatArray
    last: FloatArray
    first_rate: FloatArray
    last_rate: FloatArray

    def of(self, index: RowArray) -> "Rise":
        """Return the rows at `index`."""
        return Rise(*(column[index] for column in self))

    def at(self, fraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the cubic through the ends at a fraction of the step, and its derivative."""
        bend = 3.0 * (self.last - self.first) - 2.0 * self.first_rate - self.last_rate
        twist = self.first_rate + self.last_rate - 2.0 * (self.last - self.first)
        value = self.first + fraction * (self.first_rate + fraction * (bend + fraction * twist))
        return value, self.first_rate + fraction * (2.0 * bend + fraction * (3.0 * twist))

    def turning_point(self) -> FloatArray:
        """Return the fraction at which the cubic turns, where its rates differ in sign at the two ends."""
        bend = 3.0 * (self.last - self.first) - 2.0 * self.first_rate - self.last_rate
        twist = self.first_rate + self.last_rate - 2.0 * (self.last - self.first)
        root = np.sqrt(bend * bend - 3.0 * twist * self.first_rate)
        return np.abs(self.first_rate) / (root - np.sign(self.first_rate) * bend)


def crossing_fraction(rise: Rise, boundary: FloatArray, down: NDArray[np.bool_], end: FloatArray) -> FloatArray:
    """Return the fraction, up to `end`, at which the cubic goes down (or up) through the boundary.

    Bisection, then Newton's method held to the bracket; `end` where the cubic stays short of the boundary.
    """
    side = np.where(down, 1.0, -1.0)
    low, high = np.zeros_like(end), end.copy()
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        short = side * (rise.at(middle)[0] - boundary) > 0.0
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    fraction = 0.5 * (low + high)
    for _ in range(_NEWTON_STEPS):
        value, slope = rise.at(fraction)
        short = side * (value - boundary) > 0.0
        low, high = np.where(short, fraction, low), np.where(short, high, fraction)
        better = fraction - (value - boundary) / slope
        fraction = np.where((better > low) & (better < high), better, 0.5 * (low + high))
    return fraction


def state_within(
    start: Start, step: Step, h: FloatArray, index: RowArray, fraction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of the steps at `index`, by the quintic through both ends' states."""
    position, velocity, acceleration = (rows[:, index] for rows in start)
    end_position, end_velocity, end_acceleration = (rows[:, index] for rows in step[:3])
    length = h[index]
    slope, curve = length * velocity, length * length * acceleration
    p = end_position - position - slope - 0.5 * curve
    q = length * end_velocity - slope - curve
    s = length * length * end_acceleration - curve
    c3, c4, c5 = 10.0 * p - 4.0 * q + 0.5 * s, 7.0 * q - 15.0 * p - s, 6.0 * p - 3.0 * q + 0.5 * s
    f = fraction
    moved = position + f * (slope + f * (0.5 * curve + f * (c3 + f * (c4 + f * c5))))
    rate = slope + f * (curve + f * (3.0 * c3 + f * (4.0 * c4 + f * (5.0 * c5))))
    return moved, rate / length


def height_within(
    start: Start, step: Step, h: FloatArray, index: RowArray, fraction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return heights, m, and how much they would change in the whole step, m, at a fraction of it, by the quintic."""
    position, velocity = state_within(start, step, h, index, fraction)
    inverse_radius = 1.0 / np.sqrt(position[0] * position[0] + position[1] * position[1] + position[2] * position[2])
    height, climb = height_and_climb(position, velocity, inverse_radius)
    return height, climb * h[index]
