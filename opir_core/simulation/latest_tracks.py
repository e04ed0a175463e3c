"""The last row of each track of a run as plain values, for its summary."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.estimation.ellipses import CONTAINMENT, containment_ellipse
from opir_core.geometry.sphere import AzimuthalEquidistant, unit_vectors
from opir_core.interfaces.impact_regions import ImpactRegion
from opir_core.interfaces.records import IMPACT_METHODS, Tracks
from opir_core.interfaces.weighed_tracks import hypothesis_columns
from opir_core.scene.scene import REPORTED_TYPES

#: The area of Europe, km²: of a wider region no point says where it is.
WIDE_KM2 = 1e7

#: Half of an interval that contains 95 % of a normal distribution, in standard deviations.
SIGMAS_95 = 1.96

#: What is at least as probable is said.
_PROBABLE = 0.5


class LatestTracks:
    """The last row of each track of a run, window by window; `hypotheses` are the names of the
    run's hypotheses.
    """

    def __init__(self, hypotheses: Sequence[str] = ()) -> None:
        self._hypotheses = hypotheses
        self._latest = Tracks.empty()
        self._first_s: dict[int, float] = {}

    def __len__(self) -> int:
        """The number of tracks that were reported: trackers may leave out numbers."""
        return len(self._first_s)

    def take(self, tracks: Tracks) -> None:
        """Add the rows (n,) of a window, sorted by tick."""
        if not len(tracks):
            return
        for track, tick_s in zip(tracks.track.tolist(), tracks.tick_s.tolist(), strict=True):
            self._first_s.setdefault(track, tick_s)
        rows = Tracks.concatenate([self._latest, tracks])
        _, last_row = np.unique(rows.track[::-1], return_index=True)
        self._latest = rows.take(np.sort(len(rows) - 1 - last_row))

    def rows(self) -> list[Mapping[str, Any]]:
        """Return one row of plain values per track, in the order of their numbers."""
        latest = self._latest.take(np.argsort(self._latest.track, kind="stable"))
        launch, impact = (_semi_major_km(latest, name) for name in ("launch", "impact"))
        columns = hypothesis_columns(latest, self._hypotheses)
        weighed = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        return [
            {
                **self._row(latest, place, launch[place], impact[place]),
                **_likeliest(row["hypotheses"]),
                **row,
            }
            for place, row in enumerate(weighed)
        ]

    def _row(
        self, latest: Tracks, place: int, launch_km: float, impact_km: float
    ) -> Mapping[str, Any]:
        track = int(latest.track[place])
        chance = latest.type_probability[place]
        is_typed = bool(np.isfinite(chance).any())
        return {
            "track_id": track,
            "first_s": self._first_s[track],
            "last_s": float(latest.tick_s[place]),
            "seen_s": _number(float(latest.seen_s[place])),
            "is_brief": bool(latest.is_brief[place]),
            "reported_type": REPORTED_TYPES[int(np.nanargmax(chance))] if is_typed else None,
            "type_probability": float(np.nanmax(chance)) if is_typed else None,
            "launch": _point(
                latest.launch[place], float(latest.launch_covariance[place, 2, 2]), launch_km
            ),
            "impact": _impact(latest, place, impact_km),
        }


def _likeliest(hypotheses: Mapping[str, float] | None) -> Mapping[str, Any]:
    chance, name = (
        max((chance, name) for name, chance in hypotheses.items()) if hypotheses else (None, None)
    )
    return {"likeliest_hypothesis": name, "hypothesis_probability": chance}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _semi_major_km(tracks: Tracks, point: str) -> list[float]:
    """Return the semi-major axes (n,), km, of the 95 % ellipses of launch or impact points; nan
    where unknown.
    """
    covariance = getattr(tracks, f"{point}_covariance")[:, :2, :2]
    sigmas = tracks.impact_sigmas if point == "impact" else None
    return (containment_ellipse(covariance, reported_sigmas=sigmas).semi_major_m * 1e-3).tolist()


def _impact(latest: Tracks, place: int, semi_major_km: float) -> Mapping[str, Any] | None:
    """Return a predicted impact point, how it was predicted, and its 95 % regions, the most
    probable condition first; of a wide one, where it is from the launch point, and why.

    The paper's law states no containment: its σ is `sigma_km`, and there is no semi-major axis.
    """
    method = IMPACT_METHODS[latest.impact_method[place]]
    is_paper = method == "paper"
    variance_s2 = float(latest.impact_covariance[place, 2, 2])
    point = _point(latest.impact[place], variance_s2, np.nan if is_paper else semi_major_km)
    if point is None:
        return None
    variance_m2 = 0.5 * float(np.trace(latest.impact_covariance[place, :2, :2]))
    outer = [region for region in latest.impact_regions[place] if region.containment == CONTAINMENT]
    regions = [
        {
            "condition": region.condition,
            "probability": region.probability,
            "area_95_km2": region.area_km2,
            "effective_samples": _number(region.effective_samples),
        }
        for region in outer
    ]
    is_wide = bool(outer) and outer[0].area_km2 > WIDE_KM2
    return {
        **point,
        "region_95_km2": regions[0]["area_95_km2"] if regions else None,
        "regions": regions,
        "from_launch": _from_launch(outer[0], latest.launch[place]) if is_wide else None,
        "reason": _reason(latest, place, outer[0]) if is_wide else None,
        "method": method,
        "sigma_km": 1e-3 * variance_m2**0.5 if is_paper and 0.0 <= variance_m2 < np.inf else None,
    }


def _point(place: Any, variance_s2: float, semi_major_km: float) -> Mapping[str, Any] | None:
    """Return a point (latitude, longitude, time) in degrees and seconds, with the half-widths of
    its 95 % intervals, or None if it is not estimated.
    """
    if not np.isfinite(place).all():
        return None
    latitude_deg, longitude_deg = np.degrees(place[:2]).tolist()
    return {
        "lat_deg": latitude_deg,
        "lon_deg": (longitude_deg + 180.0) % 360.0 - 180.0,
        "time_s": float(place[2]),
        "time_95_s": SIGMAS_95 * variance_s2**0.5 if 0.0 <= variance_s2 < np.inf else None,
        "semi_major_95_km": semi_major_km if np.isfinite(semi_major_km) else None,
    }


def _reason(latest: Tracks, place: int, region: ImpactRegion) -> str | None:
    """Return in words why a region is wide, None if nothing says it."""
    if region.condition == "relights":
        return "it may burn again"
    if latest.probability_burning[place] >= _PROBABLE:
        return "the burn goes on"
    spread = latest.state_covariance[place, 3:, 3:]
    if not np.isfinite(spread).all():
        return None
    half_km_s = 1e-3 * SIGMAS_95 * float(np.linalg.eigvalsh(spread)[-1]) ** 0.5
    return f"the velocity is known to {half_km_s:.1f} km/s"


def _from_launch(region: ImpactRegion, launch: FloatArray) -> Mapping[str, Any] | None:
    """Return the least and the largest distance of a region from a launch point (2 or more,), km,
    and the directions, degrees, between which it lies, None for all; None without a launch point.
    """
    if not region.polygons or not np.isfinite(launch).all():
        return None
    chart = AzimuthalEquidistant.about(unit_vectors(launch[None])[0])
    rings = [ring for polygon in region.polygons for ring in polygon]
    east, north = chart.points(np.concatenate(rings)).T
    distance_km = np.hypot(east, north) * 1e-3
    latitude, longitude = launch[:2].tolist()
    is_around = region.contains(latitude, longitude)
    is_opposite = region.contains(-latitude, longitude + np.pi)
    farthest_km = np.pi * EARTH_EQUATORIAL_RADIUS_M * 1e-3
    bearings = np.sort(np.degrees(np.arctan2(east, north)) % 360.0)
    gaps = np.diff(bearings, append=bearings[0] + 360.0)
    widest = int(np.argmax(gaps))
    between = [float(bearings[(widest + 1) % len(bearings)]), float(bearings[widest])]
    is_all = is_around or is_opposite or gaps[widest] < 180.0
    return {
        "least_km": 0.0 if is_around else float(distance_km.min()),
        "most_km": farthest_km if is_opposite else float(distance_km.max()),
        "bearings_deg": None if is_all else between,
    }
