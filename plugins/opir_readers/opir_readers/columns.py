"""Columns of tables: which quantity and unit each one holds, by its own name or by the user's map.

A name is a quantity with its unit, `x_ecef_km`; without a unit it is that of the first in the list.
A map says the same of columns with other names: `{lat: "Latitude (°)", height_ft: ALT}`.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches

from attrs import frozen

from opir_core.plugin import BadFileError
from opir_readers.published import published
from opir_readers.time_systems import utc_s

Units = Mapping[str, float]

TIMES: Units = published("units")["time"]
LENGTHS: Units = published("units")["length"]
SPEEDS: Units = published("units")["speed"]
ANGLES: Units = published("units")["angle"]


def xyz(pattern: str) -> tuple[str, ...]:
    """Return the names of three components.

    >>> xyz("v{}_ecef")
    ('vx_ecef', 'vy_ecef', 'vz_ecef')
    """
    return tuple(pattern.format(axis) for axis in "xyz")


#: Quantities that come together: of a place, with the frame in words, and of a velocity.
ECEF = xyz("{}_ecef")
GEODETIC = ("lat", "lon", "height")
LOCAL = ("east", "north", "up")
DOWNRANGE = ("downrange", "height")
PLACES: Mapping[tuple[str, ...], str] = {
    ECEF: "ECEF",
    GEODETIC: "latitude, longitude, height above WGS 84",
    LOCAL: "east, north and up from the launch point",
    DOWNRANGE: "distance downrange and height from the launch point",
    xyz("{}_eme2000"): "EME2000",
    xyz("{}_teme"): "TEME",
}
INERTIAL_VELOCITY = xyz("v{}_inertial")
LOCAL_VELOCITY = ("v_east", "v_north", "v_up")

#: Velocities, with the celestial frame that a place beside them has to be in, "" for ECEF.
VELOCITIES: Mapping[tuple[str, ...], str] = {
    xyz("v{}_ecef"): "",
    INERTIAL_VELOCITY: "",
    LOCAL_VELOCITY: "",
    xyz("v{}_eme2000"): "EME2000",
    xyz("v{}_teme"): "TEME",
}
#: A height above the launch point, in place of `height`.
ALTITUDE = "altitude"
TIME = "time"
BURNING = "is_burning"
#: The time as a date, in place of seconds, and other names of such columns, in lower case.
DATE = "timestamp"
_DATES = (DATE, "time_utc", "utc", "utc_time", "datetime", "date", "epoch", "utcgregorian")

#: Times that count from a date, and that date, s of Unix time.
SCALES = {
    "unix_time": 0.0,
    "gps_time": 315_964_800.0,
    "mjd": -40_587.0 * 86_400.0,
    "jd": -2_440_587.5 * 86_400.0,
}

#: Times that count from a date: their units.
SCALE_UNITS = {"unix_time": TIMES, "gps_time": TIMES, "mjd": {"": 86_400.0}, "jd": {"": 86_400.0}}

#: The units of each quantity, the first of them where none is named: SI units and radians in one
#: unit.
UNITS: Mapping[str, Units] = {
    TIME: TIMES,
    **dict.fromkeys((*ECEF, *xyz("{}_eme2000"), *xyz("{}_teme")), LENGTHS),
    "lat": ANGLES,
    "lon": ANGLES,
    **dict.fromkeys(("height", ALTITUDE, *LOCAL, "downrange"), LENGTHS),
    **dict.fromkeys((name for group in VELOCITIES for name in group), SPEEDS),
    BURNING: {"": 1.0},
    DATE: {"": 1.0},
    **SCALE_UNITS,
}

#: Names that tables of other programs give their columns, for the map that a message proposes.
_AXIS = r"\b({0}|{0} (ecef|ecf|efg|itrf|fixed|pos|position)|(ecef|ecf|efg|itrf|fixed|earthfixed|pos|position|r) {0})\b"
_RATE = r"\b(v ?{0}\b|{0} ?dot\b|(vel|velocity|v)( ecef)? {0}\b|{0} vel|d{0} dt)"
_WORDS = (
    (r"^ts?(ime)?\b|elapsed", "time"),
    (r"\blat", "lat"),
    (r"\blon|\blng", "lon"),
    (r"\balt|height|\bh\b", "height"),
    *((_RATE.format(axis), f"v{axis}_ecef") for axis in "xyz"),
    *((_AXIS.format(axis), f"{axis}_ecef") for axis in "xyz"),
)
#: Names of axes that do not turn with the Earth.
_INERTIAL = re.compile(r"eci(?!t)|j2000|eme2000|gcr[fs]|icr[fs]|inertial|mj2000|teme")

_OPENING = re.compile(r"[(\[]")


@frozen
class Column:
    """A column that is read: its place in a line, its name there, its quantity, and its unit in SI
    units or radians.
    """

    place: int
    name: str
    quantity: str
    factor: float


#: Returns the quantity that a name stands for and its unit, None for an unknown name.
QuantityOf = Callable[[str], tuple[str, float] | None]


def quantity_of(name: str) -> tuple[str, float] | None:
    """Return the quantity that a name like `x_ecef_km` stands for and its unit, or None.

    >>> quantity_of("X_ECEF [km]")
    ('x_ecef', 1000.0)
    """
    if bare_name(name)[0].rpartition(".")[2] in _DATES:
        return DATE, 1.0
    return unit_of(plain_name(name), UNITS)


def plain_name(name: str) -> str:
    """Return a name in lower case with its unit at its end, "" for one with another unit in
    brackets.

    >>> plain_name("Azimuth (deg)")
    'azimuth_deg'
    """
    bare, unit = bare_name(name)
    if not unit:
        return bare
    written = published("units")["written"]
    return f"{bare}_{written[unit]}" if unit in written else ""


def bare_name(name: str) -> tuple[str, str]:
    """Return a name in lower case without its unit in brackets, and that unit.

    >>> bare_name("Altitude (ft)")
    ('altitude', 'ft')
    """
    lower = name.strip().lower()
    inside = lower[:-1]
    closed = max(inside.rfind(")"), inside.rfind("]")) + 1
    opening = _OPENING.search(inside, closed) if lower.endswith((")", "]")) else None
    if opening is None:
        return lower, ""
    return inside[: opening.start()].rstrip(), inside[opening.end() :].strip()


def unix_s_of_scale(scale: str, since_s: float) -> float:
    """Return seconds of UTC since 1970 of a time that counts from the date of a scale."""
    unix_s = since_s + SCALES[scale]
    return utc_s(unix_s, "GPS") if scale == "gps_time" else unix_s


def unit_of(name: str, units: Mapping[str, Units]) -> tuple[str, float] | None:
    """Return the quantity of a name, of those with these units, and its unit; None for an unknown
    name.

    >>> unit_of("height_km", UNITS)
    ('height', 1000.0)
    """
    for quantity, factors in units.items():
        if name == quantity:
            return quantity, next(iter(factors.values()))
        unit = name.removeprefix(f"{quantity}_")
        if unit != name and unit in factors:
            return quantity, factors[unit]
    return None


def map_complaint(
    columns: Mapping[str, str] | None,
    units: Mapping[str, Units] = UNITS,
    quantity_of: QuantityOf = quantity_of,
) -> str | None:
    """Return the first error in the quantities of a column map, or None."""
    for name in columns or ():
        if quantity_of(name) is None:
            nearest = get_close_matches(name, _names_with_units(units), n=1)
            known = f"quantities are {', '.join(units)}"
            hint = f"did you mean {nearest[0]}?" if nearest else known
            return f"{name} is no quantity with its unit; {hint}"
    return None


def columns_of(names: Sequence[str], line: int, columns: Mapping[str, str]) -> Mapping[str, Column]:
    """Return the columns that are read, by quantity; raises `BadFileError` where they do not make
    states.

    `columns` maps quantities with units to names of columns; others are known by their own names.
    `line` is that of the names.
    """
    numbered = _numbered(names, columns.values())
    known = columns_by_quantity(names, line, columns, quantity_of, numbered)
    _require_states(known, names, line)
    return known


def columns_by_quantity(
    names: Sequence[str],
    line: int,
    columns: Mapping[str, str],
    quantity_of: QuantityOf,
    numbered: Sequence[str] | None = None,
    skipped: Collection[str] = (),
) -> dict[str, Column]:
    """Return the columns of known quantities; raises `BadFileError` for a column of the map that
    does not exist, and for two columns of a quantity.

    `numbered` are the names with numbers for those that repeat, `skipped` those that are not read.
    """
    mapped = {column: quantity for quantity, column in columns.items()}
    for name in mapped:
        if name not in (numbered or names):
            listed = ", ".join(map(repr, names))
            raise BadFileError(
                f"line {line}: there is no column {name!r}, which columns names; there are {listed}"
            )
    known = dict[str, Column]()
    for place, name in enumerate(numbered or names):
        quantity, factor = quantity_of(mapped.get(name, name)) or ("", 1.0)
        if not quantity or name in skipped:
            continue
        same = known.get(quantity)
        if same and (name in mapped) == (same.name in mapped):
            way = ""
            if numbered and name in names[:place]:
                way = f"; say which with columns, like {quantity}: '{name}#2'"
            raise BadFileError(
                f"line {line}: names a column twice: {same.name!r} and {name!r}{way}"
            )
        if same is None or name in mapped:
            known[quantity] = Column(place, name, quantity, factor)
    return known


def _numbered(names: Sequence[str], mapped: Collection[str]) -> list[str]:
    """Return the names of columns, `name#2` for the second of a name, where the map names one of
    these.
    """
    repeated = {name if name in names else name.rpartition("#")[0] for name in mapped}
    count = Counter[str]()
    numbered = []
    for name in names:
        count[name] += 1
        is_numbered = name in repeated and count[name] > 1
        numbered.append(f"{name}#{count[name]}" if is_numbered else name)
    return numbered


#: The beginning of the note about columns that are not read.
UNREAD = "columns that are not read: "


def unread(names: Iterable[str], columns: Mapping[str, Column]) -> list[str]:
    """Return the names of columns that are not read."""
    read = {column.name for column in columns.values()}
    return [name for name in names if name and name not in read]


def unread_note(names: Iterable[str], columns: Mapping[str, Column]) -> tuple[str, ...]:
    """Return the note about columns that are not read, none where all are."""
    unread_names = unread(names, columns)
    listed = ", ".join(map(repr, unread_names[:6]))
    more = f" and {len(unread_names) - 6} more" if len(unread_names) > 6 else ""
    return (f"{UNREAD}{listed}{more}",) if unread_names else ()


#: Columns of the fire pixels that satellite services publish.
_FIRE_PIXELS = {"latitude", "longitude", "acq_date", "frp"}


def _require_states(known: Mapping[str, Column], names: Sequence[str], line: int) -> None:
    place = place_group(known)
    velocities = [group for group in VELOCITIES if not known.keys().isdisjoint(group)]
    if len(velocities) > 1:
        raise BadFileError(
            f"line {line}: has velocities in several axes; name those to read with columns"
        )
    if any(VELOCITIES[group] != celestial_frame(place) for group in velocities):
        raise BadFileError(
            f"line {line}: has positions and velocities along different axes; name those to read"
            " with columns"
        )
    needed = [TIME, *place, *(name for group in velocities for name in group)]
    if not known.keys().isdisjoint((DATE, *SCALES)):
        needed.remove(TIME)
    if ALTITUDE in known and "height" in needed:
        needed.remove("height")
    missing = [
        _joined(quantity, next(iter(UNITS[quantity])))
        for quantity in needed
        if quantity not in known
    ]
    unknown = unread(names, known)
    if missing and {name.casefold() for name in names} >= _FIRE_PIXELS:
        raise BadFileError(
            f"line {line}: these are places of fires, not a trajectory; fires are sources of a"
            " scene: sources: [{model: fires, csv: FILE}] with columns lat_deg and lon_deg"
        )
    if missing:
        more = f" and has unknown columns ({', '.join(map(repr, unknown[:6]))})" if unknown else ""
        raise BadFileError(
            f"line {line}: lacks the column{'s' if len(missing) > 1 else ''}"
            f" {', '.join(missing)}{more}{_proposal(names)}"
        )
    for name in unknown:
        # A name that is as like a known one as this is a slip of the pen.
        nearest = get_close_matches(name, _names_with_units(UNITS), n=1, cutoff=0.85)
        if nearest:
            raise BadFileError(
                f"line {line}: {name!r} is no column that is read; did you mean {nearest[0]}?"
            )


def place_group(quantities: Iterable[str]) -> tuple[str, ...]:
    """Return the quantities by which a table gives its places."""
    names = set(quantities)
    if names & {"lat", "lon"}:
        return GEODETIC
    groups = [group for group in PLACES if names & {*group} - {"height"}]
    return groups[0] if groups else ECEF


def celestial_frame(place: tuple[str, ...]) -> str:
    """Return the frame of a place along axes that do not turn with the Earth, "" for others."""
    return PLACES[place] if PLACES[place] in VELOCITIES.values() else ""


def _proposal(names: Sequence[str]) -> str:
    """Return the column map that the names suggest, for a message, or how to write one."""
    proposed: dict[str, str] = {}
    for name in names:
        words, unit = _words_of(name)
        quantity = next((known for pattern, known in _WORDS if re.search(pattern, words)), None)
        if quantity == TIME and unit not in TIMES:
            quantity = DATE if unit or re.search(r"utc|gregorian|date", words) else TIME
        if quantity == DATE and TIME in {
            known[0] for key in proposed if (known := quantity_of(key))
        }:
            continue
        if quantity is None or any(key.startswith(quantity) for key in proposed):
            continue
        units = UNITS[quantity]
        proposed[_joined(quantity, unit if unit in units else next(iter(units)))] = name
    kinds = {known[0] for key in proposed if (known := quantity_of(key))}
    if any(_INERTIAL.search(name.lower()) for name in names) and "lat" not in kinds:
        return (
            "; they seem to be along inertial axes: with dates, set columns: {x_eme2000_km: X, …}"
            " for those of J2000 (ICRF, GCRF) or {x_teme_km: X, …}; or export Earth-fixed states"
        )
    if {"lat", "lon"} <= kinds and "height" not in kinds:
        return "; it seems to have latitude and longitude, and no height: export that too"
    has_time = kinds & {TIME, DATE} or DATE in names
    if not (has_time and ({*ECEF} <= kinds or {*GEODETIC} <= kinds)):
        return (
            "; say what they are with columns, like columns: {time_s: T, lat: Latitude, lon:"
            " Longitude, height_m: H}"
        )
    listed = ", ".join(f'{key}: "{name}"' for key, name in proposed.items())
    return f"; if this is what they are, set columns: {{{listed}}}"


def _words_of(name: str) -> tuple[str, str]:
    """Return the words of a column's name and its unit, in brackets or at the end, as names have
    it; "" for none.
    """
    written = published("units")["written"]
    bare, unit = bare_name(name)
    words = re.sub(r"[^a-z0-9°/]+", " ", bare).strip()
    if unit:
        return words, written.get(unit, unit)
    for text in sorted({*written, *written.values()}, key=len, reverse=True):
        ending = f" {text.replace('_', ' ')}"
        if words.endswith(ending):
            return words.removesuffix(ending), written.get(text, text)
    return words, ""


def _joined(quantity: str, unit: str) -> str:
    return f"{quantity}_{unit}" if unit else quantity


def _names_with_units(units: Mapping[str, Units]) -> list[str]:
    return [_joined(quantity, unit) for quantity, factors in units.items() for unit in factors]
