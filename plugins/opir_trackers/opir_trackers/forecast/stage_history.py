"""The stages that each track has shown: ignitions, burnouts and their figures, kept from tick to
tick.

A stage ends in the dark, when the filter says that the burn is over, or hot, when its mode
`staging` wins and the force has dropped: a smaller engine pushes what is left. A force that changes
by less, or rises, is a throttled engine.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import dot
from opir_core.interfaces import Columns
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.thrust import air_velocity
from opir_trackers.forecast.vehicles import BURN, FAMILIES, FORCE, GAP, NONE, RATIO, STAGES

#: A hot stage begins with at most this share of the force before.
DROP = 0.75

#: Least burn of a stage, s: what seems shorter belongs to the same stage.
LEAST_BURN_S = 12.0

#: Standard deviations of an ignition, s: after a gap, in hot staging, of a track without a launch.
RELIT_S = 0.7
STAGED_S = 2.0
UNKNOWN_S = 30.0

#: Staging that is less, and more probable than this: a steady burn, and a new stage.
_STEADY = 0.2
_STAGED = 0.5

#: The filter's greatest prior probability of thrust in any direction, that from which it counts as
#: one, and the share of what is none of these that thrusts so. Notional.
_FREE_PRIOR = 0.1
_FREE = 0.5
_FREE_SHARE = 0.5

#: Longest silence, s, after which an estimate still shows the burn.
_FRESH_S = 1.5


@frozen(eq=False, repr=False)
class StageHistory(Columns):
    """What is known of the stages of tracks (n,).

    `logs` (n, STAGES, 4) are the rows of `vehicles` of the stages that are over, nan where unknown.
    `ignition_s` is that of the last one with its error, `dark_since_s` its burnout, inf while it
    burns. `force` m/s² along the velocity and `growth` 1/s are those at `steady_s`, the last time
    of a steady burn; `staging` is the latest probability of staging. `free_odds` is the greatest
    ratio so far of the odds of thrust in another direction than along the velocity to their prior,
    1 where it never was probable.
    """

    number: IntArray
    logs: FloatArray
    ignition_s: FloatArray
    ignition_sigma_s: FloatArray
    dark_since_s: FloatArray
    force: FloatArray
    growth: FloatArray
    steady_s: FloatArray
    staging: FloatArray
    free_odds: FloatArray

    @classmethod
    def begun(cls, number: IntArray, tick_s: float) -> "StageHistory":
        """Return the histories of new tracks at a time."""
        count = len(number)
        now = np.full(count, tick_s)
        unknown = np.full(count, np.nan)
        logs = np.full((count, STAGES, 4), np.nan)
        sigma = np.full(count, UNKNOWN_S)
        dark = np.full(count, np.inf)
        return cls(
            number,
            logs,
            now - 5.0,
            sigma,
            dark,
            unknown,
            unknown.copy(),
            now,
            np.zeros(count),
            np.ones(count),
        )

    @property
    def done(self) -> IntArray:
        """Return the number of stages (n,) that are over."""
        return np.sum(np.isfinite(self.logs[:, :, BURN]), axis=1)

    @property
    def is_dark(self) -> BoolArray:
        """Return of which tracks (n,) the last stage is over."""
        dark: BoolArray = np.isfinite(self.dark_since_s)
        return dark

    @property
    def launch_s(self) -> FloatArray:
        """Return the times (n,) of the first ignitions, s: the last stage's, less the burns and
        gaps before it.
        """
        burn = self.logs[:, :, BURN]
        gap = self.logs[:, :, GAP]
        before = np.sum(np.exp(np.where(np.isnan(burn), -np.inf, burn)), axis=1)
        before += np.sum(np.exp(np.where(np.isnan(gap), -np.inf, gap)), axis=1)
        start: FloatArray = np.where(self.is_dark, self.dark_since_s, self.ignition_s) - before
        return start

    @property
    def log_free(self) -> FloatArray:
        """Return what free burns add to the log evidence (n, families): they are none of these."""
        log = np.zeros((len(self.number), len(FAMILIES)))
        log[:, NONE] = np.log(1.0 - _FREE_SHARE + _FREE_SHARE * self.free_odds)
        return log

    def of(self, number: IntArray, tick_s: float) -> "StageHistory":
        """Return the histories of tracks with these numbers, in this order; unknown ones are
        new.
        """
        if len(self.number) == len(number) and not np.count_nonzero(self.number != number):
            return self
        row = np.searchsorted(self.number, number)
        row = np.minimum(row, max(len(self.number) - 1, 0))
        known = (
            self.number[row] == number
            if len(self.number)
            else np.zeros(len(number), dtype=np.bool_)
        )
        fresh = StageHistory.begun(number[~known], tick_s)
        both = StageHistory.concatenate([self.take(row[known]), fresh])
        return both.take(
            np.argsort(np.concatenate([np.flatnonzero(known), np.flatnonzero(~known)]))
        )

    def with_end(
        self, rows: IntArray, end_s: FloatArray, gap_log: float = np.nan
    ) -> "StageHistory":
        """Return the histories with the present stages of some rows over at times (m,)."""
        rows_ = rows[self.done[rows] < STAGES]
        end_s = end_s[self.done[rows] < STAGES]
        logs = self.logs.copy()
        stage = self.done[rows_]
        burn = np.maximum(end_s - self.ignition_s[rows_], 1.0)
        since = np.clip(self.steady_s[rows_] - self.ignition_s[rows_], 0.0, burn)
        force = self.force[rows_]
        growth = self.growth[rows_]
        first = force / np.maximum(1.0 + growth * since, 0.1)
        last = force / np.maximum(1.0 - growth * (burn - since), 0.3)
        logs[rows_, stage, BURN] = np.log(burn)
        logs[rows_, stage, FORCE] = np.log(np.maximum(first, 1.0))
        logs[rows_, stage, RATIO] = np.log(np.maximum(last, 1.0) / np.maximum(first, 1.0))
        logs[rows_, stage, GAP] = gap_log
        return evolve(self, logs=logs)

    def updated(
        self,
        estimates: ModeEstimates,
        launch_s: FloatArray,
        launch_sigma_s: FloatArray,
        tick_s: float,
    ) -> "StageHistory":
        """Return the histories after a tick, of the same tracks, given their estimates and launch
        times, nan unknown."""
        hits, spell, silent_s = estimates.detection_rate.T
        pause_s = spell / np.maximum(hits, 1.0)
        burning = estimates.weight[:, 0] > 0.5
        staging = estimates.burn_share[:, 1]
        force = force_along(estimates.burn_mean[:, 0])
        then = self._with_launches(burning, launch_s, launch_sigma_s)
        lit = burning & then.is_dark
        if np.count_nonzero(lit):
            then = then._relit(lit, tick_s, pause_s)
        staged = burning & (self.staging > _STAGED) & (staging < _STEADY)
        if np.count_nonzero(staged):
            long = then.steady_s - then.ignition_s > LEAST_BURN_S
            then = then._staged(staged & long & (force < DROP * self.force))
        steady = burning & (staging < _STEADY) & (silent_s < np.maximum(_FRESH_S, 3.0 * pause_s))
        then = StageHistory(
            then.number,
            then.logs,
            then.ignition_s,
            then.ignition_sigma_s,
            then.dark_since_s,
            np.where(steady, force, then.force),
            np.where(steady, estimates.burn_mean[:, 0, 9], then.growth),
            np.where(steady, tick_s, then.steady_s),
            staging,
            np.maximum(then.free_odds, _free_odds(burning, estimates.burn_share[:, 2])),
        )
        out = (~burning & ~then.is_dark).nonzero()[0]
        if not len(out):
            return then
        since_s = then.dark_since_s.copy()
        since_s[out] = tick_s - np.maximum(silent_s - pause_s, 0.0)[out]
        return evolve(then.with_end(out, since_s[out]), dark_since_s=since_s)

    def _with_launches(
        self, burning: BoolArray, launch_s: FloatArray, sigma_s: FloatArray
    ) -> "StageHistory":
        first = burning & np.isnan(self.logs[:, 0, BURN]) & np.isfinite(launch_s)
        if not np.count_nonzero(first):
            return self
        sigma = np.where(first, np.maximum(np.nan_to_num(sigma_s), 0.3), self.ignition_sigma_s)
        return evolve(
            self, ignition_s=np.where(first, launch_s, self.ignition_s), ignition_sigma_s=sigma
        )

    def _relit(self, lit: BoolArray, tick_s: float, pause_s: FloatArray) -> "StageHistory":
        """Return the histories with those that burn again after a gap, or that a silence had
        misled.
        """
        rows = np.flatnonzero(lit)
        if not len(rows):
            return self
        logs = self.logs.copy()
        ignition = self.ignition_s.copy()
        sigma = self.ignition_sigma_s.copy()
        dark = self.dark_since_s.copy()
        last = self.done[rows] - 1
        gap = tick_s - 0.5 - self.dark_since_s[rows]
        real = (gap > 1.0 + 3.0 * pause_s[rows]) & (last >= 0) & (last < STAGES - 1)
        logs[rows[real], last[real], GAP] = np.log(gap[real])
        ignition[rows[real]] = tick_s - 0.5
        sigma[rows[real]] = RELIT_S
        logs[rows[~real], last[~real]] = np.nan
        dark[rows] = np.inf
        return evolve(
            self, logs=logs, ignition_s=ignition, ignition_sigma_s=sigma, dark_since_s=dark
        )

    def _staged(self, staged: BoolArray) -> "StageHistory":
        rows = np.flatnonzero(staged & (self.done < STAGES - 1))
        if not len(rows):
            return self
        end_s = self.steady_s[rows] + 1.0
        then = self.with_end(rows, end_s, -np.inf)
        ignition = then.ignition_s.copy()
        sigma = then.ignition_sigma_s.copy()
        ignition[rows] = end_s
        sigma[rows] = STAGED_S
        return evolve(then, ignition_s=ignition, ignition_sigma_s=sigma)

    def as_burning(self) -> "StageHistory":
        """Return the histories if the last stage still burns."""
        dark = np.flatnonzero(self.is_dark)
        if not len(dark):
            return self
        logs = self.logs.copy()
        logs[dark, self.done[dark] - 1] = np.nan
        return evolve(self, logs=logs)

    def as_staging(self, estimates: ModeEstimates) -> tuple["StageHistory", BoolArray]:
        """Return burning histories if a stage begins now, and which of them (n,) it is: others go
        on as they are.
        """
        since_s = self.steady_s - self.ignition_s
        begins = (since_s > LEAST_BURN_S) & (self.done < STAGES - 1) & np.isfinite(self.force)
        begins &= force_along(estimates.burn_mean[:, 1]) < DROP * self.force
        return self._staged(begins), begins

    def as_dark(self, tick_s: float, dark_s: FloatArray) -> "StageHistory":
        """Return the histories if the last stage is over, since a time (n,) if it was thought to
        burn.
        """
        on = np.flatnonzero(~self.is_dark)
        if not len(on):
            return self
        since_s = self.dark_since_s.copy()
        since_s[on] = tick_s - dark_s[on]
        return evolve(self.with_end(on, since_s[on]), dark_since_s=since_s)


def _free_odds(burning: BoolArray, share: FloatArray) -> FloatArray:
    """Return the ratios (n,) of the odds of shares of a free burn to their prior odds, 1 for what
    is not probable.
    """
    odds = share / np.maximum(1.0 - share, 1e-6) * (1.0 - _FREE_PRIOR) / _FREE_PRIOR
    return np.where(burning & (share > _FREE), odds, 1.0)


def force_along(state: FloatArray) -> FloatArray:
    """Return the specific force (n,), m/s², along the velocity through the air of states (n,
    10).
    """
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity) + 1.0)
    along: FloatArray = dot(velocity, state[:, 6:9]) / speed
    return along
