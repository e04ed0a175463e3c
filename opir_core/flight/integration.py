"""Integration of many arcs at once, each with its own adaptive steps.

Arcs are columns. All arithmetic is element by element, and finished arcs are removed from the
columns, so a result has the same bits alone and in any company. The arcs of a call are cut into
blocks that fit a cache.
"""

from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from attrs import define
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.altitude_events import AltitudeEvents, GroundContact, Seams
from opir_core.flight.atmosphere_density import air_layers
from opir_core.flight.conic_impact import ON_SURFACE_M
from opir_core.flight.dop853 import Acceleration, Step, StepStart, stepped
from opir_core.flight.forces import Forces
from opir_core.flight.gravity_and_drag import Gravity, GravityAndDrag, height_and_climb
from opir_core.flight.universal_anomaly import dot, length
from opir_core.geometry.vectors import floats


class IntegrationResult(IntEnum):
    """How an integration ended."""

    UNDER_WAY = 0
    REACHED_END = 1
    IMPACT = 2
    NOT_FINITE = 3
    BELOW_AIR = 4
    NOT_CONVERGED = 5


@define(eq=False, repr=False)
class ArcEnds:
    """Ends of arcs: states (3, n) at the elapsed times, and results (`IntegrationResult`)."""

    elapsed: FloatArray
    position: FloatArray
    velocity: FloatArray
    outcome: NDArray[np.int8]

    @classmethod
    def of(cls, count: int) -> "ArcEnds":
        """Return the ends of arcs under way."""
        elapsed, position, velocity = (
            np.full(shape, np.nan) for shape in ((count,), (3, count), (3, count))
        )
        return cls(elapsed, position, velocity, np.zeros(count, np.int8))


#: Called with every set of steps: numbers of the arcs, times and lengths of the steps, their
#: starts, the steps, which were accepted, and the acceleration, for dense output.
Recorder = Callable[
    [RowArray, FloatArray, FloatArray, StepStart, Step, BoolArray, Acceleration], None
]


class ArcColumns(NamedTuple):
    """The arcs of a call, flattened: `shape` is that of the broadcast leading axes."""

    shape: tuple[int, ...]
    position: FloatArray
    velocity: FloatArray
    duration: FloatArray
    tolerance: FloatArray
    ballistic_coefficient: FloatArray
    target: FloatArray

    def block(self, rows: slice) -> "ArcColumns":
        """Return some of the arcs, as copies."""
        position = self.position[:, rows].copy()
        velocity = self.velocity[:, rows].copy()
        return ArcColumns(
            self.shape, position, velocity, *(column[rows].copy() for column in self[3:])
        )


class BlockSystem:
    """The forces on the arcs of a block."""

    def __init__(self, forces: Forces, ballistic_coefficient: FloatArray) -> None:
        self.mu_m3_s2 = forces.gravity.mu_m3_s2
        self.has_air = forces.drag is not None
        self._gravity = Gravity(forces.gravity, forces.zonal)
        if forces.drag is not None:
            self._air = air_layers(forces.drag.atmosphere)
            self._rotation = forces.drag.air_rotation_rad_s
            self._log_half_inverse_beta = -np.log(2.0 * ballistic_coefficient)

    def acceleration(self, arcs: RowArray, layer: RowArray | None) -> Acceleration:
        """Return the right side for the arcs of these numbers, each in its layer of the air."""
        if not self.has_air or layer is None:
            return self._gravity
        parameters = np.take(self._air.parameters, layer, axis=1)
        return GravityAndDrag(
            self._gravity, parameters, self._log_half_inverse_beta[arcs], self._rotation
        )

    def levels(self, block: ArcColumns) -> AltitudeEvents | None:
        """Return the heights at which steps must end, or None without air and impact height."""
        if self.has_air:
            seams = Seams(self._air.floors_m, self._air.strides_m, self._air.stride_shares)
        elif np.any(block.target > -np.inf):
            # One layer without a floor, in which no change of height is a bound.
            seams = Seams(np.array([-1e9]), np.array([1e12]), np.zeros(1))
        else:
            return None
        return AltitudeEvents(seams, block.target, block.duration < 0.0)


class Integration:
    """Arcs under way: columns of states, and the step-size control of every arc."""

    def __init__(
        self,
        system: BlockSystem,
        states: tuple[FloatArray, FloatArray],
        duration: FloatArray,
        tolerance: FloatArray,
        levels: AltitudeEvents | None = None,
        recorder: Recorder | None = None,
    ) -> None:
        self._system = system
        self._levels = levels
        self._recorder = recorder
        self._position, self._velocity = states
        self._duration = duration
        # A looser tolerance, m, saves next to nothing at order 8, a tighter one is below
        # rounding.
        self._tolerance = np.clip(tolerance, 1e-8, 0.1)
        if system.has_air:
            # Ratio of estimated to true local errors, at worst, where drag changes fast.
            self._tolerance *= 0.5
        self._index = np.arange(duration.size)
        self._elapsed = np.zeros(duration.size)
        self._planned = np.full(duration.size, np.inf)
        self._ends = ArcEnds.of(duration.size)

    def ends(self) -> ArcEnds:
        """Return the ends of the arcs."""
        with np.errstate(all="ignore"):
            self._begin()
            for _ in range(200_000):
                if not self._index.size:
                    break
                self._attempt()
            self._drop(np.full(self._index.size, IntegrationResult.NOT_CONVERGED, np.int8))
        return self._ends

    def _begin(self) -> None:
        self._acceleration = self._system.acceleration(self._index, None)(
            self._position, self._velocity
        )
        landing = None if self._levels is None else self._levels.begin(self._state())
        self._acceleration = self._right_side()(self._position, self._velocity)
        radius = length(self._position)
        circular_speed = np.sqrt(self._system.mu_m3_s2 / radius)
        # The first step, in units of sqrt(r³/mu), at a tolerance of 1 m.
        self._natural = 0.25 * radius / circular_speed * _eighth_root(self._tolerance)
        # An error of velocity this small, relative to circular speed, is rounding, which no
        # shorter step would reduce.
        self._rounding = 4e-16 * circular_speed
        self._horizon = self._time_left()
        outcome = self._outcome(self._duration == 0.0, landing)
        finite = np.isfinite(self._duration) & np.isfinite(self._position + self._velocity).all(
            axis=0
        )
        outcome[~finite] = IntegrationResult.NOT_FINITE
        self._drop(outcome)

    def _attempt(self) -> None:
        """Try one step of every arc; accept those that are accurate enough and stay within their
        layer.
        """
        start = self._state()
        remaining_s = np.abs(self._duration - self._elapsed)
        longest = self._natural
        step_s = longest
        if self._levels is not None:
            longest, step_s = self._levels.lengths(longest)
        even = remaining_s / np.ceil(remaining_s / longest)
        step_s = np.minimum(np.minimum(step_s, even), self._planned)
        h = np.copysign(step_s, self._duration)
        right_side = self._right_side()
        step = stepped(right_side, start, h)
        ratio = step.velocity_error / self._allowed_error(step_s)
        accepted = ratio <= 1.0
        self._planned[:] = np.inf
        self._natural = step_s * np.fmax(np.minimum(0.9 / _eighth_root(ratio), 6.0), 0.2)
        np.copyto(
            self._natural, np.maximum(self._natural, longest), where=accepted & (step_s < longest)
        )
        if self._levels is not None:
            over, fraction = self._levels.shortened(start, step, h, accepted)
            accepted[over] = False
            self._planned[over] = step_s[over] * fraction
            self._natural[over] = longest[over]
        if self._recorder is not None:
            self._recorder(self._index, self._elapsed, h, start, step, accepted, right_side)
        self._accept(step, accepted, h, accepted & (step_s >= remaining_s))

    def _allowed_error(self, step_s: FloatArray) -> FloatArray:
        """Return the errors of velocity, m/s, that steps may add.

        A step may use a share of the tolerance equal to its length over that of the arc, or to 100
        s or a sixteenth of the arc if these are longer. An error of velocity grows for four steps
        at least.
        """
        share = np.maximum(step_s, np.minimum(self._horizon * (1.0 / 16.0), 100.0)) / self._horizon
        growth_s = np.maximum(self._time_left(), 4.0 * step_s)
        return np.maximum(self._tolerance * share / growth_s, self._rounding)

    def _accept(self, step: Step, accepted: BoolArray, h: FloatArray, at_end: BoolArray) -> None:
        np.copyto(self._position, step.position, where=accepted)
        np.copyto(self._velocity, step.velocity, where=accepted)
        np.copyto(self._acceleration, step.acceleration, where=accepted)
        np.copyto(self._elapsed, self._elapsed + h, where=accepted)
        np.copyto(self._elapsed, self._duration, where=at_end)
        landing = None if self._levels is None else self._levels.advance(self._state(), accepted)
        if landing is not None and self._system.has_air and landing.changed.any():
            changed = np.flatnonzero(landing.changed)
            right_side = self._right_side(changed)
            self._acceleration[:, changed] = right_side(
                self._position[:, changed], self._velocity[:, changed]
            )
        self._drop(self._outcome(at_end, landing))

    def _state(self) -> StepStart:
        return StepStart(self._position, self._velocity, self._acceleration)

    def _outcome(self, at_end: BoolArray, landing: GroundContact | None) -> NDArray[np.int8]:
        outcome = np.where(
            at_end, IntegrationResult.REACHED_END, IntegrationResult.UNDER_WAY
        ).astype(np.int8)
        stuck = ~(self._natural > 1e-14 * (1.0 + np.abs(self._elapsed))) | ~np.isfinite(
            self._acceleration[0]
        )
        outcome[stuck & ~at_end] = IntegrationResult.NOT_CONVERGED
        if landing is not None:
            outcome[landing.sunk] = IntegrationResult.BELOW_AIR
            outcome[landing.impact] = IntegrationResult.IMPACT
        return outcome

    def _drop(self, outcome: NDArray[np.int8]) -> None:
        """Record the ends of arcs that have an outcome, and keep the others."""
        done = np.flatnonzero(outcome)
        if not done.size:
            return
        arcs = self._index[done]
        self._ends.outcome[arcs] = outcome[done]
        self._write(done[outcome[done] == IntegrationResult.REACHED_END])
        self._write_impacts(done[outcome[done] == IntegrationResult.IMPACT])
        under_way = outcome == IntegrationResult.UNDER_WAY
        for name in ("_position", "_velocity", "_acceleration"):
            setattr(self, name, getattr(self, name)[:, under_way])
        for name in self._COLUMNS:
            setattr(self, name, getattr(self, name)[under_way])
        if self._levels is not None:
            self._levels.keep(under_way)

    _COLUMNS = (
        "_index",
        "_duration",
        "_tolerance",
        "_elapsed",
        "_planned",
        "_natural",
        "_horizon",
        "_rounding",
    )

    def _write(self, done: RowArray) -> None:
        arcs = self._index[done]
        self._ends.elapsed[arcs] = self._elapsed[done]
        self._ends.position[:, arcs] = self._position[:, done]
        self._ends.velocity[:, arcs] = self._velocity[:, done]

    def _write_impacts(self, done: RowArray) -> None:
        """Record the impacts of arcs that are next to the impact height, moved there along their
        parabolas.
        """
        if not done.size or self._levels is None:
            return
        position, velocity, acceleration = (
            rows[:, done] for rows in (self._position, self._velocity, self._acceleration)
        )
        time = self._levels.time_to_target(position, velocity, done)
        for _ in range(2):
            place = position + time * (velocity + 0.5 * time * acceleration)
            speed = velocity + time * acceleration
            time = time + self._levels.time_to_target(place, speed, done)
        arcs = self._index[done]
        self._ends.elapsed[arcs] = np.maximum(self._elapsed[done] + time, 0.0)
        self._ends.position[:, arcs] = position + time * (velocity + 0.5 * time * acceleration)
        self._ends.velocity[:, arcs] = velocity + time * acceleration

    def _time_left(self) -> FloatArray:
        """Return the time over which an error of velocity grows into one of position: to the end or
        the impact.
        """
        remaining = np.abs(self._duration - self._elapsed)
        if self._levels is None or not self._levels.has_target:
            return remaining
        fall = self._levels.fall_time(dot(self._position, self._position), self._system.mu_m3_s2)
        # An impact is displaced by up to 2.5 times an error of velocity times the time of fall,
        # which counts as 10 s at least.
        return np.minimum(remaining, 2.5 * np.maximum(fall, 10.0))

    def _right_side(self, rows: RowArray | None = None) -> Acceleration:
        layer = None if self._levels is None else self._levels.layer
        if rows is None:
            return self._system.acceleration(self._index, layer)
        return self._system.acceleration(self._index[rows], None if layer is None else layer[rows])


def _eighth_root(column: FloatArray) -> FloatArray:
    return np.sqrt(np.sqrt(np.sqrt(column)))


#: Arcs per block: few enough for the stages of a step to stay in a second-level cache.
_BLOCK = 1024


def columns_of(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    tolerance_m: ArrayLike,
    forces: Forces,
    height_m: ArrayLike = -np.inf,
) -> ArcColumns:
    """Return the arguments of a call, broadcast and flattened.

    `ValueError` where a state is not a vector of three, shapes do not fit or a tolerance is not
    positive.
    """
    vectors = [floats(vector) for vector in (position_m, velocity_m_s)]
    if any(vector.ndim == 0 or vector.shape[-1] != 3 for vector in vectors):
        raise ValueError(
            f"states need a last axis of 3, got shapes {vectors[0].shape} and {vectors[1].shape}"
        )
    beta = 1.0 if forces.drag is None else forces.drag.ballistic_coefficient_kg_m2
    scalars = [floats(scalar) for scalar in (duration_s, tolerance_m, beta, height_m)]
    if not bool(np.all(scalars[1] > 0.0)):
        raise ValueError("tolerance_m must be positive")
    shape = np.broadcast_shapes(
        *(vector.shape[:-1] for vector in vectors), *(scalar.shape for scalar in scalars)
    )
    position, velocity = (
        np.broadcast_to(vector, (*shape, 3)).reshape(-1, 3).T for vector in vectors
    )
    duration, tolerance, beta, height = (
        np.broadcast_to(scalar, shape).reshape(-1) for scalar in scalars
    )
    return ArcColumns(
        shape,
        position,
        velocity,
        np.where(np.isnan(height), np.nan, duration),
        tolerance,
        beta,
        height,
    )


def come_down(columns: ArcColumns) -> RowArray:
    """Return the rows of arcs that start below their height and descend."""
    with np.errstate(all="ignore"):
        inverse_radius = 1.0 / length(columns.position)
        height, climb = height_and_climb(columns.position, columns.velocity, inverse_radius)
    down = (height < columns.target - ON_SURFACE_M) & (climb < 0.0) & ~np.isnan(columns.duration)
    return down.nonzero()[0]


def integrations(
    columns: ArcColumns, forces: Forces, recorder: Recorder | None = None
) -> Iterator[tuple[slice, Integration]]:
    """Yield the blocks of the arcs, each with its integration."""
    for start in range(0, columns.duration.size, _BLOCK):
        rows = slice(start, start + _BLOCK)
        block = columns.block(rows)
        system = BlockSystem(forces, block.ballistic_coefficient)
        states = block.position, block.velocity
        yield (
            rows,
            Integration(
                system, states, block.duration, block.tolerance, system.levels(block), recorder
            ),
        )
