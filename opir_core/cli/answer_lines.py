"""The answers of a run, a sentence per target: who saw it first, after how long, what it is, from where, to where.

What is reported is the detections' and the tracker's; only the target's name and type are from the truth.
"""

from collections.abc import Mapping
from typing import Any

from opir_core.cli.terminal import grouped

#: Targets with a sentence of their own.
_ANSWERED = 6
#: From this area on, km², no decimals are printed.
_WHOLE_KM2 = 10.0


def answers(summary: Mapping[str, Any], most: int = _ANSWERED) -> list[str]:
    """Return a sentence for each of the first targets of a run's summary, and the number of the others."""
    tracks = {row["track_id"]: row for row in summary["tracks"]}
    targets = summary["targets"]
    lines = [_answer(row, tracks.get(row["track_id"])) for row in targets[:most]]
    return [*lines, f"... and {len(targets) - most} more targets"] if len(targets) > most else lines


def _answer(target: Mapping[str, Any], track: Mapping[str, Any] | None) -> str:
    name = f"{target['target_id']} ({target['target_type']})"
    if target["latency_s"] is None:
        return f"{name}: not detected"
    latency_s, end_to_end_s = target["latency_s"], target["end_to_end_latency_s"]
    late = f", reported after {end_to_end_s:.3f} s" if end_to_end_s != latency_s else ""
    seen = f"first seen by {target['first_sensor_id']} after {latency_s:.3f} s{late}"
    return "; ".join([f"{name}: {seen}", _type_text(target, track), *_places(track)])


def _type_text(target: Mapping[str, Any], track: Mapping[str, Any] | None) -> str:
    """Return the type of the track with its probability, else that of the detections."""
    if track is not None and track["type_probability"] is not None:
        return f"reported {track['reported_type']} (probability {track['type_probability']:.2f})"
    return f"reported {target['reported_type']} (confidence up to {target['highest_confidence']:.2f})"


def _places(track: Mapping[str, Any] | None) -> list[str]:
    """Return the estimated launch and impact points, as far as there are any."""
    if track is None:
        return []
    launch, impact = track["launch"], track["impact"]
    parts = [f"from {place_text(launch)}{spread_text(launch)}"] if launch is not None else []
    if impact is not None:
        parts.append(f"to {place_text(impact)}{spread_text(impact)}")
    return [" ".join(parts)] if parts else []


def point_text(point: Mapping[str, Any] | None) -> str:
    """Return `34.73 N 120.57 W at 10.0 s (0.1 km)`, or `-` for a point that is not estimated.

    The figure is the 95 % semi-major axis, the area of the 95 % region, or the σ of the paper's law.
    """
    return "-" if point is None else f"{place_text(point)} at {point['time_s']:.1f} s{spread_text(point)}"


def place_text(point: Mapping[str, Any]) -> str:
    """Return latitude and longitude, `34.73 N 120.57 W`."""
    lat_deg, lon_deg = point["lat_deg"], point["lon_deg"]
    return f"{abs(lat_deg):.2f} {'N' if lat_deg >= 0.0 else 'S'} {abs(lon_deg):.2f} {'E' if lon_deg >= 0.0 else 'W'}"


def spread_text(point: Mapping[str, Any]) -> str:
    """Return ` (95 % in 79 000 km2)`, ` (0.1 km)` or "": how uncertain a point is."""
    if point.get("sigma_km") is not None:
        return f" (sigma {point['sigma_km']:.1f} km)"
    if point.get("region_95_km2") is not None:
        area_km2 = point["region_95_km2"]
        short = float(f"{area_km2:.2g}")
        return f" (95 % in {grouped(round(short)) if short >= _WHOLE_KM2 else f'{short:g}'} km2)"
    return "" if point["semi_major_95_km"] is None else f" ({point['semi_major_95_km']:.1f} km)"


def track_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of a track in the table of a run."""
    chance = row["type_probability"]
    reported = "-" if chance is None else f"{row['reported_type']} {chance:.2f}"
    times = f"{row['first_s']:.1f}", f"{row['last_s']:.1f}"
    return (str(row["track_id"]), reported, *times, point_text(row["launch"]), point_text(row["impact"]))
