"""Particles of burning tracks: states of the filter's density, weighed by the law of the stage that
burns.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.square_root import inverse_root
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast.burning_on import RemainingBurns
from opir_trackers.forecast.later_burns import Later, later_burns
from opir_trackers.forecast.particles import BURNING, Particles, draws, shares_in_numbers, widened
from opir_trackers.forecast.present_burn import PresentBurns, present_burns
from opir_trackers.forecast.stage_history import StageHistory, force_along
from opir_trackers.forecast.vehicles import FAMILIES, STAGES, VehicleModel

#: Hot stagings in the law of vehicles, as a share of the new stages that the filter expects.
_HOT = 0.25

#: Least time since ignition, s.
_SOON_S = 0.5


def burning_particles(
    model: VehicleModel,
    estimates: ModeEstimates,
    history: StageHistory,
    prior: FloatArray,
    time_s: float,
) -> Particles:
    """Return the particles of burning tracks (n,) at a time; `prior` (families,) are weights of the
    families.
    """
    drawn = _drawn_burns(model, estimates, history, time_s)
    log = np.stack(
        [
            law.log_evidence + before
            for law, before in zip(drawn.laws, drawn.log_before.T, strict=True)
        ]
    )
    log = log.reshape(len(FAMILIES), len(estimates), BURNING)
    log += _staging_logs(log, prior, drawn.part.reshape(-1, BURNING), estimates.burn_share)
    family, source, weight = _allotted(log, prior)
    draw = np.tile(np.arange(BURNING), len(estimates))
    return _with_later_burns(
        model, drawn, family, source, weight, draw, time_s - history.as_burning().launch_s
    )


class _DrawnBurns(NamedTuple):
    """States of the filter (p, 10), the stages (p,) that burn there, and their laws by family.

    `total`, `number` (p, families, 4) and `hot` (p, families) are as in `Known`; `log_before` (p,
    families) is the evidence of the earlier stages, and of at least as many; `part` (p,) is the
    part of the filter's burn: 0 steady, 1 staging, 2 free.
    """

    track: IntArray
    part: IntArray
    state: FloatArray
    force: FloatArray
    since_s: FloatArray
    stage: IntArray
    total: FloatArray
    number: FloatArray
    hot: FloatArray
    log_before: FloatArray
    laws: list[PresentBurns]


def _drawn_burns(
    model: VehicleModel, estimates: ModeEstimates, history: StageHistory, time_s: float
) -> _DrawnBurns:
    count = len(estimates)
    lots = draws()
    on = history.as_burning()
    staged, begins = on.as_staging(estimates)
    parts = estimates.burn_mean.shape[1]
    place = lots.uniform[:BURNING, 0]
    # The part of each: staging, free, and steady between them.
    part = np.where(
        place < estimates.burn_share[:, 1:2],
        1,
        np.where(place > 1.0 - estimates.burn_share[:, 2:], 2, 0),
    )
    side = widened(inverse_root(estimates.burn_root.reshape(-1, 10, 10))).reshape(
        count, parts, 10, 10
    )
    each = lots.state[:BURNING] @ side.swapaxes(2, 3) + estimates.burn_mean[:, :, None]
    state = np.take_along_axis(each, part[:, None, :, None], axis=1).reshape(-1, 10)
    # The part that is staging is the next stage of some tracks, and the same one of others.
    new = ((part == 1) & begins[:, None]).ravel().astype(np.int64)
    track = np.repeat(np.arange(count), BURNING)
    begun, doubt = (
        np.stack([getattr(one, name) for one in (on, staged)])[new, track]
        for name in ("ignition_s", "ignition_sigma_s")
    )
    since = np.maximum(
        time_s - begun + doubt * ndtri(np.tile(lots.uniform[:BURNING, 1], count)), _SOON_S
    )
    known = [model.given(one.logs) for one in (on, staged)]
    done, total, number, hot, before = (
        np.stack([getattr(one, name) for one in known])[new, track]
        for name in ("done", "total", "number", "hot", "log_evidence")
    )
    stage = np.minimum(done, STAGES - 1)
    force = force_along(state)
    before = before + np.log(np.maximum(model.more(stage), 1e-12)) + history.log_free[track]
    highest = model.data["highest_m_s2"]
    laws = [
        present_burns(
            force, state[:, 9], since, *model.law(np.array(family), stage, *sums), highest
        )
        for family, sums in enumerate(zip(total.swapaxes(0, 1), number.swapaxes(0, 1), strict=True))
    ]
    return _DrawnBurns(
        track, part.ravel(), state, force, since, stage, total, number, hot, before, laws
    )


def _staging_logs(
    log: FloatArray, prior: FloatArray, part: IntArray, share: FloatArray
) -> FloatArray:
    """Return what to add to log evidences (families, n, m) so that the filter says how probable
    staging is.

    Its looks are in the shares (n, 2) of its parts already. But it expects a new stage at any time.
    """
    top = log.max(axis=(0, 2))[:, None]
    density = np.sum(np.exp(log - top) * prior[:, None, None], axis=0)
    steady, staging = (np.sum(np.where(part == code, density, 0.0), axis=1) for code in (0, 1))
    odds = share[:, 1] * _HOT / np.maximum(share[:, 0] + share[:, 1] * _HOT, 1e-12)
    known = (steady > 0.0) & (staging > 0.0) & (odds > 0.0) & (odds < 1.0)
    change = np.log(odds, where=known, out=np.zeros(len(odds))) - np.log1p(
        -odds, where=known, out=np.zeros(len(odds))
    )
    change += np.log(steady, where=known, out=np.zeros(len(odds))) - np.log(
        staging, where=known, out=np.zeros(len(odds))
    )
    return np.where(part == 1, np.where(known, change, 0.0)[:, None], 0.0)


def _allotted(log: FloatArray, prior: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return families, sources and weights (n, m) of the particles of tracks.

    `log` (families, n, m) are the log evidences of states by family: a family has a share of the
    particles near its probability, and its states are drawn by their evidence.
    """
    families, count, size = log.shape
    density = np.exp(log - log.max(axis=(0, 2))[:, None])
    evidence = density.sum(axis=2).T * prior
    share = evidence / evidence.sum(axis=1, keepdims=True)
    number = shares_in_numbers(share, size)
    ends = np.cumsum(number, axis=1)
    place = np.arange(size)
    row = np.arange(count)[:, None]
    family = np.sum(place >= ends[:, :, None], axis=1).clip(0, families - 1)
    position = (place - (ends - number)[row, family] + 0.5) / number[row, family]
    return (
        family,
        _systematic(density, family, position),
        (share / np.maximum(number, 1))[row, family],
    )


def _with_later_burns(
    model: VehicleModel,
    drawn: _DrawnBurns,
    family: IntArray,
    source: IntArray,
    weight: FloatArray,
    draw: IntArray,
    flown_s: FloatArray,
) -> Particles:
    """Return the particles of sources among the drawn burns, with burn times and later stages of
    their families.
    """
    rows = (np.arange(len(source))[:, None] * BURNING + source).ravel()
    kind = family.ravel()
    burn, first, rate = (np.empty(len(rows)) for _ in range(3))
    for code, law in enumerate(drawn.laws):
        mine = np.flatnonzero(kind == code)
        some = rows[mine]
        burn[mine] = law.burn_s(some, draws().uniform[draw[mine], 2])
        first[mine] = law.first_m_s2[some]
        rate[mine] = law.growth_per_s[some]
    stage = drawn.stage[rows]
    since = drawn.since_s[rows]
    track = drawn.track[rows]
    shown = np.stack(
        [np.log(burn), np.log(first), _ratio_log(rate, burn), np.zeros(len(burn))], axis=1
    )
    score = model.scores(kind, stage, shown) * _SHOWN
    total = drawn.total[rows, kind] + score
    number = drawn.number[rows, kind] + _SHOWN
    later = later_burns(model, kind, stage + 1, total, number, draw, drawn.hot[rows, kind])
    burns = _joined(burn - since, drawn.force[rows], rate, since, later, flown_s[track])
    lit = np.ones(len(rows), dtype=np.int64)
    state = drawn.state[rows]
    return Particles.of(
        burns,
        track,
        kind,
        lit,
        draw,
        weight.ravel(),
        state[:, :6],
        state[:, 6:9],
        drawn.part[rows] == 2,
    )


#: The rows of a stage that a burn shows: not the gap after it.
_SHOWN = np.array([1.0, 1.0, 1.0, 0.0])


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
    found = np.searchsorted(flat, position + shift[family, row])
    source: IntArray = np.clip(found - (family * count + row) * size, 0, size - 1)
    return source


def _ratio_log(rate: FloatArray, burn: FloatArray) -> FloatArray:
    logs: FloatArray = -np.log(np.maximum(1.0 - rate * burn, 0.02))
    return logs


def _joined(
    left_s: FloatArray,
    force: FloatArray,
    rate: FloatArray,
    since_s: FloatArray,
    later: Later,
    flown_s: FloatArray,
) -> RemainingBurns:
    """Return the burns of particles whose present stage has `left_s` to go, then the later ones."""
    growth = rate / np.maximum(1.0 - rate * since_s, 0.05)
    burn = np.concatenate([np.maximum(left_s, 0.0)[:, None], later.burn_s[:, :-1]], axis=1)
    gap = np.concatenate([np.zeros((len(left_s), 1)), later.gap_s[:, :-1]], axis=1)
    size = np.concatenate(
        [np.maximum(force, 0.5)[:, None], later.acceleration_m_s2[:, :-1]], axis=1
    )
    growths = np.concatenate([growth[:, None], later.growth_per_s[:, :-1]], axis=1)
    start = np.cumsum(burn + gap, axis=1) - burn
    return RemainingBurns(start, burn, size, growths, flown_s)
