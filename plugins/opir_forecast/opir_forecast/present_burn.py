"""The burn time of the present stage, given its age, its force and its growth.

With constant thrust and mass flow the acceleration of a stage is A / (1 - c s) after s seconds (the
rocket equation), so its relative growth κ says c = κ / (1 + κ s), and each burn time B the ratio of
masses, 1 / (1 - c B). The law of a stage is that of B, A and the ratio; in terms of force, growth
and B, its density has the Jacobian 1 / (f (1 - c B) (1 + κ s)²).
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_forecast.vehicles import BURN, FORCE, GAP, LAW, RATIO


@frozen(eq=False)
class PresentBurns:
    """The present stages of particles (p,): first acceleration and growth c, and the law of the
    burn time.

    `log_evidence` (p,) is the density of force and growth, `cells` (p, cells) the probabilities of
    equal cells of the burn time from `since_s` to `longest_s` (p,).
    """

    since_s: FloatArray
    longest_s: FloatArray
    first_m_s2: FloatArray
    growth_per_s: FloatArray
    log_evidence: FloatArray
    cells: FloatArray

    def burn_s(self, rows: IntArray, share: FloatArray) -> FloatArray:
        """Return burn times (m,) of particles `rows` at quantiles `share` (m,) of their laws."""
        cells = self.cells[rows]
        total = np.cumsum(cells, axis=1)
        cell = np.minimum(np.sum(total < share[:, None], axis=1), LAW.cells - 1)
        row = np.arange(len(cell))
        inside = 1.0 - (total[row, cell] - share) / np.maximum(cells[row, cell], 1e-12)
        quantile = (cell + np.clip(inside, 0.0, 1.0)) / LAW.cells
        return self.since_s[rows] + (self.longest_s - self.since_s)[rows] * quantile


def present_burns(
    force: FloatArray,
    growth: FloatArray,
    since_s: FloatArray,
    law: tuple[FloatArray, FloatArray],
    highest_m_s2: float = np.inf,
) -> PresentBurns:
    """Return the stages of particles (p,) with forces along the velocity m/s² and growths 1/s,
    after times (p,).

    `law` is mean and standard deviation (p, 4) of the logarithms of the stage, `highest_m_s2`
    bounds its last acceleration.
    """
    mean, sigma = law
    force = np.maximum(force, LAW.least_force_m_s2)
    grown = np.maximum(1.0 + growth * since_s, LAW.least_acceleration)
    start_force = force / grown
    rate = growth / grown
    longest_s = _longest_s(mean + LAW.longest_sigmas * sigma, rate, since_s)
    middles = (np.arange(LAW.cells) + 0.5) / LAW.cells
    burn = since_s[:, None] + (longest_s - since_s)[:, None] * middles
    mass = np.maximum(1.0 - rate[:, None] * burn, LAW.least_mass)
    density, peak = _burn_density(burn, mass, (start_force / highest_m_s2)[:, None], law)
    total = density.sum(axis=1)
    force_score = (np.log(start_force) - mean[:, FORCE]) / sigma[:, FORCE]
    scale = np.log(sigma[:, :GAP].prod(axis=1) * force * grown * grown)
    integral = np.log(total * (longest_s - since_s) / LAW.cells)
    evidence = peak + integral - 0.5 * force_score * force_score - scale
    return PresentBurns(since_s, longest_s, start_force, rate, evidence, density / total[:, None])


def _burn_density(
    burn: FloatArray, mass: FloatArray, force: FloatArray, law: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the densities (p, cells) of burn times with remaining masses, over the exponentials of
    peaks (p,).

    `force` (p, 1) is the first acceleration over the highest one. Few structures bear more at the
    end of a burn: odds by the eighth power of the last acceleration.
    """
    mean, sigma = law
    burn_score = (np.log(burn) - mean[:, BURN, None]) / sigma[:, BURN, None]
    ratio_score = (-np.log(mass) - mean[:, RATIO, None]) / sigma[:, RATIO, None]
    log = -0.5 * (burn_score * burn_score + ratio_score * ratio_score)
    peak = log.max(axis=1)
    power_8 = np.square(np.square(np.square(force / mass)))
    return np.exp(log - peak[:, None]) / (mass * (1.0 + power_8)), peak


def _longest_s(longest_logs: FloatArray, rate: FloatArray, since_s: FloatArray) -> FloatArray:
    """Return the longest burn times (p,): by the law's logarithms (p, 4), or when the mass is used
    up.
    """
    used_up = -np.expm1(-longest_logs[:, RATIO]) / np.maximum(rate, 1e-6)
    used_up = np.where(rate > 1e-6, used_up, np.inf)
    return np.maximum(np.minimum(np.exp(longest_logs[:, BURN]), used_up), since_s + 1.0)
