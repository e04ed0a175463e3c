"""What is known of lines of sight: pairs with their looks, light times, and visibility by the second."""

from enum import IntEnum

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.columns import Columns

#: Step of the grid on which geometry is sampled, s: the whole seconds of scene time.
GRID_STEP_S = 1.0


class Blocked(IntEnum):
    """Why a pair has no looks."""

    NOT = 0
    NO_LOOK = 1
    BEHIND_EARTH = 2
    OUTSIDE_FIELD_OF_REGARD = 3
    BELOW_MINIMUM_ELEVATION = 4


class Visibility(IntEnum):
    """Whether looks in a cell of the grid see their target."""

    NEVER = 0
    ALWAYS = 1
    PERHAPS = 2


@frozen(eq=False)
class GridPlace:
    """Where looks fall on the grid: the point before each, and the fraction of the step from there."""

    point: IntArray
    fraction: FloatArray

    def interpolated(self, values: FloatArray) -> FloatArray:
        """Return values at the looks, linear between those at the points."""
        early = values[self.point]
        between: FloatArray = early + (values[self.point + 1] - early) * self.fraction
        return between


@frozen(eq=False)
class Sightlines:
    """What is known of pairs' lines of sight on the grid: light times and elevations at its points, sight in its cells.

    Linear between points, light times are right to 5e-8 s, in which a target moves 0.4 mm, and the sines of the
    sensor's elevation above the target's horizon to 3e-6 (3e-5 from a low orbit). Light times are zero where the scene
    switches them off. A pair's points are `first_point` + its grid step; a cell bears the number of its first point.
    """

    first_point: IntArray
    travel_s: FloatArray
    elevation_sine: FloatArray
    sight: NDArray[np.uint8]

    def place(self, pair: IntArray, time_s: FloatArray) -> GridPlace:
        """Return where the looks of pairs (n,) at times (n,) fall on the grid."""
        step = np.floor(time_s)
        return GridPlace(self.first_point[pair] + step.astype(np.int64), time_s - step)


@frozen(eq=False)
class Pairs(Columns):
    """Sensor-target pairs, sorted by sensor, then target; one row a pair.

    Scans `first_scan` to `last_scan` (both included, none where first > last) look at the target at
    phase_ns + scan · period_ns; where `is_checked`, each look is still to be tested for visibility. Light that left the
    target after `until_s`, its burnout or its flight's end, is not looked at.
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

    @property
    def looks(self) -> IntArray:
        """Return how many looks each pair has."""
        count: IntArray = np.maximum(self.last_scan - self.first_scan + 1, 0)
        return count

    def is_over(self, time_ns: int) -> BoolArray:
        """Return which pairs have no look at or after a moment of scene time."""
        over: BoolArray = self.phase_ns + self.last_scan * self.period_ns < time_ns
        return over
