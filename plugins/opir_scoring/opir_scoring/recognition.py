"""Which tracks are recognised as launches: of launches, and after which time; and of what is none,
false launches.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import frozen
from scipy.stats import chi2

from opir_core.arrays import FloatArray
from opir_scoring.containments import proportion, share
from opir_scoring.evidence import Ownership, RunEvidence

#: The probability of a launch from which on a warning is taken as sure.
SURE = 0.95


@frozen(eq=False)
class Recognition:
    """How the tracks of a run were recognised; of a tracker that weighs no launches all is nan.

    `false_launches` counts the tracks of no launch that had a probability of a launch above the
    threshold at any tick. `recognised_after_s` and `sure_after_s` are the times from each launch's
    ignition until a track of it had one above the threshold, and above `SURE`, first; inf for
    never.
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
    weighs = not len(tracks) or bool(np.isfinite(tracks.probability_launch).any())
    above = tracks.probability_launch > threshold
    false = len(np.unique(tracks.track[above & (owners.target[owner] < 0)]))
    available_s = np.fmax(tracks.available_s, tracks.tick_s)
    after = []
    for passed in (above, tracks.probability_launch > SURE):
        first_s = np.full(launches, np.inf)
        rows = np.flatnonzero(passed & (owners.target[owner] >= 0))
        np.minimum.at(first_s, owners.target[owner[rows]], available_s[rows])
        after.append(
            first_s - plan.targets.ignition_s[:launches] if weighs else np.full(launches, np.nan)
        )
    hours = plan.end_ns / 3.6e12
    ids = plan.targets.ids[:launches]
    return Recognition(hours, float(false) if weighs else np.nan, ids, *after)


def recognition_figures(found: Sequence[Recognition], seeds: Sequence[int]) -> dict[str, Any]:
    """Return the figures of runs with these seeds: false launches per hour, the share recognised,
    and the times.
    """
    recognised, sure = (
        np.concatenate([getattr(each, name) for each in found])
        for name in ("recognised_after_s", "sure_after_s")
    )
    known = ~np.isnan(recognised)
    names = [(seed, name) for each, seed in zip(found, seeds, strict=True) for name in each.targets]
    return {
        "false_launches": sum(each.false_launches for each in found),
        "hours": sum(each.hours for each in found),
        "false_launches_an_hour": _rate(
            sum(each.false_launches for each in found), sum(each.hours for each in found)
        ),
        "launches_recognised": share(
            *proportion(int(np.isfinite(recognised).sum()), int(known.sum()))
        ),
        "launches_sure": share(*proportion(int(np.isfinite(sure).sum()), int(known.sum()))),
        "median_sure_after_s": float(np.median(sure[known])) if known.any() else np.nan,
        "launches": [
            {"seed": seed, "target": name, "recognised_after_s": first, "sure_after_s": later}
            for (seed, name), first, later in zip(
                names, recognised.tolist(), sure.tolist(), strict=True
            )
        ],
    }


def _rate(count: float, hours: float) -> dict[str, Any]:
    """Return a Poisson rate with its exact 95 % interval (Garwood, Biometrika 28 (1936), 437)."""
    if np.isnan(count) or not hours > 0.0:
        return share(np.nan, np.nan, np.nan)
    low = float(chi2.ppf(0.025, 2.0 * count)) / 2.0 if count else 0.0
    high = float(chi2.ppf(0.975, 2.0 * count + 2.0)) / 2.0
    return share(count / hours, low / hours, high / hours)
