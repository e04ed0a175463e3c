"""Particles of tracks: what each may be, with a state of the filter and the burns that remain to it.

A burning track's states come from the filter's density and are weighed by the law of the stage that burns; a dark one's
are in free flight, with no burn left or with those of the stages to come. All draws are the same quantiles for all
tracks and ticks, so regions change smoothly.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve, frozen
from scipy.special import ndtr, ndtri

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.square_root import inverse_root
from opir_core.interfaces import names_of
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.mode_mixing import SPEED_SIGMA_M_S
from opir_trackers.forecast.burning_on import RemainingBurns
from opir_trackers.forecast.present_burn import PresentBurns, present_burns
from opir_trackers.forecast.stage_history import StageHistory, force_along
from opir_trackers.forecast.vehicles import (
    BURN,
    FAMILIES,
    FORCE,
    GAP,
    RATIO,
    STAGES,
    Known,
    VehicleModel,
)

#: Particles of a burning track; of a dark one, those whose burn is over, and those that burn again.
BURNING, OVER, AGAIN = 256, 192, 128

#: Least share of the particles of each family: regions are mostly of missiles.
_LEAST_SHARE = np.array([0.5, 0.06, 0.04])

#: Families less probable than this have none.
_NEGLIGIBLE = 1e-3

#: Relights less probable than this, of all dark particles, get none.
_LEAST_RELIGHT = 2e-3

#: Hot stagings in the law of vehicles, as a share of the new stages that the filter expects.
_HOT = 0.25

#: Below this share of the velocity's prior standard deviation, looks know more than the prior.
_SEEN = 0.4

#: Least time since ignition, s.
_SOON_S = 0.5


@frozen(eq=False, repr=False)
class Particles(RemainingBurns):
    """Particles (p,) of tracks (rows of the forecast) with families, inertial states (p, 6), and remaining burns.

    `lit` is 1 for those that burn now, 2 for those that burn again, 0 for dark ones whose burn is over; `weight` sums
    to one over each of a track's burning and dark particles. `draw` is the number of a particle's draws, `force` (p, 3)
    its specific force, 0 in the dark.
    """

    track: IntArray
    family: IntArray
    lit: IntArray
    draw: IntArray
    weight: FloatArray
    state: FloatArray
    force: FloatArray

    @classmethod
    def of(cls, burns: RemainingBurns, *rest: Any) -> "Particles":
        """Return the particles of remaining burns and the other columns, in order."""
        return cls(*(getattr(burns, name) for name in names_of(RemainingBurns)), *rest)

    def of_tracks(self, rows: IntArray) -> "Particles":
        """Return the particles with the numbers of their tracks among others."""
        return evolve(self, track=rows[self.track])


class Draws(NamedTuple):
    """Numbers of draws: normal ones of states (m, 10) and of later stages (m, STAGES, 4), uniform ones (m, 5 +
    STAGES)."""

    state: FloatArray
    later: FloatArray
    uniform: FloatArray


@cache
def draws() -> Draws:
    """Return the draws of all tracks: a Latin hypercube of uniform numbers, and normal ones of zero mean."""
    rng = np.random.default_rng(1)
    size = BURNING + OVER + AGAIN
    state = rng.normal(size=(size, 10))
    steps = np.stack([rng.permutation(size) for _ in range(5 + STAGES)], axis=1)
    return Draws(state, rng.normal(size=(size, STAGES, 4)), (steps + rng.random(steps.shape)) / size)


def burning_particles(
    model: VehicleModel, estimates: ModeEstimates, history: StageHistory, prior: FloatArray, time_s: float
) -> Particles:
    """Return the particles of burning tracks (n,) at a time; `prior` (families,) are weights of the families."""
    drawn = _drawn_burns(model, estimates, history, time_s)
    log = np.stack([law.log_evidence + before for law, before in zip(drawn.laws, drawn.log_before.T, strict=True)])
    log = log.reshape(len(FAMILIES), len(estimates), BURNING)
    log += _staging_logs(log, prior, drawn.part.reshape(-1, BURNING), estimates.burn_share)
    family, source, weight = _allotted(log, prior)
    draw = np.tile(np.arange(BURNING), len(estimates))
    return _with_later_burns(model, drawn, family, source, weight, draw, time_s - history.as_burning().launch_s)


class _DrawnBurns(NamedTuple):
    """States of the filter (p, 10), the stages (p,) that burn there, and their laws by family.

    `total`, `number` (p, families, 4) and `hot` (p, families) are as in `Known`; `log_before` (p, families) is the
    evidence of the earlier stages, and of at least as many; `part` (p,) is 1 for the filter's part that is staging.
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


def _drawn_burns(model: VehicleModel, estimates: ModeEstimates, history: StageHistory, time_s: float) -> _DrawnBurns:
    count, lots = len(estimates), draws()
    on = history.as_burning()
    staged, begins = on.as_staging(estimates)
    parts, place = estimates.burn_mean.shape[1], lots.uniform[:BURNING, 0]
    # The part of each: staging, free, and steady between them.
    part = np.where(place < estimates.burn_share[:, 1:2], 1, np.where(place > 1.0 - estimates.burn_share[:, 2:], 2, 0))
    side = widened(inverse_root(estimates.burn_root.reshape(-1, 10, 10))).reshape(count, parts, 10, 10)
    each = lots.state[:BURNING] @ side.swapaxes(2, 3) + estimates.burn_mean[:, :, None]
    state = np.take_along_axis(each, part[:, None, :, None], axis=1).reshape(-1, 10)
    # The part that is staging is the next stage of some tracks, and the same one of others.
    new = ((part == 1) & begins[:, None]).ravel().astype(np.int64)
    track = np.repeat(np.arange(count), BURNING)
    begun, doubt = (
        np.stack([getattr(one, name) for one in (on, staged)])[new, track]
        for name in ("ignition_s", "ignition_sigma_s")
    )
    since = np.maximum(time_s - begun + doubt * ndtri(np.tile(lots.uniform[:BURNING, 1], count)), _SOON_S)
    known = [model.given(one.logs) for one in (on, staged)]
    done, total, number, hot, before = (
        np.stack([getattr(one, name) for one in known])[new, track]
        for name in ("done", "total", "number", "hot", "log_evidence")
    )
    stage, force = np.minimum(done, STAGES - 1), force_along(state)
    before = before + np.log(np.maximum(model.more(stage), 1e-12))
    highest = model.data["highest_m_s2"]
    laws = [
        present_burns(force, state[:, 9], since, *model.law(np.array(family), stage, *sums), highest)
        for family, sums in enumerate(zip(total.swapaxes(0, 1), number.swapaxes(0, 1), strict=True))
    ]
    return _DrawnBurns(track, part.ravel(), state, force, since, stage, total, number, hot, before, laws)


def _staging_logs(log: FloatArray, prior: FloatArray, part: IntArray, share: FloatArray) -> FloatArray:
    """Return what to add to log evidences (families, n, m) so that the filter says how probable staging is.

    Its looks are in the shares (n, 2) of its parts already. But it expects a new stage at any time.
    """
    top = log.max(axis=(0, 2))[:, None]
    density = np.sum(np.exp(log - top) * prior[:, None, None], axis=0)
    steady, staging = (np.sum(np.where(part == code, density, 0.0), axis=1) for code in (0, 1))
    odds = share[:, 1] * _HOT / np.maximum(share[:, 0] + share[:, 1] * _HOT, 1e-12)
    known = (steady > 0.0) & (staging > 0.0) & (odds < 1.0)
    change = np.log(odds / (1.0 - odds), where=known, out=np.zeros(len(odds)))
    change += np.log(steady, where=known, out=np.zeros(len(odds))) - np.log(
        staging, where=known, out=np.zeros(len(odds))
    )
    return np.where(part == 1, np.where(known, change, 0.0)[:, None], 0.0)


def widened(side: FloatArray) -> FloatArray:
    """Return covariance roots (n, d, d), wider where the velocity is known by the filter's prior alone.

    That prior is of all times of a burn (`mode_mixing.SPEED_SIGMA_M_S`); late stages are up to four times as fast. One
    sensor does not see the velocity along its line of sight.
    """
    spread = np.sqrt(np.sum(side[:, 3:6] ** 2, axis=(1, 2))) / SPEED_SIGMA_M_S
    factor = 1.0 + np.clip((spread - _SEEN) / (1.0 - _SEEN), 0.0, 1.0)
    return side * factor[:, None, None]


def _allotted(log: FloatArray, prior: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return families, sources and weights (n, m) of the particles of tracks.

    `log` (families, n, m) are the log evidences of states by family: a family has a share of the particles near its
    probability, and its states are drawn by their evidence.
    """
    families, count, size = log.shape
    density = np.exp(log - log.max(axis=(0, 2))[:, None])
    evidence = density.sum(axis=2).T * prior
    share = evidence / evidence.sum(axis=1, keepdims=True)
    number = _numbers(share, size)
    ends = np.cumsum(number, axis=1)
    place, row = np.arange(size), np.arange(count)[:, None]
    family = np.sum(place >= ends[:, :, None], axis=1).clip(0, families - 1)
    position = (place - (ends - number)[row, family] + 0.5) / number[row, family]
    return family, _systematic(density, family, position), (share / np.maximum(number, 1))[row, family]


def _with_later_burns(
    model: VehicleModel,
    drawn: _DrawnBurns,
    family: IntArray,
    source: IntArray,
    weight: FloatArray,
    draw: IntArray,
    flown_s: FloatArray,
) -> Particles:
    """Return the particles of sources among the drawn burns, with burn times and later stages of their families."""
    rows, kind = (np.arange(len(source))[:, None] * BURNING + source).ravel(), family.ravel()
    burn, first, rate = (np.empty(len(rows)) for _ in range(3))
    for code, law in enumerate(drawn.laws):
        mine = np.flatnonzero(kind == code)
        some = rows[mine]
        burn[mine] = law.burn_s(some, draws().uniform[draw[mine], 2])
        first[mine], rate[mine] = law.first_m_s2[some], law.growth_per_s[some]
    stage, since, track = drawn.stage[rows], drawn.since_s[rows], drawn.track[rows]
    shown = np.stack([np.log(burn), np.log(first), _ratio_log(rate, burn), np.zeros(len(burn))], axis=1)
    score = model.scores(kind, stage, shown) * _SHOWN
    total, number = drawn.total[rows, kind] + score, drawn.number[rows, kind] + _SHOWN
    later = later_burns(model, kind, stage + 1, total, number, draw, drawn.hot[rows, kind])
    burns = _joined(burn - since, drawn.force[rows], rate, since, later, flown_s[track])
    lit, state = np.ones(len(rows), dtype=np.int64), drawn.state[rows]
    return Particles.of(burns, track, kind, lit, draw, weight.ravel(), state[:, :6], state[:, 6:9])


#: The rows of a stage that a burn shows: not the gap after it.
_SHOWN = np.array([1.0, 1.0, 1.0, 0.0])


def _systematic(density: FloatArray, family: IntArray, position: FloatArray) -> IntArray:
    """Return sources (n, m) drawn by densities (families, n, m) at positions (n, m) within each particle's family."""
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


class Later(NamedTuple):
    """Stages to come of particles (p, STAGES): gaps before them, burn times (0: none), accelerations and growths c."""

    gap_s: FloatArray
    burn_s: FloatArray
    acceleration_m_s2: FloatArray
    growth_per_s: FloatArray


def later_burns(
    model: VehicleModel,
    family: IntArray,
    done: IntArray,
    total: FloatArray,
    number: FloatArray,
    draw: IntArray,
    hot: FloatArray,
    dark_s: FloatArray | None = None,
) -> Later:
    """Return the stages to come after `done` (p,) of particles with sums of scores; `hot` (p,) without a gap.

    With `dark_s` (p,) there is at least one, after a gap longer than that; without, their number is drawn.
    """
    lots = draws()
    uniform = lots.uniform[draw]
    stages = np.zeros((4, len(family), STAGES))
    chance = uniform[:, 3]
    least = model.more(done - 1)[np.arange(len(family)), family]
    for step in range(STAGES - 1):
        stage = np.minimum(done + step, STAGES - 1)
        mean, sigma = model.law(family, stage, total, number)
        more = model.more(done + step)[np.arange(len(family)), family]
        exists = (done + step < STAGES) & (chance * least < more)
        if dark_s is not None and step == 0:
            least, exists = more, done < STAGES
        normal = lots.later[draw, step]
        logs = mean + sigma * normal
        gap = np.where(uniform[:, 5 + step] < hot, 0.0, np.exp(logs[:, GAP]))
        if dark_s is not None and step == 0:
            gap = _longer_gap(mean[:, GAP], sigma[:, GAP], dark_s, uniform[:, 4])
            logs[:, GAP] = np.log(gap)
        room = np.log(model.data["highest_m_s2"]) - logs[:, FORCE]
        ratio = np.maximum(np.minimum(logs[:, RATIO], room), 0.02)
        burn, first = np.exp(logs[:, BURN]), np.exp(logs[:, FORCE])
        columns = gap, burn, first, -np.expm1(-ratio) / burn
        stages[:, :, step] = np.where(exists, np.stack(columns), 0.0)
        score = model.scores(family, stage, logs)
        total, number = total + score, number + 1.0
    return Later(*stages)


def _longer_gap(mean: FloatArray, sigma: FloatArray, dark_s: FloatArray, share: FloatArray) -> FloatArray:
    """Return draws (p,) of log-normal gaps longer than a time (p,), s."""
    below = ndtr((np.log(np.maximum(dark_s, 0.05)) - mean) / sigma)
    score = ndtri(np.minimum(below + (1.0 - below) * share, 1.0 - 1e-12))
    gap: FloatArray = np.maximum(np.exp(mean + sigma * score), dark_s)
    return gap


def _joined(
    left_s: FloatArray, force: FloatArray, rate: FloatArray, since_s: FloatArray, later: Later, flown_s: FloatArray
) -> RemainingBurns:
    """Return the burns of particles whose present stage has `left_s` to go, then the later ones."""
    growth = rate / np.maximum(1.0 - rate * since_s, 0.05)
    burn = np.concatenate([np.maximum(left_s, 0.0)[:, None], later.burn_s[:, :-1]], axis=1)
    gap = np.concatenate([np.zeros((len(left_s), 1)), later.gap_s[:, :-1]], axis=1)
    size = np.concatenate([np.maximum(force, 0.5)[:, None], later.acceleration_m_s2[:, :-1]], axis=1)
    growths = np.concatenate([growth[:, None], later.growth_per_s[:, :-1]], axis=1)
    start = np.cumsum(burn + gap, axis=1) - burn
    return RemainingBurns(start, burn, size, growths, flown_s)


def dark_particles(
    model: VehicleModel,
    estimates: ModeEstimates,
    history: StageHistory,
    prior: FloatArray,
    dark_s: FloatArray,
    time_s: float,
) -> tuple[Particles, FloatArray]:
    """Return the particles of tracks (n,) that are dark for times (n,), s, and what may yet burn again, (n, families).

    The second is the probability of a relight of each family, by its number of stages and its gaps, not weighed by
    where these lead.
    """
    over = history.as_dark(time_s, dark_s)
    known = model.given(over.logs)
    families, count = np.arange(len(FAMILIES)), len(estimates)
    stage = np.minimum(known.done, STAGES - 1)
    law = model.law(families, stage[:, None], known.total, known.number)
    longer = ndtr((law[0][:, :, GAP] - np.log(np.maximum(dark_s, 0.05))[:, None]) / law[1][:, :, GAP])
    more, all_ = model.more(known.done), model.more(np.maximum(known.done - 1, 0))
    # What ignites without a gap does so within about the time between two looks.
    waits = more * longer * np.where(dark_s[:, None] > 1.0, 1.0 - known.hot, 1.0)
    ends = np.maximum(all_ - more, 1e-3)
    evidence = np.exp(known.log_evidence - known.log_evidence.max(axis=1, keepdims=True)) * prior
    relight = evidence * waits
    whole = (relight + evidence * ends).sum(axis=1, keepdims=True)
    relight, ended = relight / whole, evidence * ends / whole
    side = widened(inverse_root(estimates.coast_root))
    lots = draws()
    parts = [
        _free(known, ended, estimates, side, np.arange(OVER) + BURNING, np.arange(count)),
        _again(model, known, relight, estimates, side, lots, dark_s, time_s - over.launch_s),
    ]
    return Particles.concatenate(parts), relight / np.maximum(relight + ended, 1e-12)


def _free(
    known: Known, ended: FloatArray, estimates: ModeEstimates, side: FloatArray, draw: IntArray, rows: IntArray
) -> Particles:
    """Return particles in free flight of tracks `rows`, of each family in turn; weights are by families, (n,
    families)."""
    count, size = len(rows), len(draw)
    number = _numbers(ended[rows], size)
    family = np.sum(np.arange(size) >= np.cumsum(number, axis=1)[:, :, None], axis=1).clip(0, len(FAMILIES) - 1)
    row = np.arange(count)[:, None]
    weight = (ended[rows] / np.maximum(number, 1))[row, family].ravel()
    state = draws().state[draw, :6] @ side[rows].swapaxes(1, 2) + estimates.coast_mean[rows, None]
    nothing = np.zeros((count * size, STAGES))
    burns = RemainingBurns(nothing, nothing, nothing, nothing, nothing[:, 0])
    track, lit = np.repeat(rows, size), np.zeros(count * size, dtype=np.int64)
    # Families take turns, so that each has states of all kinds.
    turn = _turns(size)
    family, weight = family[:, turn].ravel(), weight.reshape(count, size)[:, turn].ravel()
    return Particles.of(burns, track, family, lit, np.tile(draw, count), weight, state.reshape(-1, 6), nothing[:, :3])


@cache
def _turns(size: int) -> IntArray:
    """Return a fixed random order of so many particles."""
    return np.random.default_rng(5).permutation(size)


def _numbers(share: FloatArray, size: int) -> IntArray:
    """Return numbers (n, families) of particles that add up to `size`, nearly in proportion to shares."""
    given = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-300)
    given = np.where(given > _NEGLIGIBLE, np.maximum(given, _LEAST_SHARE), 0.0)
    given /= given.sum(axis=1, keepdims=True)
    numbers: IntArray = np.diff(np.rint(np.cumsum(given, axis=1) * size).astype(np.int64), axis=1, prepend=0)
    return numbers


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
    total, number = known.total[free.track, free.family], known.number[free.track, free.family]
    hot = known.hot[free.track, free.family]
    waits = dark_s[free.track]
    later = later_burns(model, free.family, known.done[free.track], total, number, free.draw, hot, waits)
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
