"""What is known of lines of sight: pairs with their looks, light times, and visibility by the second."""

from enum import IntEnum

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.records import BoolArray, Columns, FloatArray, IndexArray, IntArray

#: Step of the grid on which geometry is sampled, s.
GRID_STEP_S = 1.0


class Blocked(IntEnum):
    """Why a pair has no looks."""

    NOT = 0
    NO_LOOK = 1
    BEHIND_EARTH = 2
    OUTSIDE_FIELD_OF_REGARD = 3
    BELOW_MINIMUM_ELEVATION = 4


class Sight(IntEnum):
    """Whether looks in a cell of the grid see their target."""

    NEVER = 0
    ALWAYS = 1
    PERHAPS = 2


@frozen(eq=False)
class Sightlines:
    """What is known of pairs' lines of sight on the grid: light times at its points, visibility in its cells.

    Light times are linear between points and right to 5e-8 s, in which a target moves 0.4 mm; they are zero where the
    scene switches light time off. A pair's points are `first_point` + its grid step; a cell bears the number of the
    point it starts at.
    """

    first_point: IntArray
    travel_s: FloatArray
    sight: NDArray[np.uint8]

    def light_time_s(self, pair: IntArray, time_s: FloatArray) -> FloatArray:
        """Return the travel time of the light that pairs (n,) receive at times (n,)."""
        step = np.floor(time_s / GRID_STEP_S)
        point = self.first_point[pair] + step.astype(np.int64)
        early, late = self.travel_s[point], self.travel_s[point + 1]
        travel_s: FloatArray = early + (late - early) * (time_s / GRID_STEP_S - step)
        return travel_s

    def sight_at(self, pair: IntArray, time_s: FloatArray) -> NDArray[np.uint8]:
        """Return the `Sight` of looks of pairs (n,) at times (n,)."""
        return self.sight[self.first_point[pair] + np.floor(time_s / GRID_STEP_S).astype(np.int64)]


@frozen(eq=False)
class Pairs(Columns):
    """Sensor-target pairs, sorted by sensor, then target; one row a pair.

    Scans `first_scan` to `last_scan` (both included, none where first > last) look at the burning target at
    phase_ns + scan · period_ns; where `is_checked`, each look is still to be tested for visibility.
    """

    sensor: IndexArray
    target: IndexArray
    period_ns: IntArray
    phase_ns: IntArray
    first_scan: IntArray
    last_scan: IntArray
    is_checked: BoolArray
    blocked: IntArray

    @property
    def looks(self) -> IntArray:
        """Return how many looks each pair has."""
        count: IntArray = np.maximum(self.last_scan - self.first_scan + 1, 0)
        return count

    def is_over(self, time_ns: int) -> BoolArray:
        """Return which pairs have no look at or after a moment of scene time."""
        over: BoolArray = self.phase_ns + self.last_scan * self.period_ns < time_ns
        return over
