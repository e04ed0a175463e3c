"""Tracks that are recognised as launches: of launches, and after which time; of other sources and
noise, false launches.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_scoring.containments import figure, share
from opir_scoring.evidence import Ownership, RunEvidence
from opir_scoring.quantiles import chi_square_quantiles

#: P(launch) above which a track counts as recognised in studies and tables.
RECOGNITION_PROBABILITY = 0.95


@frozen(eq=False)
class Recognition:
    """How the tracks of a run were recognised; of a tracker that weighs no launches all is nan.

    `false_launches` counts the tracks of no launch that had a probability of a launch above the
    threshold at any tick. `recognised_after_s` and `sure_after_s` are the times from each launch's
    ignition until a track of it had one above the threshold, and above `RECOGNITION_PROBABILITY`,
    first; inf for never.
    """

    hours: float
    false_launches: float
    targets: tuple[str, ...]
    recognised_after_s: FloatArray
    sure_after_s: FloatArray


def recognition(evidence: RunEvidence, owners: Ownership, threshold: float) -> Recognition:
    """Return how the tracks of a run were recognised."""
    tracks = evidence.tracks
    plan = evidence.plan
    launches = len(plan.scene.targets)
    owner = np.searchsorted(owners.track, tracks.track)
    target = owners.target[owner]
    # A tracker that weighs no launches has no figures.
    unknown = 0.0
    if len(tracks) and not np.isfinite(tracks.probability_launch).any():
        unknown = np.nan
    available_s = np.fmax(tracks.available_s, tracks.tick_s)

    def after_s(is_above: BoolArray) -> FloatArray:
        earliest_s = np.full(launches, np.inf)
        rows = np.flatnonzero(is_above & (target >= 0))
        np.minimum.at(earliest_s, target[rows], available_s[rows])
        return earliest_s - plan.targets.ignition_s[:launches] + unknown

    is_above = tracks.probability_launch > threshold
    return Recognition(
        hours=plan.end_ns / 3.6e12,
        false_launches=len(np.unique(tracks.track[is_above & (target < 0)])) + unknown,
        targets=plan.targets.ids[:launches],
        recognised_after_s=after_s(is_above),
        sure_after_s=after_s(tracks.probability_launch > RECOGNITION_PROBABILITY),
    )


def recognition_figures(runs: Sequence[Recognition], seeds: Sequence[int]) -> dict[str, Any]:
    """Return the figures of runs with these seeds: false launches per hour, the share recognised,
    and the times.
    """
    recognised_s = np.concatenate([run.recognised_after_s for run in runs])
    sure_s = np.concatenate([run.sure_after_s for run in runs])
    is_weighed = ~np.isnan(recognised_s)
    false_launches = sum(run.false_launches for run in runs)
    hours = sum(run.hours for run in runs)
    return {
        "false_launches": false_launches,
        "hours": hours,
        "false_launches_an_hour": _rate(false_launches, hours),
        "launches_recognised": share(np.isfinite(recognised_s[is_weighed])),
        "launches_sure": share(np.isfinite(sure_s[is_weighed])),
        "median_sure_after_s": _median(sure_s[is_weighed]),
        "launches": [
            launch for run, seed in zip(runs, seeds, strict=True) for launch in _launches(run, seed)
        ],
    }


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _launches(run: Recognition, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the times of each launch of a run, as plain values."""
    times = (run.targets, run.recognised_after_s.tolist(), run.sure_after_s.tolist())
    for target, recognised_s, sure_s in zip(*times, strict=True):
        yield {
            "seed": seed,
            "target": target,
            "recognised_after_s": recognised_s,
            "sure_after_s": sure_s,
        }


def _rate(count: float, hours: float) -> dict[str, Any]:
    """Return a Poisson rate with its exact 95 % interval (Garwood, Biometrika 28 (1936), 437)."""
    if np.isnan(count) or not hours > 0.0:
        return figure(np.nan)
    low = float(chi_square_quantiles(0.025, 2.0 * count)) / 2.0 if count else 0.0
    high = float(chi_square_quantiles(0.975, 2.0 * count + 2.0)) / 2.0
    return figure(count / hours, low / hours, high / hours)
