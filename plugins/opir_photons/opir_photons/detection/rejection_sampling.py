"""Measurements conditional on a detection, by rejection sampling; and truncated normal numbers.

A rule proposes measurements from the distribution conditional on some of its conditions; the first
proposal that also meets the others has the exact conditional distribution. The acceptance rate
follows from P_d. Rows with a very low rate, and rows without an accepted proposal, are drawn by the
rule's inverse, which has the same distribution. All random numbers of a row come from a seed of its
own.
"""

from typing import Protocol

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

from opir_core.arrays import BoolArray, FloatArray, IntArray, WordArray
from opir_core.random_streams import further_words, uniforms_of

#: Least uniform number with a finite normal quantile.
LEAST_UNIFORM = 2.0**-54


def tail_normals(lower: FloatArray, uniforms: FloatArray) -> FloatArray:
    """Return standard normal numbers (n,) conditional on being at least `lower`, from numbers (n,)
    in [0, 1).

    As `truncated_normals` without an upper bound, in a third of the time.
    """
    drawn: FloatArray = np.maximum(
        -ndtri(np.maximum(uniforms, LEAST_UNIFORM) * ndtr(-lower)), lower
    )
    # Beyond this a normal tail is no double of full precision.
    rows = np.flatnonzero(lower > 36.0)
    if len(rows):
        drawn[rows] = truncated_normals(lower[rows], np.full(len(rows), np.inf), uniforms[rows])
    return drawn


def truncated_normals(lower: FloatArray, upper: FloatArray, uniforms: FloatArray) -> FloatArray:
    """Return standard normal numbers (n,) conditional on lying in [lower, upper], from numbers (n,)
    in [0, 1).

    Bounds may be infinite, or as large as 1e100; if lower >= upper the lower bound is returned.
    """
    is_high = lower > 0.0
    # Positive bounds are mirrored, so that probabilities are lower tails, which have logarithms.
    low = np.where(is_high, -upper, lower)
    high = np.where(is_high, -lower, upper)
    log_high = log_ndtr(high)
    share = np.exp(np.minimum(log_ndtr(low) - log_high, 0.0))
    level = np.where(is_high, 1.0 - uniforms, uniforms)
    with np.errstate(divide="ignore"):
        drawn = ndtri_exp(log_high + np.log(level + (1.0 - level) * share))
    within = np.clip(np.where(is_high, -drawn, drawn), lower, np.maximum(lower, upper))
    return np.where(lower < upper, within, lower)


#: Acceptance rate below which the inverse is used: it costs about as much as 2048 proposals.
LEAST_PASSING = 1.0 / 2048.0


class Rule(Protocol):
    """A rule over bands, for measured signals (n, B) in standard deviations of the noise and slopes
    of gates (n, k).
    """

    def passes(self, measured: FloatArray, slopes: FloatArray) -> BoolArray:
        """Return which measurements detect."""

    def proposed(self, snr: FloatArray, slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) that meet some of the conditions, from numbers (n, B + 1) in
        [0, 1).
        """

    def passing(self, snr: FloatArray, probability: FloatArray) -> FloatArray:
        """Return the shares (n,) of proposals that detect, for looks with P_d (n,)."""

    def conditional(self, snr: FloatArray, slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) conditional on a detection, from numbers (n, B + 1) in [0,
        1).
        """


def accepted_draws(
    rule: Rule, snr: FloatArray, slopes: FloatArray, probability: FloatArray, seeds: WordArray
) -> FloatArray:
    """Return measurements (n, B) that detect, of looks with P_d (n,)."""
    # Most rows pass at once, without an acceptance rate.
    measured = rule.proposed(
        snr, slopes, _uniforms(seeds, np.zeros(len(seeds), dtype=np.int64), snr.shape[1] + 1)
    )
    rejected = np.flatnonzero(~rule.passes(measured, slopes))
    if len(rejected):
        measured[rejected] = _until_one_passes(
            rule, snr[rejected], slopes[rejected], probability[rejected], seeds[rejected]
        )
    return measured


def _until_one_passes(
    rule: Rule, snr: FloatArray, slopes: FloatArray, probability: FloatArray, seeds: WordArray
) -> FloatArray:
    """Return measurements (n, B) that detect, for looks with a rejected first proposal."""
    measured = np.empty(snr.shape)
    share = rule.passing(snr, probability)
    likely = share >= LEAST_PASSING
    # Of rows with 0.75 proposals per round over the acceptance rate, one in exp(18) is rejected in
    # all 24 rounds.
    tries = np.ceil(0.75 / np.where(likely, share, 1.0)).astype(np.int64)
    rejected = np.flatnonzero(likely)
    for turn in range(24):
        missed = [rejected[:0]]
        for rows in _portions(rejected, tries):
            passed, drawn = _turn(rule, snr[rows], slopes[rows], seeds[rows], tries[rows], turn)
            measured[rows[passed]] = drawn
            missed.append(rows[~passed])
        rejected = np.concatenate(missed)
        if not len(rejected):
            break
    remaining = np.concatenate([np.flatnonzero(~likely), rejected])
    if len(remaining):
        # Numbers of the inverse are far along a row's sequence.
        number = np.full(len(remaining), 1 << 32)
        uniforms = _uniforms(seeds[remaining], number, snr.shape[1] + 1)
        measured[remaining] = rule.conditional(snr[remaining], slopes[remaining], uniforms)
    return measured


def _portions(rows: IntArray, tries: IntArray) -> list[IntArray]:
    """Return rows divided into portions of about 32768 tries."""
    step = 1 << 15
    ends = np.cumsum(tries[rows])
    edges = np.searchsorted(ends, np.arange(step, ends[-1] if len(ends) else 0, step))
    return [portion for portion in np.split(rows, np.unique(edges)) if len(portion)]


def _turn(
    rule: Rule, snr: FloatArray, slopes: FloatArray, seeds: WordArray, tries: IntArray, turn: int
) -> tuple[BoolArray, FloatArray]:
    """Return whether rows (n,) pass within their `tries`, and the first passing proposal of each,
    (passed, B).
    """
    ends = np.cumsum(tries)
    row = np.repeat(np.arange(len(tries)), tries)
    number = np.arange(len(row)) + np.repeat(1 + turn * tries - (ends - tries), tries)
    sides = slopes.take(row, axis=0)
    uniforms = _uniforms(seeds.take(row), number, snr.shape[1] + 1)
    drawn = rule.proposed(snr.take(row, axis=0), sides, uniforms)
    accepted = np.flatnonzero(rule.passes(drawn, sides))
    # The first of each row.
    accepted = accepted[np.flatnonzero(np.diff(row[accepted], prepend=-1))]
    passed = np.zeros(len(tries), dtype=np.bool_)
    passed[row[accepted]] = True
    return passed, drawn[accepted]


def _uniforms(seeds: WordArray, number: IntArray, count: int) -> FloatArray:
    """Return numbers (n, count) in [0, 1) of the tries `number` (n,) of seeds (n,)."""
    uniforms = np.empty((count, len(seeds)))
    for place, column in enumerate(uniforms):
        column[:] = uniforms_of(further_words(seeds, (number * count + place).view(np.uint64)))
    return uniforms.T
