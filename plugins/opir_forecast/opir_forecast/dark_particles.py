"""Particles of dark tracks: in free flight, without another burn or with those of the stages to
come.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_estimation.square_root import inverse_root
from scipy.special import ndtr

from opir_core.arrays import FloatArray, IntArray
from opir_forecast.estimates import BoostEstimates
from opir_forecast.particles import (
    AGAIN,
    LAW,
    OVER,
    BurnState,
    FlownVehicles,
    Particles,
    draws,
    families_of_particles,
    later_burns,
    shares_in_numbers,
    widened,
)
from opir_forecast.stage_history import StageHistory
from opir_forecast.vehicles import FAMILIES, GAP, STAGES, Known, VehicleModel


class _Coast(NamedTuple):
    """Free flights of tracks (n,): means (n, 6) and covariance roots (n, 6, 6) of their states.

    `dark_s` and `flown_s` (n,) are the times since the burn ended and since the launch.
    """

    mean: FloatArray
    root: FloatArray
    dark_s: FloatArray
    flown_s: FloatArray


def dark_particles(
    model: VehicleModel,
    estimates: BoostEstimates,
    history: StageHistory,
    prior: FloatArray,
    dark_s: FloatArray,
    time_s: float,
) -> tuple[Particles, FloatArray]:
    """Return the particles of tracks (n,) that are dark for times (n,), s, and probabilities (n,
    families) of another burn.

    The second is the probability of a relight of each family, by its number of stages and its gaps,
    not weighed by where these lead.
    """
    over = history.as_dark(time_s, dark_s)
    next_stage = model.given(over.logs)
    relight, ended = _shares(model, next_stage, over.log_free, prior, dark_s)
    root = widened(inverse_root(estimates.coast_root))
    coast = _Coast(estimates.coast_mean, root, dark_s, time_s - over.launch_s)
    free = _free(coast, ended, OVER, np.arange(len(estimates)))
    relit = _again(model, next_stage, relight, coast)
    return Particles.concatenate([free, relit]), relight / np.maximum(relight + ended, 1e-12)


def _shares(
    model: VehicleModel,
    next_stage: Known,
    log_free: FloatArray,
    prior: FloatArray,
    dark_s: FloatArray,
) -> FloatArray:
    """Return the probabilities (2, n, families) of tracks that wait for another stage, and of
    those whose burnt one was the last.
    """
    log = next_stage.log_evidence + log_free
    evidence = np.exp(log - log.max(axis=1, keepdims=True)) * prior
    weights = np.array(_relight_weights(model, next_stage, dark_s)) * evidence
    return weights / (weights[0] + weights[1]).sum(axis=1, keepdims=True)


def _relight_weights(
    model: VehicleModel, next_stage: Known, dark_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities (n, families) that tracks dark for times (n,) wait for another
    stage, and that the burnt one was the last.
    """
    done = next_stage.done
    stage = np.minimum(done, STAGES - 1)[:, None]
    law = model.law(np.arange(len(FAMILIES)), stage, next_stage.total, next_stage.number)
    mean, sigma = (rows[:, :, GAP] for rows in law)
    dark_s = dark_s[:, None]
    log_dark = np.log(np.maximum(dark_s, 0.05))
    more = model.more(done)
    at_least = model.more(np.maximum(done - 1, 0))
    # Without a gap the next stage ignites within about the time between two looks.
    waits = np.where(dark_s > 1.0, 1.0 - next_stage.hot, 1.0)
    return more * ndtr((mean - log_dark) / sigma) * waits, np.maximum(at_least - more, 1e-3)


def _free(coast: _Coast, share: FloatArray, draw: IntArray, rows: IntArray) -> Particles:
    """Return particles in free flight of tracks `rows`, of each family in turn; weights are by
    families, (n, families)."""
    count = len(rows)
    size = len(draw)
    number = shares_in_numbers(share[rows], size)
    # Families take turns, so that each has states of all kinds.
    family = families_of_particles(number, size)[:, _turns(size)]
    weight = (share[rows] / np.maximum(number, 1))[np.arange(count)[:, None], family]
    state = draws().state[draw, :6] @ coast.root[rows].mT + coast.mean[rows, None]
    nothing = np.zeros((count * size, STAGES))
    return Particles(
        nothing,
        nothing,
        nothing,
        nothing,
        nothing[:, 0],
        np.repeat(rows, size),
        family.ravel(),
        np.full(count * size, int(BurnState.DARK)),
        np.tile(draw, count),
        weight.ravel(),
        state.reshape(-1, 6),
        nothing[:, :3],
        np.zeros(count * size, np.bool_),
    )


@cache
def _turns(size: int) -> IntArray:
    """Return a fixed random order of a number of particles."""
    return np.random.default_rng(5).permutation(size)


def _vehicles(next_stage: Known, free: Particles) -> FlownVehicles:
    """Return the vehicles of particles before their next stages."""
    total, number, hot = (
        column[free.track, free.family]
        for column in (next_stage.total, next_stage.number, next_stage.hot)
    )
    done = next_stage.done[free.track]
    return FlownVehicles(free.family, done, total, number, hot, free.draw)


def _again(model: VehicleModel, next_stage: Known, relight: FloatArray, coast: _Coast) -> Particles:
    """Return dark particles that burn again, of tracks that may."""
    may_relight = relight.sum(axis=1) > LAW.least_relight
    rows = np.flatnonzero(may_relight & (next_stage.done < STAGES))
    free = _free(coast, relight, AGAIN, rows)
    track = free.track
    waits = coast.dark_s[track]
    later = later_burns(model, _vehicles(next_stage, free), waits)
    later.gap_s[:, 0] = np.maximum(later.gap_s[:, 0] - waits, 0.0)
    return evolve(
        free,
        start_s=later.starts_s,
        burn_s=later.burn_s,
        acceleration_m_s2=later.first_m_s2,
        growth_per_s=later.growth_per_s,
        since_s=coast.flown_s[track],
        lit=np.full(len(free), int(BurnState.RELIT)),
    )
