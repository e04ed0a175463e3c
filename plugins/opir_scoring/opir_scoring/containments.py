"""Consistency of estimates: NEES, NIS, their χ² bands and distribution, containment, and interval
estimates of figures.

Innovations need no truth: the detections are compared with the prediction of the tick before. Only
a track's first detection after each tick is used, because its innovation is independent from tick
to tick.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from attrs import frozen
from opir_estimation import matvec, tangent_axes
from scipy.special import chdtr, stdtrit

from opir_core.arrays import BoolArray, FloatArray, IntArray, RowArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, SPEED_OF_LIGHT_M_S
from opir_core.interfaces import TRACK_CONTAINMENTS, Columns
from opir_core.plugin import Tracks
from opir_scoring.evidence import Ownership, RunEvidence, rows_in_force
from opir_scoring.quantiles import chi_square_quantiles

#: No two points on the ground are farther apart, m: half of the equator.
FARTHEST_M = float(np.pi * EARTH_EQUATORIAL_RADIUS_M)

#: Nominal containments of a containment curve.
CONTAINMENTS = (0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99)


@frozen
class Consistency:
    """The average NEES of samples, its χ² band, and the p-value of their χ² distribution; nan if it
    was not asked for.
    """

    samples: int
    freedom: int
    mean: float
    lower: float
    upper: float
    p_value: float

    @property
    def is_inside(self) -> bool:
        """Whether the average is within its band."""
        return self.lower <= self.mean <= self.upper


def nees(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return normalised estimation errors squared (n,) of errors (n, d) with covariances (n, d, d).

    nan where an error or a covariance is unknown, inf where the covariance is not positive
    definite.
    """
    is_known = np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    variance: FloatArray = np.diagonal(covariance, axis1=1, axis2=2)
    value = np.where(is_known, np.inf, np.nan)
    rows = np.flatnonzero(is_known & ~(variance <= 0.0).any(axis=1))
    value[rows] = _normalised_squares(error[rows], covariance[rows])
    return value


def _normalised_squares(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the NEES (n,) with covariances of positive variances; inf where they are not
    definite.
    """
    value = np.full(len(error), np.inf)
    # Scaled to unit variances, so that metres and metres per second do not spoil the factorisation.
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=1, axis2=2)))
    correlation = covariance / (scale[:, :, None] * scale[:, None, :])
    rows = np.flatnonzero(np.linalg.eigvalsh(correlation).min(axis=1, initial=np.inf) > 0.0)
    whitened = (error / scale)[rows]
    solved = np.linalg.solve(correlation[rows], whitened[:, :, None])[:, :, 0]
    value[rows] = np.sum(whitened * solved, axis=1)
    return value


def consistency(
    values: FloatArray, freedom: int, probability: float = 0.99, *, has_test: bool = True
) -> Consistency:
    """Return the average of independent NEES values (n,), its band, and a test of their
    distribution.

    The average of n values of `freedom` degrees is χ² of n · freedom degrees, over n (Bar-Shalom,
    Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.2). The
    distribution test is that of Kolmogorov and Smirnov: a mean can be right while single values are
    not.
    """
    values = values[~np.isnan(values)]
    if not len(values):
        return Consistency(0, freedom, np.nan, np.nan, np.nan, np.nan)
    tails = ((1 - probability) / 2, (1 + probability) / 2)
    lower, upper = (chi_square_quantiles(tails, len(values) * freedom) / len(values)).tolist()
    p_value = _distribution_p(values, freedom) if has_test else np.nan
    return Consistency(len(values), freedom, float(values.mean()), lower, upper, p_value)


def _distribution_p(values: FloatArray, freedom: int) -> float:
    """Return the p-value that NEES values (n,) are χ² of `freedom` degrees."""
    from scipy.stats import kstest  # takes half a second

    return float(kstest(values, lambda value: chdtr(freedom, value)).pvalue)


def containment(values: FloatArray, freedom: int, nominal: float) -> tuple[float, float, float]:
    """Return the share of NEES values within the ellipse of a nominal containment, and its 95 %
    interval (Wilson).
    """
    values = values[~np.isnan(values)]
    return proportion(
        int(np.count_nonzero(values <= chi_square_quantiles(nominal, freedom))), len(values)
    )


def on_normal_scale(
    values: FloatArray, reported_sigmas: FloatArray, freedom: int = 2
) -> FloatArray:
    """Return NEES values (n,) rescaled to a normal distribution of `freedom` degrees.

    `reported_sigmas` (n, 3) are the reported radii of the ellipses of `TRACK_CONTAINMENTS`, nan for
    a normal distribution. An error on such an ellipse maps to the χ² quantile of its containment;
    the scale is linear between them and proportional beyond the largest. So `containment` and
    `consistency` score the reported ellipses.
    """
    usual = np.sqrt(chi_square_quantiles(TRACK_CONTAINMENTS, freedom))
    is_reported = np.asarray(np.isfinite(reported_sigmas).all(axis=1))
    radii = np.where(is_reported[:, None], reported_sigmas, usual)
    scaled = np.square(_rescaled(np.sqrt(values), radii, usual))
    return np.where(is_reported, scaled, values)


def _rescaled(distance: FloatArray, radii: FloatArray, usual: FloatArray) -> FloatArray:
    """Return distances (n,) mapped piecewise linearly from radii (n, k) to usual ones (k,)."""
    knots = np.column_stack([np.zeros(len(radii)), radii])
    levels = np.append(0.0, usual)
    step = np.minimum(np.sum(distance[:, None] > radii, axis=1), len(usual) - 1)
    row = np.arange(len(radii))
    start = knots[row, step]
    slope = (levels[step + 1] - levels[step]) / (knots[row, step + 1] - start)
    within = levels[step] + (distance - start) * slope
    beyond = distance * (levels[-1] / radii[:, -1])
    return np.where(distance > radii[:, -1], beyond, within)


def proportion(successes: float, trials: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Wilson, J. Am. Stat. Assoc. 22 (1927), 209); nan
    without trials.
    """
    if not trials:
        return np.nan, np.nan, np.nan
    z = 1.959963984540054
    share = successes / trials
    shrink = 1 + z * z / trials
    middle = (share + z * z / (2 * trials)) / shrink
    spread = np.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    half = z / shrink * spread
    return share, max(float(middle - half), 0.0), min(float(middle + half), 1.0)


def root_mean_square(
    error_m: FloatArray, cluster: IntArray | None = None
) -> tuple[float, float, float]:
    """Return the root mean square of errors (n,), and its 95 % interval: Student's, for its
    logarithm.

    Errors of one `cluster` (n,), as those of a track at its ticks, are dependent: the jackknife
    leaves out whole clusters (Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982,
    chapter 3). With ten normal errors 93 to 94 % of such intervals contain the truth, 84 to 87 % of
    bootstrap percentile intervals. With one cluster the interval is nan.
    """
    is_known = np.isfinite(error_m)
    square = np.square(error_m[is_known])
    if not len(square):
        return np.nan, np.nan, np.nan
    value = float(np.sqrt(square.mean()))
    group = np.arange(len(square))
    if cluster is not None:
        group = np.unique(cluster[is_known], return_inverse=True)[1]
    total = np.bincount(group, square).astype(np.float64)
    factor = _interval_factor(total, np.bincount(group))
    return value, value / factor, value * factor


def _interval_factor(total: FloatArray, count: IntArray) -> float:
    """Return the factor from a root mean square to the ends of its interval, by sums (k,) of
    squares in clusters; nan for one cluster.
    """
    remaining = total.sum() - total
    if len(total) < 2 or not remaining.min() > 0.0:
        return np.nan
    return float(np.exp(jackknife_half(0.5 * np.log(remaining / (count.sum() - count)))))


def jackknife_half(left_out: FloatArray) -> float:
    """Return half of the 95 % interval of a figure from its values (k,) without each cluster."""
    degrees = len(left_out) - 1
    error = np.sqrt(degrees * np.mean(np.square(left_out - left_out.mean())))
    return float(stdtrit(degrees, 0.975) * error)


#: Detections later than this after a tick are left out, s: a boost of 50 m/s² deviates by 25 m from
#: a straight line.
REACH_S = 1.0


@frozen(eq=False, repr=False)
class Innovations(Columns):
    """One row per tick of a target's track in force: target, time since ignition, geometry, and the
    NIS.

    The normalised innovation squared has two degrees of freedom: the two angles across the line of
    sight.
    """

    target: IntArray
    since_s: FloatArray
    is_stereo: BoolArray
    is_biased: BoolArray
    nis: FloatArray


def innovations(evidence: RunEvidence, owners: Ownership) -> Innovations:
    """Return the innovations of the tracks in force, by track."""
    tracks = evidence.tracks.take(rows_in_force(evidence, owners))
    is_known = np.isfinite(tracks.state).all(axis=1)
    tracks = tracks.take(is_known & np.isfinite(tracks.state_covariance).all(axis=(1, 2)))
    return Innovations.concatenate(
        _of_track(evidence, tracks.take(tracks.track == number), owners)
        for number in np.unique(tracks.track).tolist()
    )


def _of_track(evidence: RunEvidence, tracks: Tracks, owners: Ownership) -> Innovations:
    row = int(np.searchsorted(owners.track, tracks.track[0]))
    rows, tick = _first_rows(evidence, owners.track[row], tracks.tick_s)
    tracks = tracks.take(tick)
    target = int(owners.target[row])
    return Innovations(
        target=np.full(len(rows), target, dtype=np.int64),
        since_s=tracks.tick_s - evidence.plan.targets.ignition_s[target],
        is_stereo=np.full(len(rows), owners.is_stereo[row]),
        is_biased=np.full(len(rows), owners.is_biased[row]),
        nis=_normalised(evidence, rows, tracks),
    )


def _first_rows(evidence: RunEvidence, track: int, tick_s: FloatArray) -> tuple[RowArray, RowArray]:
    """Return the rows (n,) of a track's first detections soon after its ticks, and the ticks."""
    rows = np.flatnonzero(evidence.track == track)
    tick = np.searchsorted(tick_s, evidence.time_s[rows], side="right") - 1
    rows = rows[tick >= 0]
    tick, earliest = np.unique(tick[tick >= 0], return_index=True)
    rows = rows[earliest]
    is_near = evidence.time_s[rows] - tick_s[tick] <= REACH_S
    return rows[is_near], tick[is_near]


def _normalised(evidence: RunEvidence, rows: IntArray, tracks: Tracks) -> FloatArray:
    """Return the NIS (n,) of detections; the state is extrapolated linearly to the time of
    emission.
    """
    sensor_m = evidence.sensor_ecef_m[rows]
    age_s = evidence.time_s[rows] - tracks.tick_s
    expected_m = tracks.state[:, :3] + tracks.state[:, 3:] * age_s[:, None]
    if evidence.plan.scene.light_time:
        range_m = np.sqrt(np.sum((expected_m - sensor_m) ** 2, axis=1))
        age_s = age_s - range_m / SPEED_OF_LIGHT_M_S
        expected_m = tracks.state[:, :3] + tracks.state[:, 3:] * age_s[:, None]
    line_m = expected_m - sensor_m
    range_m = np.sqrt(np.sum(line_m * line_m, axis=1))
    axes = tangent_axes(line_m / range_m[:, None])
    measured = matvec(axes, evidence.direction_ecef[rows])
    measured = measured[:, :2] / measured[:, 2:]
    slope = axes[:, :2] / range_m[:, None, None]
    slope = np.concatenate([slope, slope * age_s[:, None, None]], axis=2)
    spread = slope @ tracks.state_covariance @ slope.mT
    spread[:, [0, 1], [0, 1]] += np.square(evidence.sigma_rad[rows])[:, None]
    return np.sum(measured * np.linalg.solve(spread, measured[:, :, None])[:, :, 0], axis=1)


def figure(value: float, lower: float = np.nan, upper: float = np.nan) -> dict[str, Any]:
    """Return a figure with its 95 % interval."""
    return {"value": value, "interval_95": [lower, upper]}


def rms(
    error: FloatArray, cluster: IntArray | None = None, limit: float = np.inf
) -> dict[str, Any]:
    """Return the root mean square of errors (n,), at most `limit`, dependent in a cluster (n,),
    with its interval.
    """
    value, lower, upper = root_mean_square(error, cluster)
    return figure(value, lower, min(upper, limit))


def energy(
    score: FloatArray, cluster: IntArray | None = None, limit: float = np.inf
) -> dict[str, Any]:
    """Return the mean of energy scores (n,), at most `limit`, dependent in a cluster (n,), with its
    interval.
    """
    value, lower, upper = np.square(root_mean_square(np.sqrt(score), cluster)).tolist()
    return figure(value, lower, min(upper, limit))


def over(numerator: Mapping[str, Any], bound: float) -> dict[str, Any]:
    """Return a figure divided by a bound."""
    low, high = numerator["interval_95"]
    return figure(numerator["value"] / bound, low / bound, high / bound)


def share(is_true: BoolArray) -> dict[str, Any]:
    """Return the share of true ones of cases (n,), with its interval."""
    return figure(*proportion(int(np.count_nonzero(is_true)), len(is_true)))


def of_some(figure: Mapping[str, Any], count: int, total: int) -> dict[str, Any]:
    """Return a figure with the `share` of `count` in the `total` launches or ticks; nan of none."""
    return {**figure, "share": count / total if total else np.nan}


def mean(values: FloatArray, limit: float = np.inf) -> dict[str, Any]:
    """Return the mean of the finite ones of independent values (n,) in [0, limit], with Student's
    interval.
    """
    values = values[np.isfinite(values)]
    count = len(values)
    if not count:
        return figure(np.nan)
    centre = float(values.mean())
    half = np.nan
    if count > 1:
        half = float(stdtrit(count - 1, 0.975) * values.std(ddof=1) / np.sqrt(count))
    return figure(centre, max(centre - half, 0.0), min(centre + half, limit))


def consistent(result: Consistency) -> dict[str, Any]:
    """Return an average NEES or NIS and its band, over its degrees of freedom: 1 is consistent."""
    return {
        "samples": result.samples,
        "mean": result.mean / result.freedom,
        "band_99": [result.lower / result.freedom, result.upper / result.freedom],
        "distribution_p": result.p_value,
    }


def contained(values: FloatArray) -> list[dict[str, Any]]:
    """Return the containment curve of NEES values (n,) on the ground: nominal and observed
    shares.
    """
    return [
        {"nominal": nominal, **figure(*containment(values, 2, nominal))} for nominal in CONTAINMENTS
    ]


def plain(value: Any) -> Any:
    """Return figures for JSON, with null for nan and inf."""
    if isinstance(value, Mapping):
        return {key: plain(member) for key, member in value.items()}
    if isinstance(value, list):
        return [plain(member) for member in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
