"""One DOP853 step of many arcs at once, each with its own length."""

from typing import NamedTuple, Protocol

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.flight import dop853
from opir_core.flight.gravity import Alone
from opir_core.flight.single_steps import single_step


class Acceleration(Protocol):
    """The right side of r'' = a(r, v) over columns of arcs."""

    #: Whether velocities matter; where they do not, `None` stands for them.
    needs_velocity: bool

    def __call__(self, position: FloatArray, velocity: FloatArray, /) -> FloatArray:
        """Return accelerations (3, n), m/s², at positions and velocities (3, n)."""
        ...

    def alone(self, arc: int) -> Alone:
        """Return the same for one of the arcs, to the same bits."""
        ...


class Start(NamedTuple):
    """The states that steps begin from, (3, n) each, with the accelerations there."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Step(NamedTuple):
    """Where the steps end, the estimated errors of the velocities there, m/s, and the accelerations at the stages."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    velocity_error: FloatArray
    stages: list[FloatArray]


def stepped(right_side: Acceleration, start: Start, h: FloatArray) -> Step:
    """Return one step of length h (n,), s, of either sign, from every state."""
    if h.size <= _FEW:
        return _stepped_one_by_one(right_side, start, h)
    stages = Stages(right_side, start, h, [start.acceleration])
    for stage in range(1, dop853.STAGES):
        stages.append(stage)
    position, velocity = stages.append(dop853.STAGES)
    return Step(position, velocity, stages.accelerations[-1], _velocity_error(stages), stages.accelerations)


#: Up to this many arcs are stepped one by one.
_FEW = 8


def _stepped_one_by_one(right_side: Acceleration, start: Start, h: FloatArray) -> Step:
    states = zip(*(rows.T.tolist() for rows in start), h.tolist(), strict=True)
    steps = [
        single_step(right_side.alone(arc), right_side.needs_velocity, position, velocity, acceleration, length)
        for arc, (position, velocity, acceleration, length) in enumerate(states)
    ]
    end, speed = (np.array([step[each] for step in steps]).T.copy() for each in (0, 1))
    stages = list(np.array([step.stages for step in steps]).transpose(2, 1, 0).copy())
    return Step(end, speed, stages[-1], np.array([step.velocity_error for step in steps]), stages)


class Stages:
    """The accelerations at the stages of a step, each found from those before it."""

    def __init__(self, right_side: Acceleration, start: Start, h: FloatArray, accelerations: list[FloatArray]) -> None:
        self.accelerations = accelerations
        self._right_side, self._start = right_side, start
        self._h, self._hh, self._drift = h, h * h, h * start.velocity
        self._scratch = np.empty_like(start.position)

    def append(self, stage: int) -> tuple[FloatArray, FloatArray]:
        """Add the acceleration at a stage; return the state there, without its velocity where forces do not need it."""
        position = self._drift * dop853.NODES[stage]
        position += self._start.position
        if dop853.POSITION_WEIGHTS[stage]:
            position += self.h2_sum(dop853.POSITION_WEIGHTS[stage])
        velocity = self._start.velocity
        if self._right_side.needs_velocity or stage == dop853.STAGES:
            velocity = velocity + self.h_sum(dop853.VELOCITY_WEIGHTS[stage])
        self.accelerations.append(self._right_side(position, velocity))
        return position, velocity

    def h_sum(self, weights: dop853.Row) -> FloatArray:
        """Return h times the weighted sum of the accelerations."""
        total = self._sum(weights)
        total *= self._h
        return total

    def h2_sum(self, weights: dop853.Row) -> FloatArray:
        """Return h² times the weighted sum of the accelerations."""
        total = self._sum(weights)
        total *= self._hh
        return total

    def _sum(self, weights: dop853.Row) -> FloatArray:
        """Add up in the order given, whatever the number of arcs."""
        (first, weight), *rest = weights
        total = self.accelerations[first] * weight
        for stage, weight in rest:
            np.multiply(self.accelerations[stage], weight, out=self._scratch)
            total += self._scratch
        return total


def _velocity_error(stages: Stages) -> FloatArray:
    """Return Hairer, Nørsett and Wanner's blend of the estimates of order 5 and 3, e5²/sqrt(e5² + 0.01 e3²), m/s."""
    fifth = _square(stages.h_sum(dop853.ERROR_5))
    third = _square(stages.h_sum(dop853.ERROR_3))
    scale = np.sqrt(fifth + 0.01 * third)
    error: FloatArray = fifth / np.where(scale == 0.0, 1.0, scale)
    return error


def _square(rows: FloatArray) -> FloatArray:
    rows *= rows
    square: FloatArray = rows[0] + rows[1] + rows[2]
    return square
