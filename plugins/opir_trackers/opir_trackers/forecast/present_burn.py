"""How long the stage that burns now will burn, given how long it has, its force and its growth.

With constant thrust and mass flow the acceleration of a stage is A / (1 - c s) after s seconds (the
rocket equation), so its relative growth κ says c = κ / (1 + κ s), and each burn time B the ratio of
masses, 1 / (1 - c B). The law of a stage is that of B, A and the ratio; in terms of force, growth
and B, its density has the Jacobian 1 / (f (1 - c B) (1 + κ s)²).
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.forecast.vehicles import BURN, FORCE, GAP, RATIO

#: Cells of the burn time between now and its longest value, and that value in standard deviations
#: of its law.
CELLS = 16
LONGEST = 3.5

#: Least shares of a mass and of an acceleration, and least force, m/s²: beyond, a state fits no
#: stage.
_LEAST_MASS = 0.02
_LEAST_SHARE = 0.1
_LEAST_FORCE = 0.5

_MIDDLES = (np.arange(CELLS) + 0.5) / CELLS


@frozen(eq=False)
class PresentBurns:
    """The present stages of particles (p,): first acceleration and growth c, and the law of the
    burn time.

    `log_evidence` (p,) is the density of force and growth, `cells` (p, CELLS) the probabilities of
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
        total = np.cumsum(self.cells[rows], axis=1)
        cell = np.minimum(np.sum(total < share[:, None], axis=1), CELLS - 1)
        each = np.arange(len(cell))
        inside = 1.0 - (total[each, cell] - share) / np.maximum(self.cells[rows][each, cell], 1e-12)
        part = (cell + np.clip(inside, 0.0, 1.0)) / CELLS
        burn: FloatArray = self.since_s[rows] + (self.longest_s - self.since_s)[rows] * part
        return burn


def present_burns(
    force: FloatArray,
    growth: FloatArray,
    since_s: FloatArray,
    mean: FloatArray,
    sigma: FloatArray,
    highest_m_s2: float = np.inf,
) -> PresentBurns:
    """Return the stages of particles (p,) with forces along the velocity m/s² and growths 1/s,
    after times (p,).

    `mean` and `sigma` (p, 4) are those of the logarithms of the stage's law, `highest_m_s2` bounds
    its last acceleration.
    """
    force = np.maximum(force, _LEAST_FORCE)
    grown = np.maximum(1.0 + growth * since_s, _LEAST_SHARE)
    first = force / grown
    rate = growth / grown
    most = mean + LONGEST * sigma
    used_up = np.where(rate > 1e-6, -np.expm1(-most[:, RATIO]) / np.maximum(rate, 1e-6), np.inf)
    longest = np.maximum(np.minimum(np.exp(most[:, BURN]), used_up), since_s + 1.0)
    burn = since_s[:, None] + (longest - since_s)[:, None] * _MIDDLES
    shrink = np.maximum(1.0 - rate[:, None] * burn, _LEAST_MASS)
    one = (np.log(burn) - mean[:, BURN, None]) / sigma[:, BURN, None]
    other = (-np.log(shrink) - mean[:, RATIO, None]) / sigma[:, RATIO, None]
    # Few structures bear more at the end of a burn: odds by the eighth power of the last
    # acceleration.
    most_8 = np.square(np.square(np.square((first / highest_m_s2)[:, None] / shrink)))
    log = -0.5 * (one * one + other * other)
    top = log.max(axis=1)
    density = np.exp(log - top[:, None]) / (shrink * (1.0 + most_8))
    total = density.sum(axis=1)
    early = (np.log(first) - mean[:, FORCE]) / sigma[:, FORCE]
    scale = np.log(sigma[:, :GAP].prod(axis=1) * force * grown * grown)
    evidence = top + np.log(total * (longest - since_s) / CELLS) - 0.5 * early * early - scale
    return PresentBurns(since_s, longest, first, rate, evidence, density / total[:, None])
