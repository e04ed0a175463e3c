"""References of detection, scoring and estimation: distributions, latency, consistency, ellipses,
least squares.
"""

from itertools import permutations

import mpmath as mp
import numpy as np
import opir_photons.detection as detection
import opir_scoring as scoring
from opir_estimation import square_root, tangent_axes
from opir_estimation.filter.measurement_updates import least_squares

from exact_cases import draws
from exact_cases.measure import Case, dot, norm
from opir_core.estimation.ellipses import containment_ellipse, sigmas
from opir_core.geometry.vectors import angle_between_rad


def tail(x):
    """Return Q(x), the upper tail of the standard normal distribution."""
    return mp.erfc(x / mp.sqrt(2)) / 2


def quantile(probability):
    """Return Φ⁻¹(p), by Newton's method in the logarithm of the smaller tail."""
    if not 0 < probability < 1:
        return None
    upper = probability > mp.mpf(1) / 2
    small = 1 - probability if upper else probability
    expected = mp.log(small)
    x = mp.sqrt(-2 * expected) if expected < -2 else mp.mpf(1) / 2
    for _ in range(200):
        value = tail(x)
        step = (mp.log(value) - expected) * value / (mp.exp(-x * x / 2) / mp.sqrt(2 * mp.pi))
        x += step
        if abs(step) < mp.mpf(10) ** -(mp.mp.dps - 4):
            break
    return x if upper else -x


def student_tail(x, freedom):
    """Return the upper tail of Student's t: an incomplete beta function."""
    share = (
        mp.betainc(freedom / 2, mp.mpf(1) / 2, 0, freedom / (freedom + x * x), regularized=True) / 2
    )
    return share if x >= 0 else 1 - share


def student_threshold(probability, cells):
    """Return the threshold of a tail of Student's t, by secant steps in logarithms from the float64
    answer.
    """
    expected = mp.log(probability)
    start = mp.mpf(float(detection.cfar_threshold(float(probability), float(cells))))
    previous = start
    guess = start * (1 + mp.mpf(10) ** -9) + mp.mpf(10) ** -12
    miss_before = mp.log(student_tail(previous, cells - 1)) - expected
    for _ in range(4):
        miss = mp.log(student_tail(guess, cells - 1)) - expected
        if miss == miss_before:
            break
        previous, guess, miss_before = (
            guess,
            guess - miss * (guess - previous) / (miss - miss_before),
            miss,
        )
    return guess


def noncentral_tail(snr, threshold, cells):
    """Return P(T > t) of the noncentral t: over the χ of the reference cells, by quadrature."""
    freedom = cells - 1
    shift = snr / mp.sqrt(1 + 1 / cells)

    def part(s):
        log_density = (freedom - 1) * mp.log(s) - freedom * s * s / 2
        return mp.exp(log_density - peak) * tail(threshold * s - shift)

    top = mp.sqrt((freedom - 1) / freedom) if freedom > 1 else mp.mpf(1)
    peak = (freedom - 1) * mp.log(top) - freedom * top * top / 2 if freedom > 1 else mp.mpf(-1) / 2
    width = 1 / mp.sqrt(2 * freedom)
    edges = sorted(
        {
            max(mp.mpf(0), top + k * width)
            for k in (-40, -16, -10, -6, -3, -1, 0, 1, 3, 6, 10, 16, 40)
        }
    )
    scale = mp.quad(lambda s: mp.exp((freedom - 1) * mp.log(s) - freedom * s * s / 2 - peak), edges)
    # What the tail favours may lie far below the peak of χ.
    return mp.quad(part, edges) / scale


def binomial_tail(probability, needed, looks):
    return mp.fsum(
        mp.binomial(looks, k) * probability**k * (1 - probability) ** (looks - k)
        for k in range(needed, looks + 1)
    )


def log_miss(probability):
    return mp.log1p(-probability) if probability < 1 else -mp.inf


def cumulative(probability, looks):
    return (
        mp.mpf(0)
        if looks == 0
        else mp.mpf(1)
        if probability == 1
        else -mp.expm1(looks * log_miss(probability))
    )


def grid_time(value):
    """Return a time in whole nanoseconds, as the functions compare times: by the float product's
    nearest integer.
    """
    return mp.mpf(float(np.rint(float(value) * 1e9)))


def latency_cdf(time, period, probability, random=True):
    elapsed = grid_time(max(time, mp.mpf(0)))
    step = grid_time(period)
    total = mp.floor(elapsed / step)
    certain = cumulative(probability, total)
    fraction = elapsed / step - total if random else mp.mpf(0)
    return certain + (1 - certain) * fraction * probability


def latency_quantile(level, period, probability):
    """Return the quantile for scans of random phase."""
    if probability == 0:
        return mp.inf if level > 0 else mp.mpf(0)
    if level == 0:
        return mp.mpf(0)
    looks = mp.log1p(-level) / log_miss(probability) if probability < 1 else mp.mpf(0)
    total = mp.nint(looks) if abs(looks - mp.nint(looks)) < mp.mpf("1e-9") else mp.floor(looks)
    remainder = mp.log1p(-level) - (total * log_miss(probability) if total else 0)
    return period * (total - mp.expm1(remainder) / probability)


def latencies(rng, n):
    """Return times, periods and P_d: whole scans and parts of them, a nanosecond and a year."""
    period = draws.log_uniform(rng, n, 1e-3, 1e2, (10.0, 1e-9))
    return (
        period * draws.log_uniform(rng, n, 1e-3, 1e6, (1.0, 7.0, 0.0)),
        period,
        draws.probabilities(rng, n),
    )


def _snr(rng, n):
    return draws.log_uniform(rng, n, 1e-3, 60.0, (0.0,)), draws.uniform(
        rng, n, -5.0, 38.0, (0.0, 5.0)
    )


def correlations(rng, n):
    step = rng.uniform(0.0, 0.999, n)
    return (step[:, None] ** np.arange(12),)


def ellipse(covariance):
    """Return the 95 % semi-axes of a covariance [a, b, c, d] from its characteristic polynomial."""
    a, b, c, d = covariance
    cross = (b + c) / 2
    middle = (a + d) / 2
    spread = mp.sqrt(((a - d) / 2) ** 2 + cross * cross)
    radius = mp.sqrt(-2 * mp.log(mp.mpf(1) - mp.mpf(0.95)))
    low = (a * d - cross * cross) / (middle + spread)
    return radius * mp.sqrt(middle + spread), radius * mp.sqrt(max(low, mp.mpf(0)))


def covariances(rng, n, size=2):
    """Return covariances (n, size²), m²: a metre to 1000 km, with axes up to a million times as
    long as wide.
    """
    root = rng.normal(size=(n, size, size)) * draws.log_uniform(rng, n, 1.0, 1e6)[:, None, None]
    root[:, 0] *= draws.log_uniform(rng, n, 1e-5, 1.0)[:, None]
    return (root @ root.transpose(0, 2, 1)).reshape(n, -1)


def nees(error, covariance):
    size = len(error)
    solved = mp.lu_solve(
        mp.matrix([covariance[size * row : size * (row + 1)] for row in range(size)]),
        mp.matrix(error),
    )
    return dot(error, list(solved))


def gospa(estimate, truth):
    """Return the distance of three estimates and three truths in the plane, by all assignments."""
    points = [[values[2 * k : 2 * k + 2] for k in range(3)] for values in (estimate, truth)]
    cut = mp.mpf(5)
    costs = [
        mp.fsum(
            min(norm([a - b for a, b in zip(points[0][i], points[1][j], strict=True)]), cut) ** 2
            for i, j in enumerate(order)
        )
        for order in permutations(range(3))
    ]
    return mp.sqrt(min(costs))


def solution(rows, right):
    """Return the least-squares solution of 6 rows of 3, by the normal equations in many digits."""
    matrix = mp.matrix([rows[3 * k : 3 * k + 3] for k in range(6)])
    return list(mp.lu_solve(matrix.T * matrix, matrix.T * mp.matrix(right)))


def _stack(rows, right):
    stack = np.concatenate([rows.reshape(-1, 6, 3), right[:, :, None]], axis=2)
    return least_squares(stack)[1]


def _lines(rng, n):
    """Return whitened rows of three sensors almost in one plane, and residuals."""
    rows = rng.normal(size=(n, 6, 3))
    rows[:, :, 2] *= draws.log_uniform(rng, n, 1e-6, 1.0)[:, None]
    return rows.reshape(n, 18), rng.normal(size=(n, 6))


def inverse(root):
    """Return the inverse of an upper triangle of 3 given as 9 numbers, as such."""
    return list(mp.matrix([root[3 * k : 3 * k + 3] for k in range(3)]) ** -1)


def _roots(rng, n):
    root = np.triu(rng.normal(size=(n, 3, 3)))
    root[:, [0, 1, 2], [0, 1, 2]] = draws.log_uniform(rng, 3 * n, 1e-3, 1e3).reshape(n, 3)
    return (root.reshape(n, 9),)


def directed(direction):
    """Return the tangent axes of a direction as 9 numbers (Duff et al. 2017)."""
    x, y, z = direction
    sign = -1 if z < 0 else 1
    low = 1 + abs(z)
    return [
        1 - x * x / low,
        -x * y / low,
        -sign * x,
        -sign * x * y / low,
        sign * (1 - y * y / low),
        -y,
        x,
        y,
        z,
    ]


def between(a, b):
    return mp.atan2(
        norm(
            [
                a[1] * b[2] - a[2] * b[1],
                a[2] * b[0] - a[0] * b[2],
                a[0] * b[1] - a[1] * b[0],
            ]
        ),
        dot(a, b),
    )


def _of(module, name):
    return f"{module.__name__.removeprefix('opir_core.')}.{name}"


#: Probabilities below it may be rounded to 0; their logarithms are exact.
LEAST = 1e-290

CASES = (
    Case(
        "detection.probability_of_detection",
        _snr,
        detection.probability_of_detection,
        lambda s, t: tail(t - s),
        scale=(LEAST,),
    ),
    Case(
        "detection.false_alarm_probability",
        lambda r, n: (draws.uniform(r, n, -8.0, 38.0, (0.0,)),),
        detection.false_alarm_probability,
        tail,
        scale=(LEAST,),
    ),
    Case(
        "detection.threshold_sigma",
        lambda r, n: (draws.probabilities(r, n),),
        detection.threshold_sigma,
        lambda p: None if quantile(p) is None else -quantile(p),
        share=0.5,
    ),
    Case(
        "detection.m_of_n_probability",
        lambda r, n: (draws.probabilities(r, n),),
        lambda p: detection.m_of_n_probability(p, 3, 5),
        lambda p: binomial_tail(p, 3, 5),
        scale=(LEAST,),
    ),
    Case(
        "detection.cfar_threshold",
        lambda r, n: (draws.log_uniform(r, n, 1e-12, 0.5), r.integers(4, 200, n).astype(float)),
        detection.cfar_threshold,
        student_threshold,
        fixed=(1,),
        share=0.1,
    ),
    Case(
        "detection.cfar_probability_of_detection",
        lambda r, n: (
            draws.uniform(r, n, 0.0, 12.0, (0.0,)),
            r.uniform(2.0, 12.0, n),
            r.integers(8, 100, n).astype(float),
        ),
        detection.cfar_probability_of_detection,
        noncentral_tail,
        fixed=(2,),
        share=0.05,
        digits=25,
    ),
    Case(
        "detection.cfar_loss",
        lambda r, n: (draws.log_uniform(r, n, 1e-9, 0.1), r.integers(8, 100, n).astype(float)),
        lambda p, c: detection.cfar_probability_of_detection(
            -detection.cfar_loss(p, c) * (-detection.threshold_sigma(p)),
            detection.cfar_threshold(p, c),
            c,
        ),
        lambda p, c: mp.mpf(1) / 2,
        # Of P_d in the SNR, where that is 5 to 10.
        condition=lambda p, c: [8],
    ),
    Case(
        "detection.effective_looks",
        correlations,
        detection.effective_looks,
        lambda rho: (
            12 / (2 * mp.fsum((1 - mp.mpf(k) / 12) * r for k, r in enumerate(rho)) - rho[0])
        ),
    ),
    Case(
        "detection.cumulative_probability",
        lambda r, n: (draws.probabilities(r, n), draws.log_uniform(r, n, 1.0, 1e9, (0.0,))),
        detection.cumulative_probability,
        cumulative,
    ),
    Case(
        "detection.latency_cdf",
        latencies,
        lambda *c: detection.latency_cdf(*c, scan_phase="random"),
        latency_cdf,
        fixed=(0, 1),
    ),
    Case(
        "detection.latency_mean",
        lambda r, n: (r.uniform(0.01, 20.0, n), np.maximum(draws.probabilities(r, n), 1e-290)),
        lambda *c: detection.latency_mean(*c, scan_phase="random"),
        lambda t, p: t * (1 / p - mp.mpf(1) / 2),
    ),
    Case(
        "detection.latency_quantile",
        lambda r, n: (
            draws.probabilities(r, n),
            r.uniform(0.01, 20.0, n),
            np.maximum(draws.probabilities(r, n), 1e-290),
        ),
        lambda q, t, p: detection.latency_quantile(
            np.minimum(q, 1.0 - 2.0**-53), t, p, scan_phase="random"
        ),
        lambda q, t, p: latency_quantile(min(q, 1 - mp.mpf(2) ** -53), t, p),
    ),
    Case(
        "scoring.nees",
        lambda r, n: (r.normal(size=(n, 3)), covariances(r, n, 3)),
        lambda e, c: scoring.nees(e, c.reshape(-1, 3, 3)),
        nees,
        share=0.5,
    ),
    Case(
        "scoring.gospa",
        lambda r, n: (4.0 * r.normal(size=(n, 6)), 4.0 * r.normal(size=(n, 6))),
        lambda e, t: np.array(
            [
                scoring.gospa(one.reshape(3, 2), other.reshape(3, 2), cutoff=5.0).distance
                for one, other in zip(e, t, strict=True)
            ]
        ),
        gospa,
        share=0.2,
    ),
    Case(
        "estimation.containment_ellipse",
        lambda r, n: (covariances(r, n),),
        lambda c: tuple(containment_ellipse(c.reshape(-1, 2, 2)))[:2],
        ellipse,
    ),
    Case(
        "estimation.containment_ellipse.sigmas",
        lambda r, n: (np.minimum(draws.probabilities(r, n), 1.0 - 2.0**-53),),
        lambda p: np.array([sigmas(one) for one in p.tolist()]),
        lambda p: mp.sqrt(-2 * mp.log1p(-p)),
    ),
    Case("trackers.least_squares", _lines, _stack, solution, share=0.2),
    Case(
        "estimation.square_root.inverse_root",
        _roots,
        lambda root: square_root.inverse_root(root.reshape(-1, 3, 3)).reshape(-1, 9),
        inverse,
        share=0.5,
    ),
    Case(
        "estimation.tangent_axes",
        lambda r, n: (draws.directions(r, n) + 0.0,),
        lambda d: tangent_axes(d).reshape(-1, 9),
        directed,
    ),
    Case(
        "geometry.vectors.angle_between_rad",
        lambda r, n: (draws.positions(r, n), draws.positions(r, n)),
        angle_between_rad,
        between,
    ),
)

LEFT_OUT = {
    "detection": {
        "FusedBands": "a dot product and a normal distribution"
        " (tests/plugins/photons/detection/test_fused_bands.py)",
        **dict.fromkeys(
            ("blur_rad", "unlit_electrons_per_s"),
            "through budgets and frames (tests/against/test_against_bench_scripts.py)",
        ),
        "RatioGates": "an integral to a stated tolerance"
        " (tests/plugins/photons/detection/test_band_rules.py)",
    },
    "scoring": {
        **dict.fromkeys(
            [
                "Consistency",
                "StateErrors",
                "Gospa",
                "ScoredRun",
                "ImpactScores",
                "Ownership",
                "RunEvidence",
                "ScoreSettings",
                "Scorecard",
                "WarningRequirement",
                "WarningTimes",
            ],
            "a record",
        ),
        **dict.fromkeys(("LaunchShare", "Tails"), "a record"),
        **dict.fromkeys(("NOT_SHOWN", "RECOGNITION_PROBABILITY", "TAILS_95"), "a constant"),
        **dict.fromkeys(
            ("verdict_in_all", "share_curve"),
            "shares by hand and on 1000 drawn studies (tests/plugins/scoring/test_launch_shares.py)",
        ),
        "recognition": "by hand (tests/plugins/scoring/test_hypothesis_scores.py)",
        "warning_times": "by hand, row by row (tests/plugins/studies/test_warning_metric.py)",
        "paired_figures": "differences against SciPy's paired test"
        " (tests/plugins/scoring/test_paired.py)",
        "comparison_text": "words (tests/plugins/scoring/test_paired.py)",
        **dict.fromkeys(
            ("percent_text", "share_text"), "words (tests/plugins/studies/test_some_launches.py)"
        ),
        "chi_square_quantiles": "mpmath's distribution function (tests/plugins/scoring/test_quantiles.py)",
        "consistency": "SciPy's χ² quantiles (tests/plugins/scoring)",
        "containment": "counts, and SciPy's χ² quantile (tests/plugins/scoring)",
        **dict.fromkeys(
            [
                "evidence_of_files",
                "evidence_of_run",
                "impact_scores",
                "ownership",
                "scorecard",
                "coverage",
                "last_rows",
            ],
            "takes runs, not numbers",
        ),
        **dict.fromkeys(
            [
                "ground_error",
                "phase_scores",
                "place_of",
                "point_errors",
                "rows_in_force",
                "scorecard_of",
                "scored_run",
            ],
            "takes runs, not numbers",
        ),
        **dict.fromkeys(["state_errors", "true_states_ecef"], "takes runs, not numbers"),
        **dict.fromkeys(
            ["energy_scores", "log_scores", "brier_scores"],
            "closed forms and another library (tests/against/test_against_crps_of_scoringrules.py)",
        ),
        **dict.fromkeys(
            ["open_set_rate", "reliability"],
            "counts (tests/plugins/scoring/test_hypothesis_scores.py)",
        ),
        **dict.fromkeys(["main_regions", "regions_given"], "chooses records"),
        "region_energy_m": "areas to 1 % (tests/plugins/scoring/test_impact_scores.py)",
        **dict.fromkeys(["add_score_settings", "score_settings", "scorecard_text"], "texts"),
        **dict.fromkeys(["GEOMETRIES", "OLDEST_S", "PHASES", "USUAL_SETTINGS"], "a constant"),
    },
}
