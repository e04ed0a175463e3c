"""Detection latency and cumulative probability of detection: closed forms for periodic, independent
looks.

A sensor looks at a target once in each scan period T and detects it in each look with the same
probability P_d, independently of other looks. The number of looks to the first detection is then
geometrically distributed (opir-simulator paper (2026), sections 4.2 and 5.1, with the corrections
of docs/explanation/paper-errata.md).

Two phases of the scan are modelled. `aligned`: the launch is at the time of a scan, so the first
look is one full period after ignition (the convention of the paper). `random`: the first look is
uniformly distributed over the first period. Light time and processing are not included: add them.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_photons.columns import floats

ScanPhase = Literal["aligned", "random"]


def cumulative_probability(detection_probability: ArrayLike, looks: ArrayLike) -> FloatArray:
    """Return the probabilities P_cum = 1 - (1 - P_d)^n of at least one detection in n independent
    looks.

    Arguments broadcast; the result has their common shape. `detection_probability` is P_d of one
    look, in [0, 1]; `looks` is n >= 0, which need not be an integer. `nan` where an argument is
    outside its domain. The relative error is a few units in the last place, for small P_d too.

    Source: opir-simulator paper (2026), section 4.2.
    """
    log_miss = _log_miss(detection_probability)
    count = floats(looks)
    with np.errstate(invalid="ignore"):
        exponent = np.where(count == 0.0, 0.0, np.where(count >= 0.0, count, np.nan) * log_miss)
    return np.asarray(-np.expm1(exponent))


def latency_cdf(
    time_s: ArrayLike,
    scan_period_s: ArrayLike,
    detection_probability: ArrayLike,
    scan_phase: ScanPhase = "aligned",
) -> FloatArray:
    """Return the probabilities that the latency, from ignition to the first detection, is at most
    `time_s`.

    Arguments broadcast; the result has their common shape. `time_s` and `scan_period_s` (> 0) are
    in seconds, compared to the nearest nanosecond; `detection_probability` is P_d of one look, in
    [0, 1]. With n = floor(t / T) and f = t / T - n the result is 1 - (1 - P_d)^n for `aligned`
    scans and 1 - (1 - P_d)^n (1 - f P_d) for those of `random` phase. 0 before ignition; `nan`
    where an argument is outside its domain. `ValueError` for an unknown `scan_phase`.

    Source: opir-simulator paper (2026), section 5.1, for `aligned`; for `random` its mean over a
    uniform first look.
    """
    _require_phase(scan_phase)
    time, period, probability = _columns(time_s, scan_period_s, detection_probability)
    # The simulator's times are whole nanoseconds, so times are compared to the nearest one.
    elapsed_ns = np.rint(np.maximum(time, 0.0) * 1e9)
    period_ns = np.rint(period * 1e9)
    with np.errstate(invalid="ignore", divide="ignore"):
        looks = np.where(np.isinf(elapsed_ns), np.inf, np.floor(elapsed_ns / period_ns))
        fraction = np.where(np.isinf(elapsed_ns), 0.0, elapsed_ns / period_ns - looks)
    certain = cumulative_probability(probability, looks)
    if scan_phase == "aligned":
        return certain
    return np.asarray(certain + (1.0 - certain) * fraction * probability)


def latency_mean(
    scan_period_s: ArrayLike, detection_probability: ArrayLike, scan_phase: ScanPhase = "aligned"
) -> FloatArray:
    """Return the mean latencies, s: T / P_d for `aligned` scans, T (1 / P_d - 1/2) for those of
    `random` phase.

    Arguments as in `latency_cdf`; inf for P_d = 0. Source: opir-simulator paper (2026), section
    5.1.
    """
    _require_phase(scan_phase)
    period, probability = _columns(scan_period_s, detection_probability)
    with np.errstate(divide="ignore"):
        return np.asarray(period * (1.0 / probability - (0.0 if scan_phase == "aligned" else 0.5)))


def latency_quantile(
    quantile: ArrayLike,
    scan_period_s: ArrayLike,
    detection_probability: ArrayLike,
    scan_phase: ScanPhase = "aligned",
) -> FloatArray:
    """Return the least latencies, s, that are not exceeded with probability `quantile`, in [0, 1).

    Other arguments as in `latency_cdf`, which this inverts: T ⌈ln(1 - q) / ln(1 - P_d)⌉ for
    `aligned` scans, where a quotient within 1e-9 of an integer is that integer. inf for P_d = 0 and
    q > 0; `nan` outside the domain.

    Source: opir-simulator paper (2026), section 5.1, as corrected in
    docs/explanation/paper-errata.md.
    """
    _require_phase(scan_phase)
    level, period, probability = _columns(quantile, scan_period_s, detection_probability)
    level = np.where((level >= 0.0) & (level < 1.0), level, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        looks = np.where(level == 0.0, 0.0, np.log1p(-level) / _log_miss(probability))
        nearest = np.rint(looks)
        looks = np.where(np.abs(looks - nearest) < 1e-9, nearest, looks)
        if scan_phase == "aligned":
            # With P_d = 1 the quotient is 0, and one look is needed for any q above 0.
            needed = np.maximum(np.ceil(looks), 1.0)
            return np.asarray(period * np.where(level > 0.0, needed, looks))
        complete = np.floor(looks)
        log_missed = np.where(complete == 0.0, 0.0, complete * _log_miss(probability))
        share = -np.expm1(np.log1p(-level) - log_missed) / probability
        periods = complete + np.where(level == 0.0, 0.0, share)
        return np.asarray(period * np.where(np.isinf(looks), np.inf, periods))


def _columns(*columns: ArrayLike) -> tuple[FloatArray, ...]:
    """Return arrays of the times or quantiles, of the periods and of the probabilities, nan outside
    their domains.
    """
    *levels, period, probability = map(floats, columns)
    return *levels, np.where(period > 0.0, period, np.nan), _probability(probability)


def _log_miss(detection_probability: ArrayLike) -> FloatArray:
    """Return ln(1 - P_d): -inf for 1, nan outside [0, 1]."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log1p(-_probability(floats(detection_probability))))


def _probability(values: FloatArray) -> FloatArray:
    """Return probabilities, nan outside [0, 1]."""
    return np.where((values >= 0.0) & (values <= 1.0), values, np.nan)


def _require_phase(scan_phase: str) -> None:
    if scan_phase not in ("aligned", "random"):
        raise ValueError(f"scan_phase must be aligned or random, not {scan_phase!r}")
