"""Posteriors of boosts that one sensor sees, by importance sampling: what the fit's moments are held against.

Nothing in what is sampled is linear: rows are residuals of the paths themselves, priors those of natural parameters.
"""

import numpy as np
from attrs import evolve
from profile_flights import PRIORS

from opir_core.tracking.profile import fit, flight
from opir_core.tracking.profile.coordinates import natural
from opir_core.tracking.profile.family import BURN, EAST, LIFT, NORTH, SPEED, START, TURN_EAST, TURN_NORTH
from opir_core.tracking.profile.fit import Hypotheses
from opir_core.tracking.profile.hypotheses import joined

#: Degrees of freedom and widening of the mixture that is drawn from; by how much shares of its parts are evened out.
FREEDOM, WIDER, EVENER = 6.0, 1.2, 0.6

#: Starts before the first light at which each hypothesis is fitted beside where it stands, s; how near to them.
SOONER_S, NEAR_S = np.arange(0.5, 26.0, 3.0), 1.8

#: The same for ends after the last light, each between two of these, s, and how near to it, of the way between them.
LATER_S, NEAR = np.append(0.0, np.geomspace(0.15, 60.0, 11)), 0.6


def log_posterior(x, hypothesis, rows, first_s, last_s):
    """Return log posteriors (n,) of parameters (n, 10), counted from a hypothesis's anchor, and the paths.

    `first_s` is the first light and `last_s` the last, scene times: the burn lasted until then.
    """
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
    start, before, hidden = x[:, START], first_s - hypothesis.anchor_s - x[:, START], priors.hidden_s
    told = np.log(1.98 * (before > 0.0)) - 0.5 * np.square(before / hidden)
    log += np.logaddexp(told, np.log(0.01) - 0.5 * np.square(start / hidden))
    return np.where(paths.burnout_s > last_s, log, -np.inf), paths


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
        evidence = solution.evidence - np.log(width)
        again = evolve(again, parameters=parameters, spread=solution.spread, evidence=evidence)
    return again


def sampled_states(hypotheses, rows, first_s, last_s, tick_s, count, seed):
    """Return states (m, 6) at a tick of a burn that one track's hypotheses tell, their weights, and how many count."""
    again = sooner(hypotheses, rows, first_s)
    paths, sound, weight = _sampled(hypotheses, again, rows, first_s, last_s, count, seed)
    here = paths.places(sound, np.full(len(sound), tick_s))
    return np.concatenate([here.position_m, here.velocity_m_s], axis=1), weight, 1.0 / np.square(weight).sum()


def sampled_impacts(hypotheses, rows, first_s, last_s, count, seed):
    """Return impacts (m, 3) of a burn that one track's hypotheses tell, their weights, and how many count."""
    again = later(hypotheses, rows, last_s)
    paths, sound, weight = _sampled(hypotheses, again, rows, first_s, last_s, count, seed)
    end_s = paths.burnout_s[sound]
    there = paths.places(sound, end_s)
    landed = flight.landed(np.column_stack([there.position_m, there.velocity_m_s, end_s]))
    return landed, weight, 1.0 / np.square(weight).sum()


def _sampled(hypotheses, again, rows, first_s, last_s, count, seed):
    """Return paths drawn for one track's hypotheses, fitted again beside, which of them count, and their weights."""
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
    # What is drawn far out may be no boost at all.
    with np.errstate(all="ignore"):
        log, paths = log_posterior(x, hypotheses.take([0]), rows, first_s, last_s)
    drawn = np.zeros(count)
    for part, mean, one in zip(share, every.parameters, root, strict=True):
        square = np.sum(np.square(np.linalg.solve(one, (x - mean).T)), axis=0)
        height = np.exp(-np.log(np.diagonal(one) / scale[0]).sum())
        drawn += part * height * (1.0 + square / FREEDOM) ** (-0.5 * (FREEDOM + 10.0))
    log = np.where(np.isfinite(log), log, -np.inf) - np.log(drawn)
    weight = np.exp(log - log.max())
    sound = np.flatnonzero(weight > 1e-7)
    weight = weight[sound] / weight[sound].sum()
    return paths, sound, weight
