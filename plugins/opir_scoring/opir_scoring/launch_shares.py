"""Shares of launches over runs: their intervals, what they show of a required share, and curves over
time.

Launches of one run share its sensors, weather and random numbers, so runs are the units that are
independent: the exact binomial interval is that of the effective number of launches (Korn and
Graubard, Survey Methodology 24 (1998), 193). Runs of unequal numbers of launches are worth Kish's
number of equal ones. Where few runs differ from the others, their dependence is hardly known, and
the design effect is drawn towards that of full dependence.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from attrs import frozen
from scipy.special import betaincinv, stdtrit

from opir_core.arrays import BoolArray, FloatArray, IntArray

#: The level of intervals; the two tails are equal.
LEVEL = 0.95
MET, NOT_MET, NOT_SHOWN = VERDICTS = ("met", "not met", "not shown")
#: The most runs that are looked for to decide a requirement.
MAXIMUM_RUNS = 1_000_000
#: Runs of full dependence that count beside the observed ones: with none 7.7 % of the verdicts on
#: 20 runs of 100 strongly dependent launches are wrong, with one 5.5 %, with two 2.7 %.
_DEPENDENT_RUNS = 2.0


class Tails(NamedTuple):
    """The probabilities below and above an interval."""

    low: float
    high: float


#: The tails of a single 95 % interval.
TAILS_95 = Tails(0.5 * (1.0 - LEVEL), 0.5 * (1.0 - LEVEL))


@frozen
class LaunchShare:
    """The share of launches that something is true of: over `launches` of `runs`, of which
    `effective` are independent.
    """

    share: float
    launches: int
    runs: int
    effective: float

    @classmethod
    def of(cls, is_true: BoolArray, run: IntArray) -> "LaunchShare":
        """Return the share of launches (n,), with the number of the run of each (n,)."""
        _, place = np.unique(run, return_inverse=True)
        trials = np.bincount(place).astype(np.float64) if len(place) else np.zeros(0)
        successes = np.bincount(place, is_true, len(trials)).astype(np.float64)
        launches = len(is_true)
        share = float(successes.sum()) / launches if launches else np.nan
        effective = _effective_launches(share, successes, trials)
        return cls(share, launches, len(trials), effective)

    def interval(self, tails: Tails = TAILS_95) -> tuple[float, float]:
        """Return the exact binomial interval (Clopper and Pearson, Biometrika 26 (1934), 404); nan
        without launches, or where one run has several.
        """
        return _exact_interval(self.share, self.effective, tails)

    def verdict(self, required: float, tails: Tails = TAILS_95) -> str:
        """Return one of `VERDICTS` on a required share: the interval lies above, below or around
        it.
        """
        low, high = self.interval(tails)
        if low >= required:
            return MET
        return NOT_MET if high < required else NOT_SHOWN

    def deciding_runs(self, required: float, tails: Tails = TAILS_95) -> int | None:
        """Return about how many runs decide a required share, if this share stays: those that there
        are where they do; None where no number up to a million does.
        """
        if not self.effective or np.isnan(self.effective):
            return None
        a_run = self.effective / self.runs

        def decides(runs: int) -> bool:
            low, high = _exact_interval(self.share, runs * a_run, tails)
            return bool(low >= required or high < required)

        few = self.runs
        if decides(few):
            return few
        many = 2 * few
        while many <= MAXIMUM_RUNS and not decides(many):
            few, many = many, 2 * many
        if many > MAXIMUM_RUNS:
            return None
        while many - few > 1:
            middle = (few + many) // 2
            few, many = (few, middle) if decides(middle) else (middle, many)
        return many


def _effective_launches(share: float, successes: FloatArray, trials: FloatArray) -> float:
    """Return the number of independent launches that successes (k,) in trials (k,) of runs are
    worth; nan for one run of several launches.

    A share of 0 or 1 shows nothing of the dependence within runs: each run counts as one launch.
    """
    runs = len(trials)
    launches = float(trials.sum())
    if launches == runs:
        return launches
    if runs < 2:
        return np.nan
    # Runs with many launches count for most of the others (Kish, Survey Sampling (1965), 425).
    equal_runs = launches**2 / float(np.sum(np.square(trials)))
    variance = runs / (runs - 1) * np.sum(np.square(successes - share * trials)) / launches**2
    design_effect = 1.0
    if variance > 0.0:
        tail = 0.5 * (1.0 + LEVEL)
        ratio = stdtrit(launches - 1, tail) / stdtrit(max(equal_runs - 1.0, 1.0), tail)
        of_launches = share * (1.0 - share) / launches
        design_effect = max(float(variance / of_launches / ratio**2), 1.0)
    differing = min(np.count_nonzero(successes), np.count_nonzero(successes < trials))
    informative = differing * equal_runs / runs
    dependent = _DEPENDENT_RUNS * launches / equal_runs
    return launches * (informative + _DEPENDENT_RUNS) / (informative * design_effect + dependent)


def _exact_interval(share: float, launches: float, tails: Tails) -> tuple[float, float]:
    if not launches or np.isnan(launches):
        return np.nan, np.nan
    successes = share * launches
    failures = launches - successes
    low = betaincinv(successes, failures + 1.0, tails.low) if successes > 0.0 else 0.0
    high = betaincinv(successes + 1.0, failures, 1.0 - tails.high) if failures > 0.0 else 1.0
    return float(low), float(high)


def verdict_in_all(verdicts: Sequence[str]) -> str:
    """Return the verdict on a requirement in every condition, from the verdicts in each.

    Met if met in each; not met if not met in any. So "met" needs no correction for their number;
    the upper tail of each is to be divided by it.
    """
    if all(verdict == MET for verdict in verdicts):
        return MET
    return NOT_MET if NOT_MET in verdicts else NOT_SHOWN


def share_curve(
    time_s: FloatArray, run: IntArray, instants_s: FloatArray
) -> list[tuple[LaunchShare, float, float]]:
    """Return the share of launches whose time (n,) is at most each instant, with its interval;
    launches with nan do not count.
    """
    applies = ~np.isnan(time_s)
    shares = [
        LaunchShare.of(time_s[applies] <= instant_s, run[applies]) for instant_s in instants_s
    ]
    return [(share, *share.interval()) for share in shares]
