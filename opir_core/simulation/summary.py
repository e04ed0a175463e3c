"""The summary of a run, counted window by window, so that memory does not grow with its duration."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.estimation.ellipses import CONTAINMENT, containment_ellipse
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import IMPACT_METHODS, Tracks, Window
from opir_core.planning.sightlines import Blocked, Pairs
from opir_core.planning.targets import Targets
from opir_core.scene.scene import REPORTED_TYPES


def planned_work(pairs: Pairs) -> Mapping[str, Any]:
    """Return how many pairs and looks a plan has, and how many pairs it skips, by reason, as plain values.

    Looks that are visible throughout need no visibility test; the others are tested one by one.
    """
    looks, skipped = pairs.looks, pairs.blocked[pairs.looks == 0]
    tested = int(looks[pairs.is_checked].sum())
    return {
        "pairs": len(looks),
        "pairs_skipped": {
            reason.name.lower(): int(np.count_nonzero(skipped == reason)) for reason in Blocked if reason in skipped
        },
        "looks": int(looks.sum()),
        "looks_visible_throughout": int(looks.sum()) - tested,
        "looks_tested_for_visibility": tested,
    }


class Tally:
    """Counts looks, detections and first detections of windows."""

    def __init__(
        self,
        sensors: Sequence[Sensor],
        targets: Targets,
        pairs: Pairs,
        reported_types: Sequence[str] = REPORTED_TYPES,
    ) -> None:
        self._sensors, self._targets, self._types = sensors, targets, reported_types
        self._work = planned_work(pairs)
        self._looks_of_sensor = np.bincount(pairs.sensor, pairs.looks, minlength=len(sensors))
        shape = len(sensors), len(targets.ids)
        self._looks = 0
        self._tracks = 0
        self._latest = LatestTracks()
        #: Detections by target and track.
        self._held: dict[tuple[int, int], int] = {}
        self._noise = np.zeros(shape[0], dtype=np.int64)
        self._detections = np.zeros(shape, dtype=np.int64)
        self._first_s = np.full(shape, np.inf)
        self._first_report_s = np.full(shape[1], np.inf)
        self._is_delayed = any(sensor.reporting for sensor in sensors)
        self._last_s = np.full(shape, -np.inf)
        self._reported = np.zeros((shape[1], len(reported_types)), dtype=np.int64)
        self._confidence = np.zeros(shape[1])

    def over(self, windows: Iterable[Window]) -> Iterator[Window]:
        """Yield the windows, counting them."""
        for window in windows:
            self.count(window)
            yield window

    def count(self, window: Window) -> None:
        """Count a window."""
        self._looks += window.looks
        self._tracks = max(self._tracks, int(window.tracks.track.max(initial=-1)) + 1)
        self._latest.take(window.tracks)
        seen, target = window.detections, window.truth.target
        self._count_held(target, seen.track)
        is_noise = target < 0
        columns: tuple[Any, ...] = (seen.sensor, target, seen.time_ns, seen.reported_type, seen.confidence)
        rows = np.flatnonzero(~is_noise)
        if self._is_delayed:
            rows = rows.take(np.argsort(seen.time_ns.take(rows), kind="stable"))
            np.minimum.at(self._first_report_s, target.take(rows), seen.reported_ns.take(rows) * 1e-9)
        if is_noise.any() or self._is_delayed:
            self._noise += np.bincount(seen.sensor[is_noise], minlength=len(self._noise))
            columns = tuple(column.take(rows) for column in columns)
        self._count(*columns)

    def _count(
        self,
        sensor: IndexArray,
        target: IndexArray,
        time_ns: IntArray,
        reported_type: NDArray[np.uint8],
        confidence: FloatArray,
    ) -> None:
        """Count detections (n,) of targets, sorted by time."""
        sensors, targets = self._detections.shape
        pair = sensor * targets + target
        time_s = time_ns * 1e-9
        self._detections += np.bincount(pair, minlength=sensors * targets).reshape(sensors, targets)
        # The last of repeated writes stays: written backwards, it is the first detection of each pair.
        first_s, last_s = np.full(sensors * targets, np.inf), np.full(sensors * targets, -np.inf)
        first_s[pair[::-1]], last_s[pair] = time_s[::-1], time_s
        np.minimum(self._first_s, first_s.reshape(sensors, targets), out=self._first_s)
        np.maximum(self._last_s, last_s.reshape(sensors, targets), out=self._last_s)
        types = self._reported.shape[1]
        reported = np.bincount(target * types + reported_type, minlength=targets * types)
        self._reported += reported.reshape(targets, types)
        np.maximum.at(self._confidence, target, confidence)

    def _count_held(self, target: IndexArray, track: IntArray) -> None:
        """Count detections (n,) of targets by the tracks that hold them."""
        held = np.flatnonzero((track >= 0) & (target >= 0))
        if not len(held):
            return
        both, count = np.unique((target[held].astype(np.int64) << 32) | track[held], return_counts=True)
        for pair, number in zip(both.tolist(), count.tolist(), strict=True):
            key = pair >> 32, pair & 0xFFFFFFFF
            self._held[key] = self._held.get(key, 0) + number

    def _track_of(self, target: int, tracks: Collection[int]) -> int | None:
        """Return the reported track with the most detections of a target, the first of equals, or None."""
        held = {track: number for (own, track), number in self._held.items() if own == target and track in tracks}
        return max(sorted(held), key=lambda track: held[track]) if held else None

    def counts(self) -> Mapping[str, int]:
        """Return the run's totals."""
        return {
            "sensors": len(self._sensors),
            "targets": len(self._targets.ids),
            "looks": self._looks,
            "detections": int(self._detections.sum() + self._noise.sum()),
            "noise_detections": int(self._noise.sum()),
            "tracks": self._tracks,
        }

    def summary(self) -> Mapping[str, Any]:
        """Return the totals and one row per sensor, target and track, as plain values."""
        tracks = self._latest.rows()
        numbers = {row["track_id"] for row in tracks}
        return {
            "counts": self.counts(),
            "work": self._work,
            "sensors": [
                {
                    "sensor_id": sensor.id,
                    "sensor_type": sensor.type,
                    "looks": int(self._looks_of_sensor[row]),
                    "reporting_mean_s": sum(stage.mean_s for stage in sensor.reporting),
                    "detections": int(self._detections[row].sum() + self._noise[row]),
                    "noise_detections": int(self._noise[row]),
                    "targets_detected": int((self._detections[row] > 0).sum()),
                }
                for row, sensor in enumerate(self._sensors)
            ],
            "targets": [
                {**self._target_row(row), "track_id": self._track_of(row, numbers)}
                for row in range(len(self._targets.ids))
            ],
            "tracks": tracks,
        }

    def _target_row(self, row: int) -> Mapping[str, Any]:
        targets, detections = self._targets, self._detections[:, row]
        is_detected = bool(detections.sum())
        first = int(self._first_s[:, row].argmin())
        first_s = float(self._first_s[first, row])
        first_report_s = float(self._first_report_s[row]) if self._is_delayed else first_s
        reported = self._types[int(self._reported[row].argmax())]
        return {
            "target_id": targets.ids[row],
            "target_type": targets.class_names[row],
            "ignition_s": float(targets.ignition_s[row]),
            "burnout_s": float(targets.burnout_s[row]),
            "detections": int(detections.sum()),
            "sensors": int((detections > 0).sum()),
            "first_detection_s": first_s if is_detected else None,
            "first_sensor_id": self._sensors[first].id if is_detected else None,
            "latency_s": first_s - float(targets.ignition_s[row]) if is_detected else None,
            "end_to_end_latency_s": first_report_s - float(targets.ignition_s[row]) if is_detected else None,
            "last_detection_s": float(self._last_s[:, row].max()) if is_detected else None,
            "reported_type": reported if is_detected else None,
            "highest_confidence": float(self._confidence[row]) if is_detected else None,
        }


class LatestTracks:
    """The last row of each track of a run, window by window."""

    def __init__(self) -> None:
        self._latest = Tracks.empty()
        self._first_s: dict[int, float] = {}

    def take(self, tracks: Tracks) -> None:
        """Add the rows (n,) of a window, sorted by tick."""
        if not len(tracks):
            return
        for track, tick_s in zip(tracks.track.tolist(), tracks.tick_s.tolist(), strict=True):
            self._first_s.setdefault(track, tick_s)
        rows = Tracks.concatenate([self._latest, tracks])
        _, last = np.unique(rows.track[::-1], return_index=True)
        self._latest = rows.take(np.sort(len(rows) - 1 - last))

    def rows(self) -> list[Mapping[str, Any]]:
        """Return one row of plain values per track, in the order of their numbers."""
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
            "impact": _impact(latest, place, impact_km),
        }


def _semi_major_km(tracks: Tracks, point: str) -> list[float]:
    """Return the semi-major axes (n,), km, of the 95 % ellipses of launch or impact points; nan where unknown."""
    covariance = getattr(tracks, f"{point}_covariance")[:, :2, :2]
    sigmas = tracks.impact_sigmas if point == "impact" else None
    return (containment_ellipse(covariance, reported_sigmas=sigmas).semi_major_m * 1e-3).tolist()


def _impact(latest: Tracks, place: int, semi_major_km: float) -> Mapping[str, Any] | None:
    """Return a predicted impact point, how it was predicted, and the area of its 95 % region if there is one.

    The paper's law states no containment: its σ is `sigma_km`, and there is no semi-major axis.
    """
    method = IMPACT_METHODS[latest.impact_method[place]]
    is_paper = method == "paper"
    point = _point(latest.impact[place], np.nan if is_paper else semi_major_km)
    if point is None:
        return None
    variance_m2 = 0.5 * float(np.trace(latest.impact_covariance[place, :2, :2]))
    areas_km2 = [region.area_km2 for region in latest.impact_regions[place] if region.containment == CONTAINMENT]
    return {
        **point,
        "region_95_km2": areas_km2[0] if areas_km2 else None,
        "method": method,
        "sigma_km": 1e-3 * variance_m2**0.5 if is_paper and 0.0 <= variance_m2 < np.inf else None,
    }


def _point(place: Any, semi_major_km: float) -> Mapping[str, Any] | None:
    """Return a point (latitude, longitude, time) in degrees and seconds, or None if it is not estimated."""
    if not np.isfinite(place).all():
        return None
    latitude_deg, longitude_deg = np.degrees(place[:2]).tolist()
    return {
        "lat_deg": latitude_deg,
        "lon_deg": (longitude_deg + 180.0) % 360.0 - 180.0,
        "time_s": float(place[2]),
        "semi_major_95_km": semi_major_km if np.isfinite(semi_major_km) else None,
    }
