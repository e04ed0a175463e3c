"""Predicted impacts against the true ones: containment and area of impact regions, by phase of the
flight.

The main regions are those of the most probable condition; those whose condition is true of the
target are scored too. A track without regions is scored by its ellipses. A target in orbit has no
impact: a prediction for it is an error.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import containment_ellipse
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS, Columns
from opir_core.plugin import ImpactRegion, Tracks
from opir_scoring.containments import FARTHEST_M, energy, mean, rms, share
from opir_scoring.errors import ground_error, place_of
from opir_scoring.evidence import Ownership, RunEvidence, rows_in_force
from opir_scoring.proper_scores import energy_scores
from opir_scoring.region_points import region_energy_m

#: Instants of a flight: a share of the burn, and s after that.
INSTANTS: tuple[tuple[float, float], ...] = (
    (0.25, 0.0),
    (0.5, 0.0),
    (0.75, 0.0),
    (0.95, 0.0),
    (1.0, 5.0),
    (1.0, 20.0),
)

#: Names of the phases: the instants, and the last estimate of a target.
PHASES = (
    *(
        f"{after_s:g} s after burnout" if after_s else f"{100 * burned:g} % of burn"
        for burned, after_s in INSTANTS
    ),
    "last estimate",
)

#: The oldest estimate that counts at an instant, s; the time between two ticks where that is
#: longer.
OLDEST_S = 5.0

_COMES_DOWN, _BURN_OVER, _RELIGHTS = IMPACT_CONDITIONS


@frozen(eq=False, repr=False)
class ImpactScores(Columns):
    """Scores of predicted impacts, one row per tick of a target's track in force.

    `has_impact` is false for targets in orbit; those of unknown impact have no rows. `is_predicted`
    marks rows with an impact point or region. `contained` (n, 3) is 1 where the region of each
    probability of `TRACK_CONTAINMENTS` contains the true impact, 0 where not, nan without region or
    impact; `area_km2` (n, 3) are the regions' areas. `impact_m` is the error of the impact point
    along the ground.

    `contained` and `area_km2` are of the main regions, `contained_given` and `area_given_km2` (n,
    3) of those whose condition is true: "burn over" after the target's last burnout, "relights"
    before it, where there is none of these "comes down". `condition_brier` is the Brier score of
    the probabilities of the first two, `effective_samples` the least of any region. `energy_m` is
    the energy score of the impact, given that the target comes down; nan except in `phase_scores`.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {
        name: (len(TRACK_CONTAINMENTS),)
        for name in ("contained", "area_km2", "contained_given", "area_given_km2")
    }

    target: IntArray
    tick_s: FloatArray
    is_stereo: BoolArray
    is_biased: BoolArray
    has_impact: BoolArray
    is_predicted: BoolArray
    impact_m: FloatArray
    contained: FloatArray
    area_km2: FloatArray
    contained_given: FloatArray
    area_given_km2: FloatArray
    condition_brier: FloatArray
    effective_samples: FloatArray
    energy_m: FloatArray


def impact_scores(evidence: RunEvidence, owners: Ownership) -> ImpactScores:
    """Return the scores of the impacts that targets' tracks in force predict, by target and
    tick.
    """
    return _scores(evidence, owners, _rows(evidence, owners))


def phase_scores(evidence: RunEvidence, owners: Ownership) -> tuple[IntArray, ImpactScores]:
    """Return phases (n,), numbers into `PHASES`, that targets' tracks reach, and the scores of
    their estimates at these.
    """
    rows = _rows(evidence, owners)
    target = _targets_of(evidence, owners, rows)
    tick_s = evidence.tracks.tick_s[rows]
    oldest_s = max(OLDEST_S, evidence.plan.make_tracker().cadence_s or 0.0)
    estimates = list[tuple[int, int]]()
    for number in np.unique(target).tolist():
        of_target = np.flatnonzero(target == number)
        for phase, instant_s in enumerate(_instants_s(evidence, number)):
            place = int(np.searchsorted(tick_s[of_target], instant_s, side="right")) - 1
            if place >= 0 and tick_s[of_target[place]] >= instant_s - oldest_s:
                estimates.append((phase, int(of_target[place])))
        estimates.append((len(INSTANTS), int(of_target[-1])))
    phases, estimate = np.array(estimates, dtype=np.int64).reshape(-1, 2).T
    estimate, place_of_phase = np.unique(estimate, return_inverse=True)
    scores = _scores(evidence, owners, rows[estimate])
    tracks = evidence.tracks.take(rows[estimate])
    energy_m = _energies_m(tracks, _impacts(evidence, scores.target))
    return phases, evolve(scores, energy_m=energy_m).take(place_of_phase)


def _instants_s(evidence: RunEvidence, target: int) -> list[float]:
    """Return the scene times of `INSTANTS` of a target's flight."""
    ignition_s = float(evidence.plan.targets.ignition_s[target])
    burn_s = float(evidence.plan.targets.burnout_s[target]) - ignition_s
    return [ignition_s + burned * burn_s + after_s for burned, after_s in INSTANTS]


def phase_figures(phase: IntArray, scores: ImpactScores) -> list[dict[str, Any]]:
    """Return the figures of each phase: targets, those with a predicted impact, containment and
    median areas.
    """
    return [
        {"phase": name, **_figures(scores.take(phase == number))}
        for number, name in enumerate(PHASES)
    ]


def _figures(scores: ImpactScores) -> dict[str, Any]:
    landing = scores.take(scores.has_impact)
    orbiting = scores.take(~scores.has_impact)
    return {
        "targets": len(landing),
        "predicted": share(landing.is_predicted),
        "impact_m": rms(landing.impact_m, limit=FARTHEST_M),
        "energy_m": energy(landing.energy_m, limit=FARTHEST_M),
        "regions": _region_figures(landing.contained, landing.area_km2),
        "regions_given_condition": _region_figures(landing.contained_given, landing.area_given_km2),
        "condition_brier": mean(landing.condition_brier, 2.0),
        "effective_samples": _median(landing.effective_samples),
        # Regions of fewer than a hundred effective samples are thin.
        "thin": share(_finite(landing.effective_samples) < 100.0),
        "targets_without_impact": len(orbiting),
        "predicted_without_impact": int(np.count_nonzero(orbiting.is_predicted)),
    }


def _region_figures(contained: FloatArray, area_km2: FloatArray) -> list[dict[str, Any]]:
    """Return the figures of each containment, of columns (n, 3)."""
    return [
        {
            "nominal": nominal,
            **share(_finite(inside) == 1.0),
            "median_area_km2": _median(area),
        }
        for nominal, inside, area in zip(TRACK_CONTAINMENTS, contained.T, area_km2.T, strict=True)
    ]


def _finite(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def _median(values: FloatArray) -> float:
    values = _finite(values)
    return float(np.median(values)) if len(values) else np.nan


def _targets_of(evidence: RunEvidence, owners: Ownership, rows: IntArray) -> IntArray:
    return owners.target[np.searchsorted(owners.track, evidence.tracks.track[rows])]


def _rows(evidence: RunEvidence, owners: Ownership) -> IntArray:
    """Return the rows of the run's tracks in force whose target is known to come down, or not
    to.
    """
    rows = rows_in_force(evidence, owners)
    truths = evidence.plan.targets.truth()
    is_known = np.array([bool(truth.get("impact") or truth.get("orbit")) for truth in truths])
    return rows[is_known[_targets_of(evidence, owners, rows)]] if len(rows) else rows


def _scores(evidence: RunEvidence, owners: Ownership, rows: IntArray) -> ImpactScores:
    """Return the scores of rows (n,) of the run's tracks."""
    tracks = evidence.tracks.take(rows)
    owner = np.searchsorted(owners.track, tracks.track)
    target = owners.target[owner]
    impact = _impacts(evidence, target)
    error = ground_error(tracks.impact, impact)
    has_impact = np.isfinite(impact[:, 0])
    contained, area_km2 = _ellipses(tracks, error)
    contained_given = contained.copy()
    area_given_km2 = area_km2.copy()
    brier, samples = np.full((2, len(rows)), np.nan)
    is_over = tracks.tick_s >= evidence.plan.targets.burnout_s[target]
    scored = _RegionScores()
    for row in np.flatnonzero(tracks.impact_regions.astype(bool)).tolist():
        regions = tracks.impact_regions[row]
        contained[row], area_km2[row] = scored(main_regions(regions), impact[row])
        true_regions = regions_given(regions, is_over[row])
        contained_given[row], area_given_km2[row] = scored(true_regions, impact[row])
        brier[row] = _condition_brier(regions, is_over[row])
        samples[row] = np.min([region.effective_samples for region in regions])
    for column in (contained, contained_given, brier):
        column[~has_impact] = np.nan
    has_region = np.count_nonzero(np.isfinite(area_km2), axis=1) > 0
    return ImpactScores(
        target=target,
        tick_s=tracks.tick_s,
        is_stereo=owners.is_stereo[owner],
        is_biased=owners.is_biased[owner],
        has_impact=has_impact,
        is_predicted=np.isfinite(tracks.impact[:, 0]) | has_region,
        impact_m=np.linalg.norm(error, axis=1),
        contained=contained,
        area_km2=area_km2,
        contained_given=contained_given,
        area_given_km2=area_given_km2,
        condition_brier=brier,
        effective_samples=samples,
        energy_m=np.full(len(rows), np.nan),
    )


def _impacts(evidence: RunEvidence, target: IntArray) -> FloatArray:
    """Return the true impacts (n, 3) of targets (n,): latitude, longitude, rad, and height; nan
    without one.
    """
    truth = evidence.plan.targets.truth()
    places = [place_of(truth[number].get("impact")) for number in target.tolist()]
    return np.array(places, dtype=np.float64).reshape(-1, 3)


def main_regions(regions: Sequence[ImpactRegion]) -> list[ImpactRegion]:
    """Return the regions of the most probable condition, which come first."""
    return [region for region in regions if region.condition == regions[0].condition]


def regions_given(regions: Sequence[ImpactRegion], is_over: bool) -> list[ImpactRegion]:
    """Return the regions whose condition is true of a target whose last burn is over, or not.

    These are the regions "burn over" or "relights"; where these are missing, those that presume
    neither.
    """
    true = _BURN_OVER if is_over else _RELIGHTS
    return [region for region in regions if region.condition == true] or [
        region for region in regions if region.condition == _COMES_DOWN
    ]


def _condition_brier(regions: Sequence[ImpactRegion], is_over: bool) -> float:
    """Return the Brier score of the probabilities that the burn is over, or goes on; nan where
    neither is stated.
    """
    stated = {
        region.condition: region.probability
        for region in regions
        if region.condition != _COMES_DOWN
    }
    if not stated:
        return np.nan
    over = stated.get(_BURN_OVER, 0.0)
    relights = stated.get(_RELIGHTS, 0.0)
    return float((over - is_over) ** 2 + (relights - (not is_over)) ** 2)


def _energies_m(tracks: Tracks, impact: FloatArray) -> FloatArray:
    """Return the energy scores (n,), m, of stated impacts, of regions or else of ellipses, with
    true ones (n, 3).
    """
    error = ground_error(tracks.impact, impact)
    energy_m = energy_scores(error, tracks.impact_covariance[:, :2, :2], tracks.impact_sigmas)
    has_regions = tracks.impact_regions.astype(bool) & np.isfinite(impact[:, 0])
    for row in np.flatnonzero(has_regions).tolist():
        energy_m[row] = region_energy_m(tracks.impact_regions[row], impact[row])
    return energy_m


def _ellipses(tracks: Tracks, error_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return whether the ellipses of tracks contain impacts at errors (n, 2), and their areas, km²:
    both (n, 3).
    """
    contained, area_km2 = np.full((2, len(tracks), len(TRACK_CONTAINMENTS)), np.nan)
    for place, containment in enumerate(TRACK_CONTAINMENTS):
        major, minor, bearing = containment_ellipse(
            tracks.impact_covariance[:, :2, :2], containment, tracks.impact_sigmas
        )
        contained[:, place] = _inside(error_m, major, minor, bearing)
        area_km2[:, place] = 1e-6 * np.pi * major * minor
    return contained, area_km2


def _inside(
    error_m: FloatArray, major: FloatArray, minor: FloatArray, bearing: FloatArray
) -> FloatArray:
    """Return 1 where errors (n, 2) lie inside ellipses (n,), else 0; nan where one is unknown."""
    east, north = error_m.T
    along = east * np.sin(bearing) + north * np.cos(bearing)
    across = east * np.cos(bearing) - north * np.sin(bearing)
    inside = np.square(along * minor) + np.square(across * major) <= np.square(major * minor)
    return np.where(np.isfinite(major) & np.isfinite(east), inside, np.nan)


class _RegionScores:
    """Compares regions with impacts, those of many ticks once."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, float, float], bool] = {}

    def __call__(
        self, regions: Sequence[ImpactRegion], impact: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return whether regions contain an impact (latitude, longitude, ...), and their areas,
        km²: both (3,). The regions of all calls live as long as the scores.
        """
        contained, area_km2 = np.full((2, len(TRACK_CONTAINMENTS)), np.nan)
        latitude, longitude = impact[:2].tolist()
        for place, containment in enumerate(TRACK_CONTAINMENTS):
            for region in regions:
                if abs(region.containment - containment) <= 1e-6:
                    key = id(region), latitude, longitude
                    if key not in self._known:
                        self._known[key] = region.contains(latitude, longitude)
                    contained[place] = self._known[key]
                    area_km2[place] = region.area_km2
        return contained, area_km2
