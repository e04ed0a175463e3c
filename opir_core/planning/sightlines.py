"""Lines of sight: pairs of sensor and target with their looks, light times and visibility on a grid
of scene time.
"""

from enum import IntEnum
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_core.planning.targets import Targets

#: Step of the grid on which geometry is sampled, s: the whole seconds of scene time.
GRID_STEP_S = 1.0


class Blocked(IntEnum):
    """Why a pair has no looks."""

    NOT = 0
    NO_LOOK = 1
    BEHIND_EARTH = 2
    OUTSIDE_FIELD_OF_REGARD = 3
    BELOW_MINIMUM_ELEVATION = 4
    NEAR_THE_SUN = 5


class Visibility(IntEnum):
    """Whether the target is visible to looks in a cell of the grid."""

    NEVER = 0
    ALWAYS = 1
    UNCERTAIN = 2


@frozen(eq=False, repr=False)
class GridPlace:
    """Positions of looks on the grid: the point before each, and the fraction of the step since
    then.
    """

    point: IntArray
    fraction: FloatArray

    def interpolated(self, values: FloatArray) -> FloatArray:
        """Return values at the looks, interpolated linearly between the points."""
        start = values[self.point]
        return start + (values[self.point + 1] - start) * self.fraction


@frozen(eq=False, repr=False)
class Sightlines:
    """Lines of sight of all pairs: light times and elevations at the grid's points, `Visibility` in
    its cells.

    Interpolated linearly, light times are accurate to 5e-8 s, in which a target moves 0.4 mm, and
    the sines of the sensor's elevation above the target's horizon to 3e-6 (3e-5 from a low orbit).
    Light times are zero if the scene switches them off. A pair's points are `first_point` + its
    grid step, over the time of its looks; a cell has the number of its first point.
    """

    first_point: IntArray
    travel_s: FloatArray
    elevation_sine: FloatArray
    sight: ByteArray

    def place(self, pair: IntArray, time_s: FloatArray) -> GridPlace:
        """Return the grid positions of the looks of pairs (n,) at times (n,)."""
        step = np.floor(time_s)
        return GridPlace(self.first_point[pair] + step.astype(np.int64), time_s - step)

    def over_looks(self, pairs: "Pairs", rows: IntArray) -> "Sightlines":
        """Return the lines of sight of some pairs, given with their rows, over the time of possible
        looks only.
        """
        first_step = pairs.from_ns // 1_000_000_000
        points = np.where(
            pairs.to_ns > pairs.from_ns, pairs.to_ns // 1_000_000_000 - first_step + 2, 0
        )
        offset = np.cumsum(points) - points
        points_read = np.arange(int(points.sum())) + np.repeat(
            self.first_point[rows] + first_step - offset, points
        )
        # A time that is rounded up to a whole second has one point more than the grid; its weight
        # is 0.
        points_read = np.minimum(points_read, len(self.travel_s) - 1)
        return Sightlines(
            offset - first_step,
            self.travel_s[points_read],
            self.elevation_sine[points_read],
            self.sight[points_read],
        )

    @classmethod
    def joined(cls, sightlines: "list[Sightlines]") -> "Sightlines":
        """Return the lines of sight of all parts, in order; the list is emptied, so that no column
        is twice in memory but the one that is joined."""
        starts = np.cumsum([0, *(len(piece.travel_s) for piece in sightlines)])[:-1]
        columns: dict[str, list[NDArray[Any]]] = {
            "first_point": [
                piece.first_point + start for piece, start in zip(sightlines, starts, strict=True)
            ],
            "travel_s": [piece.travel_s for piece in sightlines],
            "elevation_sine": [piece.elevation_sine for piece in sightlines],
            "sight": [piece.sight for piece in sightlines],
        }
        sightlines.clear()
        empty = {"first_point": np.empty(0, np.int64), "sight": np.empty(0, np.uint8)}
        return cls(
            **{
                name: np.concatenate([*columns.pop(name), empty.get(name, np.empty(0))])
                for name in list(columns)
            }
        )


@frozen(eq=False, repr=False)
class Pairs(Columns):
    """Sensor-target pairs, sorted by sensor, then target; one row per pair.

    Looks are possible after `from_ns`, at most at `to_ns`, whatever the phase. Scans `first_scan`
    to `last_scan` (both included, none if first > last) look at the target at phase_ns + scan ·
    period_ns; if `is_checked`, single looks need a visibility test. Light emitted after `until_s`,
    the target's burnout or end of flight, is not observed.
    """

    sensor: IndexArray
    target: IndexArray
    period_ns: IntArray
    phase_ns: IntArray
    first_scan: IntArray
    last_scan: IntArray
    is_checked: BoolArray
    blocked: IntArray
    until_s: FloatArray
    from_ns: IntArray
    to_ns: IntArray

    @property
    def looks(self) -> IntArray:
        """Number of looks of each pair."""
        return np.maximum(self.last_scan - self.first_scan + 1, 0)

    def is_over(self, time_ns: int) -> BoolArray:
        """Return which pairs have no look at or after a scene time."""
        return self.phase_ns + self.last_scan * self.period_ns < time_ns


#: Step of the velocities at the ends of a flight, s.
_END_STEP_S = 0.05

#: Each iteration reduces the error by speed / c < 3e-5: three leave less than a nanosecond.
LIGHT_TIME_ITERATIONS = 3


@frozen(eq=False, repr=False)
class Grid:
    """Whole steps of scene time that enclose each target's observed time, end to end; cells lie
    between points.
    """

    first_step: IntArray
    points: IntArray
    first_point: IntArray
    pair: IntArray
    time_s: FloatArray

    @classmethod
    def over(cls, start_s: FloatArray, stop_s: FloatArray) -> "Grid":
        """Return the grid that encloses start to stop (n,) of each of n pairs."""
        first_step = np.floor(start_s / GRID_STEP_S).astype(np.int64)
        points = np.floor(stop_s / GRID_STEP_S).astype(np.int64) - first_step + 2
        offset = np.cumsum(points) - points
        pair = np.repeat(np.arange(len(points)), points)
        step = np.arange(len(pair)) - offset[pair] + first_step[pair]
        return cls(first_step, points, offset - first_step, pair, step * GRID_STEP_S)

    def cells(self) -> IntArray:
        """Return the points at which a cell starts: all but the last of each pair."""
        return np.flatnonzero(self.pair[1:] == self.pair[:-1])

    def any_of_pair(self, cells: IntArray) -> BoolArray:
        """Return which pairs have at least one of the cells."""
        return np.bincount(self.pair[cells], minlength=len(self.points)) > 0

    def span(
        self, cells: IntArray, start_s: FloatArray, stop_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return each pair's start and stop, limited to the first and last of the given cells."""
        first_s = np.full(len(self.points), np.inf)
        last_s = np.full(len(self.points), -np.inf)
        np.minimum.at(first_s, self.pair[cells], self.time_s[cells])
        np.maximum.at(last_s, self.pair[cells], self.time_s[cells] + GRID_STEP_S)
        return np.maximum(start_s, first_s), np.minimum(stop_s, last_s)


@frozen(eq=False, repr=False)
class TargetPath:
    """Paths of the targets (n,) of pairs, each observed up to its end (n,), extended at constant
    velocity before and after the observed time, so that the grid's outer cells are smooth."""

    targets: Targets
    target: IndexArray
    end_s: FloatArray
    velocity_in_m_s: FloatArray
    velocity_out_m_s: FloatArray

    @classmethod
    def of(cls, targets: Targets, target: IndexArray, end_s: FloatArray) -> "TargetPath":
        """Return the paths of targets (n,) to their ends (n,)."""
        start_s = targets.ignition_s[target]
        short_s = np.minimum(_END_STEP_S, end_s - start_s)
        next_s = np.minimum(start_s + short_s, end_s)
        previous_s = np.maximum(end_s - short_s, start_s)
        moved_in = targets.position_ecef_m(target, next_s) - targets.position_ecef_m(
            target, start_s
        )
        moved_out = targets.position_ecef_m(target, end_s) - targets.position_ecef_m(
            target, previous_s
        )
        return cls(
            targets,
            target,
            end_s,
            moved_in / _step_s(start_s, next_s),
            moved_out / _step_s(previous_s, end_s),
        )

    def take(self, rows: IntArray) -> "TargetPath":
        """Return the paths of some pairs."""
        velocities = self.velocity_in_m_s[rows], self.velocity_out_m_s[rows]
        return TargetPath(self.targets, self.target[rows], self.end_s[rows], *velocities)

    def position_ecef_m(self, pair: IntArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of the targets of pairs (m,) at any times (m,)."""
        target = self.target[pair]
        start_s = self.targets.ignition_s[target]
        end_s = self.end_s[pair]
        within_s = np.minimum(np.maximum(time_s, start_s), end_s)
        position = self.targets.position_ecef_m(target, within_s)
        # Only the outer cells of a pair reach beyond the observed time.
        beyond = np.flatnonzero(time_s != within_s)
        if beyond.size:
            pairs_beyond = pair[beyond]
            over_s = (time_s[beyond] - within_s[beyond])[:, None]
            velocity = np.where(
                over_s < 0.0,
                self.velocity_in_m_s[pairs_beyond],
                self.velocity_out_m_s[pairs_beyond],
            )
            position = position.copy()  # it may be a trajectory's own
            position[beyond] += velocity * over_s
        return position


def _step_s(start_s: FloatArray, stop_s: FloatArray) -> FloatArray:
    """Return steps (n, 1), s; infinite if there is none (ignition at the end of the scene), so that
    velocity is 0.
    """
    step_s = stop_s - start_s
    return np.where(step_s > 0.0, step_s, np.inf)[:, None]


def distance_m(one_m: FloatArray, other_m: FloatArray) -> FloatArray:
    """Return the distances (n,) between positions (n, 3)."""
    x, y, z = (one_m[:, axis] - other_m[:, axis] for axis in range(3))
    return np.sqrt(x * x + y * y + z * z)
