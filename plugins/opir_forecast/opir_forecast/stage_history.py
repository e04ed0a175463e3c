"""The stages of each track so far: ignitions, burnouts and their figures, kept from tick to tick.

A stage ends in the dark, when the filter says that the burn is over, or hot, when its mode
`staging` wins and the force has dropped: a smaller engine pushes the remaining vehicle. A force
that changes by less, or rises, is a throttled engine.
"""

from typing import Any

import numpy as np
from attrs import evolve, frozen
from opir_estimation import air_velocity, dot

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns
from opir_forecast.estimates import BoostEstimates
from opir_forecast.vehicles import (
    BURN,
    FAMILIES,
    GAP,
    LAW,
    NONE,
    STAGES,
)


@frozen(eq=False, repr=False)
class StageHistory(Columns):
    """The stages of tracks (n,) so far.

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
        return cls(
            number,
            logs=np.full((count, STAGES, 4), np.nan),
            ignition_s=np.full(count, tick_s - 5.0),
            ignition_sigma_s=np.full(count, LAW.unknown_s),
            dark_since_s=np.full(count, np.inf),
            force=np.full(count, np.nan),
            growth=np.full(count, np.nan),
            steady_s=np.full(count, tick_s),
            staging=np.zeros(count),
            free_odds=np.ones(count),
        )

    @property
    def done(self) -> IntArray:
        """Return the number of stages (n,) that are over."""
        return np.add.reduce(np.isfinite(self.logs[:, :, BURN]), axis=1)

    @property
    def is_dark(self) -> BoolArray:
        """Whether the last stage of each track (n,) is over."""
        return np.isfinite(self.dark_since_s)

    @property
    def launch_s(self) -> FloatArray:
        """Return the times (n,) of the first ignitions, s: the last stage's, less the burns and
        gaps before it.
        """
        burn_s, gap_s = (
            np.sum(np.exp(np.where(np.isnan(log), -np.inf, log)), axis=1)
            for log in (self.logs[:, :, BURN], self.logs[:, :, GAP])
        )
        latest_s = np.where(self.is_dark, self.dark_since_s, self.ignition_s)
        return latest_s - (burn_s + gap_s)

    @property
    def log_free(self) -> FloatArray:
        """Return the change of the log evidence (n, families) by free burns, which favour `none`."""
        log = np.zeros((len(self), len(FAMILIES)))
        log[:, NONE] = np.log(1.0 - LAW.free_share + LAW.free_share * self.free_odds)
        return log

    def with_end(
        self, rows: IntArray, end_s: FloatArray, gap_log: float = np.nan
    ) -> "StageHistory":
        """Return the histories with the present stages of some rows over at times (m,)."""
        has_room = self.done[rows] < STAGES
        rows = rows[has_room]
        stage = self.done[rows]
        burn = np.maximum(end_s[has_room] - self.ignition_s[rows], 1.0)
        since = np.clip(self.steady_s[rows] - self.ignition_s[rows], 0.0, burn)
        figures = _stage_figures(burn, since, self.force[rows], self.growth[rows])
        logs = self.logs.copy()
        logs[rows, stage] = np.stack([*np.log(figures), np.full(len(rows), gap_log)], axis=1)
        return evolve(self, logs=logs)

    def updated(self, estimates: BoostEstimates, tick_s: float) -> "StageHistory":
        """Return the histories after a tick, of the same tracks, given their estimates."""
        silent_s = estimates.silent_s
        pause_s = estimates.pause_s
        burning = estimates.burning > 0.5
        staging = estimates.burn_share[:, 1]
        force = force_along(estimates.burn_mean[:, 0])
        history = self._with_launches(burning, estimates)
        history = history._relit(burning & history.is_dark, tick_s - 0.5, pause_s)
        history = history._with_hot_ends(burning, staging, force)
        is_recent = silent_s < np.maximum(LAW.recent_s, 3.0 * pause_s)
        steady = burning & (staging < LAW.steady) & is_recent
        history = history._with_burn(steady, force, estimates, tick_s)
        burnout_s = tick_s - np.maximum(silent_s - pause_s, 0.0)
        return history._dark_since(~burning & ~history.is_dark, burnout_s)

    def _with_hot_ends(
        self, burning: BoolArray, staging: FloatArray, force: FloatArray
    ) -> "StageHistory":
        """Return the histories with another stage where staging is over, and the force has dropped."""
        has_staged = burning & (self.staging > LAW.staged) & (staging < LAW.steady)
        is_long = self.steady_s - self.ignition_s > LAW.least_burn_s
        return self._staged(has_staged & is_long & (force < LAW.drop * self.force))

    def _with_burn(
        self, steady: BoolArray, force: FloatArray, estimates: BoostEstimates, tick_s: float
    ) -> "StageHistory":
        """Return the histories with the present forces where burns are steady."""
        free_odds = _free_odds(estimates.burning > 0.5, estimates.burn_share[:, 2])
        return StageHistory(
            self.number,
            self.logs,
            self.ignition_s,
            self.ignition_sigma_s,
            self.dark_since_s,
            np.where(steady, force, self.force),
            np.where(steady, estimates.burn_mean[:, 0, 9], self.growth),
            np.where(steady, tick_s, self.steady_s),
            estimates.burn_share[:, 1],
            np.maximum(self.free_odds, free_odds),
        )

    def _dark_since(self, ended: BoolArray, time_s: FloatArray) -> "StageHistory":
        """Return the histories with the last stages of some over since times (n,)."""
        rows = ended.nonzero()[0]
        if not rows.size:
            return self
        since_s = self.dark_since_s.copy()
        since_s[rows] = time_s[rows]
        return evolve(self.with_end(rows, since_s[rows]), dark_since_s=since_s)

    def _with_launches(self, burning: BoolArray, estimates: BoostEstimates) -> "StageHistory":
        """Return the histories whose first stages ignited at the launch, where that is known."""
        launch_s = estimates.launch[:, 2]
        is_launch = burning & np.isnan(self.logs[:, 0, BURN]) & np.isfinite(launch_s)
        if True not in is_launch:
            return self
        # An unknown error counts as none.
        sigma_s = np.fmax(np.sqrt(estimates.launch_covariance[:, 2, 2]), 0.3)
        return self._with_ignitions(
            np.where(is_launch, launch_s, self.ignition_s),
            np.where(is_launch, sigma_s, self.ignition_sigma_s),
        )

    def _with_ignitions(self, time_s: FloatArray, sigma_s: FloatArray) -> "StageHistory":
        """Return the histories with the last ignitions at times (n,), with their errors."""
        return StageHistory(
            self.number,
            self.logs,
            time_s,
            sigma_s,
            self.dark_since_s,
            self.force,
            self.growth,
            self.steady_s,
            self.staging,
            self.free_odds,
        )

    def _ignited(self, rows: IntArray, time_s: Any, sigma_s: float) -> "StageHistory":
        """Return the histories with the last ignitions of some rows at a time, with its error."""
        ignition = self.ignition_s.copy()
        sigma = self.ignition_sigma_s.copy()
        ignition[rows] = time_s
        sigma[rows] = sigma_s
        return self._with_ignitions(ignition, sigma)

    def _relit(self, lit: BoolArray, time_s: float, pause_s: FloatArray) -> "StageHistory":
        """Return the histories with those that burn again after a gap, since a time, or that a
        silence had misled.
        """
        rows = lit.nonzero()[0]
        if not rows.size:
            return self
        logs = self.logs.copy()
        stage = self.done[rows] - 1
        gap = time_s - self.dark_since_s[rows]
        is_gap = (gap > 1.0 + 3.0 * pause_s[rows]) & (stage >= 0) & (stage < STAGES - 1)
        logs[rows, stage, GAP] = np.log(np.maximum(gap, 1.0))
        logs[rows[~is_gap], stage[~is_gap]] = np.nan
        relit = evolve(self, logs=logs, dark_since_s=np.where(lit, np.inf, self.dark_since_s))
        return relit._ignited(rows[is_gap], time_s, LAW.relit_s)

    def _staged(self, staged: BoolArray) -> "StageHistory":
        """Return the histories with another stage of some since their last steady burn."""
        rows = staged.nonzero()[0]
        rows = rows[self.done[rows] < STAGES - 1]
        if not rows.size:
            return self
        end_s = self.steady_s[rows] + 1.0
        return self.with_end(rows, end_s, -np.inf)._ignited(rows, end_s, LAW.staged_s)

    def as_burning(self) -> "StageHistory":
        """Return the histories if the last stage still burns."""
        dark = np.flatnonzero(self.is_dark)
        if not dark.size:
            return self
        logs = self.logs.copy()
        logs[dark, self.done[dark] - 1] = np.nan
        return evolve(self, logs=logs)

    def as_staging(self, estimates: BoostEstimates) -> tuple["StageHistory", BoolArray]:
        """Return burning histories if a stage begins at present, and in which of them (n,) it does:
        others go on as they are.
        """
        since_s = self.steady_s - self.ignition_s
        begins = (since_s > LAW.least_burn_s) & (self.done < STAGES - 1) & np.isfinite(self.force)
        begins &= force_along(estimates.burn_mean[:, 1]) < LAW.drop * self.force
        return self._staged(begins), begins

    def as_dark(self, tick_s: float, dark_s: FloatArray) -> "StageHistory":
        """Return the histories if the last stage is over, since a time (n,) if it was thought to
        burn.
        """
        return self._dark_since(~self.is_dark, tick_s - dark_s)


def _stage_figures(
    burn: FloatArray, since: FloatArray, force: FloatArray, growth: FloatArray
) -> list[FloatArray]:
    """Return burn times, first accelerations and ratios of masses (n,) of stages with forces and
    growths at times since ignition.
    """
    start = np.maximum(force / np.maximum(1.0 + growth * since, 0.1), 1.0)
    end = np.maximum(force / np.maximum(1.0 - growth * (burn - since), 0.3), 1.0)
    return [burn, start, end / start]


def _free_odds(burning: BoolArray, share: FloatArray) -> FloatArray:
    """Return the ratios (n,) of the odds of shares of a free burn to their prior odds, 1 where it
    is not probable.
    """
    odds = share / np.maximum(1.0 - share, 1e-6) * (1.0 - LAW.free_prior) / LAW.free_prior
    return np.where(burning & (share > LAW.free), odds, 1.0)


def force_along(state: FloatArray) -> FloatArray:
    """Return the specific force (n,), m/s², along the velocity through the air of states (n,
    10).
    """
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity) + 1.0)
    return dot(velocity, state[:, 6:9]) / speed
