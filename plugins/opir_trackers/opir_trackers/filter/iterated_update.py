"""How estimates take in the looks of a slice: together, by one QR decomposition a track, linearised anew.

The looks are linearised where the estimate stands, and again at each round's solution until that hardly moves them. All
modes go through their rounds together, for the lines of sight are the same.
"""

from collections.abc import Sequence
from math import hypot, inf
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import square_root
from opir_core.estimation.lines_of_sight import Planes, Sights, along
from opir_core.estimation.motion import followed, weights_at
from opir_trackers.filter.dynamics import Dynamics

#: Rounds of relinearisation stop once no look would move by more than this many standard deviations in another.
_SETTLED_SIGMAS = 1e-2


class Mode(NamedTuple):
    """The estimates (n,) of one mode: how it moves, means (n, d) and roots (n, d, d) of information."""

    motion: Dynamics
    mean: FloatArray
    root: FloatArray


class Updated(NamedTuple):
    """Means and roots of a mode after a slice, and the least sums of squares (n,) of prior and looks."""

    mean: FloatArray
    root: FloatArray
    left: FloatArray


def updated(modes: Sequence[Mode], time_s: float, sights: Sights, rounds: int) -> list[Updated]:
    """Return modes (k,) of the same tracks at a time after sights of all of them, in so many rounds at most."""
    slice_ = _Slice.of(sights, time_s, len(modes[0].mean))
    points = [mode.mean for mode in modes]
    for turn in range(rounds):
        residual, slope, range_m = slice_.planes.projected(slice_.positions(modes, points))
        after, steps = [], []
        for mode, point, off, gain in zip(modes, points, residual, slope, strict=True):
            stack = slice_.stacked(mode, point, off, gain)
            if turn:
                stack[:, : mode.mean.shape[1], -1] = along(mode.root, mode.mean - point)
            upper, step, left = square_root.least_squares(stack)
            steps.append(step)
            after.append(Updated(point + step, upper, left))
        points = [found.mean for found in after]
        if turn + 1 < rounds and slice_.bend(steps, range_m) < _SETTLED_SIGMAS:
            break
    return after


def gained(mode: Mode, after: Updated) -> FloatArray:
    """Return the log likelihoods (n,) of the looks that led from one to the other."""
    total: FloatArray = square_root.log_determinants(mode.root, after.root) - 0.5 * after.left
    return total


class _Slice(NamedTuple):
    """Sights (m,) of n tracks in a slice, the weights (m, 5) of their times, and where their rows are to stand.

    `planes` are those of the sights, `place` (m,) is each sight's place among those of its track, `depth` how many the
    track with most has.
    """

    sights: Sights
    planes: Planes
    tracks: int
    weight: FloatArray
    place: IntArray
    depth: int

    @classmethod
    def of(cls, sights: Sights, time_s: float, tracks: int) -> "_Slice":
        track, planes = sights.track, sights.whitened()
        weight = weights_at(sights.time_s - time_s)
        if tracks == 1:
            return cls(sights, planes, 1, weight, track, len(track))
        order = np.argsort(track, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(track, minlength=tracks))])
        place = np.empty(len(track), dtype=np.int64)
        place[order] = np.arange(len(track)) - starts[track[order]]
        return cls(sights, planes, tracks, weight, place, int(place.max(initial=-1)) + 1)

    def positions(self, modes: Sequence[Mode], points: list[FloatArray]) -> FloatArray:
        """Return where each mode's tracks are at the times of sights, (k, m, 3)."""
        paths = [mode.motion.taylor(point) for mode, point in zip(modes, points, strict=True)]
        if self.tracks == 1:
            return np.array([self.weight.dot(path[0]) for path in paths])
        return np.array([followed(path.take(self.sights.track, axis=0), self.weight) for path in paths])

    def stacked(self, mode: Mode, point: FloatArray, residual: FloatArray, slope: FloatArray) -> FloatArray:
        """Return a mode's roots above whitened rows [H | residual], (n, d + 2 depth, d + 1), padded with zeros."""
        size = point.shape[1]
        stack = np.zeros((self.tracks, size + 2 * self.depth, size + 1))
        stack[:, :size, :size] = mode.root
        if self.tracks == 1:
            rows = stack[0, size:].reshape(-1, 2, size + 1)
            rows[:, :, :size], rows[:, :, size] = mode.motion.seen(slope, self.weight, point), residual
            return stack
        track = self.sights.track
        rows = np.empty((len(track), 2, size + 1))
        rows[:, :, :size] = mode.motion.seen(slope, self.weight, point.take(track, axis=0))
        rows[:, :, size] = residual
        stack[:, size:].reshape(self.tracks, -1, 2, size + 1)[track, self.place] = rows
        return stack

    def bend(self, steps: list[FloatArray], range_m: FloatArray) -> float:
        """Return a bound, in standard deviations, on how far looks are off the straight lines of their linearisation.

        A point moved by a small angle across and along the ray is off by the square of the angle. `steps` (n, d) each
        are those of the modes, `range_m` (k, m) the distances of their looks.
        """
        if not self.depth:
            return 0.0
        span = float(np.maximum.reduce(np.abs(self.weight[:, 1])))
        reach, nearest = max([_reach_m(step, span) for step in steps]), float(np.minimum.reduce(range_m, axis=None))
        # A whitener's largest singular value is at most twice its largest element.
        sharp = 2.0 * float(np.maximum.reduce(np.abs(self.sights.whitener), axis=None))
        return (reach / nearest) ** 2 * sharp if nearest > 0.0 else inf


def _reach_m(step: FloatArray, span_s: float) -> float:
    """Return how far steps (n, d) in position and its derivatives move a track at most, so long before or after."""
    weights = (1.0, span_s, span_s**2 / 2.0, span_s**3 / 6.0)
    if len(step) == 1:
        numbers, reach = step[0].tolist(), 0.0
        for k in range(len(numbers) // 3):
            reach += weights[k] * hypot(*numbers[3 * k : 3 * k + 3])
        return reach
    blocks = step.shape[1] // 3
    parts = step[:, : 3 * blocks].reshape(len(step), blocks, 3)
    length = np.sqrt(np.add.reduce(parts * parts, axis=2))
    return float((length @ np.array(weights[:blocks])).max())
