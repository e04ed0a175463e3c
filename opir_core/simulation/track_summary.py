"""The last estimate of each track of a run, as the rows of its summary."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from opir_core.estimation.containment_ellipse import containment_ellipse
from opir_core.interfaces.records import Tracks
from opir_core.scene.scene import REPORTED_TYPES


class LatestTracks:
    """Keeps the last row of each track, and the last that has an impact point, while windows go by."""

    def __init__(self) -> None:
        self._latest = Tracks.empty()
        self._first_s: dict[int, float] = {}

    def take(self, tracks: Tracks) -> None:
        """Take in the rows (n,) of a window, sorted by tick."""
        if not len(tracks):
            return
        for track, tick_s in zip(tracks.track.tolist(), tracks.tick_s.tolist(), strict=True):
            self._first_s.setdefault(track, tick_s)
        rows = Tracks.concatenate([self._latest, tracks])
        _, last = np.unique(rows.track[::-1], return_index=True)
        self._latest = rows.take(np.sort(len(rows) - 1 - last))

    def rows(self) -> list[Mapping[str, Any]]:
        """Return a row of plain values for each track, in the order of their numbers."""
        latest = self._latest.take(np.argsort(self._latest.track, kind="stable"))
        launch, impact = (_semi_major_km(latest, name) for name in ("launch", "impact"))
        return [self._row(latest, place, launch[place], impact[place]) for place in range(len(latest))]

    def _row(self, latest: Tracks, place: int, launch_km: float, impact_km: float) -> Mapping[str, Any]:
        track, chance = int(latest.track[place]), latest.type_probability[place]
        is_typed = bool(np.isfinite(chance).any())
        return {
            "track_id": track,
            "first_s": self._first_s[track],
            "last_s": float(latest.tick_s[place]),
            "reported_type": REPORTED_TYPES[int(np.nanargmax(chance))] if is_typed else None,
            "type_probability": float(np.nanmax(chance)) if is_typed else None,
            "launch": _point(latest.launch[place], launch_km),
            "impact": _point(latest.impact[place], impact_km),
        }


def _semi_major_km(tracks: Tracks, point: str) -> list[float]:
    """Return the semi-major axes (n,), km, of the 95 % ellipses of launch or impact points; nan where unknown."""
    covariance = getattr(tracks, f"{point}_covariance")[:, :2, :2]
    sigmas = tracks.impact_sigmas if point == "impact" else None
    axes_km: list[float] = (containment_ellipse(covariance, reported_sigmas=sigmas).semi_major_m * 1e-3).tolist()
    return axes_km


def _point(place: Any, semi_major_km: float) -> Mapping[str, Any] | None:
    """Return a point (latitude, longitude, time) in degrees and seconds, or None where it is not estimated."""
    if not np.isfinite(place).all():
        return None
    latitude_deg, longitude_deg = np.degrees(place[:2]).tolist()
    return {
        "lat_deg": latitude_deg,
        "lon_deg": (longitude_deg + 180.0) % 360.0 - 180.0,
        "time_s": float(place[2]),
        "semi_major_95_km": semi_major_km if np.isfinite(semi_major_km) else None,
    }
