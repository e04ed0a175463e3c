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

#: Largest argument at which a normal tail is a double of full precision.
_PLAIN = 36.0
_LEAST_LEVEL = 2.0**-54


def tail_normals(lower: FloatArray, uniforms: FloatArray) -> FloatArray:
    """Return standard normal numbers (n,) conditional on being at least `lower`, from numbers (n,)
    in [0, 1).

    As `truncated_normals` without an upper bound, in a third of the time.
    """
    drawn: FloatArray = np.maximum(-ndtri(np.maximum(uniforms, _LEAST_LEVEL) * ndtr(-lower)), lower)
    far = np.flatnonzero(lower > _PLAIN)
    if len(far):
        drawn[far] = truncated_normals(lower[far], np.full(len(far), np.inf), uniforms[far])
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

#: Tries per round times the acceptance rate, and rounds; one row in exp(_TRIES · _TURNS) is left
#: after all.
_TRIES = 0.75
_TURNS = 24

#: Most proposals at once.
_MOST_AT_ONCE = 1 << 15

#: First number of the inverse in a row's sequence.
_INVERSE_AT = 1 << 32


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
    left = np.flatnonzero(~rule.passes(measured, slopes))
    if len(left):
        again = snr[left], slopes[left], probability[left], seeds[left]
        measured[left] = _until_one_passes(rule, *again)
    return measured


def _until_one_passes(
    rule: Rule, snr: FloatArray, slopes: FloatArray, probability: FloatArray, seeds: WordArray
) -> FloatArray:
    """Return measurements (n, B) that detect, for looks with a rejected first proposal."""
    measured = np.empty(snr.shape)
    share = rule.passing(snr, probability)
    likely = share >= LEAST_PASSING
    tries = np.ceil(_TRIES / np.where(likely, share, 1.0)).astype(np.int64)
    left = np.flatnonzero(likely)
    for turn in range(_TURNS):
        missed = [left[:0]]
        for part in _portions(left, tries):
            passed, drawn = _turn(rule, snr[part], slopes[part], seeds[part], tries[part], turn)
            measured[part[passed]] = drawn
            missed.append(part[~passed])
        left = np.concatenate(missed)
        if not len(left):
            break
    rest = np.concatenate([np.flatnonzero(~likely), left])
    if len(rest):
        uniforms = _uniforms(seeds[rest], np.full(len(rest), _INVERSE_AT), snr.shape[1] + 1)
        measured[rest] = rule.conditional(snr[rest], slopes[rest], uniforms)
    return measured


def _portions(rows: IntArray, tries: IntArray) -> list[IntArray]:
    """Return rows divided into portions of about `_MOST_AT_ONCE` tries."""
    ends = np.cumsum(tries[rows])
    edges = np.searchsorted(
        ends, np.arange(_MOST_AT_ONCE, ends[-1] if len(ends) else 0, _MOST_AT_ONCE)
    )
    return [part for part in np.split(rows, np.unique(edges)) if len(part)]


def _turn(
    rule: Rule, snr: FloatArray, slopes: FloatArray, seeds: WordArray, tries: IntArray, turn: int
) -> tuple[BoolArray, FloatArray]:
    """Return which rows (n,) pass within their `tries`, and the first passing proposal of each,
    (passed, B).
    """
    ends = np.cumsum(tries)
    row = np.repeat(np.arange(len(tries)), tries)
    number = np.arange(len(row)) + np.repeat(1 + turn * tries - (ends - tries), tries)
    sides = slopes.take(row, axis=0)
    drawn = rule.proposed(
        snr.take(row, axis=0), sides, _uniforms(seeds.take(row), number, snr.shape[1] + 1)
    )
    good = np.flatnonzero(rule.passes(drawn, sides))
    rows = row[good]
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    passed = np.zeros(len(tries), dtype=np.bool_)
    passed[rows[first]] = True
    return passed, drawn[good[first]]


def _uniforms(seeds: WordArray, number: IntArray, count: int) -> FloatArray:
    """Return numbers (n, count) in [0, 1) of the tries `number` (n,) of seeds (n,)."""
    uniforms = np.empty((count, len(seeds)))
    for each in range(count):
        uniforms[each] = uniforms_of(further_words(seeds, (number * count + each).view(np.uint64)))
    return uniforms.T
