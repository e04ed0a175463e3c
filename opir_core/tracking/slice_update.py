"""How estimates take in the looks of a slice: together, by one QR decomposition a track, linearised anew.

The looks are linearised where the estimate stands, and again at each round's solution until that hardly moves them. All
modes go through their rounds together, for the lines of sight are the same.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from opir_core.records import FloatArray, IntArray
from opir_core.tracking import square_root
from opir_core.tracking.motion import Dynamics, followed, weights_at
from opir_core.tracking.rays import Sights, along

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
    weight = weights_at(sights.time_s - time_s)
    place, depth = _queued(sights.track, len(modes[0].mean))
    points = [mode.mean for mode in modes]
    for turn in range(rounds):
        position = _positions(modes, points, sights.track, weight)
        residual, slope, range_m = sights.projected(position)
        after, steps = [], []
        for (motion, mean, root), point, off, gain in zip(modes, points, residual, slope, strict=True):
            rows = _rows(motion, point, sights.track, off, gain, weight)
            owed = along(root, mean - point) if turn else np.zeros_like(mean)
            upper, step, left = square_root.updated(root, owed, _stacked(rows, sights.track, place, len(mean), depth))
            steps.append(step)
            after.append(Updated(point + step, upper, left))
        points = [found.mean for found in after]
        if turn + 1 < rounds and _bend(sights, steps, range_m, weight) < _SETTLED_SIGMAS:
            break
    return after


def gained(mode: Mode, after: Updated) -> FloatArray:
    """Return the log likelihoods (n,) of the looks that led from one to the other."""
    log = square_root.log_determinant(mode.root) - square_root.log_determinant(after.root)
    total: FloatArray = log - 0.5 * after.left
    return total


def _positions(modes: Sequence[Mode], points: list[FloatArray], track: IntArray, weight: FloatArray) -> FloatArray:
    """Return where each mode's tracks are at the times of sights, (k, m, 3)."""
    path = np.array([mode.motion.taylor(point) for mode, point in zip(modes, points, strict=True)])
    if path.shape[1] == 1:
        lone: FloatArray = weight @ path[:, 0]
        return lone
    return followed(path.take(track, axis=1), weight)


def _queued(track: IntArray, count: int) -> tuple[IntArray, int]:
    """Return each sight's place among those of its track, and how many the track with most has."""
    if count == 1:
        return track, len(track)
    order = np.argsort(track, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(track, minlength=count))])
    place = np.empty(len(track), dtype=np.int64)
    place[order] = np.arange(len(track)) - starts[track[order]]
    return place, int(place.max(initial=-1)) + 1


def _rows(
    motion: Dynamics, point: FloatArray, track: IntArray, residual: FloatArray, slope: FloatArray, weight: FloatArray
) -> FloatArray:
    """Return whitened rows [H | residual] of sights, (m, 2, d + 1)."""
    full = np.empty((*residual.shape, point.shape[1] + 1))
    full[:, :, :-1] = motion.seen(slope, weight, point if len(point) == 1 else point.take(track, axis=0))
    full[:, :, -1] = residual
    return full


def _stacked(full: FloatArray, track: IntArray, place: IntArray, count: int, depth: int) -> FloatArray:
    """Return rows (m, 2, w) of sights below each other, track by track, (n, 2 depth, w), padded with zeros."""
    width = full.shape[2]
    if count == 1:
        return full.reshape(1, 2 * depth, width)
    rows = np.zeros((count, depth, 2, width))
    rows[track, place] = full
    return rows.reshape(count, 2 * depth, width)


def _bend(sights: Sights, steps: list[FloatArray], range_m: FloatArray, weight: FloatArray) -> float:
    """Return a bound, in standard deviations, on how far looks are off the straight lines of their linearisation.

    A point moved by a small angle across and along the ray is off by the square of the angle. `steps` (n, d) each are
    those of the modes.
    """
    if not len(range_m[0]):
        return 0.0
    furthest = np.abs(weight).max(axis=0)
    reach = max(_reach_m(step, furthest) for step in steps)
    nearest = float(range_m.min())
    sharp = np.square(sights.whitener).reshape(len(sights), 4).sum(axis=1).max()
    return float((reach / nearest) ** 2 * np.sqrt(sharp)) if nearest > 0.0 else float("inf")


def _reach_m(step: FloatArray, furthest: FloatArray) -> float:
    """Return how far steps (n, d) in position and its derivatives move a track at most, with weights of a time."""
    blocks = step.shape[1] // 3
    parts = step[:, : 3 * blocks].reshape(len(step), blocks, 3)
    length = np.sqrt(np.add.reduce(parts * parts, axis=2))
    return float((length @ furthest[:blocks]).max())
