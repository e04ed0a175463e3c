"""Posteriors of boosts that sensors see, by importance sampling: what the fit's moments are held against.

Nothing in what is sampled is linear: rows are residuals of the paths themselves, priors those of natural parameters.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve
from class_flights import PRIORS
from opir_trackers.profile import fit, flight
from opir_trackers.profile.family import BURN, EAST, LIFT, NORTH, SPEED, START, TURN_EAST, TURN_NORTH, natural
from opir_trackers.profile.fit import Hypotheses
from opir_trackers.profile.hypotheses import joined, probability

#: Degrees of freedom and widening of the mixture that is drawn from; by how much shares of its parts are evened out.
FREEDOM, WIDER, EVENER = 6.0, 1.2, 0.6

#: Starts before the first light at which each hypothesis is fitted beside where it stands, s; how near to them.
SOONER_S, NEAR_S = np.arange(0.5, 26.0, 3.0), 1.8

#: The same for ends after the last light, each between two of these, s, and how near to it, of the way between them.
LATER_S, NEAR = np.append(0.0, np.geomspace(0.15, 60.0, 11)), 0.6


#: Hypotheses less probable than this lead nowhere else, nor starts that are less likely than the best by this share;
#: weights of what is drawn below this, of the largest, are left out.
TELLING, LEADING, COUNTED = 2e-3, 1e-2, 1e-7


class Looks(NamedTuple):
    """When like sensors saw light of a burn, scene times: the first of all, and of each (sensors,) the last.

    After that they looked every `period_s` until `until_s` (sensors,), and would have seen it with a chance each time.
    """

    first_s: float
    last_s: np.ndarray
    until_s: np.ndarray
    period_s: float
    chance: float

    @classmethod
    def of(cls, seen, tick_s, period_s, chance):
        """Return the looks at one track, of which this is seen, until a tick."""
        last_s = seen.last_s[0]
        return cls(seen.first_s.min(), last_s, np.maximum(tick_s - seen.travel_s[0], last_s), period_s, chance)

    def log_lasted(self, end_s):
        """Return the log likelihoods (n,) of what was seen, and then not, were the burn to end at times (n,)."""
        unseen_s = np.minimum(end_s[:, None], self.until_s) - self.last_s
        missed = np.maximum(np.floor(unseen_s / self.period_s - 1e-6), 0.0).sum(axis=1)
        return np.where(end_s > self.last_s.max(), missed * np.log1p(-self.chance), -np.inf)


def log_posterior(x, hypothesis, rows, looks):
    """Return log posteriors (n,) of parameters (n, 10), counted from a hypothesis's anchor."""
    count, priors = len(x), PRIORS.take(np.repeat(hypothesis.kind, len(x)))
    paths = fit.family_of(evolve(hypothesis.take(np.zeros(count, dtype=np.int64)), parameters=x), PRIORS)
    every = rows.take(np.tile(np.arange(len(rows)), count))
    line = paths.places(np.repeat(np.arange(count), len(rows)), every.time_s).position_m - every.origin_ecef_m
    local = np.einsum("nij,nj->ni", every.axes, line)
    off = local[:, :2] / local[:, 2:] / every.sigma_rad[:, None]
    log = -0.5 * np.square(off).sum(axis=1).reshape(count, -1).sum(axis=1)
    found = natural(x, priors)
    length = np.hypot(found.parameters[:, TURN_EAST], found.parameters[:, TURN_NORTH])
    log -= 0.5 * np.square((length - priors.turn_rad) / priors.turn_sigma_rad) + np.log(length * found.lean**2)
    normal = [EAST, NORTH, *range(SPEED, LIFT + 1)]
    log -= 0.5 * np.sum((priors.information() * np.square(found.parameters))[:, normal], axis=1)
    start, before, hidden = x[:, START], looks.first_s - hypothesis.anchor_s - x[:, START], priors.hidden_s
    told = np.log(1.98 * (before > 0.0)) - 0.5 * np.square(before / hidden)
    log += np.logaddexp(told, np.log(0.01) - 0.5 * np.square(start / hidden))
    return log + looks.log_lasted(paths.burnout_s)


def sooner(hypotheses, rows, first_s):
    """Return hypotheses fitted anew near starts sooner than the first light, from where they lead."""
    again = hypotheses.take(np.repeat(np.arange(len(hypotheses)), len(SOONER_S)))
    start = np.tile(first_s - hypotheses.anchor_s[0] - SOONER_S, len(hypotheses))
    slope = np.tile(np.eye(10)[START], (len(start), 1))
    return _near(again, rows, lambda _: (start, slope), np.full(len(start), NEAR_S))


def later(hypotheses, rows, last_s):
    """Return hypotheses fitted anew near ends of burns later than the last light, from where they lead."""
    again = hypotheses.take(np.repeat(np.arange(len(hypotheses)), len(LATER_S) - 1))
    end_s = np.tile(last_s + 0.5 * (LATER_S[1:] + LATER_S[:-1]), len(hypotheses))

    def wanted(trial):
        family, slope = fit.family_of(trial, PRIORS), np.zeros((len(trial), 10))
        slope[:, START], slope[:, BURN] = 1.0, family.courses.burn_s
        return end_s - family.burnout_s + np.sum(slope * trial.parameters, axis=1), slope

    return _near(again, rows, wanted, np.tile(NEAR * np.diff(LATER_S), len(hypotheses)))


def _near(again, rows, wanted, width):
    """Return hypotheses (n,) fitted anew where what goes with slopes (n, 10) is near values (n,), to widths (n,)."""
    value, slope = wanted(again)
    gain = np.einsum("nij,nj->ni", again.spread, slope)
    away = (value - np.sum(slope * again.parameters, axis=1)) / np.sum(gain * slope, axis=1)
    again = evolve(again, parameters=again.parameters + gain * away[:, None])
    row, owner = joined(again.track, rows.track)
    for _ in range(6):
        value, slope = (each / width.reshape(-1, *(1,) * (each.ndim - 1)) for each in wanted(again))
        family = fit.family_of(again, PRIORS)
        again = fit.with_rows(again.cleared(), family, rows.take(row), owner, np.ones(len(row)))
        near = evolve(
            again,
            normal=again.normal + slope[:, :, None] * slope[:, None],
            right=again.right + value[:, None] * slope,
            square=again.square + np.square(value),
        )
        solution = fit.solved(near, PRIORS, np.zeros(1))
        parameters = fit.moved(again, solution.parameters, PRIORS)
        # Of widths that differ each stands for as much more.
        evidence = np.nan_to_num(solution.evidence - np.log(width), nan=-np.inf)
        again = evolve(again, parameters=parameters, spread=solution.spread, evidence=evidence)
    return again


def states_of(drawn, tick_s):
    """Return the states (m, 6) at a tick of boosts, in free flight once their burns are over."""
    family, nothing = fit.family_of(drawn, PRIORS), np.zeros((len(drawn), 10, 10))
    return flight.states(family, nothing, tick_s, *flight.burnouts(family, nothing), "kepler").mean


def impacts_of(drawn):
    """Return where boosts come down, (m, 3), nan of those that do not."""
    family = fit.family_of(drawn, PRIORS)
    there = family.places(np.arange(len(drawn)), family.burnout_s)
    return flight.landed(np.column_stack([there.position_m, there.velocity_m_s, family.burnout_s]))


def effective(weight):
    """Return how many of what is drawn with such weights (m,) count."""
    return 1.0 / np.square(weight).sum()


def sampled(hypotheses, rows, looks, count, seed, *, starts=True, ends=True):
    """Return boosts (m,) drawn for one track's hypotheses, and their weights (m,).

    They are drawn from hypotheses fitted anew near starts, near ends, or near both.
    """
    again = hypotheses = hypotheses.take(probability(hypotheses) > TELLING)
    # What is fitted far out, or drawn there, may be no boost at all: it is likely nowhere.
    with np.errstate(all="ignore"):
        if starts:
            again = sooner(again, rows, looks.first_s)
            again = again.take(again.evidence > again.evidence.max() + np.log(LEADING))
        if ends:
            both = Hypotheses.concatenate([hypotheses, again]) if starts else again
            again = later(both, rows, looks.last_s.max())
        return _sampled(hypotheses, again, rows, looks, count, seed)


def _sampled(hypotheses, again, rows, looks, count, seed):
    """Return boosts drawn for one track's hypotheses, fitted again beside, and their weights."""
    dice = np.random.default_rng(seed)
    level = np.append(np.full(len(hypotheses), again.evidence.max()), again.evidence)
    every, share = Hypotheses.concatenate([hypotheses, again]), np.exp(EVENER * (level - level.max()))
    every, share = every.take(share > 1e-4), share[share > 1e-4] / share[share > 1e-4].sum()
    scale = np.sqrt(np.diagonal(every.spread, axis1=1, axis2=2))
    unit = every.spread / (scale[:, :, None] * scale[:, None]) + 1e-9 * np.eye(10)
    root = WIDER * np.linalg.cholesky(unit) * scale[:, :, None]
    which = dice.choice(len(share), count, p=share)
    normal = dice.normal(size=(count, 10)) / np.sqrt(dice.chisquare(FREEDOM, count) / FREEDOM)[:, None]
    x = every.parameters[which] + np.einsum("nij,nj->ni", root[which], normal)
    log = log_posterior(x, hypotheses.take([0]), rows, looks)
    drawn = np.zeros(count)
    for part, mean, one in zip(share, every.parameters, root, strict=True):
        square = np.sum(np.square(np.linalg.solve(one, (x - mean).T)), axis=0)
        height = np.exp(-np.log(np.diagonal(one) / scale[0]).sum())
        drawn += part * height * (1.0 + square / FREEDOM) ** (-0.5 * (FREEDOM + 10.0))
    log = np.where(np.isfinite(log), log, -np.inf) - np.log(drawn)
    weight = np.exp(log - log.max())
    sound = np.flatnonzero(weight > COUNTED)
    boosts = evolve(hypotheses.take(np.zeros(len(sound), dtype=np.int64)), parameters=x[sound])
    return boosts, weight[sound] / weight[sound].sum()
