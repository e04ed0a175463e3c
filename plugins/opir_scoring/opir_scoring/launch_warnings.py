"""Warning times: from the instant at which an estimate meets a requirement, and stays within it, to
the impact.

An estimate meets the requirement if P(missile) is above a threshold, and the region of the impact
and the ellipse of the launch point, as the tracker reports them, are small enough. Whether they are
right is another question, which containments answer.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from attrs import field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import containment_ellipse
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import Tracks
from opir_scoring.evidence import Ownership, RunEvidence, rows_in_force
from opir_scoring.impacts import ImpactScores, impact_scores


@frozen(kw_only=True)
class WarningRequirement:
    """Requirements on an estimate to count as a warning; None: not required.

    `region_km2` is the largest area of the impact region, and `launch_point_km` the largest
    semi-major axis of the ellipse of the launch point, both of `containment`.
    """

    missile_probability: float | None
    region_km2: float | None
    launch_point_km: float | None
    containment: float = TRACK_CONTAINMENTS[-1]


@frozen(eq=False)
class WarningTimes:
    """One row per launch, times in s since its ignition, inf for never.

    `track_s` is the first estimate of a track, `region_s` the first one with an impact region or
    ellipse, `warned_s` the first one from which on all estimates meet the requirement; each counts
    when it is available. `impact_s` is the true impact, nan for a launch that does not come down or
    whose impact is unknown. `contained` is whether the region of that first warning contains the
    true impact, nan where there is none.
    """

    track_s: FloatArray
    region_s: FloatArray
    warned_s: FloatArray
    impact_s: FloatArray
    contained: FloatArray
    warning_s: FloatArray = field(init=False)

    def __attrs_post_init__(self) -> None:
        """Set the warning times: from the warning to the impact, 0 for none or one after it, nan
        without an impact.
        """
        remaining_s = np.maximum(self.impact_s - self.warned_s, 0.0)
        warning_s = np.where(np.isnan(self.impact_s), np.nan, remaining_s)
        object.__setattr__(self, "warning_s", warning_s)


def warning_times(
    evidence: RunEvidence, owners: Ownership, requirement: WarningRequirement
) -> WarningTimes:
    """Return the warning times of a run's launches, from their tracks in force."""
    targets = evidence.plan.targets
    launches = len(evidence.plan.scene.targets)
    tracks = evidence.tracks.take(rows_in_force(evidence, owners))
    target = owners.target[np.searchsorted(owners.track, tracks.track)]
    available_s = np.fmax(tracks.available_s, tracks.tick_s)
    area_km2, contained = _region_columns(evidence, owners, target, requirement.containment)
    stays = _stays(_meets(tracks, area_km2, requirement), target)
    ignition_s = targets.ignition_s[:launches]

    def after_s(rows: BoolArray) -> FloatArray:
        earliest_s = np.full(launches, np.inf)
        np.minimum.at(earliest_s, target[rows], available_s[rows])
        return earliest_s - ignition_s

    return WarningTimes(
        track_s=after_s(np.isfinite(available_s)),
        region_s=after_s(np.isfinite(area_km2)),
        warned_s=after_s(stays),
        impact_s=_impacts_s(targets.truth()[:launches]) - ignition_s,
        contained=_at_first(stays, target, contained, launches),
    )


def _at_first(rows: BoolArray, target: IntArray, values: FloatArray, launches: int) -> FloatArray:
    """Return the values (launches,) at the first marked row of each target, nan without one."""
    at_first = np.full(launches, np.nan)
    marked = np.flatnonzero(rows)
    _, earliest = np.unique(target[marked], return_index=True)
    starts = marked[earliest]
    at_first[target[starts]] = values[starts]
    return at_first


def _region_columns(
    evidence: RunEvidence, owners: Ownership, target: IntArray, containment: float
) -> tuple[FloatArray, FloatArray]:
    """Return areas, km², of impact regions of rows in force (n,), and whether they contain the
    impact.
    """
    # Rows of scores are those of the tracks whose launch is known to come down, or not, in the same
    # order.
    scores = _scores_of(evidence, owners)
    place = int(np.argmin(np.abs(np.array(TRACK_CONTAINMENTS) - containment)))
    is_scored = np.isin(target, scores.target)
    area_km2, contained = np.full((2, len(target)), np.nan)
    area_km2[is_scored] = scores.area_km2[:, place]
    contained[is_scored] = scores.contained[:, place]
    return area_km2, contained


@lru_cache(maxsize=1)
def _scores_of(evidence: RunEvidence, owners: Ownership) -> ImpactScores:
    """Return the scores of impacts; several requirements on one run share them."""
    return impact_scores(evidence, owners)


def _impacts_s(truths: Sequence[Mapping[str, Any]]) -> FloatArray:
    impacts = [truth.get("impact") or {} for truth in truths]
    return np.array([impact.get("time_s", np.nan) for impact in impacts], dtype=np.float64)


def _meets(tracks: Tracks, area_km2: FloatArray, requirement: WarningRequirement) -> BoolArray:
    """Return whether rows (n,) of tracks, with areas (n,) of their impact regions, meet a
    requirement.
    """
    met = np.ones(len(tracks), dtype=np.bool_)
    if requirement.missile_probability is not None:
        met &= tracks.probability_missile > requirement.missile_probability
    if requirement.region_km2 is not None:
        met &= area_km2 < requirement.region_km2
    if requirement.launch_point_km is not None:
        ellipse = containment_ellipse(tracks.launch_covariance[:, :2, :2], requirement.containment)
        met &= ellipse.semi_major_m < 1e3 * requirement.launch_point_km
    return met


def _stays(met: BoolArray, target: IntArray) -> BoolArray:
    """Return whether rows (n,), by target and tick, and all later ones of their target are met."""
    failed = np.cumsum(~met)
    end = np.searchsorted(target, target, side="right") - 1
    return met & (failed == failed[end])
