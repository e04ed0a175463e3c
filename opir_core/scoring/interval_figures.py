"""Figures of a scorecard as plain values, each with its 95 % interval."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.scoring.consistency import CONTAINMENTS, Consistency, containment, root_mean_square

_GROUND_FREEDOM = 2


def rms(error: FloatArray, cluster: IntArray | None = None) -> dict[str, Any]:
    """Return the root mean square of errors (n,); those of a cluster (n,) are not independent of each other."""
    value, lower, upper = root_mean_square(error, cluster)
    return {"value": value, "interval_95": [lower, upper]}


def over(figure: Mapping[str, Any], bound: float) -> dict[str, Any]:
    """Return a figure over a bound."""
    low, high = figure["interval_95"]
    return {"value": figure["value"] / bound, "interval_95": [low / bound, high / bound]}


def share(value: float, lower: float, upper: float) -> dict[str, Any]:
    """Return a share with its interval."""
    return {"value": value, "interval_95": [lower, upper]}


def mean(values: FloatArray, most: float = np.inf) -> dict[str, Any]:
    """Return the mean of what is known of independent values (n,) in [0, most], with Student's interval."""
    from scipy.stats import t

    values = values[np.isfinite(values)]
    if not len(values):
        return {"value": np.nan, "interval_95": [np.nan, np.nan]}
    centre, count = float(values.mean()), len(values)
    half = float(t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count)) if count > 1 else np.nan
    return {"value": centre, "interval_95": [max(centre - half, 0.0), min(centre + half, most)]}


def consistent(found: Consistency) -> dict[str, Any]:
    """Return an average NEES or NIS and its band over its degrees of freedom: 1 is honest."""
    return {
        "samples": found.samples,
        "mean": found.mean / found.freedom,
        "band_99": [found.lower / found.freedom, found.upper / found.freedom],
        "distribution_p": found.p_value,
    }


def contained(values: FloatArray) -> list[dict[str, Any]]:
    """Return the containment curve of NEES values (n,) on the ground: nominal shares, and those observed."""
    return [{"nominal": nominal, **share(*containment(values, _GROUND_FREEDOM, nominal))} for nominal in CONTAINMENTS]


def plain(value: Any) -> Any:
    """Return figures for JSON, where what is not known is null."""
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
