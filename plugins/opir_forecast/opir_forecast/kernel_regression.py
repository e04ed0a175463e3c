"""Approximate Bayesian computation with regression adjustment: hidden variables, by draws whose
other variables are like the measured ones.

Draws are weighted by a normal kernel of their distance from the measurement, and the variance that
the kernel adds to the noise is removed by linear regression (Beaumont, Zhang and Balding, Genetics
162, 2002).
"""

import numpy as np
from opir_estimation import law_parameters

from opir_core.arrays import FloatArray

LAW = law_parameters("opir_forecast", "matching")


def hidden_moments(
    difference: FloatArray,
    hidden: FloatArray,
    scale: FloatArray,
    noise: FloatArray,
    log_prior: FloatArray,
    law_errs: bool = False,
) -> tuple[FloatArray, FloatArray, float] | None:
    """Return mean (k,), covariance (k, k) and effective samples of the hidden variables; None if
    too few draws are like the measurement.

    `difference` (m, d) of draws is that from a measurement with `noise` (d, d), `hidden` (m, k) are
    their hidden variables. The kernel is the narrowest multiple of `scale` (d,) under which enough
    draws count. If `law_errs`, the law is wrong by as much as the kernel had to be widened: that is
    noise of the look, and no variance to remove by regression (Wilkinson, Stat. Appl. Genet. Mol.
    Biol. 12, 2013).
    """
    factor = LAW.narrow
    weight = _kernel_weights(difference, factor * scale, noise, log_prior)
    while 1.0 / np.sum(weight * weight) < LAW.enough and factor < LAW.widest:
        factor *= LAW.wider
        weight = _kernel_weights(difference, factor * scale, noise, log_prior)
    if 1.0 / np.sum(weight * weight) < LAW.fewest:
        return None
    kernel = (factor * scale) ** 2
    if law_errs:
        kernel = (LAW.narrow * scale) ** 2
        noise = noise + np.diag((factor * scale) ** 2 - kernel)
    # Draws weighted by the noise N and a kernel W lack just a look with the covariance
    # (N⁻¹ - (N + W)⁻¹)⁻¹ = N + N W⁻¹ N.
    return _regressed(difference, hidden, weight, noise + (noise / kernel) @ noise)


def _kernel_weights(
    difference: FloatArray, width: FloatArray, noise: FloatArray, log_prior: FloatArray
) -> FloatArray:
    """Return the weights (m,) of draws by their differences (m, d), with a kernel of widths (d,)
    and noise (d, d).
    """
    log = log_prior - 0.5 * squared_distances(difference, width, noise)
    weight = np.exp(log - log.max())
    return weight / weight.sum()


def squared_distances(difference: FloatArray, width: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the squared lengths (m,) of differences (m, d), in units of a kernel of widths (d,)
    and noise (d, d).
    """
    white = np.linalg.solve(np.linalg.cholesky(np.diag(width * width) + noise), difference.T)
    return np.sum(white * white, axis=0)


def _regressed(
    difference: FloatArray, hidden: FloatArray, weight: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return the moments of hidden variables (m, k) after a look, with noise, that shows no
    difference (m, d).
    """
    samples = 1.0 / float(np.sum(weight * weight))
    mean_difference = weight @ difference
    mean = weight @ hidden
    centred = difference - mean_difference
    deviation = hidden - mean
    weighted = (centred * weight[:, None]).T
    gain = np.linalg.solve(weighted @ centred + noise, weighted @ deviation)
    residual = deviation - centred @ gain
    freed = samples / max(samples - 1.0 - difference.shape[1], 1.0)
    covariance = freed * ((residual * weight[:, None]).T @ residual + gain.T @ noise @ gain)
    return mean - mean_difference @ gain, covariance, samples
