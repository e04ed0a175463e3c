"""Measurements conditional on a detection, drawn again and again until they pass a sensor's rule.

What passes first follows the law of free draws given that they pass, exactly. Rows that hardly ever pass, and those
that have not after all their tries, are drawn by the rule's own inverse, which has the same law. All numbers of a row
come from one seed of its own.
"""

from typing import Protocol

import numpy as np

from opir_core.dice import Words
from opir_core.randomness import further_words, normal_pairs, uniforms_of
from opir_core.records import BoolArray, FloatArray, IntArray

#: Rows less probable than this are inverted at once.
LEAST_PROBABLE = 1.0 / 32.0

#: Tries in one turn: so many over the probability; and turns, after which one row in exp(_TRIES · _TURNS) is left.
_TRIES, _TURNS = 1.5, 6

#: Where in a row's sequence the numbers of the inverse stand.
_INVERSE_AT = 1 << 32


class Rule(Protocol):
    """What a rule over bands does with measured signals (n, B), in standard deviations of the noise (n, B)."""

    def passes(self, measured: FloatArray, noise: FloatArray) -> BoolArray:
        """Return which measurements detect."""

    def conditional(self, snr: FloatArray, noise: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements conditional on a detection from numbers (n, B + 1) in [0, 1)."""


def measured_to_pass(
    rule: Rule, snr: FloatArray, noise: FloatArray, probability: FloatArray, seeds: Words
) -> FloatArray:
    """Return measurements (n, B) that detect, of looks that free draws detect with probabilities (n,)."""
    measured = np.empty(snr.shape)
    likely = probability >= LEAST_PROBABLE
    tries = np.ceil(_TRIES / np.where(likely, probability, 1.0)).astype(np.int64)
    left = np.flatnonzero(likely)
    for turn in range(_TURNS):
        if not len(left):
            break
        passed, drawn = _turn(rule, snr[left], noise[left], seeds[left], tries[left], turn)
        measured[left[passed]] = drawn
        left = left[~passed]
    rest = np.concatenate([np.flatnonzero(~likely), left])
    if len(rest):
        measured[rest] = rule.conditional(snr[rest], noise[rest], _uniforms(seeds[rest], snr.shape[1] + 1))
    return measured


def _turn(
    rule: Rule, snr: FloatArray, noise: FloatArray, seeds: Words, tries: IntArray, turn: int
) -> tuple[BoolArray, FloatArray]:
    """Return which rows (n,) pass in so many tries, and the first of each that does, (passed, B)."""
    ends = np.cumsum(tries)
    row = np.repeat(np.arange(len(tries)), tries)
    number = np.arange(len(row)) + np.repeat(turn * tries - (ends - tries), tries)
    drawn = snr.take(row, axis=0) + _normals(seeds.take(row), number, snr.shape[1])
    good = np.flatnonzero(rule.passes(drawn, noise.take(row, axis=0)))
    rows = row[good]
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    passed = np.zeros(len(tries), dtype=np.bool_)
    passed[rows[first]] = True
    return passed, drawn[good[first]]


def _normals(seeds: Words, number: IntArray, bands: int) -> FloatArray:
    """Return standard normal numbers (n, bands) of tries with these numbers (n,)."""
    normals, words = np.empty((bands, len(seeds))), (bands + 1) // 2
    for word in range(words):
        raw = further_words(seeds, (number * words + word).view(np.uint64))
        normals[2 * word : 2 * word + 2] = normal_pairs(raw)[: bands - 2 * word]
    return normals.T


def _uniforms(seeds: Words, count: int) -> FloatArray:
    numbers = [np.full(len(seeds), _INVERSE_AT + each, dtype=np.uint64) for each in range(count)]
    return np.stack([uniforms_of(further_words(seeds, number)) for number in numbers], axis=1)
