"""What a run's tracks cover, tick by tick: which launches have one, and how far the two sets are from each other."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.scoring.evidence import Ownership, RunEvidence, true_states
from opir_core.scoring.gospa import gospa

_NS = 1_000_000_000


@frozen(kw_only=True)
class GospaSettings:
    """GOSPA's parameters: the cut-off distance c, m, the order p and alpha."""

    cutoff_m: float = 5000.0
    order: float = 2.0
    alpha: float = 2.0


@frozen(eq=False)
class Coverage:
    """One row a launch that was detected.

    `share` is of the ticks from its first detection to its burnout the share with a track, `first_track_s` how long
    after that detection the first came, s, and `tracks` how many it had in all: more than one where a track was lost or
    doubled.
    """

    share: FloatArray
    first_track_s: FloatArray
    tracks: IntArray


def ticks_s(evidence: RunEvidence) -> FloatArray:
    """Return the ticks (n,) of a run, s: those at which its tracker is asked, whether or not it told anything then.

    Where tracks were told at other times, as by a tracker from elsewhere, it is those times.
    """
    told = np.unique(evidence.tracks.tick_s)
    cadence_s, end_ns = evidence.plan.make_tracker().cadence_s, evidence.plan.end_ns
    if cadence_s is None:
        return told
    step_ns = max(1, round(cadence_s * _NS))
    asked: FloatArray = np.append(np.arange(step_ns, end_ns, step_ns), end_ns) / _NS
    return asked if np.isin(told, asked).all() else told


def coverage(evidence: RunEvidence, owners: Ownership) -> Coverage:
    """Return what a run's tracks cover of its launches."""
    ticks, owner = ticks_s(evidence), owners.target[np.searchsorted(owners.track, evidence.tracks.track)]
    shares, firsts, counts = [], [], []
    for target in range(len(evidence.plan.scene.targets)):
        seen = evidence.time_s[evidence.target == target]
        if not len(seen):
            continue
        told = np.unique(evidence.tracks.tick_s[owner == target])
        due = ticks[(ticks >= seen[0]) & (ticks <= evidence.plan.targets.burnout_s[target])]
        shares.append(float(np.isin(due, told).mean()) if len(due) else np.nan)
        firsts.append(float(told[0] - seen[0]) if len(told) else np.nan)
        counts.append(np.count_nonzero(owners.target == target))
    return Coverage(np.array(shares), np.array(firsts), np.array(counts, dtype=np.int64))


def gospa_parts(evidence: RunEvidence, owners: Ownership, settings: GospaSettings) -> FloatArray:
    """Return (ticks, 5): distance, the three p-th powers, and how many launches there are whose truth is known.

    A track of a launch whose truth is no longer known, as after burnout, is neither found nor false: it is left out.
    """
    targets, tracks = evidence.plan.targets, evidence.tracks
    launches = np.arange(len(evidence.plan.scene.targets), dtype=np.int32)
    owner = owners.target[np.searchsorted(owners.track, tracks.track)]
    rows = []
    for tick_s in ticks_s(evidence).tolist():
        known = launches[(targets.ignition_s[launches] <= tick_s) & (targets.end_s[launches] >= tick_s)]
        if not len(known):
            continue
        true = true_states(evidence.plan, known, np.full(len(known), tick_s))[:, :3]
        judged = (tracks.tick_s == tick_s) & np.isfinite(tracks.state[:, 0])
        told = tracks.state[judged & ((owner < 0) | np.isin(owner, known)), :3]
        found = gospa(told, true, cutoff=settings.cutoff_m, order=settings.order, alpha=settings.alpha)
        rows.append((found.distance, found.localisation, found.missed, found.false, len(known)))
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def mean_gospa(parts: FloatArray, order: float) -> FloatArray:
    """Return a run's mean distance, the same a target, and its three parts a target; nan where no truth was known.

    The distance a target is (d^p / n)^(1/p) of n targets: where each is found, and as far off as any other, it is how
    far that is, however many there are.
    """
    if not len(parts):
        return np.full(5, np.nan)
    powers = parts[:, 1:4] / parts[:, 4:]
    each = powers.sum(axis=1) ** (1.0 / order)
    mean: FloatArray = np.concatenate([parts[:, :1], each[:, None], powers], axis=1).mean(axis=0)
    return mean
