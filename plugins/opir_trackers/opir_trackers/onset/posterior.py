"""Probabilities of the groups of hypotheses of tracks, by marginal likelihoods of their lines of
sight.

The likelihood of lines under a Gaussian prior of the motion is a closed form of the motion
statistics; all groups are compared in one measurement space, the angles of the lines. False alarms
are as dense as the sensors state, others as dense as their errors make them (track score after
Blackman and Popoli, "Design and Analysis of Modern Tracking Systems", 1999, 6.2).
"""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.configs import HypothesesConfig
from opir_trackers.onset.motion_priors import AGES_S, LOG_IN_VIEW, MotionPriors, none_per_day
from opir_trackers.onset.motion_statistics import (
    ASKED_AGAIN_S,
    GROUND,
    LAUNCH,
    NOISE,
    MotionStatistics,
)

#: A track is decided once ground and noise together are less probable than the first and a launch
#: more than the second.
RARE = 1e-4
SURE = 0.999

#: Scan periods without a detection after which what shone has gone out.
GONE_SCANS = 5.0

#: A silence longer than this, s, in the first lines is no look or two that were missed; notional.
#: Nor is a shorter one that is as improbable as the second, by the lines so far.
DARK_S = 3.0
LOG_CHANCE = float(np.log(1e-3))

#: Log of the share of launches that are hidden for so long, behind edges of clouds; notional.
LOG_DARK_LAUNCH = float(np.log(0.01))


@frozen
class DecisionLaw:
    """When tracks are decided and assessed."""

    #: A ground source is decided after one horizon, once P(launch) is below this: 1/1000 of the
    #: prior. Of fires it is 1e-9 by then, of real space launches seen by scanners of 10 s it was at
    #: least 4e-5.
    no_launch: float = 1e-6

    #: All else is decided after this number of horizons, where a line has 1/257 of its weight.
    horizons: float = 2.0

    #: Odds of a launch from the place of a ground source, while it is watched: of one launch a day,
    #: in 40 s, within 1 km somewhere in view, 5e-12; far above, so that a source that hid a launch
    #: may still become one.
    same_place: float = 1e-9

    #: Mean time of a burn, s, notional.
    burn_s: float = 100.0

    #: What was first seen longer ago than this, s, and is less probably a launch than before is
    #: assessed again after the second time, s: fires, which are many. Slow launches are by then
    #: more probable: they are recognised no later for it.
    young_s: float = 20.0
    again_s: float = 5.0


LAW = DecisionLaw()


def standing(statistics: MotionStatistics) -> BoolArray:
    """Return which tracks (n,) are where their lines say that they stand, whatever the filter says."""
    decided = statistics.is_decided & statistics.stands
    return decided | statistics.stand_among_others(RARE)


def log_silence(lines: FloatArray, lit_s: FloatArray, silent_s: FloatArray) -> FloatArray:
    """Return the log probabilities (n,) of a silence of what has given lines in times `lit_s`, s.

    The lines of what shines on are a Poisson process; its rate has the Gamma posterior of the lines.
    """
    return -lines * np.log1p(silent_s / lit_s)


@frozen(eq=False)
class GroupPosterior:
    """The probabilities of groups under a tracker's settings.

    `log_clutter` (sensors,) is the log density of false alarms, per scan and steradian, over the
    detection probability; -inf for none.
    """

    priors: tuple[MotionPriors, ...]
    log_rate: FloatArray
    bolide_s: float
    log_clutter: FloatArray

    @classmethod
    def of(
        cls,
        config: HypothesesConfig,
        clutter_per_sr: FloatArray,
        detection_probability: FloatArray,
        rates: Mapping[str, float] | None = None,
    ) -> "GroupPosterior":
        """Return the posterior for clutter densities (sensors,), per scan, detection probabilities
        (sensors,) and rates, 1/day, by default those of the settings.
        """
        rates = rates or config.rates()
        per_day = [
            rates["ground_sources_per_day"],
            rates["bolides_per_day"],
            rates["launches_per_day"],
            none_per_day(rates),
        ]
        priors = MotionPriors.of(config, rates)
        with np.errstate(divide="ignore"):
            return cls(
                priors=(priors, *(priors.at(age_s) for age_s in AGES_S[1:].tolist())),
                log_rate=np.log(np.array(per_day) / 86400.0),
                bolide_s=config.bolide_s,
                log_clutter=np.log(clutter_per_sr / detection_probability),
            )

    @property
    def launches_per_ground_source(self) -> float:
        """The rate of launches over that of ground sources, at most 1."""
        return float(np.exp(min(self.log_rate[LAUNCH - GROUND] - self.log_rate[0], 0.0)))

    @property
    def prior(self) -> FloatArray:
        """The probabilities (5,) of the groups before the first line, of what is no noise."""
        share = np.exp(self.log_rate)
        return np.append(0.0, share / share.sum())

    def assessed(
        self,
        statistics: MotionStatistics,
        time_s: float,
        first_s: FloatArray,
        seen_s: FloatArray,
        pause_s: FloatArray,
        step_s: float = 1.0,
        silent_s: FloatArray | None = None,
        is_rocket: BoolArray | None = None,
    ) -> MotionStatistics:
        """Return the statistics with new probabilities of the undecided tracks at a time, a step
        after the last one; and of decided launches that are asked again, unless they move as only
        rockets do (n,).

        `first_s` and `seen_s` (n,) are the times of the first and the last detection, `pause_s`
        (n,) the longest scan period of the sensors that see the track, `silent_s` (n,) for how long
        they looked since the last detection, by default throughout. What has been seen for long,
        still is, and is less probably a launch than before the first line is assessed now and then,
        and what has begun anew since the last detection with its next one: no line is no noise.
        Lines that are not of one motion say nothing of it: these statistics begin anew. So do those
        of a source that is still seen and likeliest stands, but may be a launch.
        """
        silent_s = time_s - seen_s if silent_s is None else silent_s
        is_seen = silent_s < pause_s + step_s
        waits = is_seen & self._wait(statistics, time_s - first_s, time_s - step_s - first_s)
        again = _asked_again(statistics, time_s, step_s) & is_seen
        if is_rocket is not None:
            again &= ~is_rocket
        waits |= statistics.epoch_s > seen_s
        rows = ((~statistics.is_decided & ~waits) | again).nonzero()[0]
        if not len(rows):
            return statistics
        open_tracks = statistics.part(rows)
        bright_s = np.maximum(seen_s[rows] - open_tracks.epoch_s, 0.0)
        gone = silent_s[rows] > GONE_SCANS * pause_s[rows]
        result = self.probabilities(open_tracks, bright_s, pause_s[rows], gone)
        is_decided, restarts = _decisions(open_tracks, result, time_s, is_seen[rows])
        # What no motion explains is no reason to doubt a launch: its lines may be those of others.
        remains = again[rows] & (restarts | (result[:, LAUNCH] > 0.5))
        result[remains] = statistics.probability[rows[remains]]
        statistics = _with_decisions(statistics, rows, result, is_decided | remains)
        restarts &= ~remains
        if not restarts.any():
            return statistics
        begun = rows[restarts]
        carried = statistics.carried.copy()
        carried[begun] = self._carried(result[restarts])
        return evolve(statistics, carried=carried).restarted(begun, time_s)

    def _wait(
        self, statistics: MotionStatistics, age_s: FloatArray, age_before_s: FloatArray
    ) -> BoolArray:
        """Return which tracks (n,) are improbable launches at ages (n,), s, that are not those of a
        new assessment; what stands among others is assessed as seldom from the beginning.
        """
        improbable = statistics.probability[:, LAUNCH] < self.prior[LAUNCH]
        same = np.floor(age_s / LAW.again_s) == np.floor(age_before_s / LAW.again_s)
        stand = statistics.stand_among_others(RARE)
        return improbable & ((age_s > LAW.young_s) | stand) & same

    def _carried(self, probability: FloatArray) -> FloatArray:
        """Return what statistics (n,) that begin anew keep of probabilities (n, 5): log likelihood
        ratios (n, 5) of the groups to a ground source, where that is the likeliest.

        What stood for a horizon has not become a launch since, but for one from the same place: that
        is as rare as `LAW.same_place`. False alarms are judged anew.
        """
        prior = np.maximum(self.prior, LAW.same_place)
        log = np.log(np.maximum(probability / prior, LAW.same_place))
        log = np.clip(log - log[:, [GROUND]], np.log(LAW.same_place), 0.0)
        log[:, NOISE] = 0.0
        return np.where((probability.argmax(axis=1) == GROUND)[:, None], log, 0.0)

    def _log_evidence(self, statistics: MotionStatistics, age_s: FloatArray) -> FloatArray:
        """Return the evidence (n, c) of the lines of tracks for the priors at their ages (n,), s, up
        to the horizon: of later lines a cubic says nothing.

        One sensor alone sees neither height nor climb, which aircraft are known by.
        """
        alone = statistics.lack_range
        told_s = np.where(alone, 0.0, np.minimum(age_s, statistics.horizon_s()))
        number = AGES_S.searchsorted(told_s, side="right") - 1
        if len(number) == 1:
            result = log_evidence(self.priors[int(number[0])], statistics)
        else:
            result = np.empty((len(number), len(self.priors[0].group)))
            for age in np.unique(number).tolist():
                rows = (number == age).nonzero()[0]
                result[rows] = log_evidence(self.priors[age], statistics.take(rows))
        result[alone[:, None] & self.priors[0].needs_height] = -np.inf
        return result

    def _log_densities(self, evidence: FloatArray) -> FloatArray:
        """Return the log densities (n, 5) of the groups by the evidence of their motions; that of
        noise is not set.
        """
        log = np.empty((len(evidence), 1 + len(self.log_rate)))
        for group in range(GROUND, log.shape[1]):
            of_group = evidence[:, self.priors[0].group == group]
            log[:, group] = np.logaddexp.reduce(of_group, axis=1) + self.log_rate[group - GROUND]
        return log

    def probabilities(
        self, statistics: MotionStatistics, age_s: FloatArray, pause_s: FloatArray, gone: BoolArray
    ) -> FloatArray:
        """Return the probabilities (n, 5) of the groups; `gone` (n,) tracks are no longer seen.

        Light that lasts for a mean time T goes out at an age t with the density exp(-t / T) / T. So
        a launch that goes out as soon as it is seen is as much less probable than a bolide as its
        burn is longer.
        """
        evidence = self._log_evidence(statistics, age_s) + self.priors[0].log_weights(
            pause_s, age_s
        )
        log = self._log_densities(evidence)
        log[:, NOISE] = statistics.noise_log - np.log(pause_s) - LOG_IN_VIEW
        log += statistics.carried
        log[gone, LAUNCH] += min(np.log(self.bolide_s / LAW.burn_s), 0.0)
        share = np.exp(log - log.max(axis=1, keepdims=True))
        return share / share.sum(axis=1, keepdims=True)


def _asked_again(statistics: MotionStatistics, time_s: float, step_s: float) -> BoolArray:
    """Return which decided launches (n,) have come to an age at which they are asked again."""
    age_s = time_s - statistics.epoch_s
    is_due = np.zeros(len(age_s), dtype=np.bool_)
    for mark_s in ASKED_AGAIN_S:
        is_due |= (age_s >= mark_s) & (age_s - step_s < mark_s)
    return is_due & statistics.are_launches(time_s)


def _with_decisions(
    statistics: MotionStatistics, rows: IntArray, result: FloatArray, is_decided: BoolArray
) -> MotionStatistics:
    """Return the statistics with probabilities (k, 5) of some rows, and which are decided."""
    probability = statistics.probability.copy()
    decided = statistics.is_decided.copy()
    probability[rows] = result
    decided[rows] = is_decided
    return evolve(statistics, probability=probability, is_decided=decided)


def _decisions(
    statistics: MotionStatistics, probability: FloatArray, time_s: float, is_seen: BoolArray
) -> tuple[BoolArray, BoolArray]:
    """Return which tracks (n,) are decided by probabilities (n, 5), and whose statistics begin
    anew.

    The track of a ground source has a narrow gate: a launch that was decided to be one would leave
    it.
    """
    still = probability[:, GROUND] + probability[:, NOISE]
    launched = (still < RARE) & (probability[:, LAUNCH] > SURE)
    horizons = (time_s - statistics.epoch_s) / statistics.horizon_s()
    stands = probability.argmax(axis=1) == GROUND
    no_launch = probability[:, LAUNCH] < LAW.no_launch
    over = horizons > LAW.horizons
    restarts = statistics.are_unlike_any_motion() | (over & stands & ~no_launch & is_seen)
    decided = launched | np.where(stands, no_launch & (horizons > 1.0), over)
    return decided & ~restarts, restarts


def log_evidence(priors: MotionPriors, statistics: MotionStatistics) -> FloatArray:
    """Return log marginal likelihoods (n, c) of the lines of tracks under each prior.

    They are relative to the product of the likelihoods of lines without error. With information J,
    pull b and misfit s of the lines and a prior m + S z: A = I + Sᵀ J S, v = Sᵀ (b - J m), and -2
    log L = log det A + s - 2 mᵀ b + mᵀ J m - vᵀ A⁻¹ v. Determinant and form come from one Cholesky
    factor, of A bordered by v.
    """
    motions = statistics.of_motion()
    starts = range(0, max(len(statistics), 1), _BLOCK_TRACKS)
    blocks = [[column[start : start + _BLOCK_TRACKS] for column in motions] for start in starts]
    return np.concatenate([_log_evidence(priors, *block) for block in blocks])


#: Tracks whose evidence is computed together: a matrix for each prior takes memory.
_BLOCK_TRACKS = 16


def _log_evidence(
    priors: MotionPriors, information: FloatArray, pull: FloatArray, misfit: FloatArray
) -> FloatArray:
    """Return log marginal likelihoods (n, c) of lines with information, pull and misfit."""
    mean = priors.mean
    off = pull[:, :, None] - information @ mean.T
    least = misfit[:, None] - np.sum(mean.T * (pull[:, :, None] + off), axis=1)
    size = mean.shape[1]
    factor = np.linalg.cholesky(_bordered(priors.root, information, off, least))
    pivots = np.diagonal(factor, axis1=2, axis2=3)
    log_determinant = -np.log(pivots[:, :, :size]).sum(axis=2)
    return log_determinant - 0.5 * (np.square(pivots[:, :, size]) - 1.0)


def _bordered(
    root: FloatArray, information: FloatArray, off: FloatArray, least: FloatArray
) -> FloatArray:
    """Return A = I + Sᵀ J S (n, c, 12, 12), bordered by v = Sᵀ (b - J m) and `least` + 1."""
    count, kinds = least.shape
    size = root.shape[1]
    turned = root.mT
    bordered = np.empty((count, kinds, size + 1, size + 1))
    bordered[:, :, :size, :size] = (turned @ information[:, None]) @ root + np.eye(size)
    border = (turned @ off.mT[..., None])[..., 0]
    bordered[:, :, size, :size] = border
    bordered[:, :, :size, size] = border
    bordered[:, :, size, size] = least + 1.0
    return bordered
