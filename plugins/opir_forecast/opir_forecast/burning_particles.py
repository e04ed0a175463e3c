"""Particles of burning tracks: states of the filter's density, weighed by the law of the stage that
burns.
"""

from typing import NamedTuple

import numpy as np
from opir_estimation.square_root import inverse_root
from scipy.special import ndtri

from opir_core.arrays import FloatArray, IntArray
from opir_forecast.estimates import BoostEstimates
from opir_forecast.particles import (
    BURNING,
    LAW,
    BurnState,
    FlownVehicles,
    Particles,
    draws,
    families_of_particles,
    later_burns,
    shares_in_numbers,
    widened,
)
from opir_forecast.present_burn import PresentBurns, present_burns
from opir_forecast.stage_history import StageHistory, force_along
from opir_forecast.vehicles import FAMILIES, STAGES, Known, VehicleModel, VehicleStages

#: Parts of the filter's burn.
STEADY, STAGING, FREE = range(3)

#: The rows of a stage that a burn shows: not the gap after it.
_SHOWN = np.array([1.0, 1.0, 1.0, 0.0])


def burning_particles(
    model: VehicleModel,
    estimates: BoostEstimates,
    history: StageHistory,
    prior: FloatArray,
    time_s: float,
) -> Particles:
    """Return the particles of burning tracks (n,) at a time; `prior` (families,) are weights of the
    families.
    """
    drawn = _drawn_burns(model, estimates, history, time_s)
    size = len(BURNING)
    log = _log_evidence(drawn, prior, estimates.burn_share)
    family, source, weight = _allotted(log, prior)
    rows = (np.arange(len(source))[:, None] * size + source).ravel()
    columns = family.ravel(), np.tile(BURNING, len(source)), weight.ravel()
    launch_s = history.as_burning().launch_s
    return _with_later_burns(model, drawn, rows, *columns, time_s - launch_s)


def _log_evidence(drawn: "_DrawnBurns", prior: FloatArray, share: FloatArray) -> FloatArray:
    """Return the log evidences (families, n, m) of drawn burns, by shares (n, 3) of their kinds."""
    log = np.stack([law.log_evidence for law in drawn.laws]) + drawn.log_stages.T
    log = log.reshape(len(FAMILIES), len(share), -1)
    return log + _staging_logs(log, prior, drawn.burn_kind.reshape(len(share), -1), share)


class _DrawnBurns(NamedTuple):
    """States of the filter (p, 10) with kinds of burns, stages (p,) that burn, and their laws.

    `known` (p,) are the laws of the stages by family, `laws` the present burns of each family;
    `log_stages` (p, families) is the evidence of the earlier stages, and of at least as many.
    """

    track: IntArray
    burn_kind: IntArray
    state: FloatArray
    force: FloatArray
    since_s: FloatArray
    stage: IntArray
    known: Known
    log_stages: FloatArray
    laws: list[PresentBurns]


def _drawn_burns(
    model: VehicleModel, estimates: BoostEstimates, history: StageHistory, time_s: float
) -> _DrawnBurns:
    """Return the draws of burns of tracks (n,) at a time."""
    track = np.repeat(np.arange(len(estimates)), len(BURNING))
    burn_kind = _burn_kinds(estimates.burn_share)
    state = _drawn_states(estimates, burn_kind).reshape(-1, 10)
    burning = history.as_burning()
    staged, begins = burning.as_staging(estimates)
    # The part that is staging is the next stage of some tracks, and the same one of others.
    row = track + len(estimates) * ((burn_kind == STAGING) & begins[:, None]).ravel()
    histories = StageHistory.concatenate([burning, staged])
    uniform = np.tile(draws().uniform[BURNING, 1], len(estimates))
    error_s = histories.ignition_sigma_s[row] * ndtri(uniform)
    since_s = np.maximum(time_s - histories.ignition_s[row] + error_s, LAW.least_since_s)
    next_stage = model.given(histories.logs).take(row)
    stage = np.minimum(next_stage.done, STAGES - 1)
    log_more = np.log(np.maximum(model.more(stage), 1e-12))
    log_stages = next_stage.log_evidence + log_more + history.log_free[track]
    force = force_along(state)
    laws = _present_laws(model, next_stage, stage, (force, state[:, 9], since_s))
    burn_kind = burn_kind.ravel()
    return _DrawnBurns(track, burn_kind, state, force, since_s, stage, next_stage, log_stages, laws)


def _present_laws(
    model: VehicleModel,
    next_stage: Known,
    stage: IntArray,
    burn: tuple[FloatArray, FloatArray, FloatArray],
) -> list[PresentBurns]:
    """Return the present burns of each family, by forces, growths and ages (p,)."""
    laws = []
    for family in range(len(FAMILIES)):
        law = model.law(
            np.array(family), stage, next_stage.total[:, family], next_stage.number[:, family]
        )
        laws.append(present_burns(*burn, law, model.data["highest_m_s2"]))
    return laws


def _burn_kinds(share: FloatArray) -> IntArray:
    """Return the kinds of burns (n, m) of draws, by shares (n, 3): staging, free, and steady
    between them.
    """
    place = draws().uniform[BURNING, 0]
    other_kinds = np.where(place > 1.0 - share[:, 2:], FREE, STEADY)
    return np.where(place < share[:, 1:2], STAGING, other_kinds)


def _drawn_states(estimates: BoostEstimates, burn_kind: IntArray) -> FloatArray:
    """Return drawn states (n, m, 10) of the filter's densities of kinds of burns (n, m)."""
    root = widened(inverse_root(estimates.burn_root.reshape(-1, 10, 10)))
    root = root.reshape(estimates.burn_root.shape)
    states = draws().state[BURNING] @ root.mT + estimates.burn_mean[:, :, None]
    return np.take_along_axis(states, burn_kind[:, None, :, None], axis=1)


def _staging_logs(
    log: FloatArray, prior: FloatArray, burn_kind: IntArray, share: FloatArray
) -> FloatArray:
    """Return changes (n, m) of log evidences (families, n, m) that carry the filter's probability of
    staging.

    Its looks are in the shares (n, 3) of its parts already. But it expects a new stage at any time.
    """
    peak = log.max(axis=(0, 2))[:, None]
    density = np.sum(np.exp(log - peak) * prior[:, None, None], axis=0)
    steady, staging = (
        np.sum(np.where(burn_kind == kind, density, 0.0), axis=1) for kind in (STEADY, STAGING)
    )
    hot = share[:, 1] * LAW.hot_share
    odds = hot / np.maximum(share[:, 0] + hot, 1e-12)
    is_known = (steady > 0.0) & (staging > 0.0) & (odds > 0.0) & (odds < 1.0)
    odds, steady, staging = (np.where(is_known, value, 0.5) for value in (odds, steady, staging))
    change = np.log(odds) - np.log1p(-odds) + (np.log(steady) - np.log(staging))
    is_staging = (burn_kind == STAGING) & is_known[:, None]
    return np.where(is_staging, change[:, None], 0.0)


def _allotted(log: FloatArray, prior: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return families, sources and weights (n, m) of the particles of tracks.

    `log` (families, n, m) are the log evidences of states by family: a family has a share of the
    particles near its probability, and its states are drawn by their evidence.
    """
    size = log.shape[2]
    density = np.exp(log - log.max(axis=(0, 2))[:, None])
    evidence = density.sum(axis=2).T * prior
    share = evidence / evidence.sum(axis=1, keepdims=True)
    number = shares_in_numbers(share, size)
    family = families_of_particles(number, size)
    start, count, weight = (
        np.take_along_axis(values, family, axis=1)
        for values in (np.cumsum(number, axis=1) - number, number, share / np.maximum(number, 1))
    )
    position = (np.arange(size) - start + 0.5) / count
    return family, _systematic(density, family, position), weight


def _systematic(density: FloatArray, family: IntArray, position: FloatArray) -> IntArray:
    """Return sources (n, m) drawn by densities (families, n, m) at positions (n, m) within each
    particle's family.
    """
    total = np.cumsum(density, axis=2)
    total /= np.maximum(total[:, :, -1:], 1e-300)
    families, count, size = density.shape
    shift = (np.arange(families)[:, None] * count + np.arange(count)) * 2.0
    flat = (total + shift[:, :, None]).ravel()
    row = np.arange(count)[:, None]
    rank = np.searchsorted(flat, position + shift[family, row])
    return np.clip(rank - (family * count + row) * size, 0, size - 1)


def _with_later_burns(
    model: VehicleModel,
    drawn: _DrawnBurns,
    rows: IntArray,
    family: IntArray,
    draw: IntArray,
    weight: FloatArray,
    flown_s: FloatArray,
) -> Particles:
    """Return the particles of rows of the drawn burns, with burn times and later stages of their
    families.
    """
    burn, acceleration, rate = _present_stages(drawn, rows, family, draw)
    ratio_log = -np.log(np.maximum(1.0 - rate * burn, 0.02))
    logs = np.stack([np.log(burn), np.log(acceleration), ratio_log, np.zeros(len(burn))], axis=1)
    later = later_burns(model, _after_present(model, drawn, rows, family, draw, logs))
    since_s = drawn.since_s[rows]
    growth = rate / np.maximum(1.0 - rate * since_s, 0.05)
    burns = _joined(burn - since_s, drawn.force[rows], growth, later)
    track = drawn.track[rows]
    state = drawn.state[rows]
    return Particles(
        burns.starts_s,
        burns.burn_s,
        burns.first_m_s2,
        burns.growth_per_s,
        flown_s[track],
        track,
        family,
        np.full(len(rows), int(BurnState.LIT)),
        draw,
        weight,
        state[:, :6],
        state[:, 6:9],
        drawn.burn_kind[rows] == FREE,
    )


def _present_stages(
    drawn: _DrawnBurns, rows: IntArray, family: IntArray, draw: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return burn times, first accelerations and growths (p,) of the present stages of rows."""
    stages = np.empty((3, len(rows)))
    for number, law in enumerate(drawn.laws):
        members = np.flatnonzero(family == number)
        sources = rows[members]
        burn = law.burn_s(sources, draws().uniform[draw[members], 2])
        stages[:, members] = burn, law.first_m_s2[sources], law.growth_per_s[sources]
    burn, acceleration, growth = stages
    return burn, acceleration, growth


def _after_present(
    model: VehicleModel,
    drawn: _DrawnBurns,
    rows: IntArray,
    family: IntArray,
    draw: IntArray,
    logs: FloatArray,
) -> FlownVehicles:
    """Return the vehicles of rows after their present stages with logarithms (p, 4)."""
    stage = drawn.stage[rows]
    score = model.scores(family, stage, logs) * _SHOWN
    total, number, hot = (
        column[rows, family] for column in (drawn.known.total, drawn.known.number, drawn.known.hot)
    )
    return FlownVehicles(family, stage + 1, total + score, number + _SHOWN, hot, draw)


def _joined(
    remaining_s: FloatArray, force: FloatArray, growth: FloatArray, later: VehicleStages
) -> VehicleStages:
    """Return the stages of particles whose present one burns for `remaining_s`, with the later
    ones.
    """
    present = (
        np.zeros(len(force)),
        np.maximum(remaining_s, 0.0),
        np.maximum(force, 0.5),
        growth,
    )
    return VehicleStages(
        *(
            np.concatenate([column[:, None], columns[:, :-1]], axis=1)
            for column, columns in zip(present, later, strict=True)
        )
    )
