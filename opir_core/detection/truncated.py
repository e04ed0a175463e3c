"""Normal numbers within bounds, by the inverse of the distribution, exact far out in the tails."""

import numpy as np

from opir_core.arrays import FloatArray

#: Up to there a normal tail is a double with all its bits.
_PLAIN = 36.0
_LEAST_LEVEL = 2.0**-54


def tail_normals(lower: FloatArray, uniforms: FloatArray) -> FloatArray:
    """Return standard normal numbers (n,) conditional on being at least `lower`, from numbers (n,) in [0, 1).

    The same law as of `truncated_normals` without an upper bound, for a third of the time.
    """
    from scipy.special import ndtr, ndtri

    drawn: FloatArray = np.maximum(-ndtri(np.maximum(uniforms, _LEAST_LEVEL) * ndtr(-lower)), lower)
    far = np.flatnonzero(lower > _PLAIN)
    if len(far):
        drawn[far] = truncated_normals(lower[far], np.full(len(far), np.inf), uniforms[far])
    return drawn


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
