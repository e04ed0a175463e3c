"""Columns of tables: which quantity and unit each one holds, by its own name or by the user's map.

A name is a quantity with its unit, `x_ecef_km`; without a unit it is that of the first in the list.
A map says the same of columns with other names: `{lat: "Latitude (°)", height_ft: ALT}`.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches

from attrs import frozen

from opir_core.plugin import BadFileError
from opir_readers.time_systems import utc_s

#: Units, by what follows an underscore in a name, in SI units and radians.
TIMES = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
LENGTHS = {"m": 1.0, "km": 1e3, "ft": 0.3048, "nmi": 1852.0}
_SPEED = {"m_s": 1.0, "km_s": 1e3, "ft_s": 0.3048, "km_h": 1.0 / 3.6, "kn": 1852.0 / 3600.0}
ANGLES = {"deg": math.pi / 180.0, "rad": 1.0}

#: How a state may give its place, and its velocity: the quantities, which come together.
PLACES = (
    ("x_ecef", "y_ecef", "z_ecef"),
    ("lat", "lon", "height"),
    ("east", "north", "up"),
    ("downrange", "height"),
    ("x_eme2000", "y_eme2000", "z_eme2000"),
    ("x_teme", "y_teme", "z_teme"),
)
#: The frames of places along axes that do not turn with the Earth.
CELESTIAL: Mapping[tuple[str, ...], str] = {PLACES[4]: "EME2000", PLACES[5]: "TEME"}
#: A height above the launch point, in place of `height`.
ALTITUDE = "altitude"
VELOCITIES = (
    ("vx_ecef", "vy_ecef", "vz_ecef"),
    ("vx_inertial", "vy_inertial", "vz_inertial"),
    ("v_east", "v_north", "v_up"),
    ("vx_eme2000", "vy_eme2000", "vz_eme2000"),
    ("vx_teme", "vy_teme", "vz_teme"),
)
CELESTIAL_RATES: Mapping[tuple[str, ...], str] = dict(
    zip(VELOCITIES[3:], CELESTIAL.values(), strict=True)
)
TIME = "time"
BURNING = "is_burning"
#: The time as a date, in place of seconds, and other names of such columns, in lower case.
DATE = "timestamp"
#: Times that count from a date, and that date, s of Unix time.
SCALES = {
    "unix_time": 0.0,
    "gps_time": 315_964_800.0,
    "mjd": -40_587.0 * 86_400.0,
    "jd": -2_440_587.5 * 86_400.0,
}
_DATES = ("timestamp", "time_utc", "utc", "utc_time", "datetime", "date", "epoch", "utcgregorian")

#: Times that count from a date: their units.
SCALE_UNITS = {"unix_time": TIMES, "gps_time": TIMES, "mjd": {"": 86_400.0}, "jd": {"": 86_400.0}}

#: The units of each quantity, the first of them where none is named: SI units and radians in one
#: unit.
UNITS: Mapping[str, Mapping[str, float]] = {
    TIME: TIMES,
    **dict.fromkeys((*PLACES[0], *PLACES[4], *PLACES[5]), LENGTHS),
    "lat": ANGLES,
    "lon": ANGLES,
    **dict.fromkeys(("height", ALTITUDE, "east", "north", "up", "downrange"), LENGTHS),
    **dict.fromkeys((name for group in VELOCITIES for name in group), _SPEED),
    BURNING: {"": 1.0},
    DATE: {"": 1.0},
    **SCALE_UNITS,
}

#: How like a known name an unknown one must be to be taken for a slip of the pen.
_SLIP = 0.85

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
#: How tables write units, in lower case, and what names have for them.
WRITTEN_UNITS = {
    "°": "deg",
    "degrees": "deg",
    "degree": "deg",
    "deg": "deg",
    "rad": "rad",
    "arcsec": "arcsec",
    "mrad": "mrad",
    "urad": "urad",
    "µrad": "urad",
    "s": "s",
    "sec": "s",
    "seconds": "s",
    "ms": "ms",
    "h": "h",
    "hours": "h",
    "min": "min",
    "m": "m",
    "meters": "m",
    "metres": "m",
    "km": "km",
    "ft": "ft",
    "feet": "ft",
    "m/s": "m_s",
    "m/sec": "m_s",
    "km/s": "km_s",
    "km/sec": "km_s",
    "nmi": "nmi",
    "ft/s": "ft_s",
    "ft/sec": "ft_s",
    "kn": "kn",
    "km/h": "km_h",
}


_WITH_UNIT = re.compile(r"(.*?)\s*[(\[]\s*([^)\]]*?)\s*[)\]]")


@frozen
class Column:
    """A column that is read: its place in a line, its name there, its quantity, and its unit in SI
    units or radians.
    """

    place: int
    name: str
    quantity: str
    factor: float


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
    return f"{bare}_{WRITTEN_UNITS[unit]}" if unit in WRITTEN_UNITS else ""


def bare_name(name: str) -> tuple[str, str]:
    """Return a name in lower case without its unit in brackets, and that unit."""
    match = _WITH_UNIT.fullmatch(name.strip().lower())
    return (match[1], match[2]) if match else (name.strip().lower(), "")


def unix_s_of_scale(scale: str, since_s: float) -> float:
    """Return seconds of UTC since 1970 of a time that counts from the date of a scale."""
    since = since_s + SCALES[scale]
    return utc_s(since, "GPS") if scale == "gps_time" else since


def unit_of(name: str, known: Mapping[str, Mapping[str, float]]) -> tuple[str, float] | None:
    """Return the quantity of a name, of those `known` with their units, and its unit; None for
    none.

    >>> unit_of("height_km", UNITS)
    ('height', 1000.0)
    """
    for quantity, units in known.items():
        if name == quantity:
            return quantity, next(iter(units.values()))
        if name.startswith(f"{quantity}_") and name[len(quantity) + 1 :] in units:
            return quantity, units[name[len(quantity) + 1 :]]
    return None


def map_complaint(columns: Mapping[str, str] | None) -> str | None:
    """Return the first error in the quantities of a column map, or None."""
    for name in columns or ():
        if quantity_of(name) is None:
            near = get_close_matches(name, _all_names(), n=1)
            hint = f"did you mean {near[0]}?" if near else f"quantities are {', '.join(UNITS)}"
            return f"{name} is no quantity with its unit; {hint}"
    return None


def columns_of(names: Sequence[str], line: int, given: Mapping[str, str]) -> dict[str, Column]:
    """Return the columns that are read, by quantity; raises `BadFileError` where they do not make
    states.

    `given` maps quantities with units to names of columns; others are known by their own names.
    `line` is that of the names.
    """
    found: dict[str, Column] = {}
    mapped = {own: wanted for wanted, own in given.items()}
    numbered = _numbered(names, mapped)
    lost = [own for own in mapped if own not in numbered]
    if lost:
        listed = ", ".join(map(repr, names))
        raise BadFileError(
            f"line {line}: there is no column {lost[0]!r}, which columns names; there are {listed}"
        )
    for place, name in enumerate(numbered):
        known = quantity_of(mapped.get(name, name))
        if known is None:
            continue
        if known[0] in found and (name in mapped) == (found[known[0]].name in mapped):
            way = (
                f"; say which with columns, like {known[0]}: '{name}#2'"
                if name in names[:place]
                else ""
            )
            raise BadFileError(
                f"line {line}: names a column twice: {found[known[0]].name!r} and {name!r}{way}"
            )
        if known[0] not in found or name in mapped:
            found[known[0]] = Column(place, name, *known)
    _require_states(found, names, line)
    return found


def _numbered(names: Sequence[str], mapped: Iterable[str]) -> list[str]:
    """Return the names of columns, `name#2` for the second of a name, where the map names one of
    these.
    """
    chosen = {own.rpartition("#")[0] for own in mapped if own not in names} | {
        own for own in mapped if own in names
    }
    count: dict[str, int] = {}
    found = []
    for name in names:
        count[name] = count.get(name, 0) + 1
        found.append(f"{name}#{count[name]}" if name in chosen and count[name] > 1 else name)
    return found


def unread(names: Iterable[str], columns: Mapping[str, Column]) -> list[str]:
    """Return the names of columns that are not read."""
    read = {column.name for column in columns.values()}
    return [name for name in names if name and name not in read]


def _require_states(found: dict[str, Column], names: Sequence[str], line: int) -> None:
    groups = [place_group(found)]
    groups += [group for group in VELOCITIES if any(name in found for name in group)]
    if len(groups) > 2:
        raise BadFileError(
            f"line {line}: has velocities in several axes; name those to read with columns"
        )
    frames = [CELESTIAL.get(groups[0]), *(CELESTIAL_RATES.get(group) for group in groups[1:])]
    if len(set(frames)) > 1:
        raise BadFileError(
            f"line {line}: has positions and velocities along different axes; name those to read"
            f" with columns"
        )
    needed = (TIME, *(name for group in groups for name in group))
    instead = [("height", ALTITUDE), *((TIME, date) for date in (DATE, *SCALES))]
    stood_for = {quantity for quantity, other in instead if other in found}
    missing = [
        quantity for quantity in needed if quantity not in found and quantity not in stood_for
    ]
    unknown = unread(names, found)
    slips = {
        name: near
        for name in unknown
        if (near := get_close_matches(name, _all_names(), n=1, cutoff=_SLIP))
    }
    if missing:
        is_most = len(missing) > 1
        others = (
            f" and has unknown columns ({', '.join(map(repr, unknown[:6]))})" if unknown else ""
        )
        wanted = ", ".join(map(_with_unit, missing))
        raise BadFileError(
            f"line {line}: lacks the column{'s' if is_most else ''}"
            f" {wanted}{others}{_proposal(names)}"
        )
    for name, near in slips.items():
        if name not in (column.name for column in found.values()):
            raise BadFileError(
                f"line {line}: {name!r} is no column that is read; did you mean {near[0]}?"
            )


def place_group(found: Iterable[str]) -> tuple[str, ...]:
    """Return the quantities by which a table gives its places."""
    names = set(found)
    if names & {"lat", "lon"}:
        return PLACES[1]
    if not names & set(PLACES[0]):
        return next((group for group in PLACES[2:] if names & {*group} - {"height"}), PLACES[0])
    return PLACES[0]


def _proposal(names: Sequence[str]) -> str:
    """Return the column map that the names suggest, for a message, or how to write one."""
    taken: dict[str, str] = {}
    for name in names:
        words, unit = _words_of(name)
        quantity = next((own for pattern, own in _WORDS if re.search(pattern, words)), None)
        if quantity == TIME and unit not in TIMES:
            quantity = DATE if unit or re.search(r"utc|gregorian|date", words) else TIME
        if quantity is None or any(key.startswith(quantity) for key in taken):
            continue
        units = UNITS[quantity]
        taken["_".join(filter(None, [quantity, unit if unit in units else next(iter(units))]))] = (
            name
        )
    kinds = {quantity_of(key)[0] for key in taken}  # type: ignore[index]
    if any(_INERTIAL.search(name.lower()) for name in names) and "lat" not in kinds:
        return (
            "; they seem to be along inertial axes: with dates, set columns: {x_eme2000_km: X, …}"
            " for those of J2000 (ICRF, GCRF) or {x_teme_km: X, …}; or export Earth-fixed states"
        )
    if {"lat", "lon"} <= kinds and "height" not in kinds:
        return "; it seems to have latitude and longitude, and no height: export that too"
    has_time = kinds & {TIME, DATE} or DATE in names
    if not any(set(group) <= kinds for group in PLACES[:2]) or not has_time:
        return (
            "; say what they are with columns, like columns: {time_s: T, lat: Latitude, lon:"
            " Longitude, height_m: H}"
        )
    listed = ", ".join(f'{key}: "{name}"' for key, name in taken.items())
    return f"; if this is what they are, set columns: {{{listed}}}"


def _words_of(name: str) -> tuple[str, str]:
    """Return the words of a column's name and its unit, in brackets or at the end, as names have
    it; "" for none.
    """
    bare, unit = bare_name(name)
    words = re.sub(r"[^a-z0-9°/]+", " ", bare).strip()
    if unit:
        return words, WRITTEN_UNITS.get(unit, unit)
    for written in sorted({*WRITTEN_UNITS, *WRITTEN_UNITS.values()}, key=len, reverse=True):
        ending = f" {written.replace('_', ' ')}"
        if words.endswith(ending):
            return words.removesuffix(ending), WRITTEN_UNITS.get(written, written)
    return words, ""


def _with_unit(quantity: str) -> str:
    unit = next(iter(UNITS[quantity]))
    return f"{quantity}_{unit}" if unit else quantity


def _all_names() -> list[str]:
    return [
        f"{quantity}_{unit}" if unit else quantity
        for quantity, units in UNITS.items()
        for unit in units
    ]
