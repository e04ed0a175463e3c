"""The orbit of a sensor from a file: by SGP4 from mean elements, or along an ephemeris."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import fields_dict, frozen

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, nearest_names
from opir_core.orbits import (
    MovingOrbit,
    Sgp4Motion,
    age_warning,
    omm_complaint,
    omm_name,
    satellite_of_omm,
    satellite_of_tle,
)
from opir_core.plugin import BadFileError, FileReader, StateTable
from opir_readers.interpolation import Interpolant, interpolant
from opir_readers.orbits.element_files import number_of
from opir_readers.reading import content_of, file_text, reader_of
from opir_readers.table_checks import findings_of, moment_text

_NAMES = ("OBJECT_NAME", "OBJECT_ID", "NORAD_CAT_ID")

#: Light times and lines of sight are computed some seconds around a scene: time, s, by which
#: polynomials go on.
_BEYOND_S = 10.0


def orbit_of_file(file: Any, epoch_us: int, readers: Sequence[FileReader]) -> MovingOrbit:
    """Return the orbit that a sensor's block `orbit.file` asks for, for a scene epoch.

    Raises `BadFileError`.
    """
    text = file_text(file.path).text
    reader = reader_of(text, [each for each in readers if each.yields != "detections"])
    if reader.yields == "orbits":
        return elements_orbit(
            chosen(content_of(text, reader, {}, epoch_us), file.satellite), epoch_us
        )
    named = {"object": file.satellite} if "object" in fields_dict(reader.config) else {}
    return _of_table(content_of(text, reader, named, epoch_us), epoch_us, as_given=file.as_given)


def chosen(rows: Sequence[Mapping[str, Any]], satellite: str | None) -> Mapping[str, Any]:
    """Return the elements of a name, an id or a number; of the only satellite without one. Raises
    `BadFileError`.
    """
    found = [row for row in rows if satellite is None or _is_named(row, satellite)]
    if len(found) == 1:
        return found[0]
    if not found:
        names = [omm_name(row) for row in rows]
        near = [name for name in names if str(satellite).casefold() in name.casefold()]
        near = near or nearest_names(str(satellite), names)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise BadFileError(f"has no satellite {satellite!r} among {len(rows)}{hint}")
    if satellite is None:
        raise BadFileError(
            f"has {len(found)} satellites; say which with satellite: {_listed(found)}"
        )
    raise BadFileError(
        f"has {len(found)} element sets of {satellite}; keep one of the epochs {_epochs(found)}"
    )


def _is_named(row: Mapping[str, Any], satellite: str) -> bool:
    wanted = satellite.strip()
    if any(str(row.get(name, "")).strip().casefold() == wanted.casefold() for name in _NAMES):
        return True
    return wanted.isascii() and wanted.isdigit() and number_of(row) == int(wanted)


def _listed(rows: Sequence[Mapping[str, Any]]) -> str:
    names = [omm_name(row) for row in rows[:8]]
    return ", ".join([*names, f"and {len(rows) - 8} more"] if len(rows) > 8 else names)


def _epochs(rows: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(str(row.get("EPOCH")) for row in rows[:4])


def elements_orbit(row: Mapping[str, Any], epoch_us: int) -> MovingOrbit:
    """Return the orbit of mean elements; raises `BadFileError` for wrong ones, and where SGP4 has
    no position.
    """
    name = omm_name(row)
    if "PROBLEM" in row:
        raise BadFileError(row["PROBLEM"])
    if "TLE_LINE1" in row:
        satellite = satellite_of_tle((row["TLE_LINE1"], row["TLE_LINE2"]))
    else:
        complaint = omm_complaint(row)
        if complaint:
            raise BadFileError(f"the elements of {name}: {complaint}")
        satellite = satellite_of_omm(row)
    try:
        motion = Sgp4Motion(satellite, epoch_us, name)
        motion.position_teme_m(np.zeros(1))
    except ModelError as error:
        raise BadFileError(str(error)) from error
    warning = age_warning(name, motion.age_days)
    return MovingOrbit(motion, warnings=() if warning is None else (warning,))


@frozen(eq=False)
class EphemerisMotion:
    """The motion of a satellite through the states of a table; `ModelError` outside of them."""

    table: StateTable
    curve: Interpolant
    epoch_us: int

    def state_ecef(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (n, 3) at scene times (n,)."""
        first = float(self.table.time_s[0])
        last = float(self.table.time_s[-1])
        before, after = (
            min(_BEYOND_S, float(step)) for step in np.diff(self.table.time_s)[[0, -1]]
        )
        outside = np.flatnonzero((time_s < first - before) | (time_s > last + after))
        if len(outside):
            at, start, end = (
                moment_text(self.epoch_us * 1e-6 + value)
                for value in (float(time_s[outside[0]]), first, last)
            )
            raise ModelError(
                f"the ephemeris of a sensor has no state at {at}: its states go from {start} to"
                f" {end}"
            )
        return self.curve.state(np.zeros(len(time_s), dtype=np.intp), time_s)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,)."""
        return self.state_ecef(time_s)[0]


def _of_table(table: StateTable, epoch_us: int, *, as_given: bool) -> MovingOrbit:
    found = findings_of(table, as_given=as_given)
    if found.refused:
        raise BadFileError(found.refused[0])
    if not table.has_dates:
        raise BadFileError(
            "has times without dates; a sensor needs an ephemeris with dates: OEM, SP3, STK"
        )
    motion = EphemerisMotion(table, interpolant([table]), epoch_us)
    try:
        motion.position_ecef_m(np.zeros(1))
    except ModelError as error:
        raise BadFileError(
            f"{error}; set the scene's epoch, or take the ephemeris of that day"
        ) from error
    return MovingOrbit(
        motion, warnings=tuple(words for words in found.warnings if "not read" not in words)
    )
