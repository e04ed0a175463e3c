"""`opir import`: show what a reader makes of a file, and write the states as a scene may name
them.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.errors import Problem, SceneError
from opir_core.geometry import ecef_to_geodetic
from opir_core.orbits import omm_name
from opir_core.output import OutputFiles
from opir_core.plugin import BadFileError, Host, StateTable
from opir_readers.column_maps import columns_of_text, site_of_text
from opir_readers.columns import map_complaint
from opir_readers.flights.refining import refined
from opir_readers.interpolation import largest_doubt_m, runs
from opir_readers.orbits.element_files import number_of
from opir_readers.orbits.fleet import FleetFilter, epoch_s_of, latest, range_of, sensor_lines
from opir_readers.reading import content_of, file_text, reader_of
from opir_readers.small_map import map_lines
from opir_readers.table_checks import findings_of, moment_text


def import_file(arguments: argparse.Namespace) -> int:
    """Print what a file holds; write it, if that is asked for. Raises `SceneError` for a file that
    cannot be taken.
    """
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
    return _orbits(arguments, content) if reader.yields == "orbits" else _detections(content)


def _flight(arguments: argparse.Namespace, table: StateTable) -> int:
    sys.stdout.write(
        "".join(f"  {line}\n" for line in [*flight_lines(table), *map_lines(table.position_m)])
    )
    found = findings_of(table)
    sys.stdout.write("".join(f"  warning: {words}\n" for words in found.warnings))
    if found.refused:
        raise SceneError([Problem("", words) for words in found.refused], source=arguments.file)
    if arguments.out:
        _write(table, Path(arguments.out))
        block = (
            f"{{id: T1, model: table, type: {arguments.type}, file: {json.dumps(arguments.out)},"
            f" start_s: 0}}"
        )
        sys.stdout.write(
            f"{arguments.out}: {len(table.time_s)} states; in a scene:\ntargets:\n  - {block}\n"
        )
    return 0


def _refused(path: str, error: BadFileError) -> SceneError:
    return SceneError([Problem("", str(error))], source=path)


def _settings(arguments: argparse.Namespace) -> Mapping[str, Any]:
    columns = columns_of_text(arguments.columns) if arguments.columns else {}
    complaint = map_complaint(columns)
    if complaint:
        raise SceneError([Problem("--columns", complaint)], source=arguments.file)
    site = None if arguments.site is None else site_of_text(arguments.site)
    return {
        "columns": columns,
        "start_s": arguments.start_s,
        "object": arguments.object,
        "site": site,
    }


def flight_lines(table: StateTable) -> list[str]:
    """Return what a table holds: places, times, steps, speeds and accelerations, and how sure its
    interpolation is.
    """
    step_s = np.concatenate([np.diff(table.time_s[rows]) for rows in runs(table)])
    speeds, accelerations = _motion(table)
    doubt_m = largest_doubt_m(table)
    first, last = (_time_text(table, float(table.time_s[row])) for row in (0, -1))
    velocities = "no velocities" if table.velocity_m_s is None else "velocities"
    lines = [
        (
            f"{len(table.time_s)} states, {first} to {last}, in steps of {step_s.min():g} to"
            f" {step_s.max():g} s"
        ),
        (
            f"frame {table.frame}, {velocities}; times are"
            f" {'dates in UTC' if table.has_dates else 'seconds from start_s'}"
        ),
        f"first state {_place_text(table.position_m[0])}",
        f"last state {_place_text(table.position_m[-1])}",
        (
            f"highest speed {speeds.max():.6g} m/s, highest acceleration"
            f" {accelerations.max(initial=0.0):.4g} m/s²"
        ),
        "burns "
        + ", ".join(
            f"{_time_text(table, a)} to {_time_text(table, b)}" for a, b in table.burns_s.tolist()
        ),
    ]
    if doubt_m is not None:
        lines.append(
            f"interpolation without one of the states misses it by at most {doubt_m:.3g} m"
        )
    return lines


def _detections(rows: Sequence[Mapping[str, Any]]) -> int:
    """Print how many lines of sight each sensor has, and the first one."""
    count = Counter(str(row.get("sensor_id", "without id")) for row in rows)
    first = {name: value for name, value in rows[0].items() if name != "line"}
    sys.stdout.write(
        f"  {len(rows)} lines of sight:"
        f" {', '.join(f'{name} {n}' for name, n in count.most_common(12))}\n"
    )
    sys.stdout.write(
        f"  first {json.dumps(first, ensure_ascii=False)}\n  track them with opir track FILE"
        f" --sensors …\n"
    )
    return 0


def _orbits(arguments: argparse.Namespace, rows: Sequence[Mapping[str, Any]]) -> int:
    """Print the satellites of a file that a filter leaves; write them as sensors, if that is asked
    for.
    """
    filter_ = fleet_filter(arguments)
    try:
        why = Counter(filter_.left_out(row) for row in rows)
        kept = latest([row for row in rows if not filter_.left_out(row)])
    except BadFileError as error:
        raise _refused(arguments.file, error) from error
    left = ", ".join(f"{count} {reason}" for reason, count in why.items() if reason)
    older = why[""] - len(kept)
    left += f"{', ' if left and older else ''}{older} older elements of the same" if older else ""
    sys.stdout.write(f"  {len(rows)} sets of elements{f', left out {left}' if left else ''}\n")
    for row in kept[:12]:
        sys.stdout.write(f"  {orbit_line(row)}\n")
        sys.stdout.write("".join(f"    note: {note}\n" for note in row.get("NOTES", ())))
    sys.stdout.write(f"  ... and {len(kept) - 12} more\n" if len(kept) > 12 else "")
    for row in [row for row in rows if "PROBLEM" in row][:12]:
        sys.stdout.write(f"  left out {omm_name(row)}: {row['PROBLEM']}\n")
    if arguments.sensors:
        _write_fleet(arguments, kept)
    return 0


def _write_fleet(arguments: argparse.Namespace, rows: Sequence[Mapping[str, Any]]) -> None:
    lines = list(sensor_lines(rows, arguments.sensors))
    if not arguments.out:
        sys.stdout.write("".join(f"{line}\n" for line in lines))
        return
    with OutputFiles() as files:
        files.write(Path(arguments.out), "\n".join([*lines, ""]).encode(), "sensors")
    sys.stdout.write(
        f"{arguments.out}: {len(rows)} sensors {arguments.sensors}, for a scene or opir track\n"
    )


def orbit_line(row: Mapping[str, Any]) -> str:
    """Return a satellite's name, number, epoch and elements in a line."""
    number = number_of(row)
    name = omm_name(row) if number is None else f"{omm_name(row)} ({number})"
    parts = [f"{words} {row[key]}" for key, words in _ELEMENTS if row.get(key) not in (None, "")]
    return f"{name}: {', '.join(parts)}"


_ELEMENTS = (
    ("EPOCH", "epoch"),
    ("INCLINATION", "inclination deg"),
    ("MEAN_MOTION", "turns a day"),
    ("ECCENTRICITY", "eccentricity"),
)


def fleet_filter(arguments: argparse.Namespace) -> FleetFilter:
    """Return the filter of the arguments; raises `SceneError` for what is no range."""
    problems = list[Problem]()
    values = dict[str, Any]()
    for flag, make in (
        ("inclination", lambda text: range_of(text, float)),
        ("numbers", lambda text: tuple(range_of(part, int) for part in text.split(","))),
        ("epoch", epoch_s_of),
    ):
        text = getattr(arguments, flag)
        try:
            values[flag] = None if text is None else make(text)
        except ValueError as error:
            problems.append(Problem(f"--{flag}", str(error)))
    if problems:
        raise SceneError(problems, source="command line")
    return FleetFilter(
        name=arguments.name,
        inclination_deg=values["inclination"],
        numbers=values["numbers"] or (),
        most_age_days=arguments.max_age_days,
        epoch_s=values["epoch"],
    )


def _motion(table: StateTable) -> tuple[FloatArray, FloatArray]:
    """Return speeds, m/s, and accelerations, m/s², from the differences of positions."""
    speeds = [np.zeros(1)]
    accelerations = [np.zeros(0)]
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
    latitude, longitude = (
        float(np.degrees(angle[0])) for angle in (where.latitude_rad, where.longitude_rad)
    )
    ecef = ", ".join(f"{value:.1f}" for value in position_m.tolist())
    north = "N" if latitude >= 0.0 else "S"
    east = "E" if longitude >= 0.0 else "W"
    place = (
        f"{abs(latitude):.5f}° {north} {abs(longitude):.5f}° {east}, {float(where.height_m[0]):.1f}"
        f" m above WGS 84"
    )
    return f"{place}; ECEF {ecef} m"


def _write(table: StateTable, path: Path) -> None:
    """Write the states in ECEF, as seconds from the first; raises `SinkError`."""
    names = ["time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m"]
    columns = [table.time_s - table.time_s[0], table.position_m]
    if table.velocity_m_s is not None:
        names += ["vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s"]
        columns.append(table.velocity_m_s)
    time_s = table.time_s[:, None]
    burns = table.burns_s
    is_burning = ((time_s >= burns[:, 0]) & (time_s < burns[:, 1])).any(axis=1).astype(int).tolist()
    numbers = np.column_stack(columns).tolist()
    rows = (
        ",".join(map(repr, [*row, burning]))
        for row, burning in zip(numbers, is_burning, strict=True)
    )
    lines = [",".join([*names, "is_burning"]), *rows, ""]
    with OutputFiles() as files:
        files.write(path, "\n".join(lines).encode(), "states")
