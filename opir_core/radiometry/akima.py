"""Akima's interpolation: a smooth curve through points that does not swing where they bend sharply."""

import numpy as np

from opir_core.arrays import FloatArray


def akima(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Return the curves through points, values (n, m) at rising x (n,), at places (k,) within them: (k, m).

    Source: H. Akima, Journal of the ACM 17 (1970), 589-602: cubics whose slope at a point is the mean of the slopes
    beside it, each weighted with how much the slopes bend on the other side; the slopes beyond the ends continue those
    within. Where nothing bends the plain mean is taken.
    """
    rise = np.diff(y, axis=0) / np.diff(x)[:, None]
    before = [2.0 * rise[0] - rise[1]]
    before.insert(0, 2.0 * before[0] - rise[0])
    after = [2.0 * rise[-1] - rise[-2]]
    after.append(2.0 * after[0] - rise[-1])
    slopes = np.vstack([*before, rise, *after])
    bend = np.abs(np.diff(slopes, axis=0))
    left, right = bend[2:], bend[:-2]
    total = left + right
    is_straight = total <= 1e-9 * np.abs(bend).max()
    weighted = (left * slopes[1:-2] + right * slopes[2:-1]) / np.where(is_straight, 1.0, total)
    slope = np.where(is_straight, 0.5 * (slopes[1:-2] + slopes[2:-1]), weighted)
    return _hermite(x, y, slope, at)


def _hermite(x: FloatArray, y: FloatArray, slope: FloatArray, at: FloatArray) -> FloatArray:
    """Return cubics by their values and slopes at points."""
    place = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    width = (x[place + 1] - x[place])[:, None]
    t = ((at - x[place])[:, None]) / width
    level: FloatArray = y[place] * (1.0 + 2.0 * t) * (1.0 - t) ** 2 + y[place + 1] * t * t * (3.0 - 2.0 * t)
    return level + width * t * (1.0 - t) * (slope[place] * (1.0 - t) - slope[place + 1] * t)
