"""Means with intervals over runs, and paired differences between designs."""

from typing import Any

import numpy as np

from opir_core.arrays import FloatArray

_LEVEL = 0.95


def interval(values: FloatArray) -> tuple[float, float, float]:
    """Return the mean of values (n,) and its 95 % interval by Student's t; nan does not count.

    The interval is nan for fewer than two values.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return np.nan, np.nan, np.nan
    mean = float(finite.mean())
    if len(finite) < 2:
        return mean, np.nan, np.nan
    from scipy.special import stdtrit  # lazily: reading a result needs no SciPy

    half = float(
        stdtrit(len(finite) - 1, 0.5 + 0.5 * _LEVEL) * finite.std(ddof=1) / np.sqrt(len(finite))
    )
    return mean, mean - half, mean + half


def share_with_value(values: FloatArray, shares: FloatArray | None = None) -> float:
    """Return the share of launches, or else of runs, that the mean of values (n,) of runs is over.

    `shares` (n,) are those of the launches of each run that have a value, nan for a run without a
    launch that the figure applies to. Without `shares` it is a share of runs. nan if no run counts.
    """
    if shares is None:
        shares = np.isfinite(values).astype(np.float64)
    applicable = shares[~np.isnan(shares)]
    return float(applicable.mean()) if len(applicable) else np.nan


def figures_of(values: FloatArray) -> dict[str, Any]:
    """Return count, mean, standard deviation, interval, median and the 10 and 90 % quantiles of
    values (n,).

    All but the count are of the runs that have a value: `share_with_value` belongs beside them.
    """
    finite = values[np.isfinite(values)]
    mean, low, high = interval(values)
    low_10, median, high_90 = (
        np.quantile(finite, [0.1, 0.5, 0.9]).tolist() if len(finite) else [np.nan] * 3
    )
    return {
        "runs_with_value": len(finite),
        "mean": mean,
        "low_95": low,
        "high_95": high,
        "sd": float(finite.std(ddof=1)) if len(finite) > 1 else np.nan,
        "q10": low_10,
        "median": median,
        "q90": high_90,
    }


def difference_of(values: FloatArray, reference: FloatArray) -> dict[str, float]:
    """Return the mean paired difference of values from a reference, of the same runs, with its 95 %
    interval.
    """
    count = min(len(values), len(reference))
    mean, low, high = interval(values[:count] - reference[:count])
    return {"difference": mean, "difference_low_95": low, "difference_high_95": high}
