"""Iterated extended Kalman update with all looks of a slice: one QR decomposition per track and
iteration.

Each iteration linearises the measurements at the last solution, until the change is small. All
modes iterate together, because the lines of sight are the same.
"""

from collections.abc import Sequence
from math import hypot, inf
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_estimation.directions import matvec
from opir_estimation.filter.dynamics import Dynamics
from opir_estimation.filter.measurement_updates import least_squares, log_determinant_ratio
from opir_estimation.lines_of_sight import AngleMeasurements, TangentPlanes
from opir_estimation.motion import taylor_positions, taylor_weights

#: Iteration stops once no measurement would change by more than this many standard deviations.
_SETTLED_SIGMAS = 1e-2


class Mode(NamedTuple):
    """Estimates (n,) of one mode: motion model, means (n, d) and information roots (n, d, d)."""

    motion: Dynamics
    mean: FloatArray
    root: FloatArray


class Updated(NamedTuple):
    """Means and information roots of a mode after a slice, and the least sums of squares (n,) of
    prior and looks.
    """

    mean: FloatArray
    root: FloatArray
    misfit: FloatArray


def updated(
    modes: Sequence[Mode], time_s: float, measurements: AngleMeasurements, rounds: int
) -> list[Updated]:
    """Return modes (k,) of the same tracks at a time after measurements, with at most `rounds`
    iterations.
    """
    slice_ = _Slice.of(measurements, time_s, len(modes[0].mean))
    points = [mode.mean for mode in modes]
    for turn in range(rounds):
        residual, slope, range_m = slice_.planes.projected(slice_.positions(modes, points))
        updates = []
        steps = []
        for mode, point, off, gain in zip(modes, points, residual, slope, strict=True):
            stack = slice_.stacked(mode, point, off, gain)
            if turn:
                stack[:, : mode.mean.shape[1], -1] = matvec(mode.root, mode.mean - point)
            upper, step, misfit = least_squares(stack)
            steps.append(step)
            updates.append(Updated(point + step, upper, misfit))
        points = [result.mean for result in updates]
        if turn + 1 < rounds and slice_.bend(steps, range_m) < _SETTLED_SIGMAS:
            break
    return updates


def log_likelihoods(mode: Mode, update: Updated) -> FloatArray:
    """Return the log likelihoods (n,) of the measurements of an update."""
    return log_determinant_ratio(mode.root, update.root) - 0.5 * update.misfit


class _Slice(NamedTuple):
    """Measurements (m,) of n tracks in a slice, the Taylor weights (m, 5) of their times, and their
    rows in the stack.

    `planes` are their tangent planes, `place` (m,) the index of each among those of its track,
    `depth` the largest number of measurements of a track.
    """

    measurements: AngleMeasurements
    planes: TangentPlanes
    tracks: int
    weight: FloatArray
    place: IntArray
    depth: int

    @classmethod
    def of(cls, measurements: AngleMeasurements, time_s: float, tracks: int) -> "_Slice":
        track = measurements.track
        planes = measurements.whitened()
        weight = taylor_weights(measurements.time_s - time_s)
        if tracks == 1:
            return cls(measurements, planes, 1, weight, track, len(track))
        order = np.argsort(track, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(track, minlength=tracks))])
        place = np.empty(len(track), dtype=np.int64)
        place[order] = np.arange(len(track)) - starts[track[order]]
        return cls(measurements, planes, tracks, weight, place, int(place.max(initial=-1)) + 1)

    def positions(self, modes: Sequence[Mode], points: list[FloatArray]) -> FloatArray:
        """Return the positions (k, m, 3) of each mode's tracks at the times of the measurements."""
        paths = [mode.motion.taylor(point) for mode, point in zip(modes, points, strict=True)]
        if self.tracks == 1:
            return np.array([self.weight.dot(path[0]) for path in paths])
        return np.array(
            [
                taylor_positions(path.take(self.measurements.track, axis=0), self.weight)
                for path in paths
            ]
        )

    def stacked(
        self, mode: Mode, point: FloatArray, residual: FloatArray, slope: FloatArray
    ) -> FloatArray:
        """Return the information roots above whitened rows [H | residual], (n, d + 2 depth, d + 1),
        zero-padded.
        """
        size = point.shape[1]
        stack = np.zeros((self.tracks, size + 2 * self.depth, size + 1))
        stack[:, :size, :size] = mode.root
        if self.tracks == 1:
            rows = stack[0, size:].reshape(-1, 2, size + 1)
            rows[:, :, :size] = mode.motion.measurement_rows(slope, self.weight, point)
            rows[:, :, size] = residual
            return stack
        track = self.measurements.track
        rows = np.empty((len(track), 2, size + 1))
        rows[:, :, :size] = mode.motion.measurement_rows(
            slope, self.weight, point.take(track, axis=0)
        )
        rows[:, :, size] = residual
        stack[:, size:].reshape(self.tracks, -1, 2, size + 1)[track, self.place] = rows
        return stack

    def bend(self, steps: list[FloatArray], range_m: FloatArray) -> float:
        """Return a bound, in standard deviations, on the linearisation error of the measurements.

        A displacement of angle a across and along the line has an error of a². `steps` (n, d) are
        those of the modes, `range_m` (k, m) the ranges.
        """
        if not self.depth:
            return 0.0
        span = float(np.maximum.reduce(np.abs(self.weight[:, 1])))
        reach = max([_reach_m(step, span) for step in steps])
        nearest = float(np.minimum.reduce(range_m, axis=None))
        # A whitener's largest singular value is at most twice its largest element.
        sharp = 2.0 * float(np.maximum.reduce(np.abs(self.measurements.whitener), axis=None))
        return (reach / nearest) ** 2 * sharp if nearest > 0.0 else inf


def _reach_m(step: FloatArray, span_s: float) -> float:
    """Return the largest displacement of a track by steps (n, d) of position and derivatives,
    within a time span.
    """
    weights = (1.0, span_s, span_s**2 / 2.0, span_s**3 / 6.0)
    if step.shape[0] == 1:
        numbers = step[0].tolist()
        reach = 0.0
        for k in range(len(numbers) // 3):
            reach += weights[k] * hypot(*numbers[3 * k : 3 * k + 3])
        return reach
    blocks = step.shape[1] // 3
    vectors = step[:, : 3 * blocks].reshape(len(step), blocks, 3)
    length = np.sqrt(np.add.reduce(vectors * vectors, axis=2))
    return float((length @ np.array(weights[:blocks])).max())
