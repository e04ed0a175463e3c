"""Particles of tracks: what each may be, with a state of the filter and the burns that remain to
it.

All draws are the same quantiles for all tracks and ticks, so regions change smoothly.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import names_of
from opir_trackers.filter.mode_mixing import SPEED_SIGMA_M_S
from opir_trackers.forecast.burning_on import RemainingBurns
from opir_trackers.forecast.vehicles import STAGES

#: Particles of a burning track; of a dark one, those whose burn is over, and those that burn again.
BURNING = 256
OVER = 192
AGAIN = 128

#: Least share of the particles of each family: regions are mostly of missiles.
_LEAST_SHARE = np.array([0.5, 0.06, 0.04])

#: Families less probable than this have none.
_NEGLIGIBLE = 1e-3

#: Below this share of the velocity's prior standard deviation, looks know more than the prior.
_SEEN = 0.4


@frozen(eq=False, repr=False)
class Particles(RemainingBurns):
    """Particles (p,) of tracks (rows of the forecast) with families, inertial states (p, 6), and
    remaining burns.

    `lit` is 1 for those that burn now, 2 for those that burn again, 0 for dark ones whose burn is
    over; `weight` sums to one over each of a track's burning and dark particles. `draw` is the
    number of a particle's draws, `force` (p, 3) its specific force, 0 in the dark. `is_free` (p,)
    says whether it thrusts in another direction than along the velocity, which no program
    continues.
    """

    track: IntArray
    family: IntArray
    lit: IntArray
    draw: IntArray
    weight: FloatArray
    state: FloatArray
    force: FloatArray
    is_free: BoolArray

    @classmethod
    def of(cls, burns: RemainingBurns, *rest: Any) -> "Particles":
        """Return the particles of remaining burns and the other columns, in order."""
        return cls(*(getattr(burns, name) for name in names_of(RemainingBurns)), *rest)

    def of_tracks(self, rows: IntArray) -> "Particles":
        """Return the particles with the numbers of their tracks among others."""
        return evolve(self, track=rows[self.track])


class Draws(NamedTuple):
    """Numbers of draws: normal ones of states (m, 10) and of later stages (m, STAGES, 4), uniform
    ones (m, 5 + STAGES)."""

    state: FloatArray
    later: FloatArray
    uniform: FloatArray


@cache
def draws() -> Draws:
    """Return the draws of all tracks: a Latin hypercube of uniform numbers, and normal ones of zero
    mean.
    """
    rng = np.random.default_rng(1)
    size = BURNING + OVER + AGAIN
    state = rng.normal(size=(size, 10))
    steps = np.stack([rng.permutation(size) for _ in range(5 + STAGES)], axis=1)
    return Draws(
        state, rng.normal(size=(size, STAGES, 4)), (steps + rng.random(steps.shape)) / size
    )


def widened(side: FloatArray) -> FloatArray:
    """Return covariance roots (n, d, d), wider where the velocity is known by the filter's prior
    alone.

    That prior is of all times of a burn (`mode_mixing.SPEED_SIGMA_M_S`); late stages are up to four
    times as fast. One sensor does not see the velocity along its line of sight.
    """
    spread = np.sqrt(np.sum(side[:, 3:6] ** 2, axis=(1, 2))) / SPEED_SIGMA_M_S
    factor = 1.0 + np.clip((spread - _SEEN) / (1.0 - _SEEN), 0.0, 1.0)
    return side * factor[:, None, None]


def shares_in_numbers(share: FloatArray, size: int) -> IntArray:
    """Return numbers (n, families) of particles that add up to `size`, nearly in proportion to
    shares.
    """
    given = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-300)
    given = np.where(given > _NEGLIGIBLE, np.maximum(given, _LEAST_SHARE), 0.0)
    given /= given.sum(axis=1, keepdims=True)
    numbers: IntArray = np.diff(
        np.rint(np.cumsum(given, axis=1) * size).astype(np.int64), axis=1, prepend=0
    )
    return numbers
