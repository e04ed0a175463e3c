"""The metric `search_volume`: how much a sensor on the ground must search, and whether it is there."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from attrs import frozen
from opir_scoring import evidence_of_run, ownership

from opir_core.arrays import FloatArray
from opir_core.geometry import geodetic_to_ecef, local_axes
from opir_core.planning import whole_flights
from opir_core.plugin import MetricContext
from opir_export.search_volumes import ELLIPSOID_SIGMAS, TrackCue, cues_of
from opir_export.settings import CuesConfig


@frozen
class SearchVolumeMetric:
    """The 95 % search volumes of the cues of a run, one a launch, and whether they hold the truth.

    Of several tracks of a launch the first that has a volume counts. The area is that of the ellipse
    on the sky, at the range of its middle: across the line of sight of the site.
    """

    config: CuesConfig
    shares: ClassVar[Mapping[str, str]] = {
        "search_volume_km3": "searched",
        "search_area_km2": "searched",
        "search_inside": "searched",
    }
    units: ClassVar[Mapping[str, str]] = {
        "search_volume_km3": "km3",
        "search_area_km2": "km2",
        "search_inside": "",
        "searched": "",
    }
    launch_units: ClassVar[Mapping[str, str]] = {
        "search_volume_km3": "km3",
        "search_area_km2": "km2",
        "search_inside": "",
    }

    def values(self, run: Any) -> Mapping[str, float]:
        """Return the median volume and area, the share of volumes that hold the truth, and the share
        of launches that have a volume.
        """
        columns = self.launches(run)
        known = np.isfinite(columns["search_volume_km3"])
        share = float(np.mean(known)) if len(known) else np.nan
        if not known.any():
            return {**dict.fromkeys(columns, np.nan), "searched": share}
        figures = {name: float(np.median(column[known])) for name, column in columns.items()}
        inside = float(np.mean(columns["search_inside"][known]))
        return {**figures, "search_inside": inside, "searched": share}

    def launches(self, run: Any) -> Mapping[str, FloatArray]:
        """Return volume, area and whether the truth is inside, 0 or 1, of each launch; nan without a
        volume.
        """
        columns = {name: np.full(len(run.plan.scene.targets), np.nan) for name in self.launch_units}
        if not len(run.tracks):
            return columns
        owners = ownership(evidence_of_run(run, run.plan))
        targets = dict(zip(owners.track.tolist(), owners.target.tolist(), strict=True))
        for cue in cues_of(run, self.config):
            target = targets.get(cue.track_id, -1)
            if target < 0 or cue.volume is None or np.isfinite(columns["search_inside"][target]):
                continue
            for name, value in self._figures(run, cue, target).items():
                columns[name][target] = value
        return columns

    def _figures(self, run: Any, cue: TrackCue, target: int) -> Mapping[str, float]:
        volume = cue.volume
        assert volume is not None
        return {
            "search_volume_km3": volume.ellipsoid_m3 * 1e-9,
            "search_area_km2": volume.solid_angle_sr * (volume.range_m * 1e-3) ** 2,
            "search_inside": float(self._holds_truth(run, cue, target)),
        }

    def _holds_truth(self, run: Any, cue: TrackCue, target: int) -> bool:
        """Return whether the ellipsoid of a cue holds its target."""
        volume = cue.volume
        assert volume is not None
        flights = whole_flights(run.plan)
        row = np.array([target], dtype=np.int32)
        true_m = flights.position_ecef_m(row, np.array([volume.time_s]))[0]
        site = np.radians(self.config.lat_deg), np.radians(self.config.lon_deg)
        axes = local_axes(geodetic_to_ecef(*site, self.config.height_m))
        offset_m = axes @ (true_m - np.array(volume.position_ecef_m))
        distance = offset_m @ np.linalg.solve(np.array(volume.covariance_m2), offset_m)
        return bool(distance <= ELLIPSOID_SIGMAS**2)


def search_volume_metric(config: CuesConfig, _context: MetricContext) -> SearchVolumeMetric:
    """Return the metric `search_volume`."""
    return SearchVolumeMetric(config)
