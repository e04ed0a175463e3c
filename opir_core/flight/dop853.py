"""DOP853: steps and dense output of second-order equations r'' = a(r, v), for many arcs at once or
for one arc.

Dormand and Prince's explicit Runge-Kutta method of order 8 with error estimates of orders 5 and 3
and dense output of order 7, by Hairer, Nørsett and Wanner (Solving Ordinary Differential Equations
I, 2nd ed., II.5 and II.6; program DOP853). Applied to r' = v, v' = a(r, v), the stage positions are
r + c h v + h² Σ (A·A) a_j: they need no stage velocities, and forces that do not depend on velocity
need none at all, which halves the work. Rows of the tableau are sparse: pairs (stage, weight).

Up to 8 arcs are stepped in Python floats, which is up to five times as fast as numpy there, with
the same operations in the same order and so the same bits.
"""

import json
from collections.abc import Callable
from math import fsum, nan, sqrt
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from opir_core.arrays import FloatArray

Row = tuple[tuple[int, float], ...]

#: A right side for one arc: position and velocity as six numbers in, acceleration as three out.
FloatAcceleration = Callable[..., "Vector"]

#: Stages of a step, the first of them the acceleration at its start.
STAGES = 12

_TABLEAU = json.loads(
    (Path(__file__).parents[1] / "data" / "dop853.json").read_text(encoding="utf-8")
)


def _rows(name: str) -> tuple[Row, ...]:
    return tuple(tuple((stage, weight) for stage, weight in row) for row in _TABLEAU[name])


#: Times of the stages as fractions of the step; 12 is the end of the step, 13 to 15 serve the dense
#: output only.
NODES: tuple[float, ...] = tuple(_TABLEAU["nodes"])

#: Weights h·w of the accelerations in each stage's velocity; entry 12 is the step's end.
VELOCITY_WEIGHTS = _rows("velocity")


def _after_velocity(row: Row) -> Row:
    """Return the weights of the stage accelerations in a sum of stage velocities: `row` times the
    tableau.
    """
    velocity = [dict(weights) for weights in VELOCITY_WEIGHTS]
    stages = range(max(dict(row), default=0))
    sums = ((j, fsum(w * velocity[i].get(j, 0.0) for i, w in row)) for j in stages)
    # Products that vanish by the order conditions come out as roundings of 1e-11 at most.
    return tuple((j, w) for j, w in sums if abs(w) > 1e-11)


#: Weights h²·w of the accelerations in each stage's position.
POSITION_WEIGHTS = tuple(_after_velocity(row) for row in VELOCITY_WEIGHTS)

#: Weights h·w of the accelerations in the velocity's two error estimates.
(ERROR_5,) = _rows("error_5")
_THIRD_ORDER: dict[int, float] = dict(*_rows("third_order"))
ERROR_3 = tuple((j, w - _THIRD_ORDER.get(j, 0.0)) for j, w in VELOCITY_WEIGHTS[STAGES])

#: Weights of the accelerations in the four highest terms of the dense output: h·w for velocity,
#: h²·w for position.
DENSE_VELOCITY = _rows("dense")
DENSE_POSITION = tuple(_after_velocity(row) for row in DENSE_VELOCITY)


class ColumnAcceleration(Protocol):
    """The right side of r'' = a(r, v) over columns of arcs."""

    #: Whether velocities matter; where they do not, `None` stands for them.
    needs_velocity: bool

    def __call__(self, position: FloatArray, velocity: FloatArray, /) -> FloatArray:
        """Return accelerations (3, n), m/s², at positions and velocities (3, n)."""
        ...


class Acceleration(ColumnAcceleration, Protocol):
    """A right side that can also be had for one arc."""

    def of_arc(self, arc: int) -> FloatAcceleration:
        """Return the same for one of the arcs, to the same bits."""
        ...


class StepStart(NamedTuple):
    """The states that steps begin from, (3, n) each, with the accelerations there."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Step(NamedTuple):
    """Where the steps end, the estimated errors of the velocities there, m/s, and the accelerations
    at the stages.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    velocity_error: FloatArray
    stages: list[FloatArray]


def stepped(right_side: Acceleration, start: StepStart, h: FloatArray) -> Step:
    """Return one step of length h (n,), s, of either sign, from every state."""
    if h.size > 8:
        return stepped_in_columns(right_side, start, h)
    starts = zip(*(rows.T.tolist() for rows in start), h.tolist(), strict=True)
    steps = [FloatStep.of(right_side, arc, *state) for arc, state in enumerate(starts)]
    position = np.array([step.position for step in steps]).T.copy()
    velocity = np.array([step.velocity for step in steps]).T.copy()
    stages = list(np.array([step.stages for step in steps]).transpose(2, 1, 0).copy())
    error = np.array([step.velocity_error for step in steps])
    return Step(position, velocity, stages[-1], error, stages)


Vector = tuple[float, float, float]
FloatStages = tuple[list[float], list[float], list[float]]


class FloatStep(NamedTuple):
    """The end of a step of one arc, the accelerations at its stages by component, and the estimated
    error of velocity, m/s.
    """

    position: Vector
    velocity: Vector
    stages: FloatStages
    velocity_error: float

    @classmethod
    def of(
        cls,
        right_side: Acceleration,
        arc: int,
        position: Vector,
        velocity: Vector,
        acceleration: Vector,
        h: float,
    ) -> "FloatStep":
        """Return a step of length h, s, as `stepped_in_columns` does; nan where it meets a
        singularity.
        """
        x, y, z = acceleration
        stages = [x], [y], [z]
        acceleration_at = right_side.of_arc(arc)
        drift = (h * velocity[0], h * velocity[1], h * velocity[2])
        speed = velocity
        try:
            for stage in range(1, STAGES + 1):
                place = _moved(position, drift, NODES[stage])
                if POSITION_WEIGHTS[stage]:
                    place = _moved(place, _sum(POSITION_WEIGHTS[stage], stages), h * h)
                if right_side.needs_velocity or stage == STAGES:
                    speed = _moved(velocity, _sum(VELOCITY_WEIGHTS[stage], stages), h)
                for values, value in zip(stages, acceleration_at(*place, *speed), strict=True):
                    values.append(value)
        except (ZeroDivisionError, ValueError):
            lost = (nan, nan, nan)
            return cls(lost, lost, ([nan] * 13, [nan] * 13, [nan] * 13), nan)
        fifth = _square_of(_sum(ERROR_5, stages), h)
        third = _square_of(_sum(ERROR_3, stages), h)
        return cls(place, speed, stages, fifth / (sqrt(fifth + 0.01 * third) or 1.0))


def _sum(weights: Row, stages: FloatStages) -> Vector:
    xs, ys, zs = stages
    stage, weight = weights[0]
    x = xs[stage] * weight
    y = ys[stage] * weight
    z = zs[stage] * weight
    for stage, weight in weights[1:]:
        x += xs[stage] * weight
        y += ys[stage] * weight
        z += zs[stage] * weight
    return x, y, z


def _moved(vector: Vector, change: Vector, factor: float) -> Vector:
    return (
        vector[0] + change[0] * factor,
        vector[1] + change[1] * factor,
        vector[2] + change[2] * factor,
    )


def _square_of(vector: Vector, factor: float) -> float:
    x = vector[0] * factor
    y = vector[1] * factor
    z = vector[2] * factor
    return x * x + y * y + z * z


def stepped_in_columns(right_side: ColumnAcceleration, start: StepStart, h: FloatArray) -> Step:
    """Return the step as `stepped` does, always in columns; calls the right side at `NODES[1:STAGES
    + 1]`, in order.
    """
    stages = Stages(right_side, start, h, [start.acceleration])
    for stage in range(1, STAGES):
        stages.append(stage)
    position, velocity = stages.append(STAGES)
    # Hairer, Nørsett and Wanner's blend of the estimates of order 5 and 3, e5²/sqrt(e5² + 0.01
    # e3²), m/s.
    fifth = _squares(stages.h_sum(ERROR_5))
    third = _squares(stages.h_sum(ERROR_3))
    scale = np.sqrt(fifth + 0.01 * third)
    error = fifth / np.where(scale == 0.0, 1.0, scale)
    return Step(position, velocity, stages.accelerations[-1], error, stages.accelerations)


def _squares(rows: FloatArray) -> FloatArray:
    rows *= rows
    return rows[0] + rows[1] + rows[2]


class Stages:
    """The accelerations at the stages of a step, each computed from the earlier ones."""

    def __init__(
        self,
        right_side: ColumnAcceleration,
        start: StepStart,
        h: FloatArray,
        accelerations: list[FloatArray],
    ) -> None:
        self.accelerations = accelerations
        self._right_side = right_side
        self._start = start
        self._h = h
        self._hh = h * h
        self._drift = h * start.velocity
        self._scratch = np.empty_like(start.position)

    def append(self, stage: int) -> tuple[FloatArray, FloatArray]:
        """Add the acceleration at a stage; return the state there, without its velocity where
        forces do not need it.
        """
        position = self._drift * NODES[stage]
        position += self._start.position
        if POSITION_WEIGHTS[stage]:
            position += self.h2_sum(POSITION_WEIGHTS[stage])
        velocity = self._start.velocity
        if self._right_side.needs_velocity or stage == STAGES:
            velocity = velocity + self.h_sum(VELOCITY_WEIGHTS[stage])
        self.accelerations.append(self._right_side(position, velocity))
        return position, velocity

    def h_sum(self, weights: Row) -> FloatArray:
        """Return h times the weighted sum of the accelerations."""
        total = self._sum(weights)
        total *= self._h
        return total

    def h2_sum(self, weights: Row) -> FloatArray:
        """Return h² times the weighted sum of the accelerations."""
        total = self._sum(weights)
        total *= self._hh
        return total

    def _sum(self, weights: Row) -> FloatArray:
        """Add up in the order given, whatever the number of arcs."""
        stage, weight = weights[0]
        total = self.accelerations[stage] * weight
        for stage, weight in weights[1:]:
            np.multiply(self.accelerations[stage], weight, out=self._scratch)
            total += self._scratch
        return total


def nested(terms: FloatArray, fraction: FloatArray) -> FloatArray:
    """Return u (t0 + w (t1 + u (t2 + w (t3 + u (t4 + w (t5 + u t6)))))), the change of a state
    since the start of its step, at fractions u of it, w = 1 - u; terms are (7, ..., n).
    """
    remaining = 1.0 - fraction
    value: FloatArray = terms[6] * fraction
    for order in (5, 4, 3, 2, 1, 0):
        value += terms[order]
        value *= remaining if order % 2 else fraction
    return value


def dense_output(
    right_side: ColumnAcceleration, start: StepStart, step: Step, h: FloatArray
) -> FloatArray:
    """Return the terms (7, 2, 3, n) of `nested` of positions and velocities in steps, at the cost
    of three more accelerations each (Hairer, Nørsett and Wanner, II.6).
    """
    stages = Stages(right_side, start, h, list(step.stages))
    for stage in range(STAGES + 1, len(NODES)):
        stages.append(stage)
    terms = np.empty((7, 2, *start.position.shape))
    for state, (change, start_slope, end_slope) in enumerate(
        (
            (step.position - start.position, h * start.velocity, h * step.velocity),
            (step.velocity - start.velocity, h * start.acceleration, h * step.acceleration),
        )
    ):
        terms[0, state] = change
        terms[1, state] = start_slope - change
        terms[2, state] = 2.0 * change - start_slope - end_slope
    for order in range(4):
        terms[3 + order, 0] = stages.h2_sum(DENSE_POSITION[order])
        terms[3 + order, 1] = stages.h_sum(DENSE_VELOCITY[order])
    return terms
