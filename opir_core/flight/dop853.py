"""DOP853: steps and dense output of second-order equations r'' = a(r, v), for many arcs at once or
for one arc.

Dormand and Prince's explicit Runge-Kutta method of order 8 with error estimates of orders 5 and 3
and dense output of order 7, by Hairer, Nørsett and Wanner (Solving Ordinary Differential Equations
I, 2nd ed., II.5 and II.6; program DOP853). Applied to r' = v, v' = a(r, v), the stage positions are
r + c h v + h² Σ (A·A) a_j: they need no stage velocities, and forces that do not depend on velocity
need none at all, which halves the work. Rows of the tableau are sparse: pairs (stage, weight).

Up to 8 arcs are stepped one by one in Python floats, which is up to five times as fast as numpy
there, with the same operations in the same order and so the same bits.
"""

from collections.abc import Mapping
from math import fsum, nan, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.flight.gravity_and_drag import Alone

Row = tuple[tuple[int, float], ...]

#: Stages of a step, the first of them the acceleration at its start.
STAGES = 12

# fmt: off
#: Times of the stages as fractions of the step; 12 is the end of the step, 13 to 15 serve the dense
#: output only.
NODES = (
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25,
    0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0, 0.1, 0.2, 0.7777777777777778,
)

_VELOCITY: tuple[Mapping[int, float], ...] = (
    {},
    {0: 0.05260015195876773},
    {0: 0.0197250569845379, 1: 0.0591751709536137},
    {0: 0.02958758547680685, 2: 0.08876275643042054},
    {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
    {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
    {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
    {0: 0.03709200011850479, 3: 0.17038392571223998, 4: 0.10726203044637328, 5: -0.015319437748624402,
     6: 0.008273789163814023},
    {0: 0.6241109587160757, 3: -3.3608926294469414, 4: -0.868219346841726, 5: 27.59209969944671, 6: 20.154067550477894,
     7: -43.48988418106996},
    {0: 0.47766253643826434, 3: -2.4881146199716677, 4: -0.590290826836843, 5: 21.230051448181193,
     6: 15.279233632882423, 7: -33.28821096898486, 8: -0.020331201708508627},
    {0: -0.9371424300859873, 3: 5.186372428844064, 4: 1.0914373489967295, 5: -8.149787010746927, 6: -18.52006565999696,
     7: 22.739487099350505, 8: 2.4936055526796523, 9: -3.0467644718982196},
    {0: 2.273310147516538, 3: -10.53449546673725, 4: -2.0008720582248625, 5: -17.9589318631188, 6: 27.94888452941996,
     7: -2.8589982771350235, 8: -8.87285693353063, 9: 12.360567175794303, 10: 0.6433927460157636},
    {0: 0.054293734116568765, 5: 4.450312892752409, 6: 1.8915178993145003, 7: -5.801203960010585,
     8: 0.3111643669578199, 9: -0.1521609496625161, 10: 0.20136540080403034, 11: 0.04471061572777259},
    {0: 0.056167502283047954, 6: 0.25350021021662483, 7: -0.2462390374708025, 8: -0.12419142326381637,
     9: 0.15329179827876568, 10: 0.00820105229563469, 11: 0.007567897660545699, 12: -0.008298},
    {0: 0.03183464816350214, 5: 0.028300909672366776, 6: 0.053541988307438566, 7: -0.05492374857139099,
     10: -0.00010834732869724932, 11: 0.0003825710908356584, 12: -0.00034046500868740456, 13: 0.1413124436746325},
    {0: -0.42889630158379194, 5: -4.697621415361164, 6: 7.683421196062599, 7: 4.06898981839711, 8: 0.3567271874552811,
     12: -0.0013990241651590145, 13: 2.9475147891527724, 14: -9.15095847217987},
)

_ERROR_5: Mapping[int, float] = (
    {0: 0.01312004499419488, 5: -1.2251564463762044, 6: -0.4957589496572502, 7: 1.6643771824549864,
     8: -0.35032884874997366, 9: 0.3341791187130175, 10: 0.08192320648511571, 11: -0.022355307863886294}
)
#: Weights of the third-order solution, with which those of the step are compared.
_THIRD_ORDER: Mapping[int, float] = {0: 0.2440944881889764, 8: 0.7338466882816118, 11: 0.022058823529411766}
_DENSE: tuple[Mapping[int, float], ...] = (
    {0: -8.428938276109013, 5: 0.5667149535193777, 6: -3.0689499459498917, 7: 2.38466765651207, 8: 2.117034582445028,
     9: -0.871391583777973, 10: 2.2404374302607883, 11: 0.6315787787694688, 12: -0.08899033645133331,
     13: 18.148505520854727, 14: -9.194632392478356, 15: -4.436036387594894},
    {0: 10.427508642579134, 5: 242.28349177525817, 6: 165.20045171727028, 7: -374.5467547226902,
     8: -22.113666853125306, 9: 7.733432668472264, 10: -30.674084731089398, 11: -9.332130526430229,
     12: 15.697238121770845, 13: -31.139403219565178, 14: -9.35292435884448, 15: 35.81684148639408},
    {0: 19.985053242002433, 5: -387.0373087493518, 6: -189.17813819516758, 7: 527.8081592054236, 8: -11.57390253995963,
     9: 6.8812326946963, 10: -1.0006050966910838, 11: 0.7777137798053443, 12: -2.778205752353508,
     13: -60.19669523126412, 14: 84.32040550667716, 15: 11.99229113618279},
    {0: -25.69393346270375, 5: -154.18974869023643, 6: -231.5293791760455, 7: 357.6391179106141, 8: 93.40532418362432,
     9: -37.45832313645163, 10: 104.0996495089623, 11: 29.8402934266605, 12: -43.53345659001114, 13: 96.32455395918828,
     14: -39.17726167561544, 15: -149.72683625798564},
)
# fmt: on

#: Products of the tableau that vanish by its order conditions come out as roundings of this size at
#: most.
_ZERO = 1e-11


def _row(weights: Mapping[int, float]) -> Row:
    return tuple(sorted(weights.items()))


def _after_velocity(weights: Mapping[int, float]) -> Row:
    """Return the weights of the stage accelerations in a sum of stage velocities: `weights` times
    the tableau.
    """
    stages = range(max(weights, default=0))
    sums = ((j, fsum(w * _VELOCITY[i].get(j, 0.0) for i, w in weights.items())) for j in stages)
    return tuple((j, w) for j, w in sums if abs(w) > _ZERO)


#: Weights h·w of the accelerations in each stage's velocity, and h²·w in its position; entry 12 is
#: the step's end.
VELOCITY_WEIGHTS = tuple(_row(weights) for weights in _VELOCITY)
POSITION_WEIGHTS = tuple(_after_velocity(weights) for weights in _VELOCITY)

#: Weights h·w of the accelerations in the velocity's two error estimates.
ERROR_5 = _row(_ERROR_5)
ERROR_3 = _row({j: w - _THIRD_ORDER.get(j, 0.0) for j, w in _VELOCITY[STAGES].items()})

#: Weights of the accelerations in the four highest terms of the dense output: h·w for velocity,
#: h²·w for position.
DENSE_VELOCITY = tuple(_row(weights) for weights in _DENSE)
DENSE_POSITION = tuple(_after_velocity(weights) for weights in _DENSE)


Vector = tuple[float, float, float]


class SingleStep(NamedTuple):
    """Where a step ends, the accelerations at its stages by component, and the estimated error of
    velocity, m/s.
    """

    position: Vector
    velocity: Vector
    stages: tuple[list[float], list[float], list[float]]
    velocity_error: float


_LOST = SingleStep((nan,) * 3, (nan,) * 3, ([nan] * 13, [nan] * 13, [nan] * 13), nan)


def single_step(
    acceleration: Alone,
    needs_velocity: bool,
    position: Vector,
    velocity: Vector,
    first: Vector,
    h: float,
) -> SingleStep:
    """Return a step of length h, s, from a state and the acceleration there; all nan where it meets
    a singularity.
    """
    try:
        return _step(acceleration, needs_velocity, position, velocity, first, h)
    except (ZeroDivisionError, ValueError):
        return _LOST


def _step(
    acceleration: Alone,
    needs_velocity: bool,
    position: Vector,
    velocity: Vector,
    first: Vector,
    h: float,
) -> SingleStep:
    stages = [first[0]], [first[1]], [first[2]]
    hh = h * h
    drift = (h * velocity[0], h * velocity[1], h * velocity[2])
    here = position
    speed = velocity
    for stage in range(1, STAGES + 1):
        node = NODES[stage]
        weights = POSITION_WEIGHTS[stage]
        here = (
            drift[0] * node + position[0],
            drift[1] * node + position[1],
            drift[2] * node + position[2],
        )
        if weights:
            here = _moved(here, _sum(weights, stages), hh)
        if needs_velocity or stage == STAGES:
            speed = _moved(velocity, _sum(VELOCITY_WEIGHTS[stage], stages), h)
        for component, value in zip(stages, acceleration(*here, *speed), strict=True):
            component.append(value)
    return SingleStep(here, speed, stages, _single_velocity_error(stages, h))


def _sum(weights: Row, stages: tuple[list[float], list[float], list[float]]) -> Vector:
    xs, ys, zs = stages
    first, weight = weights[0]
    x = xs[first] * weight
    y = ys[first] * weight
    z = zs[first] * weight
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


def _single_velocity_error(stages: tuple[list[float], list[float], list[float]], h: float) -> float:
    fifth, third = (_single_square(_sum(weights, stages), h) for weights in (ERROR_5, ERROR_3))
    return fifth / (sqrt(fifth + 0.01 * third) or 1.0)


def _single_square(vector: Vector, h: float) -> float:
    x = vector[0] * h
    y = vector[1] * h
    z = vector[2] * h
    return x * x + y * y + z * z


class ColumnAcceleration(Protocol):
    """The right side of r'' = a(r, v) over columns of arcs."""

    #: Whether velocities matter; where they do not, `None` stands for them.
    needs_velocity: bool

    def __call__(self, position: FloatArray, velocity: FloatArray, /) -> FloatArray:
        """Return accelerations (3, n), m/s², at positions and velocities (3, n)."""
        ...


class Acceleration(ColumnAcceleration, Protocol):
    """A right side that can also be had for one arc."""

    def alone(self, arc: int) -> Alone:
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
    if h.size <= _FEW:
        return _stepped_one_by_one(right_side, start, h)
    return stepped_in_columns(right_side, start, h)


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
    fifth = _square(stages.h_sum(ERROR_5))
    third = _square(stages.h_sum(ERROR_3))
    scale = np.sqrt(fifth + 0.01 * third)
    error = fifth / np.where(scale == 0.0, 1.0, scale)
    return Step(position, velocity, stages.accelerations[-1], error, stages.accelerations)


#: Up to this many arcs are stepped one by one.
_FEW = 8


def _stepped_one_by_one(right_side: Acceleration, start: StepStart, h: FloatArray) -> Step:
    states = zip(*(rows.T.tolist() for rows in start), h.tolist(), strict=True)
    steps = [
        single_step(
            right_side.alone(arc),
            right_side.needs_velocity,
            position,
            velocity,
            acceleration,
            length,
        )
        for arc, (position, velocity, acceleration, length) in enumerate(states)
    ]
    end, speed = (np.array([step[each] for step in steps]).T.copy() for each in (0, 1))
    stages = list(np.array([step.stages for step in steps]).transpose(2, 1, 0).copy())
    return Step(end, speed, stages[-1], np.array([step.velocity_error for step in steps]), stages)


class Stages:
    """The accelerations at the stages of a step, each found from those before it."""

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
        (first, weight), *rest = weights
        total = self.accelerations[first] * weight
        for stage, weight in rest:
            np.multiply(self.accelerations[stage], weight, out=self._scratch)
            total += self._scratch
        return total


def _square(rows: FloatArray) -> FloatArray:
    rows *= rows
    return rows[0] + rows[1] + rows[2]


class DenseOutput(NamedTuple):
    """Positions and velocities in steps as polynomials: first values, and seven terms of shape (7,
    3, n) each.

    With u the fraction of the step and w = 1 - u, a value is first + u (t0 + w (t1 + u (t2 + w (t3
    + u (t4 + w (t5 + u t6)))))) (Hairer, Nørsett and Wanner, Solving Ordinary Differential
    Equations I, 2nd ed., II.6).
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
    """Return u (t0 + w (t1 + u (t2 + ...))), the change since the start of the step; terms are (7,
    ..., n).
    """
    rest = 1.0 - fraction
    value: FloatArray = terms[6] * fraction
    for order in (5, 4, 3, 2, 1, 0):
        value += terms[order]
        value *= rest if order % 2 else fraction
    return value


def dense_output(
    right_side: ColumnAcceleration, start: StepStart, step: Step, h: FloatArray
) -> DenseOutput:
    """Return the dense output of steps, at the cost of three more accelerations each."""
    stages = Stages(right_side, start, h, list(step.stages))
    for stage in range(STAGES + 1, len(NODES)):
        stages.append(stage)
    moved = step.position - start.position
    gained = step.velocity - start.velocity
    position = np.empty((7, *moved.shape))
    velocity = np.empty((7, *moved.shape))
    position[:3] = _low_terms(moved, h * start.velocity, h * step.velocity)
    velocity[:3] = _low_terms(gained, h * start.acceleration, h * step.acceleration)
    for order, weights in enumerate(DENSE_POSITION):
        position[3 + order] = stages.h2_sum(weights)
    for order, weights in enumerate(DENSE_VELOCITY):
        velocity[3 + order] = stages.h_sum(weights)
    return DenseOutput(start.position, start.velocity, position, velocity)


def _low_terms(
    change: FloatArray, first_slope: FloatArray, last_slope: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    return change, first_slope - change, 2.0 * change - first_slope - last_slope
