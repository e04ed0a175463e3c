"""Approximate Bayesian computation with regression adjustment: what draws like one that is seen say
of what is hidden.

Draws are weighted by a normal kernel of their distance from what is seen, and what the kernel adds
to the noise is removed by linear regression (Beaumont, Zhang and Balding, Genetics 162, 2002).
"""

import numpy as np

from opir_core.arrays import FloatArray

#: Least effective number of draws under a kernel, and fewest that say anything: a regression on
#: eight numbers needs twice as many.
ENOUGH = 100.0
_FEWEST = 20.0

#: The first kernel, the factor from one to the next, and the widest.
_NARROW = 0.25
_WIDER = 1.3
_WIDEST = 10.0


def hidden_moments(
    seen: FloatArray,
    hidden: FloatArray,
    scale: FloatArray,
    noise: FloatArray,
    log_prior: FloatArray,
) -> tuple[FloatArray, FloatArray, float] | None:
    """Return mean (k,), covariance (k, k) and effective samples of what is hidden; None if too few
    draws are like it.

    `seen` (m, d) is by how much draws differ from what is seen with `noise` (d, d), `hidden` (m, k)
    what they say of the rest. The kernel is the narrowest multiple of `scale` (d,) under which
    enough draws count.
    """
    factor = _NARROW
    weight = _kernel_weights(seen, factor * scale, noise, log_prior)
    while 1.0 / np.sum(weight * weight) < ENOUGH and factor < _WIDEST:
        factor *= _WIDER
        weight = _kernel_weights(seen, factor * scale, noise, log_prior)
    if 1.0 / np.sum(weight * weight) < _FEWEST:
        return None
    return _regressed(seen, hidden, weight, _beyond_kernel(noise, factor * scale))


def _kernel_weights(
    seen: FloatArray, width: FloatArray, noise: FloatArray, log_prior: FloatArray
) -> FloatArray:
    """Return the weights (m,) of draws by their distances (m, d), with a kernel of widths (d,) and
    noise (d, d).
    """
    log = log_prior - 0.5 * squared_distances(seen, width, noise)
    weight: FloatArray = np.exp(log - log.max())
    return weight / weight.sum()


def squared_distances(seen: FloatArray, width: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the squared lengths (m,) of distances (m, d), in units of a kernel of widths (d,) and
    noise (d, d).
    """
    white = np.linalg.solve(np.linalg.cholesky(np.diag(width * width) + noise), seen.T)
    return np.asarray(np.sum(white * white, axis=0))


def _beyond_kernel(noise: FloatArray, width: FloatArray) -> FloatArray:
    """Return the covariance (d, d) of a look that is as informative as one with noise beside one
    with a kernel too.

    (N⁻¹ - (N + W)⁻¹)⁻¹ = N + N W⁻¹ N: draws weighted by the noise N and a kernel W lack just this
    look.
    """
    return noise + (noise / (width * width)) @ noise


def _regressed(
    seen: FloatArray, hidden: FloatArray, weight: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return the moments of what is hidden (m, k) after a look that sees nothing of what is seen
    (m, d), with noise.
    """
    samples = 1.0 / float(np.sum(weight * weight))
    mean_seen = weight @ seen
    mean = weight @ hidden
    apart = seen - mean_seen
    away = hidden - mean
    freed = samples / max(samples - 1.0 - seen.shape[1], 1.0)
    spread = (apart * weight[:, None]).T @ apart + noise
    gain = np.linalg.solve(spread, (apart * weight[:, None]).T @ away)
    left = away - apart @ gain
    covariance = freed * ((left * weight[:, None]).T @ left + gain.T @ noise @ gain)
    return mean - mean_seen @ gain, covariance, samples
