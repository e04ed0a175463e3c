"""What several plots of a run need: its evidence, the target of each track, the last estimates, the
hues of targets.
"""

from functools import cached_property

import numpy as np
from opir_scoring import (
    Ownership,
    RunEvidence,
    evidence_of_run,
    last_rows,
    ownership,
    place_of,
    rows_in_force,
)

from opir_core import Run
from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import containment_ellipse
from opir_core.geometry import geodesic_direct
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion, TargetClass, Tracks
from opir_report.maps.clipping import dense
from opir_report.palette import Hues

_ELLIPSE_POINTS = 73
#: Longest step along an edge of a region.
_STEP_M = 100e3


class RunFacts:
    """A run with what plots derive from it, each computed once."""

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
    def truth(self) -> list[dict[str, object]]:
        """The true launch, burnout and impact of each launch."""
        return [dict(each) for each in self.plan.targets.truth()][: self.launches]

    def right_code(self, target: int) -> int:
        """Return the code of the type that detections of a target should report, -1 if the run
        reports no such type.
        """
        right = self.plan.host.component(TargetClass, self.types[target]).reported_type
        names = list(self.run.reported_types)
        own = self.types[target]
        return names.index(own) if own in names else names.index(right) if right in names else -1

    def true_point(self, target: int, name: str) -> tuple[float, float]:
        """Return latitude and longitude, rad, of a target's `launch`, `burnout` or `impact`; nan
        for none.
        """
        latitude, longitude, _ = place_of(self.truth[target].get(name))
        return float(latitude), float(longitude)

    def in_force(self, target: int) -> Tracks:
        """Return the estimates (n,) of the track in force of a target, by tick."""
        return (
            self.run.tracks.take(self._rows_of[target])
            if target in self._rows_of
            else Tracks.empty()
        )

    @cached_property
    def last(self) -> dict[int, int]:
        """The row of the last estimate of each target with a track."""
        rows = last_rows(self.evidence, self.owners)
        return dict(zip(self._targets_of(rows).tolist(), rows.tolist(), strict=True))

    @cached_property
    def last_with_impact(self) -> dict[int, int]:
        """The row of the last estimate with a predicted impact of each target that has one."""
        known = np.isfinite(self.run.tracks.impact[:, 0]) | self.run.tracks.impact_regions.astype(
            bool
        )
        found = {target: rows[known[rows]] for target, rows in self._rows_of.items()}
        return {target: int(rows[-1]) for target, rows in found.items() if len(rows)}

    @cached_property
    def _rows_of(self) -> dict[int, IntArray]:
        rows = rows_in_force(self.evidence, self.owners)
        target = self._targets_of(rows)
        return {each: rows[target == each] for each in np.unique(target).tolist()}

    def _targets_of(self, rows: IntArray) -> IntArray:
        if not len(rows):
            return np.empty(0, dtype=np.int64)
        return self.owners.target[np.searchsorted(self.owners.track, self.run.tracks.track[rows])]


def containment_rings(tracks: Tracks, row: int) -> dict[float, tuple[float, list[FloatArray]]]:
    """Return area, km², and rings of the impact regions of an estimate by containment, else of its
    ellipses.

    The regions are those of the most probable condition.
    Rings (n, 2) are closed latitudes and longitudes, rad, with the region on their left.
    """
    regions = tracks.impact_regions[row]
    if regions:
        return {
            region.containment: (
                float(region.area_km2),
                [
                    _left_ring(region, ring, is_hole=place > 0)
                    for rings in region.polygons
                    for place, ring in enumerate(rings)
                ],
            )
            for region in regions
            if region.condition == regions[0].condition
        }
    ellipses = {
        containment: _ellipse(tracks, row, containment) for containment in TRACK_CONTAINMENTS
    }
    return {containment: found for containment, found in ellipses.items() if found is not None}


def _left_ring(region: ImpactRegion, ring: FloatArray, *, is_hole: bool) -> FloatArray:
    """Return a ring of a region, with the region on its left and points along edges, straight on
    the region's chart.
    """
    chart = region.chart()
    flat = dense(chart.points(ring), _STEP_M)
    (x, y), (east, north) = flat[:-1].T, flat[1:].T
    is_left = float(np.sum(x * north - east * y)) > 0.0
    return chart.places(flat if is_left != is_hole else flat[::-1])


def _ellipse(tracks: Tracks, row: int, containment: float) -> tuple[float, list[FloatArray]] | None:
    one = tracks.take(slice(row, row + 1))
    axes = containment_ellipse(one.impact_covariance[:, :2, :2], containment, one.impact_sigmas)
    major, minor, bearing = (float(each[0]) for each in axes)
    if not np.isfinite(major):
        return None
    angle = -np.linspace(0.0, 2.0 * np.pi, _ELLIPSE_POINTS)
    along = major * np.cos(angle)
    across = minor * np.sin(angle)
    everywhere = np.ones(len(angle))
    latitude, longitude = (value * everywhere for value in one.impact[0, :2].tolist())
    edge = geodesic_direct(
        latitude, longitude, bearing + np.arctan2(across, along), np.hypot(along, across)
    )
    return 1e-6 * np.pi * major * minor, [np.stack([edge[0], edge[1]], axis=1)]
