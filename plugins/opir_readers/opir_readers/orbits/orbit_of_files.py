"""The orbit of a sensor from a file: by SGP4 from mean elements, or along an ephemeris."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import fields_dict, frozen

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, nearest_names
from opir_core.orbits import (
    MovingOrbit,
    Sgp4Motion,
    age_warning,
    omm_name,
    satellite_of_omm,
    satellite_of_tle,
)
from opir_core.plugin import BadFileError, FileReader, StateTable
from opir_readers.interpolation import Interpolant, interpolant
from opir_readers.orbits.element_files import (
    Elements,
    ElementSets,
    elements_complaints,
    number_of,
)
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
    reader = reader_of(text, [reader for reader in readers if reader.yields != "detections"])
    if reader.yields == "orbits":
        rows = content_of(text, reader, {}, epoch_us)
        return elements_orbit(elements_of(rows, file.satellite), epoch_us)
    settings = {"object": file.satellite} if "object" in fields_dict(reader.config) else {}
    table = content_of(text, reader, settings, epoch_us)
    return _of_table(table, epoch_us, as_given=file.as_given)


def elements_of(rows: ElementSets, satellite: str | None) -> Elements:
    """Return the elements of a name, an id or a number; of the only satellite without one. Raises
    `BadFileError`.
    """
    matches = [row for row in rows if satellite is None or _is_named(row, satellite)]
    if len(matches) == 1:
        return matches[0]
    if not matches:
        raise _unknown_satellite(rows, satellite)
    count = len(matches)
    if satellite is None:
        names = [omm_name(row) for row in matches[:8]]
        names += [f"and {count - 8} more"] if count > 8 else []
        raise BadFileError(f"has {count} satellites; say which with satellite: {', '.join(names)}")
    epochs = ", ".join(str(row.get("EPOCH")) for row in matches[:4])
    raise BadFileError(f"has {count} element sets of {satellite}; keep one of the epochs {epochs}")


def _unknown_satellite(rows: ElementSets, satellite: str | None) -> BadFileError:
    name = str(satellite)
    names = [omm_name(row) for row in rows]
    nearest = [known for known in names if name.casefold() in known.casefold()]
    nearest = nearest or nearest_names(name, names)
    hint = f"; did you mean {nearest[0]}?" if nearest else ""
    return BadFileError(f"has no satellite {satellite!r} among {len(rows)}{hint}")


def _is_named(row: Elements, satellite: str) -> bool:
    bare = satellite.strip()
    if any(str(row.get(name, "")).strip().casefold() == bare.casefold() for name in _NAMES):
        return True
    return bare.isascii() and bare.isdigit() and number_of(row) == int(bare)


def elements_orbit(row: Elements, epoch_us: int) -> MovingOrbit:
    """Return the orbit of mean elements; raises `BadFileError` for wrong ones, and where SGP4 has
    no position.
    """
    name = omm_name(row)
    for words in elements_complaints([row]):
        raise BadFileError(words)
    is_tle = "TLE_LINE1" in row
    lines = row.get("TLE_LINE1", ""), row.get("TLE_LINE2", "")
    satellite = satellite_of_tle(lines) if is_tle else satellite_of_omm(row)
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
        begin, end = self.table.time_s[[0, -1]].tolist()
        lead_s, lag_s = np.minimum(np.diff(self.table.time_s)[[0, -1]], _BEYOND_S).tolist()
        outside = time_s[(time_s < begin - lead_s) | (time_s > end + lag_s)]
        if len(outside):
            moment, start, stop = (
                moment_text(self.epoch_us * 1e-6 + at_s) for at_s in (float(outside[0]), begin, end)
            )
            raise ModelError(
                f"the ephemeris of a sensor has no state at {moment}: its states go from {start} to"
                f" {stop}"
            )
        return self.curve.at(time_s)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,)."""
        return self.state_ecef(time_s)[0]


def _of_table(table: StateTable, epoch_us: int, *, as_given: bool) -> MovingOrbit:
    findings = findings_of(table, as_given=as_given)
    if findings.refused:
        raise BadFileError(findings.refused[0])
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
    return MovingOrbit(motion, warnings=findings.warnings)
