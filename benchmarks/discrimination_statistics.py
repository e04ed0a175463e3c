"""The statistics of `discrimination.py`: areas under ROC curves, shares, and how sure their
differences are.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, binomtest, norm, rankdata

from opir_core.arrays import FloatArray


def placements(plume: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how often each plume scores above the others, and each other below the plumes; ties
    count half.
    """
    m = len(plume)
    n = len(other)
    together = rankdata(np.concatenate([plume, other]))
    return (together[:m] - rankdata(plume)) / n, 1.0 - (together[m:] - rankdata(other)) / m


def area(plume: FloatArray, other: FloatArray) -> tuple[float, float, float]:
    """Return the area under the ROC curve with DeLong's 95 % interval, which has hardly a width
    where little overlaps.

    The least area is at most that of Clopper and Pearson for the smaller number of objects, were
    all separated.
    """
    up, down = placements(plume, other)
    sigma = np.sqrt(up.var(ddof=1) / len(up) + down.var(ddof=1) / len(down))
    middle = float(up.mean())
    fewest = min(len(up), len(down))
    least = min(middle - 1.96 * sigma, interval(fewest, fewest)[0])
    return middle, max(least, 0.0), min(middle + 1.96 * sigma, 1.0)


def influences(plume: FloatArray, other: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return the area of those above -inf, and what each object, seen or not, adds to it to first
    order.
    """
    seen = np.isfinite(plume), np.isfinite(other)
    parts = placements(plume[seen[0]], other[seen[1]])
    middle = float(parts[0].mean())
    added = [np.zeros(len(plume)), np.zeros(len(other))]
    for column, own, part in zip(added, seen, parts, strict=True):
        column[own] = (part - middle) / own.mean()
    return middle, added[0], added[1]


def area_gain(
    worse: list[FloatArray], better: list[FloatArray], *, of_looks: bool
) -> tuple[float, float, float]:
    """Return how much larger an area is on the same objects, the standard deviation of that, and
    one-sided p.

    Both are scores of plumes and of others. Of looks, what is not seen scores below all; else it is
    left out.
    """
    lowest = -1e300 if of_looks else -np.inf
    found = [
        influences(*(np.maximum(part, lowest) for part in scores)) for scores in (worse, better)
    ]
    gain = found[1][0] - found[0][0]
    variances = [
        np.var(found[1][side] - found[0][side], ddof=1) / len(found[0][side]) for side in (1, 2)
    ]
    sigma = float(np.sqrt(sum(variances)))
    return gain, sigma, float(norm.sf(gain / sigma)) if sigma > 0.0 else 1.0


def type_gain(worse: NDArray[np.bool_], better: NDArray[np.bool_]) -> tuple[float, float]:
    """Return by how much a share of the same looks is larger, and one-sided p (McNemar, exact)."""
    more = int(np.sum(better & ~worse))
    less = int(np.sum(worse & ~better))
    p = binomtest(more, more + less, 0.5, alternative="greater").pvalue if more + less else 1.0
    return (more - less) / len(worse), float(p)


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Clopper and Pearson)."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, count - hits + 1))
    return low, 1.0 if hits == count else float(beta.ppf(0.975, hits + 1, count - hits))


def roc(plume: FloatArray, other: FloatArray, at: FloatArray) -> FloatArray:
    """Return the share of plumes called plumes at shares of others (n,), straight between ties."""
    levels = np.unique(np.concatenate([plume, other]))[::-1]
    shares = [
        np.append(0.0, [np.mean(part >= level) for level in levels]) for part in (other, plume)
    ]
    return np.interp(at, *shares)
