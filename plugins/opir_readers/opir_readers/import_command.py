"""`opir import`: show what a reader makes of a file, and write the states as a scene may name
them.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.errors import Problem, SceneError
from opir_core.orbits import omm_name
from opir_core.output import OutputFiles
from opir_core.plugin import BadFileError, Host, StateTable
from opir_readers.column_maps import columns_of_text, site_of_text
from opir_readers.detections.numbers import NOTES, Row, Rows
from opir_readers.flights.refining import refined
from opir_readers.frames import lengths
from opir_readers.interpolation import largest_doubt_m, runs
from opir_readers.orbits.element_files import elements_complaints, number_of
from opir_readers.orbits.fleet import (
    MEND_ELEMENTS,
    FleetFilter,
    epoch_s_of,
    latest,
    range_of,
    reasons_text,
    sensor_lines,
)
from opir_readers.orbits.fleet_config import ranges_of
from opir_readers.reading import content_of, file_text, reader_of, refused
from opir_readers.small_map import map_lines
from opir_readers.table_checks import findings_of, moment_text
from opir_readers.table_targets import place_of


def import_file(arguments: argparse.Namespace) -> int:
    """Print what a file holds; write it, if that is asked for. Raises `SceneError` for a file that
    cannot be taken.
    """
    path = arguments.file
    try:
        text = file_text(path).text
        settings = _settings(arguments)
        readers = Host.discover().readers()
        reader = reader_of(text, readers, arguments.format, settings["columns"])
        content = content_of(text, reader, settings, 0)
        if isinstance(content, StateTable):
            content = refined(content, arguments.noise_m, arguments.burns)
    except BadFileError as error:
        raise refused(path, error) from error
    sys.stdout.write(f"{path}: {reader.name}, {reader.summary}\n")
    if isinstance(content, StateTable):
        _show_flight(arguments, content)
    elif reader.yields == "orbits":
        _show_orbits(arguments, content)
    else:
        _print(_detection_lines(content))
    return 0


def _print(lines: Iterator[str] | Sequence[str]) -> None:
    sys.stdout.write("".join(f"  {line}\n" for line in lines))


def _write(path: str, lines: Sequence[str], kind: str) -> None:
    """Write lines; raises `SinkError`."""
    with OutputFiles() as files:
        files.write(Path(path), "\n".join([*lines, ""]).encode(), kind)


def _show_flight(arguments: argparse.Namespace, table: StateTable) -> None:
    findings = findings_of(table)
    # First: what reads the output may stop reading.
    if arguments.out and not findings.refused:
        _write(arguments.out, list(_state_lines(table)), "states")
    _print([*flight_lines(table), *map_lines(table.position_m)])
    _print([f"note: {words}" for words in findings.notes])
    _print([f"warning: {words}" for words in findings.warnings])
    if findings.refused:
        raise SceneError([Problem("", words) for words in findings.refused], source=arguments.file)
    if arguments.out:
        block = (
            f"{{id: T1, model: table, type: {arguments.type}, file: {json.dumps(arguments.out)},"
            " start_s: 0}"
        )
        sys.stdout.write(
            f"{arguments.out}: {len(table.time_s)} states; in a scene:\ntargets:\n  - {block}\n"
        )


def _settings(arguments: argparse.Namespace) -> Mapping[str, Any]:
    return {
        "columns": columns_of_text(arguments.columns) if arguments.columns else {},
        "start_s": arguments.start_s,
        "object": arguments.object,
        "site": None if arguments.site is None else site_of_text(arguments.site),
    }


def flight_lines(table: StateTable) -> list[str]:
    """Return what a table holds: places, times, steps, speeds and accelerations, and the error of
    its interpolation.
    """

    def span(times_s: FloatArray) -> str:
        start, end = (
            moment_text(time_s) if table.has_dates else f"{time_s:.12g} s"
            for time_s in times_s.tolist()
        )
        return f"{start} to {end}"

    step_s = np.concatenate([np.diff(table.time_s[rows]) for rows in runs(table)])
    speed, acceleration = _fastest(table)
    doubt_m = largest_doubt_m(table)
    velocities = "no velocities" if table.velocity_m_s is None else "velocities"
    times = "dates in UTC" if table.has_dates else "seconds from start_s"
    steps = f"in steps of {step_s.min():g} to {step_s.max():g} s"
    lines = [
        f"{len(table.time_s)} states, {span(table.time_s[[0, -1]])}, {steps}",
        f"frame {table.frame}, {velocities}; times are {times}",
        f"first state {_place_text(table.position_m[0])}",
        f"last state {_place_text(table.position_m[-1])}",
        f"highest speed {speed:.6g} m/s, highest acceleration {acceleration:.4g} m/s²",
        "burns " + ", ".join(map(span, table.burns_s)),
    ]
    if doubt_m is not None:
        lines.append(
            f"interpolation without one of the states misses it by at most {doubt_m:.3g} m"
        )
    return lines


def _fastest(table: StateTable) -> tuple[float, float]:
    """Return the highest speed, m/s, of the velocities or, without any, from the differences of
    positions, and acceleration, m/s², from those.
    """
    velocity = table.velocity_m_s
    speed = 0.0 if velocity is None else float(lengths(velocity).max())
    acceleration = 0.0
    for rows in runs(table):
        step_s = np.diff(table.time_s[rows])
        chord = np.diff(table.position_m[rows], axis=0) / step_s[:, None]
        bend = np.diff(chord, axis=0) / (0.5 * (step_s[1:] + step_s[:-1]))[:, None]
        if velocity is None:
            speed = max(speed, float(lengths(chord).max(initial=0.0)))
        acceleration = max(acceleration, float(lengths(bend).max(initial=0.0)))
    return speed, acceleration


def _place_text(position_m: FloatArray) -> str:
    place = place_of(position_m)
    latitude = place["lat_deg"]
    longitude = place["lon_deg"]
    north = "N" if latitude >= 0.0 else "S"
    east = "E" if longitude >= 0.0 else "W"
    ecef = ", ".join(f"{value:.1f}" for value in position_m.tolist())
    return (
        f"{abs(latitude):.5f}° {north} {abs(longitude):.5f}° {east}, {place['height_m']:.1f} m above"
        f" WGS 84; ECEF {ecef} m"
    )


def _state_lines(table: StateTable) -> Iterator[str]:
    """Yield the states in ECEF, as seconds from the first, below their names."""
    names = ["time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m"]
    columns = [table.time_s - table.time_s[0], table.position_m]
    if table.velocity_m_s is not None:
        names += ["vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s"]
        columns.append(table.velocity_m_s)
    yield ",".join([*names, "is_burning"])
    for numbers, flag in zip(np.column_stack(columns).tolist(), _burning(table), strict=True):
        yield ",".join(map(repr, [*numbers, flag]))


def _burning(table: StateTable) -> list[int]:
    """Return 1 for each state of a burn, 0 for others."""
    time_s = table.time_s[:, None]
    ignition_s, burnout_s = table.burns_s.T
    is_burning = (time_s >= ignition_s) & (time_s < burnout_s)
    return is_burning.any(axis=1).astype(int).tolist()


def _detection_lines(rows: Rows) -> Iterator[str]:
    """Yield how many lines of sight each sensor has, and the first one."""
    count = Counter(str(row.get("sensor_id", "without id")) for row in rows)
    listed = ", ".join(f"{name} {number}" for name, number in count.most_common(12))
    yield f"{len(rows)} lines of sight: {listed}"
    example = {name: value for name, value in rows[0].items() if name not in ("line", NOTES)}
    yield f"first {json.dumps(example, ensure_ascii=False)}"
    yield from (f"note: {words}" for words in rows[0].get(NOTES, ()))
    yield "track them with opir track FILE --sensors …"


def _show_orbits(arguments: argparse.Namespace, rows: Rows) -> None:
    """Print the satellites of a file that a filter leaves; write them as sensors, if that is asked
    for.
    """
    fleet_filter = _fleet_filter(arguments)
    try:
        reasons = Counter(fleet_filter.left_out(row) for row in rows)
        selected = latest([row for row in rows if not fleet_filter.left_out(row)])
    except BadFileError as error:
        raise refused(arguments.file, error) from error
    reasons["older elements of the same"] = reasons.pop("", 0) - len(selected)
    # First: what reads the output may stop reading.
    written = _sensors(arguments, selected) if arguments.sensors else ""
    _print([*_orbit_lines(rows, selected, reasons_text(+reasons))])
    sys.stdout.write(written)


def _sensors(arguments: argparse.Namespace, rows: Rows) -> str:
    """Write the sensors of satellites to the file that is asked for; return the text to print."""
    _require_orbits(arguments.file, rows)
    lines = list(sensor_lines(rows, arguments.sensors))
    if not arguments.out:
        return "".join(f"{line}\n" for line in lines)
    _write(arguments.out, lines, "sensors")
    return f"{arguments.out}: {len(rows)} sensors {arguments.sensors}, for a scene or opir track\n"


def _require_orbits(path: str, rows: Rows) -> None:
    """Raise `SceneError` with the satellites that a scene would refuse."""
    complaints = [f"{words}; {MEND_ELEMENTS}" for words in elements_complaints(rows)]
    if complaints:
        raise SceneError([Problem("", words) for words in complaints], source=path)


def _orbit_lines(rows: Rows, selected: Rows, left_out: str) -> Iterator[str]:
    yield f"{len(rows)} sets of elements{f', left out {left_out}' if left_out else ''}"
    for row in selected[:12]:
        yield orbit_line(row)
        yield from (f"  note: {note}" for note in row.get("NOTES", ()))
    if len(selected) > 12:
        yield f"... and {len(selected) - 12} more"
    for row in [row for row in rows if "PROBLEM" in row][:12]:
        yield f"left out {omm_name(row)}: {row['PROBLEM']}"


def orbit_line(row: Row) -> str:
    """Return a satellite's name, number, epoch and elements in a line."""
    number = number_of(row)
    name = omm_name(row) if number is None else f"{omm_name(row)} ({number})"
    words_of = {
        "EPOCH": "epoch",
        "INCLINATION": "inclination deg",
        "MEAN_MOTION": "turns a day",
        "ECCENTRICITY": "eccentricity",
    }
    elements = [
        f"{words} {row[key]}" for key, words in words_of.items() if row.get(key) not in (None, "")
    ]
    return f"{name}: {', '.join(elements)}"


def _fleet_filter(arguments: argparse.Namespace) -> FleetFilter:
    """Return the filter of the arguments; raises `SceneError` for a text that is not a range."""
    problems = list[Problem]()
    values = dict[str, Any]()
    for flag, parse in (
        ("inclination", lambda text: range_of(text, float)),
        ("numbers", ranges_of),
        ("epoch", epoch_s_of),
    ):
        text = getattr(arguments, flag)
        try:
            values[flag] = None if text is None else parse(text)
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
