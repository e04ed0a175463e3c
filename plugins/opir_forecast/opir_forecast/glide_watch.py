"""How probably what is still seen glides: the burn is over, and the air slows and carries it.

The change of specific energy over a window, over the way, is the mean specific force along the
flight. Burns push with forces that are log-uniform between limits; a glider brakes by its drag. A
glider's burn ends in each window with a probability, low and level; two states are filtered over
windows that follow each other without a silence.
"""

from functools import cached_property

import numpy as np
from attrs import evolve, frozen
from opir_estimation import COAST, dot, glide_drag_m_s2, law_parameters
from opir_estimation.square_root import inverse_root

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.interfaces import Columns
from opir_forecast.estimates import BoostEstimates
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.outcomes import Outcomes
from opir_forecast.vehicles import LAW as STAGE_LAW

LAW = law_parameters("opir_forecast", "gliding")

#: Odds of what is sure: those of a long glide would become infinite, and its probability unknown.
MOST_ODDS = 1e100


@frozen(eq=False, repr=False)
class GlideWatch(Columns):
    """Tracks (n,) `number` with windows since `since_s`, s, nan in a silence; `energy` J/kg and
    `speed` m/s then, and the odds of a glide at the end of the window before.
    """

    number: IntArray
    since_s: FloatArray
    energy: FloatArray
    speed: FloatArray
    odds: FloatArray

    @classmethod
    def begun(cls, number: IntArray) -> "GlideWatch":
        """Return the watch of new tracks."""
        unknown = np.full(len(number), np.nan)
        return cls(number, unknown, unknown, unknown, np.zeros(len(number)))

    @cached_property
    def is_any(self) -> bool:
        """Whether a track glides with a probability that counts."""
        return bool(np.any(self.probability))

    @property
    def probability(self) -> FloatArray:
        """Return the probabilities (n,) of a glide, 0 where they do not count."""
        probability = self.odds / (1.0 + self.odds)
        return np.where(probability < LAW.least, 0.0, probability)

    def updated(self, estimates: BoostEstimates, outcomes: Outcomes, time_s: float) -> "GlideWatch":
        """Return the watch of the same tracks at a time, given their estimates."""
        silence_s = np.maximum(STAGE_LAW.recent_s, 3.0 * estimates.pause_s)
        is_silent = (estimates.silent_s > silence_s) | (estimates.burning <= 0.5)
        since_s = np.where(is_silent, np.nan, self.since_s)
        # A window of unknown start begins.
        is_due = ~is_silent & ~(time_s - since_s < LAW.window_s)
        rows = is_due.nonzero()[0]
        watch = evolve(self, since_s=since_s)
        return watch._closed(rows, estimates.take(rows), outcomes, time_s) if rows.size else watch

    def _closed(
        self, rows: IntArray, estimates: BoostEstimates, outcomes: Outcomes, time_s: float
    ) -> "GlideWatch":
        """Return the watch with other windows of rows (m,), whose estimates these are."""
        state = _means(estimates)
        speed = np.sqrt(dot(state[:, 3:], state[:, 3:]))
        energy = 0.5 * speed * speed - EARTH_MU_M3_S2 / np.sqrt(dot(state[:, :3], state[:, :3]))
        window_s = time_s - self.since_s[rows]
        force = (energy - self.energy[rows]) / (0.5 * (speed + self.speed[rows]) * window_s)
        sigma = np.sqrt(2.0) * _speed_sigmas(estimates, state[:, 3:] / speed[:, None]) / window_s
        ratio = _likelihood_ratios(state, force, np.hypot(sigma, LAW.least_force_m_s2))
        odds = self.odds[rows]
        odds = np.where(np.isnan(ratio), odds, (odds + _begun_odds(outcomes, state)) * ratio)
        odds = np.minimum(odds, MOST_ODDS)
        return GlideWatch(
            self.number,
            _replaced(self.since_s, rows, time_s),
            _replaced(self.energy, rows, energy),
            _replaced(self.speed, rows, speed),
            _replaced(self.odds, rows, odds),
        )


def _replaced(column: FloatArray, rows: IntArray, new: FloatArray | float) -> FloatArray:
    """Return a column with other values of rows."""
    replaced = column.copy()
    replaced[rows] = new
    return replaced


def with_glides(
    forecasts: LaunchForecasts, glides: FloatArray, outcomes: Outcomes
) -> LaunchForecasts:
    """Return forecasts, given those of targets that do not glide and the probabilities (n,) that
    they do.
    """
    columns = outcomes.columns("glide")
    others = 1.0 - glides
    given_launch = forecasts.given_launch * others[:, None]
    given_launch[:, columns] += glides[:, None] / max(len(columns), 1)
    relights = forecasts.probability_relights * others
    return evolve(forecasts, given_launch=given_launch, probability_relights=relights)


def _means(estimates: BoostEstimates) -> FloatArray:
    """Return the mean inertial states (n, 6) of burns over their kinds."""
    return np.add.reduce(
        estimates.burn_share[:, :, None] * estimates.burn_mean[:, :, :COAST], axis=1
    )


def _speed_sigmas(estimates: BoostEstimates, along: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of speeds in directions (n, 3), m/s."""
    spread = inverse_root(estimates.burn_root[:, 0])[:, 3:COAST]
    across = np.add.reduce(along[:, :, None] * spread, axis=1)
    return np.sqrt(np.add.reduce(across * across, axis=1))


def _likelihood_ratios(state: FloatArray, force: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the likelihoods (n,) of mean forces with errors for gliders over those for burns."""
    drag, spread = glide_drag_m_s2(state)
    least, most = np.log(LAW.burn_m_s2)
    share = (np.arange(LAW.grid) + 0.5) / LAW.grid
    burns = np.exp(least + (most - least) * share)
    burning = np.add.reduce(_density(force[:, None] - burns, sigma[:, None]), axis=1) / LAW.grid
    return _density(force - drag, np.hypot(sigma, spread)) / np.maximum(burning, 1e-100)


def _density(error: FloatArray, sigma: FloatArray) -> FloatArray:
    score = error / sigma
    return np.exp(-0.5 * score * score) / sigma


def _begun_odds(outcomes: Outcomes, state: FloatArray) -> FloatArray:
    """Return the odds (n,) that states (n, 6) are gliders whose burns ended in a window."""
    from opir_forecast.fates import features

    glide = outcomes.groups[2] / outcomes.groups.sum()
    return LAW.ended * glide * outcomes.gliding(*features(state))
