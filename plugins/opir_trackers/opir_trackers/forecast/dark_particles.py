"""Particles of dark tracks: in free flight, with no burn left or with those of the stages to
come.
"""

from functools import cache

import numpy as np
from attrs import evolve
from scipy.special import ndtr

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.square_root import inverse_root
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast.burning_on import RemainingBurns
from opir_trackers.forecast.later_burns import later_burns
from opir_trackers.forecast.particles import (
    AGAIN,
    BURNING,
    OVER,
    Draws,
    Particles,
    draws,
    shares_in_numbers,
    widened,
)
from opir_trackers.forecast.stage_history import StageHistory
from opir_trackers.forecast.vehicles import FAMILIES, GAP, STAGES, Known, VehicleModel

#: Relights less probable than this, of all dark particles, get none.
_LEAST_RELIGHT = 2e-3


def dark_particles(
    model: VehicleModel,
    estimates: ModeEstimates,
    history: StageHistory,
    prior: FloatArray,
    dark_s: FloatArray,
    time_s: float,
) -> tuple[Particles, FloatArray]:
    """Return the particles of tracks (n,) that are dark for times (n,), s, and what may yet burn
    again, (n, families).

    The second is the probability of a relight of each family, by its number of stages and its gaps,
    not weighed by where these lead.
    """
    over = history.as_dark(time_s, dark_s)
    known = model.given(over.logs)
    families = np.arange(len(FAMILIES))
    count = len(estimates)
    stage = np.minimum(known.done, STAGES - 1)
    law = model.law(families, stage[:, None], known.total, known.number)
    longer = ndtr(
        (law[0][:, :, GAP] - np.log(np.maximum(dark_s, 0.05))[:, None]) / law[1][:, :, GAP]
    )
    more = model.more(known.done)
    all_ = model.more(np.maximum(known.done - 1, 0))
    # What ignites without a gap does so within about the time between two looks.
    waits = more * longer * np.where(dark_s[:, None] > 1.0, 1.0 - known.hot, 1.0)
    ends = np.maximum(all_ - more, 1e-3)
    log = known.log_evidence + over.log_free
    evidence = np.exp(log - log.max(axis=1, keepdims=True)) * prior
    relight = evidence * waits
    whole = (relight + evidence * ends).sum(axis=1, keepdims=True)
    relight = relight / whole
    ended = evidence * ends / whole
    side = widened(inverse_root(estimates.coast_root))
    lots = draws()
    parts = [
        _free(known, ended, estimates, side, np.arange(OVER) + BURNING, np.arange(count)),
        _again(model, known, relight, estimates, side, lots, dark_s, time_s - over.launch_s),
    ]
    return Particles.concatenate(parts), relight / np.maximum(relight + ended, 1e-12)


def _free(
    known: Known,
    ended: FloatArray,
    estimates: ModeEstimates,
    side: FloatArray,
    draw: IntArray,
    rows: IntArray,
) -> Particles:
    """Return particles in free flight of tracks `rows`, of each family in turn; weights are by
    families, (n, families)."""
    count = len(rows)
    size = len(draw)
    number = shares_in_numbers(ended[rows], size)
    family = np.sum(np.arange(size) >= np.cumsum(number, axis=1)[:, :, None], axis=1).clip(
        0, len(FAMILIES) - 1
    )
    row = np.arange(count)[:, None]
    weight = (ended[rows] / np.maximum(number, 1))[row, family].ravel()
    state = draws().state[draw, :6] @ side[rows].swapaxes(1, 2) + estimates.coast_mean[rows, None]
    nothing = np.zeros((count * size, STAGES))
    burns = RemainingBurns(nothing, nothing, nothing, nothing, nothing[:, 0])
    track = np.repeat(rows, size)
    lit = np.zeros(count * size, dtype=np.int64)
    free = np.zeros(count * size, np.bool_)
    # Families take turns, so that each has states of all kinds.
    turn = _turns(size)
    family = family[:, turn].ravel()
    weight = weight.reshape(count, size)[:, turn].ravel()
    return Particles.of(
        burns,
        track,
        family,
        lit,
        np.tile(draw, count),
        weight,
        state.reshape(-1, 6),
        nothing[:, :3],
        free,
    )


@cache
def _turns(size: int) -> IntArray:
    """Return a fixed random order of a number of particles."""
    return np.random.default_rng(5).permutation(size)


def _again(
    model: VehicleModel,
    known: Known,
    relight: FloatArray,
    estimates: ModeEstimates,
    side: FloatArray,
    lots: Draws,
    dark_s: FloatArray,
    flown_s: FloatArray,
) -> Particles:
    """Return dark particles that burn again, of tracks that may."""
    rows = np.flatnonzero((relight.sum(axis=1) > _LEAST_RELIGHT) & (known.done < STAGES))
    draw = np.arange(AGAIN) + BURNING + OVER
    free = _free(known, relight, estimates, side, draw, rows)
    total = known.total[free.track, free.family]
    number = known.number[free.track, free.family]
    hot = known.hot[free.track, free.family]
    waits = dark_s[free.track]
    later = later_burns(
        model, free.family, known.done[free.track], total, number, free.draw, hot, waits
    )
    gap = later.gap_s.copy()
    gap[:, 0] = np.maximum(gap[:, 0] - waits, 0.0)
    start = np.cumsum(later.burn_s + gap, axis=1) - later.burn_s
    return evolve(
        free,
        start_s=start,
        burn_s=later.burn_s,
        acceleration_m_s2=later.acceleration_m_s2,
        growth_per_s=later.growth_per_s,
        since_s=flown_s[free.track],
        lit=np.full(len(free), 2),
    )
