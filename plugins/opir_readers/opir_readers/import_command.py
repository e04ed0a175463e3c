"""`opir import`: show what a reader makes of a file, and write the states as a scene may name them."""

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.errors import Problem, SceneError, unwritable
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import BadFileError, FileReader, Host, StateTable
from opir_readers.column_maps import columns_of_text, site_of_text
from opir_readers.columns import map_complaint
from opir_readers.flights.refining import refined
from opir_readers.interpolation import largest_doubt_m, runs
from opir_readers.reading import content_of, file_text, reader_of
from opir_readers.table_checks import findings_of, moment_text


def import_file(arguments: argparse.Namespace) -> int:
    """Print what a file holds; write it, if that is asked for. Raises `SceneError` for a file that cannot be taken."""
    path = arguments.file
    try:
        text = file_text(path).text
        reader = reader_of(text, Host.discover().readers(), arguments.format)
        content = content_of(text, reader, _settings(arguments), 0)
        if isinstance(content, StateTable):
            content = refined(content, arguments.noise_m, arguments.burns)
    except BadFileError as error:
        raise _refused(path, error) from error
    sys.stdout.write(f"{path}: {reader.name}, {reader.summary}\n")
    if isinstance(content, StateTable):
        return _flight(arguments, content)
    sys.stdout.write("".join(f"  {line}\n" for line in orbit_lines(content, reader)))
    return 0


def _flight(arguments: argparse.Namespace, table: StateTable) -> int:
    sys.stdout.write("".join(f"  {line}\n" for line in flight_lines(table)))
    found = findings_of(table)
    sys.stdout.write("".join(f"  warning: {words}\n" for words in found.warnings))
    if found.refused:
        raise SceneError([Problem("", words) for words in found.refused], source=arguments.file)
    if arguments.out:
        _write(table, Path(arguments.out))
        block = f"{{id: T1, model: table, type: {arguments.type}, file: {json.dumps(arguments.out)}, start_s: 0}}"
        sys.stdout.write(f"{arguments.out}: {len(table.time_s)} states; in a scene:\ntargets:\n  - {block}\n")
    return 0


def _refused(path: str, error: BadFileError) -> SceneError:
    return SceneError([Problem("", str(error))], source=path)


def _settings(arguments: argparse.Namespace) -> Mapping[str, Any]:
    columns = columns_of_text(arguments.columns) if arguments.columns else {}
    complaint = map_complaint(columns)
    if complaint:
        raise SceneError([Problem("--columns", complaint)], source=arguments.file)
    site = None if arguments.site is None else site_of_text(arguments.site)
    return {"columns": columns, "start_s": arguments.start_s, "object": arguments.object, "site": site}


def flight_lines(table: StateTable) -> list[str]:
    """Return what a table holds: places, times, steps, speeds and accelerations, and how sure its interpolation is."""
    step_s = np.concatenate([np.diff(table.time_s[rows]) for rows in runs(table)])
    speeds, accelerations = _motion(table)
    doubt_m = largest_doubt_m(table)
    first, last = (_time_text(table, float(table.time_s[row])) for row in (0, -1))
    velocities = "no velocities" if table.velocity_m_s is None else "velocities"
    lines = [
        f"{len(table.time_s)} states, {first} to {last}, in steps of {step_s.min():g} to {step_s.max():g} s",
        f"frame {table.frame}, {velocities}; times are {'dates in UTC' if table.has_dates else 'seconds from start_s'}",
        f"first state {_place_text(table.position_m[0])}",
        f"last state {_place_text(table.position_m[-1])}",
        f"highest speed {speeds.max():.6g} m/s, highest acceleration {accelerations.max(initial=0.0):.4g} m/s²",
        "burns " + ", ".join(f"{_time_text(table, a)} to {_time_text(table, b)}" for a, b in table.burns_s.tolist()),
    ]
    if doubt_m is not None:
        lines.append(f"interpolation without one of the states misses it by at most {doubt_m:.3g} m")
    return lines


def orbit_lines(content: Any, reader: FileReader) -> list[str]:
    """Return what a list of orbits holds."""
    names = [str(each.get("OBJECT_NAME") or each.get("NORAD_CAT_ID") or "?") for each in content]
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return [f"{len(names)} {reader.yields}: {', '.join(names[:12])}{more}"]


def _motion(table: StateTable) -> tuple[FloatArray, FloatArray]:
    """Return speeds, m/s, and accelerations, m/s², from the differences of positions."""
    speeds, accelerations = [np.zeros(1)], [np.zeros(0)]
    for rows in runs(table):
        step_s = np.diff(table.time_s[rows])
        chord = np.diff(table.position_m[rows], axis=0) / step_s[:, None]
        speeds.append(np.sqrt((chord * chord).sum(axis=1)))
        bend = np.diff(chord, axis=0) / (0.5 * (step_s[1:] + step_s[:-1]))[:, None]
        accelerations.append(np.sqrt((bend * bend).sum(axis=1)))
    return np.concatenate(speeds), np.concatenate(accelerations)


def _time_text(table: StateTable, time_s: float) -> str:
    return moment_text(time_s) if table.has_dates else f"{time_s:.12g} s"


def _place_text(position_m: FloatArray) -> str:
    where = ecef_to_geodetic(position_m[None])
    latitude, longitude = (float(np.degrees(angle[0])) for angle in (where.latitude_rad, where.longitude_rad))
    ecef = ", ".join(f"{value:.1f}" for value in position_m.tolist())
    north, east = "N" if latitude >= 0.0 else "S", "E" if longitude >= 0.0 else "W"
    place = f"{abs(latitude):.5f}° {north} {abs(longitude):.5f}° {east}, {float(where.height_m[0]):.1f} m above WGS 84"
    return f"{place}; ECEF {ecef} m"


def _write(table: StateTable, path: Path) -> None:
    """Write the states in ECEF, as seconds from the first; raises `SinkError`."""
    names, columns = ["time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m"], [table.time_s - table.time_s[0], table.position_m]
    if table.velocity_m_s is not None:
        names += ["vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s"]
        columns.append(table.velocity_m_s)
    time_s, burns = table.time_s[:, None], table.burns_s
    is_burning = ((time_s >= burns[:, 0]) & (time_s < burns[:, 1])).any(axis=1).astype(int).tolist()
    numbers = np.column_stack(columns).tolist()
    rows = (",".join(map(repr, [*row, burning])) for row, burning in zip(numbers, is_burning, strict=True))
    lines = [",".join([*names, "is_burning"]), *rows, ""]
    try:
        path.write_text("\n".join(lines), encoding="utf-8")
    except OSError as error:
        raise unwritable("states", path, error) from error
