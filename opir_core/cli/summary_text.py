"""What `opir run` prints: the run's totals, a row for each sensor and each target, and the files written.

Plain text tables, the same on a terminal and in a file.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.output.delivery import RunOutcome
    from opir_core.output.pump import SinkReport
    from opir_core.scene.scene import Scene


def table(head: Sequence[str], rows: Sequence[Sequence[object]], *, numbers: Sequence[int] = ()) -> str:
    """Return aligned columns with a head; the columns in `numbers` are set flush right."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    return "\n".join(_line(row, widths, numbers) for row in cells)


def counted(number: int) -> str:
    """Return a whole number with its thousands set apart."""
    return f"{number:,}".replace(",", " ")


def _line(row: Sequence[str], widths: Sequence[int], numbers: Sequence[int]) -> str:
    aligned = (
        cell.rjust(width) if column in numbers else cell.ljust(width)
        for column, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return "  ".join(aligned).rstrip()


#: Targets that are listed one by one; of more, the first so many.
_LISTED = 12


def as_json(outcome: "RunOutcome", files: Mapping[str, Path]) -> str:
    """Return the summary, what each sink took, and the files, as one JSON document."""
    from attrs import asdict

    outputs = {result.name: asdict(result) for result in outcome.report.sinks}
    told = {**outcome.summary, "outputs": outputs, "files": {what: str(path) for what, path in files.items()}}
    return json.dumps(told, indent=2)


def as_text(scene: "Scene", outcome: "RunOutcome", files: Mapping[str, Path]) -> str:
    """Return the summary as tables."""
    counts, targets = outcome.summary["counts"], outcome.summary["targets"]
    head = (
        f"{scene.name}: {counted(counts['detections'])} detections in {counted(counts['looks'])} looks, "
        f"{scene.duration_s:g} s, seed {scene.seed}"
    )
    parts = [
        head,
        table(_SENSOR_HEAD, [_sensor_cells(row) for row in outcome.summary["sensors"]], numbers=(2, 3, 4)),
        _listed(_TARGET_HEAD, [_target_cells(row) for row in targets], numbers=(2, 3, 5, 6)),
        _listed(_TRACK_HEAD, [_track_cells(row) for row in outcome.summary["tracks"]], numbers=(0, 2, 3)),
        "\n".join([*_delivered(scene, outcome), *(f"{path}: {what}" for what, path in files.items())]),
    ]
    return "\n\n".join(part for part in parts if part)


def _listed(head: Sequence[str], rows: Sequence[Sequence[object]], *, numbers: Sequence[int]) -> str:
    """Return a table of the first rows, with the number of those left out; "" where there is none."""
    left_out = f"\n... and {len(rows) - _LISTED} more" if len(rows) > _LISTED else ""
    return table(head, rows[:_LISTED], numbers=numbers) + left_out if rows else ""


_SENSOR_HEAD = ("sensor", "type", "looks", "detections", "targets")
_TRACK_HEAD = ("track", "type", "from s", "to s", "launch point (95 % semi-major axis)", "predicted impact point")
_TARGET_HEAD = ("target", "type", "ignition s", "latency s", "first seen by", "detections", "sensors", "reported")


def _sensor_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = (row["looks"], row["detections"], row["targets_detected"])
    return (row["sensor_id"], row["sensor_type"], *(counted(number) for number in numbers))


def _target_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    seen = row["latency_s"] is not None
    return (
        row["target_id"],
        row["target_type"],
        f"{row['ignition_s']:.3f}",
        f"{row['latency_s']:.3f}" if seen else "-",
        row["first_sensor_id"] if seen else "not seen",
        counted(row["detections"]),
        str(row["sensors"]),
        row["reported_type"] if seen else "-",
    )


def _track_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    chance = row["type_probability"]
    reported = "-" if chance is None else f"{row['reported_type']} {chance:.2f}"
    times = f"{row['first_s']:.1f}", f"{row['last_s']:.1f}"
    return (str(row["track_id"]), reported, *times, _point_text(row["launch"]), _point_text(row["impact"]))


def _point_text(point: Mapping[str, Any] | None) -> str:
    """Return `34.73 N 120.57 W at 10.0 s (0.1 km)`, or `-` for a point that is not estimated."""
    if point is None:
        return "-"
    lat_deg, lon_deg, axis_km = point["lat_deg"], point["lon_deg"], point["semi_major_95_km"]
    place = f"{abs(lat_deg):.2f} {'N' if lat_deg >= 0.0 else 'S'} {abs(lon_deg):.2f} {'E' if lon_deg >= 0.0 else 'W'}"
    return f"{place} at {point['time_s']:.1f} s" + ("" if axis_km is None else f" ({axis_km:.1f} km)")


def _delivered(scene: "Scene", outcome: "RunOutcome") -> list[str]:
    places = {choice.path: getattr(choice.config, "path", choice.name) for choice in scene.outputs}
    return [f"{places[sink.name]}: {counted(sink.delivered)} events{_besides(sink)}" for sink in outcome.report.sinks]


def _besides(sink: "SinkReport") -> str:
    """Return what else became of a sink's events."""
    fates = ("spooled", sink.spooled), ("dropped", sink.dropped), ("withheld", sink.withheld)
    parts = [f"{counted(number)} {fate}" for fate, number in fates if number]
    if sink.recovered:
        parts.append(f"{counted(sink.recovered)} of them left in the spool by an earlier run")
    return "".join(f", {part}" for part in parts)
