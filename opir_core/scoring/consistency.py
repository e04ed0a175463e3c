"""Whether errors are what the covariances say: NEES, its bands and its distribution, and containment."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.records import TOLD_CONTAINMENTS

#: Nominal containments of a containment curve.
CONTAINMENTS = (0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99)


@frozen
class Consistency:
    """The average NEES of samples, its χ² band, and the p-value that the samples are χ² distributed."""

    samples: int
    freedom: int
    mean: float
    lower: float
    upper: float
    p_value: float

    @property
    def is_inside(self) -> bool:
        """Return whether the average lies in its band."""
        return self.lower <= self.mean <= self.upper


def nees(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return normalised estimation errors squared (n,) of errors (n, d) with covariances (n, d, d).

    nan where an error or a covariance is unknown, inf where the covariance is not positive definite.
    """
    known = np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    value = np.full(len(error), np.nan)
    variance: FloatArray = np.diagonal(covariance, axis1=1, axis2=2)
    value[known & (variance <= 0.0).any(axis=1)] = np.inf
    rows = np.flatnonzero(known & ~np.isinf(value))
    # Scaled to unit variances, so that metres and metres per second do not spoil the factorisation.
    scale = np.sqrt(np.abs(np.diagonal(covariance[rows], axis1=1, axis2=2)))
    correlation = covariance[rows] / (scale[:, :, None] * scale[:, None, :])
    definite = np.linalg.eigvalsh(correlation).min(axis=1, initial=np.inf) > 0.0
    value[rows[~definite]] = np.inf
    whitened = (error[rows] / scale)[definite]
    solved = np.linalg.solve(correlation[definite], whitened[:, :, None])[:, :, 0]
    value[rows[definite]] = np.sum(whitened * solved, axis=1)
    return value


def consistency(values: FloatArray, freedom: int, probability: float = 0.99) -> Consistency:
    """Return the average of independent NEES values (n,), its band, and a test of their distribution.

    The average of n values of `freedom` degrees is χ² of n · freedom degrees, over n (Bar-Shalom, Li and Kirubarajan,
    Estimation with Applications to Tracking and Navigation, section 5.4.2). The distribution test is that of
    Kolmogorov and Smirnov: a mean can be right while single values are not.
    """
    from scipy.stats import chi2, kstest

    values = values[~np.isnan(values)]
    if not len(values):
        return Consistency(0, freedom, np.nan, np.nan, np.nan, np.nan)
    degrees = len(values) * freedom
    lower, upper = (float(chi2.ppf(p, degrees)) / len(values) for p in ((1 - probability) / 2, (1 + probability) / 2))
    p_value = float(kstest(values, chi2(freedom).cdf).pvalue)
    return Consistency(len(values), freedom, float(values.mean()), lower, upper, p_value)


def containment(values: FloatArray, freedom: int, nominal: float) -> tuple[float, float, float]:
    """Return the share of NEES values within the ellipse of a nominal containment, and its 95 % interval (Wilson)."""
    from scipy.stats import chi2

    values = values[~np.isnan(values)]
    return proportion(int(np.count_nonzero(values <= chi2.ppf(nominal, freedom))), len(values))


def on_normal_scale(values: FloatArray, told_sigmas: FloatArray, freedom: int = 2) -> FloatArray:
    """Return NEES values (n,) of points on the ground, or of other freedom, as if these were normally distributed.

    `told_sigmas` (n, 3) are the radii of ellipses told of `TOLD_CONTAINMENTS`, nan of a normal distribution. An error
    on one of these ellipses comes to the χ² quantile of its containment; between them the scale is linear, and beyond
    the largest it goes on in proportion. So `containment` and `consistency` judge the ellipses that are told.
    """
    from scipy.stats import chi2

    usual = np.sqrt(chi2.ppf(TOLD_CONTAINMENTS, freedom))
    is_told = np.asarray(np.isfinite(told_sigmas).all(axis=1))
    told = np.where(is_told[:, None], told_sigmas, usual)
    at = np.column_stack([np.zeros(len(told)), told])
    to = np.append(0.0, usual)
    distance = np.sqrt(values)
    part = np.minimum(np.sum(distance[:, None] > told, axis=1), len(usual) - 1)
    row = np.arange(len(told))
    slope = (to[part + 1] - to[part]) / (at[row, part + 1] - at[row, part])
    within = to[part] + (distance - at[row, part]) * slope
    beyond = distance * (to[-1] / told[:, -1])
    scaled = np.square(np.where(distance > told[:, -1], beyond, within))
    return np.where(is_told, scaled, values)


def proportion(successes: int, trials: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Wilson, J. Am. Stat. Assoc. 22 (1927), 209); nan of nothing."""
    if not trials:
        return np.nan, np.nan, np.nan
    z = 1.959963984540054
    share = successes / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    return share, float(middle - half), float(middle + half)


def root_mean_square(error_m: FloatArray, cluster: IntArray | None = None) -> tuple[float, float, float]:
    """Return the root mean square of errors (n,), and its 95 % interval: Student's, for its logarithm.

    Errors of one `cluster` (n,), as those of a track at its ticks, depend on each other: clusters are left out as a
    whole. The logarithm's standard error is the jackknife's (Efron, The Jackknife, the Bootstrap and Other Resampling
    Plans, 1982, chapter 3). Of ten normal errors 93 to 94 % of such intervals hold the truth, 84 to 87 % of those of a
    bootstrap's percentiles. With two or three clusters it is as wide as so few leave it; of one it is not known: nan.
    """
    known = np.isfinite(error_m)
    square = np.square(error_m[known])
    if not len(square):
        return np.nan, np.nan, np.nan
    value = float(np.sqrt(square.mean()))
    group = np.arange(len(square)) if cluster is None else np.unique(cluster[known], return_inverse=True)[1]
    total, count = np.bincount(group, square), np.bincount(group)
    others = total.sum() - total
    if len(total) < 2 or not others.min() > 0.0:
        return value, np.nan, np.nan
    from scipy.stats import t

    left_out = 0.5 * np.log(others / (count.sum() - count))
    error = np.sqrt((len(total) - 1) * np.mean(np.square(left_out - left_out.mean())))
    factor = float(np.exp(t.ppf(0.975, len(total) - 1) * error))
    return value, value / factor, value * factor
