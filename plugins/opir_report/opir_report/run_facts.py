"""Data that several plots of a run share: its evidence, the target of each track, the last
estimates, the hues of targets.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from opir_scoring import (
    Ownership,
    RunEvidence,
    ScoredRun,
    ScoreSettings,
    StateErrors,
    evidence_of_run,
    last_rows,
    ownership,
    place_of,
    rows_in_force,
    scored_run,
    state_errors,
)

from opir_core import Run
from opir_core.arrays import FloatArray, IntArray, ObjectArray
from opir_core.estimation import containment_ellipse
from opir_core.geometry import geodesic_direct
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion, TargetClass, Tracks
from opir_report.maps.clipping import dense
from opir_report.palette import Hues

#: The area of a region, km², a hundredth of the Earth, above which maps leave it out.
WIDE_KM2 = 5e6
#: Settings of the scores of a report, which shows no tests of distributions.
SETTINGS = ScoreSettings(distribution_tests=False)


class RunFacts:
    """A run with the data that plots derive from it, each computed once."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.plan = run.plan
        self.launches = len(run.plan.scene.targets)
        self.ids = list(run.target_ids[: self.launches])
        self.types = list(run.plan.targets.class_names[: self.launches])
        self.hues = Hues.of(self.ids, self.types)

    @cached_property
    def evidence(self) -> RunEvidence:
        """The run's tracks and detections with their true targets."""
        return evidence_of_run(self.run, self.plan)

    @cached_property
    def owners(self) -> Ownership:
        """The target of each track."""
        return ownership(self.evidence)

    @cached_property
    def target_ids(self) -> dict[int, str]:
        """The ids of launches by the numbers of their tracks."""
        owned = zip(self.owners.track.tolist(), self.owners.target.tolist(), strict=True)
        return {track: self.ids[target] for track, target in owned if 0 <= target < self.launches}

    @cached_property
    def scored(self) -> ScoredRun:
        """The scores of the run's tracks."""
        return scored_run(self.evidence, SETTINGS, self.states)

    @cached_property
    def states(self) -> StateErrors:
        """The errors of the states of tracks in force."""
        return state_errors(self.evidence, self.owners)

    @cached_property
    def truth(self) -> list[dict[str, object]]:
        """The true launch, burnout and impact of each launch."""
        return [dict(events) for events in self.plan.targets.truth()][: self.launches]

    @cached_property
    def right_codes(self) -> IntArray:
        """The code of the type that detections of each launch should report, -1 if the run reports
        no such type.
        """
        codes = {name: code for code, name in enumerate(self.run.reported_types)}
        types = {
            kind: self.plan.host.component(TargetClass, kind).reported_type for kind in self.types
        }
        return np.array([codes.get(kind, codes.get(types[kind], -1)) for kind in self.types])

    def true_point(self, target: int, name: str) -> tuple[float, float]:
        """Return latitude and longitude, rad, of a target's `launch`, `burnout` or `impact`; nan
        for none.
        """
        latitude, longitude, _ = place_of(self.truth[target].get(name))
        return float(latitude), float(longitude)

    def target_names(self, targets: IntArray) -> ObjectArray:
        """Return the ids (n,) of launches (n,)."""
        return np.array([self.ids[target] for target in targets.tolist()], dtype=object)

    def in_force(self, target: int) -> Tracks:
        """Return the estimates (n,) of the track in force of a target, by tick."""
        rows = self._rows_of.get(target)
        return Tracks.empty() if rows is None else self.run.tracks.take(rows)

    @cached_property
    def last(self) -> dict[int, int]:
        """The row of the last estimate of each target with a track."""
        rows = last_rows(self.evidence, self.owners)
        return dict(zip(self._targets_of(rows).tolist(), rows.tolist(), strict=True))

    @cached_property
    def last_with_impact(self) -> dict[int, int]:
        """The row of the last estimate with a predicted impact of each target that has one."""
        tracks = self.run.tracks
        has_impact = np.isfinite(tracks.impact[:, 0]) | tracks.impact_regions.astype(bool)
        rows_of = {target: rows[has_impact[rows]] for target, rows in self._rows_of.items()}
        return {target: int(rows[-1]) for target, rows in rows_of.items() if len(rows)}

    @cached_property
    def _rows_of(self) -> dict[int, IntArray]:
        rows = rows_in_force(self.evidence, self.owners)
        targets = self._targets_of(rows)
        return {target: rows[targets == target] for target in np.unique(targets).tolist()}

    def _targets_of(self, rows: IntArray) -> IntArray:
        if not len(rows):
            return np.empty(0, dtype=np.int64)
        return self.owners.target[np.searchsorted(self.owners.track, self.run.tracks.track[rows])]


class Containment(NamedTuple):
    """A region on the ground: its area, km², and its rings (n, 2), closed latitudes and longitudes,
    rad, with the region on their left.
    """

    area_km2: float
    rings: list[FloatArray]


def containment_rings(tracks: Tracks, row: int) -> dict[float, Containment]:
    """Return the impact regions of an estimate by containment, else its ellipses.

    The regions are those of the most probable condition.
    """
    regions = tracks.impact_regions[row]
    if regions:
        return {
            region.containment: _region(region)
            for region in regions
            if region.condition == regions[0].condition
        }
    ellipses = {
        containment: _ellipse(tracks, row, containment) for containment in TRACK_CONTAINMENTS
    }
    return {
        containment: ellipse for containment, ellipse in ellipses.items() if ellipse is not None
    }


def mapped_rings(tracks: Tracks, row: int) -> list[FloatArray] | None:
    """Return the rings of the largest impact region of an estimate; None for a region of over
    `WIDE_KM2`, which would cover a map and say nothing of where.
    """
    regions = list(containment_rings(tracks, row).values())
    if not regions:
        return []
    return regions[-1].rings if regions[-1].area_km2 <= WIDE_KM2 else None


def _region(region: ImpactRegion) -> Containment:
    rings = [
        _left_ring(region, ring, is_hole=number > 0)
        for polygon in region.polygons
        for number, ring in enumerate(polygon)
    ]
    return Containment(float(region.area_km2), rings)


def _left_ring(region: ImpactRegion, ring: FloatArray, *, is_hole: bool) -> FloatArray:
    """Return a ring of a region, with the region on its left and a point each 100 km along edges,
    straight on the region's chart.
    """
    chart = region.chart()
    flat = dense(chart.points(ring), 100e3)
    (x, y), (east, north) = flat[:-1].T, flat[1:].T
    is_left = float(np.sum(x * north - east * y)) > 0.0
    return chart.places(flat if is_left != is_hole else flat[::-1])


def _ellipse(tracks: Tracks, row: int, containment: float) -> Containment | None:
    track = tracks.take(slice(row, row + 1))
    axes = containment_ellipse(track.impact_covariance[:, :2, :2], containment, track.impact_sigmas)
    major, minor, bearing = (float(values[0]) for values in axes)
    if not np.isfinite(major):
        return None
    angle = -np.linspace(0.0, 2.0 * np.pi, 73)
    along = major * np.cos(angle)
    across = minor * np.sin(angle)
    latitude, longitude = (np.full(len(angle), value) for value in track.impact[0, :2].tolist())
    edge = geodesic_direct(
        latitude, longitude, bearing + np.arctan2(across, along), np.hypot(along, across)
    )
    return Containment(1e-6 * np.pi * major * minor, [np.stack([edge[0], edge[1]], axis=1)])
