"""Coverage of launches by a run's tracks per tick, and the GOSPA distance between tracks and
targets.
"""

import numpy as np
from attrs import frozen

from opir_core import Plan
from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_scoring.evidence import Ownership, RunEvidence, true_states_ecef
from opir_scoring.gospa_metric import gospa


@frozen(kw_only=True)
class GospaSettings:
    """Parameters of GOSPA: cut-off distance c, m, order p and alpha."""

    cutoff_m: float = 5000.0
    order: float = 2.0
    alpha: float = 2.0


@frozen(eq=False)
class Coverage:
    """One row per detected launch.

    `share` is the fraction of ticks with a track, from the first detection to burnout;
    `first_track_s` the time from the first detection to the first available estimate of a track, s;
    `tracks` the number of tracks, more than one where a track was lost or duplicated.
    """

    share: FloatArray
    first_track_s: FloatArray
    tracks: IntArray


def ticks_s(evidence: RunEvidence) -> FloatArray:
    """Return the ticks (n,) of a run, s, at which its tracker is stepped, with or without reported
    tracks.

    For tracks at other times, as of an external tracker, these are their times.
    """
    times = np.unique(evidence.tracks.tick_s)
    cadence_s = evidence.plan.make_tracker().cadence_s
    end_ns = evidence.plan.end_ns
    if cadence_s is None:
        return times
    step_ns = max(1, round(cadence_s * 10**9))
    ticks: FloatArray = np.append(np.arange(step_ns, end_ns, step_ns), end_ns) / 10**9
    return ticks if np.isin(times, ticks).all() else times


def coverage(evidence: RunEvidence, owners: Ownership) -> Coverage:
    """Return the coverage of a run's launches."""
    ticks = ticks_s(evidence)
    owner = owners.target[np.searchsorted(owners.track, evidence.tracks.track)]
    # Files of other trackers may not say when estimates became available: as soon as they are
    # valid.
    available_s = np.fmax(evidence.tracks.available_s, evidence.tracks.tick_s)
    rows = []
    for target in range(len(evidence.plan.scene.targets)):
        detected_s = evidence.time_s[evidence.target == target]
        if not len(detected_s):
            continue
        of_target = owner == target
        burnout_s = evidence.plan.targets.burnout_s[target]
        expected = ticks[(ticks >= detected_s[0]) & (ticks <= burnout_s)]
        share = _share(expected, evidence.tracks.tick_s[of_target])
        first_track_s = available_s[of_target].min(initial=np.inf) - detected_s[0]
        rows.append((share, first_track_s, np.count_nonzero(owners.target == target)))
    shares, first_tracks_s, counts = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    first_tracks_s = np.where(np.isinf(first_tracks_s), np.nan, first_tracks_s)
    return Coverage(shares, first_tracks_s, counts.astype(np.int64))


def _share(expected: FloatArray, times: FloatArray) -> float:
    """Return the share of expected times (n,) that are among others; nan without any."""
    return float(np.isin(expected, times).mean()) if len(expected) else np.nan


def gospa_parts(evidence: RunEvidence, owners: Ownership, settings: GospaSettings) -> FloatArray:
    """Return (ticks, 5): distance, the three p-th powers, and the number of launches with known
    truth.

    A track of a launch whose truth is no longer known, as after burnout, is left out.
    """
    rows = []
    for tick_s in ticks_s(evidence).tolist():
        estimates, true = _estimates_and_truth(evidence, owners, tick_s)
        if len(true):
            result = gospa(
                estimates,
                true,
                cutoff=settings.cutoff_m,
                order=settings.order,
                alpha=settings.alpha,
            )
            powers = (result.localisation, result.missed, result.false)
            rows.append((result.distance, *powers, len(true)))
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _estimates_and_truth(
    evidence: RunEvidence, owners: Ownership, tick_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the positions of tracks (m, 3) and of flying launches (n, 3) at a tick, m."""
    tracks = evidence.tracks.take(evidence.tracks.tick_s == tick_s)
    flying = _flying(evidence.plan, tick_s)
    true = true_states_ecef(evidence.plan, flying, np.full(len(flying), tick_s))[:, :3]
    owner = owners.target[np.searchsorted(owners.track, tracks.track)]
    is_scored = np.isfinite(tracks.state[:, 0]) & ((owner < 0) | np.isin(owner, flying))
    return tracks.state[is_scored, :3], true


def _flying(plan: Plan, tick_s: float) -> IndexArray:
    """Return the launches (n,) with known truth at a tick."""
    launches = np.arange(len(plan.scene.targets), dtype=np.int32)
    ignition_s = plan.targets.ignition_s[launches]
    return launches[(ignition_s <= tick_s) & (plan.targets.end_s[launches] >= tick_s)]


def mean_gospa(parts: FloatArray, order: float) -> FloatArray:
    """Return a run's mean distance, the same per target, and its three parts per target; nan
    without truth.

    The distance per target is (d^p / n)^(1/p) of n targets: if each is tracked with the same error,
    it is that error.
    """
    if not len(parts):
        return np.full(5, np.nan)
    powers = parts[:, 1:4] / parts[:, 4:]
    per_target = powers.sum(axis=1, keepdims=True) ** (1.0 / order)
    return np.concatenate([parts[:, :1], per_target, powers], axis=1).mean(axis=0)
