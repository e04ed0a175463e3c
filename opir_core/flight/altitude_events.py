"""Heights at which steps must end: the boundaries between layers of air, and the impact height.

Each arc is in an interval of height. A step that would leave it is shortened to end on the
boundary, where the arc changes to the next interval. So no step crosses a kink in the density of
the air or skips the onset of drag, and an impact is located exactly. The crossing within a step is
located well enough to end the next attempt there.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.conic_impact import ON_SURFACE_M
from opir_core.flight.dop853 import Step, StepStart
from opir_core.flight.gravity_and_drag import height_and_climb
from opir_core.flight.universal_anomaly import dot, length
from opir_core.geometry.vectors import FloatPair


class Rise(NamedTuple):
    """Heights, m, at both ends of steps, and the rates there times the length of the step, m."""

    start: FloatArray
    end: FloatArray
    start_rate: FloatArray
    end_rate: FloatArray

    def of(self, index: RowArray) -> "Rise":
        """Return the rows at `index`."""
        return Rise(*(column[index] for column in self))

    def _coefficients(self) -> FloatPair:
        """Return those of the square and the cube of the cubic through the ends."""
        change = self.end - self.start
        return (
            3.0 * change - 2.0 * self.start_rate - self.end_rate,
            self.start_rate + self.end_rate - 2.0 * change,
        )

    def at(self, fraction: FloatArray) -> FloatPair:
        """Return the cubic through the ends at a fraction of the step, and its derivative."""
        bend, twist = self._coefficients()
        value = self.start + fraction * (self.start_rate + fraction * (bend + fraction * twist))
        return value, self.start_rate + fraction * (2.0 * bend + fraction * (3.0 * twist))

    def turning_point(self) -> FloatArray:
        """Return the fraction at which the cubic turns, where its rates differ in sign at the two
        ends.
        """
        bend, twist = self._coefficients()
        root = np.sqrt(bend * bend - 3.0 * twist * self.start_rate)
        return np.abs(self.start_rate) / (root - np.sign(self.start_rate) * bend)


def crossing_fraction(
    rise: Rise, boundary: FloatArray, down: BoolArray, end: FloatArray
) -> FloatArray:
    """Return the fraction, up to `end`, at which the cubic goes down (or up) through the boundary.

    Bisection, then Newton's method held to the bracket; `end` where the cubic stays short of the
    boundary.
    """
    side = np.where(down, 1.0, -1.0)
    low = np.zeros_like(end)
    high = end.copy()
    for _ in range(4):
        middle = 0.5 * (low + high)
        short = side * (rise.at(middle)[0] - boundary) > 0.0
        low = np.where(short, middle, low)
        high = np.where(short, high, middle)
    fraction = 0.5 * (low + high)
    for _ in range(4):
        value, slope = rise.at(fraction)
        short = side * (value - boundary) > 0.0
        low = np.where(short, fraction, low)
        high = np.where(short, high, fraction)
        better = fraction - (value - boundary) / slope
        fraction = np.where((better > low) & (better < high), better, 0.5 * (low + high))
    return fraction


def state_within(
    start: StepStart, step: Step, h: FloatArray, index: RowArray, fraction: FloatArray
) -> FloatPair:
    """Return positions and velocities within steps at `index`, by the quintic through the states at
    both ends.
    """
    position, velocity, acceleration = (rows[:, index] for rows in start)
    end_position, end_velocity, end_acceleration = (rows[:, index] for rows in step[:3])
    duration = h[index]
    slope = duration * velocity
    curve = duration * duration * acceleration
    p = end_position - position - slope - 0.5 * curve
    q = duration * end_velocity - slope - curve
    s = duration * duration * end_acceleration - curve
    c3 = 10.0 * p - 4.0 * q + 0.5 * s
    c4 = 7.0 * q - 15.0 * p - s
    c5 = 6.0 * p - 3.0 * q + 0.5 * s
    f = fraction
    moved = position + f * (slope + f * (0.5 * curve + f * (c3 + f * (c4 + f * c5))))
    rate = slope + f * (curve + f * (3.0 * c3 + f * (4.0 * c4 + f * (5.0 * c5))))
    return moved, rate / duration


def height_within(
    start: StepStart, step: Step, h: FloatArray, index: RowArray, fraction: FloatArray
) -> FloatPair:
    """Return heights, m, at a fraction of steps, and their rates times the length of the step, m,
    by the quintic.
    """
    position, velocity = state_within(start, step, h, index, fraction)
    height, climb = height_and_climb(position, velocity, 1.0 / length(position))
    return height, climb * h[index]


#: An arc within this distance, m, is on a boundary: between layers that moves an impact by
#: micrometres.
_NEAR_M = 0.1


class Seams(NamedTuple):
    """Layers from the lowest up: their floors, m, and the bounds of steps in them, as in
    `AirLayers`.
    """

    floors_m: FloatArray
    strides_m: FloatArray
    stride_shares: FloatArray


class GroundContact(NamedTuple):
    """The arcs that changed to another layer, reached the impact height, or left the air model at
    its floor.
    """

    changed: BoolArray
    impact: BoolArray
    sunk: BoolArray


class AltitudeEvents:
    """The interval of height of each of n arcs, and the arc's place in it; rates are along the
    direction of travel.

    `target_m` is the impact height, -inf without one.
    """

    def __init__(self, seams: Seams, target_m: FloatArray, backward: BoolArray) -> None:
        self._seams = seams
        self._ceilings = np.append(seams.floors_m[1:], np.inf)
        self._target = target_m
        self._direction = np.where(backward, -1.0, 1.0)
        self.has_target = bool(np.any(target_m > -np.inf))

    def begin(self, start: StepStart) -> GroundContact:
        """Start from the first states of the arcs."""
        self._height, self._climb = self._height_and_climb(start.position, start.velocity)
        self._bend = self._curvature(start, self._climb)
        self.layer = np.searchsorted(self._seams.floors_m, self._height, side="right") - 1
        outside = self.layer < 0
        self.layer[outside] = 0
        self._above = self._height >= self._target - ON_SURFACE_M
        self._set_bounds()
        landing = self.settle(np.ones_like(outside))
        return landing._replace(sunk=landing.sunk | outside)

    def keep(self, under_way: BoolArray) -> None:
        """Keep the arcs that are under way."""
        for name in self._COLUMNS:
            setattr(self, name, getattr(self, name)[under_way])

    _COLUMNS = (
        "_target",
        "_direction",
        "_height",
        "_climb",
        "_bend",
        "layer",
        "_above",
        "_low",
        "_high",
    )

    def lengths(self, longest: FloatArray) -> FloatPair:
        """Return the longest steps, s, by accuracy and height, and equal steps that end on the
        boundary ahead.

        Within the first, height changes by at most the layer's stride. The second extrapolate the
        present motion.
        """
        above = np.maximum(self._height - self._seams.floors_m[self.layer], 0.0)
        stride = self._seams.strides_m[self.layer] + self._seams.stride_shares[self.layer] * above
        rate = np.abs(self._climb)
        # Gravity is taken as 10 m/s² in the bound of a step's change of height.
        allowed = np.minimum(longest, 2.0 * stride / (rate + np.sqrt(rate * rate + 20.0 * stride)))
        to_boundary = self._time_to_boundary()
        # A step may be this much longer than the longest one, to end on a boundary.
        count = np.ceil(to_boundary / (1.05 * allowed))
        return allowed, np.where(
            to_boundary < np.inf, to_boundary / np.maximum(count, 1.0), allowed
        )

    def _time_to_boundary(self) -> FloatArray:
        """Return the times, s, to the boundary ahead along a parabola; infinite where it is not
        reached.
        """
        rate = np.abs(self._climb)
        distance = np.where(self._climb < 0.0, self._height - self._low, self._high - self._height)
        bend = np.where(self._climb < 0.0, -self._bend, self._bend)
        time = 2.0 * distance / (rate + np.sqrt(rate * rate + 2.0 * bend * distance))
        return np.where(time > 0.0, time, np.inf)

    def fall_time(self, radius_squared_m2: FloatArray, mu_m3_s2: float) -> FloatArray:
        """Return approximate times of fall, s, to the impact height in the gravity at the present
        height.
        """
        gravity = mu_m3_s2 / radius_squared_m2
        drop = np.maximum(self._height - self._target, 0.0)
        return (self._climb + np.sqrt(self._climb * self._climb + 2.0 * gravity * drop)) / gravity

    def shortened(
        self, start: StepStart, step: Step, h: FloatArray, candidate: BoolArray
    ) -> tuple[RowArray, FloatArray]:
        """Return the candidates that step out of their interval, and the fraction of the step where
        they first do.
        """
        self._next_height, self._next_climb = self._height_and_climb(step.position, step.velocity)
        duration = np.abs(h)
        rise = Rise(
            self._height, self._next_height, self._climb * duration, self._next_climb * duration
        )
        down = rise.end < self._low - self._slack(self._next_climb)
        leaving = down | (rise.end > self._high + _NEAR_M)
        # Steps this short, s, are not shortened further.
        candidate = candidate & (duration > 1e-3)
        index = np.flatnonzero(candidate & leaving)
        end = np.ones(index.size)
        turning = np.flatnonzero(candidate & ~leaving & (rise.start_rate * rise.end_rate < 0.0))
        if turning.size:
            down[turning] = rise.start_rate[turning] < 0.0
            fraction = rise.of(turning).turning_point()
            height, _ = height_within(start, step, h, turning, fraction)
            outside = (height < self._low[turning]) | (height > self._high[turning])
            turning = turning[outside]
            fraction = fraction[outside]
            index = np.concatenate([index, turning])
            end = np.concatenate([end, fraction])
        if not index.size:
            return index, end
        return index, self._crossing(start, step, h, rise, index, down[index], end)

    def _crossing(
        self,
        start: StepStart,
        step: Step,
        h: FloatArray,
        rise: Rise,
        index: RowArray,
        down: BoolArray,
        end: FloatArray,
    ) -> FloatArray:
        """Return the fraction at which the boundary is crossed: on the cubic, then one Newton step
        on the quintic.

        Where that fails, half the first fraction: the next attempt starts closer to the boundary.
        """
        boundary = np.where(down, self._low[index], self._high[index])
        fraction = crossing_fraction(rise.of(index), boundary, down, end)
        height, rate = height_within(start, step, h, index, fraction)
        better = fraction - (height - boundary) / rate
        return np.where((better > 0.0) & (better < end), better, 0.5 * fraction)

    def advance(self, start: StepStart, accepted: BoolArray) -> GroundContact:
        """Move the accepted arcs to the ends of the last steps, the states of `start`."""
        np.copyto(self._height, self._next_height, where=accepted)
        np.copyto(self._climb, self._next_climb, where=accepted)
        self._bend = self._curvature(start, self._climb)
        return self.settle(accepted)

    def settle(self, moved: BoolArray) -> GroundContact:
        """Move arcs on a boundary, or about to cross it, into the next interval; return the
        contacts.
        """
        falling = self._climb < 0.0
        rising = self._climb > 0.0
        drop = self._height - self._low
        rise = self._high - self._height
        down = moved & falling & (drop <= self._slack(self._climb)) & self._will_cover(drop)
        up = moved & rising & (rise <= _NEAR_M) & self._will_cover(rise)
        impact = down & self._above & (self._low == self._target)
        sunk = down & ~impact & (self.layer == 0)
        changed = (down & ~impact & ~sunk) | up
        if changed.any():
            self.layer += (up & (self._high == self._ceilings[self.layer])).astype(np.intp) - (
                down & changed
            )
            self._above |= up & (self._high == self._target)
            self._set_bounds()
        return GroundContact(changed, impact, sunk)

    def _will_cover(self, distance: FloatArray) -> BoolArray:
        """Return whether the arcs will cover twice a distance, m, before they turn, in the present
        motion.
        """
        return self._climb * self._climb >= 4.0 * np.abs(self._bend) * np.maximum(distance, 0.0)

    def time_to_target(
        self, position: FloatArray, velocity: FloatArray, index: RowArray
    ) -> FloatArray:
        """Return the times, s, to the impact height of states (3, k) near it, of the arcs at
        `index`.
        """
        height, climb = height_and_climb(position, velocity, 1.0 / length(position))
        return (self._target[index] - height) / climb

    def _set_bounds(self) -> None:
        floor = self._seams.floors_m[self.layer]
        ceiling = self._ceilings[self.layer]
        self._low = np.where(self._above, np.maximum(floor, self._target), floor)
        self._high = np.where(self._above, ceiling, np.minimum(ceiling, self._target))

    def _slack(self, climb: FloatArray) -> FloatArray:
        """Return the distance to the boundary below, m, within which an arc counts as on it."""
        # At the impact height an arc must also be within 0.1 ms.
        return np.where(
            self._low == self._target, np.minimum(_NEAR_M, 1e-4 * np.abs(climb)), _NEAR_M
        )

    def _height_and_climb(self, position: FloatArray, velocity: FloatArray) -> FloatPair:
        height, climb = height_and_climb(position, velocity, 1.0 / length(position))
        return height, climb * self._direction

    def _curvature(self, start: StepStart, climb: FloatArray) -> FloatArray:
        """Return the second derivative of the radius, m/s², for that of the height."""
        position, velocity, acceleration = start
        squares = velocity * velocity
        radial = dot(position, acceleration) + squares[0] + squares[1] + squares[2]
        return (radial - climb * climb) * (1.0 / length(position))
