"""Normal numbers within bounds, by the inverse of the distribution, exact far out in the tails."""

import numpy as np

from opir_core.records import FloatArray


def truncated_normals(lower: FloatArray, upper: FloatArray, uniforms: FloatArray) -> FloatArray:
    """Return standard normal numbers (n,) conditional on lying in [lower, upper], from numbers (n,) in [0, 1).

    Bounds may be infinite and as far out as 1e100; where lower >= upper the lower bound is returned.
    """
    from scipy.special import log_ndtr, ndtri_exp

    is_high = lower > 0.0
    # Bounds above zero are mirrored, so that probabilities are those of lower tails, which have logarithms.
    low, high = np.where(is_high, -upper, lower), np.where(is_high, -lower, upper)
    log_high = log_ndtr(high)
    share = np.exp(np.minimum(log_ndtr(low) - log_high, 0.0))
    level = np.where(is_high, 1.0 - uniforms, uniforms)
    with np.errstate(divide="ignore"):
        drawn = ndtri_exp(log_high + np.log(level + (1.0 - level) * share))
    within = np.clip(np.where(is_high, -drawn, drawn), lower, np.maximum(lower, upper))
    return np.where(lower < upper, within, lower)
