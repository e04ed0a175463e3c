"""Which early rays, that belong to no track, a young track explains: those from before it was known as one."""

import numpy as np
from attrs import evolve

from opir_core.records import FloatArray, IntArray
from opir_core.tracking.profile import fit
from opir_core.tracking.profile import hypotheses as hypotheses_of
from opir_core.tracking.profile.bank import Fitting
from opir_core.tracking.profile.rows import SPAN_S, Rows, normal_points, single
from opir_core.tracking.profile.strain import Bank
from opir_core.tracking.rays import Rays

#: A ray is claimed within so many standard deviations.
_CLAIM_SIGMA = 4.5


def claimed(fitting: Fitting, bank: Bank, track: IntArray, pool: Rays) -> tuple[Bank, IntArray]:
    """Return the bank with the rays that tracks by number explain best, and whose (n,) each then is, -1 for none."""
    young = bank.hypotheses.take(np.isin(bank.hypotheses.track, track))
    owner = np.full(len(pool), -1, dtype=np.int64)
    if not len(young):
        return bank, owner
    owner = _owners(fitting, hypotheses_of.likeliest(young), pool)
    taken = np.flatnonzero(owner >= 0)
    if not len(taken):
        return bank, owner
    rays = pool.take(taken)
    rows = single(owner[taken], rays)
    path = hypotheses_of.Path.of(young, fitting.priors, None)
    rows = evolve(rows, time_s=fitting.left_s(rows, path.at(rows)))
    points = normal_points(rows, path.at, np.floor(rows.time_s / SPAN_S).astype(np.int64))
    seen = bank.seen.with_rays(rows, rays.time_s)
    return evolve(bank, rows=Rows.concatenate([bank.rows, points]), seen=seen), owner


def _owners(fitting: Fitting, likely: fit.Hypotheses, pool: Rays) -> IntArray:
    """Return the track (n,) that each ray is nearest to, in standard deviations, -1 where none is near."""
    place, ray = (grid.ravel() for grid in np.meshgrid(np.arange(len(likely)), np.arange(len(pool)), indexing="ij"))
    rows = single(likely.track[place], pool.take(ray))
    path = hypotheses_of.Path.of(likely, fitting.priors, rows)
    rows = evolve(rows, time_s=fitting.left_s(rows, path.at(rows)))
    distance = np.full(len(place), np.inf)
    near = np.flatnonzero(_angle(rows, path.at(rows)) < _NEAR_RAD)
    if len(near):
        expected, slope = fit.linearised(fit.family_of(likely, fitting.priors), rows.take(near), place[near])
        total = slope @ likely.spread[place[near]] @ slope.transpose(0, 2, 1)
        total = total + np.square(rows.sigma_rad[near])[:, None, None] * np.eye(2)
        distance[near] = np.sum(expected * np.linalg.solve(total, expected[:, :, None])[:, :, 0], axis=1)
    table = distance.reshape(len(likely), len(pool))
    best = np.argmin(table, axis=0)
    close = table[best, np.arange(len(pool))] < _CLAIM_SIGMA**2
    return np.where(close, likely.track[best], -1)


#: No young track is less certain than this, rad.
_NEAR_RAD = 2e-3


def _angle(rows: Rows, position: FloatArray) -> FloatArray:
    """Return by how much (m,) rows' directions differ from those to positions, rad, for small angles."""
    line = position - rows.origin_ecef_m
    line = line / np.sqrt(np.sum(line * line, axis=1))[:, None]
    apart: FloatArray = np.sqrt(np.sum(np.square(line - rows.axes[:, 2]), axis=1))
    return apart
