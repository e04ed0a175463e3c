"""Mean elements as they are published: OMM as JSON, CSV, KVN and XML, and two-line elements with or
without names.

Each becomes a mapping by the keywords of an OMM. Of two-line elements it has the lines too
(`TLE_LINE1`, `TLE_LINE2`); `NOTES` are what of them was mended: 68 columns get their checksum, what
follows column 69 is left out; `PROBLEM` is why a set among others cannot be used.
"""

import csv
import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from opir_core.orbits import tle_complaint
from opir_core.plugin import BadFileError
from opir_readers.xml_nodes import root_name, xml_root

Elements = Mapping[str, Any]

_NEEDED = ("MEAN_MOTION", "ECCENTRICITY", "INCLINATION")
_FIRST = re.compile(r"1 [ \dA-Z][ \d]{4}")
_SECOND = re.compile(r"2 [ \dA-Z][ \d]{4}")
_COLUMNS = 69


def is_omm(text: str) -> bool:
    """Return whether a text holds Orbit Mean-Elements Messages, in any of their four forms."""
    head = text[:4000].lstrip("\ufeff \t\r\n")
    if head[:1] in ("{", "["):
        return '"MEAN_MOTION"' in head and '"ECCENTRICITY"' in head
    if head[:1] == "<":
        return root_name(text) in ("omm", "ndm") and "<meanElements" in text
    first = head.partition("\n")[0].upper()
    names = {name.strip().strip('"') for name in first.split(",")}
    return "CCSDS_OMM_VERS" in head[:400] or set(_NEEDED) <= names


def is_tle(text: str) -> bool:
    """Return whether a text holds two-line elements, with or without lines of names."""
    lines = [line for line in text[:4000].split("\n") if line.strip() and not line.startswith("#")][
        :3
    ]
    pairs = [(lines[k], lines[k + 1]) for k in range(len(lines) - 1)]
    return any(_FIRST.match(first) and _SECOND.match(second) for first, second in pairs[:2])


def omm_elements(text: str) -> Sequence[Elements]:
    """Return the messages of a text; raises `BadFileError`."""
    head = text.lstrip("\ufeff \t\r\n")
    if head[:1] in ("{", "["):
        found = _of_json(text)
    elif head[:1] == "<":
        found = _of_xml(text)
    elif "CCSDS_OMM_VERS" in head[:400]:
        found = _of_kvn(text)
    else:
        found = _of_csv(text)
    if not found:
        raise BadFileError("holds no OMM")
    return [
        {**each, "NORAD_CAT_ID": number_of(each)} if number_of(each) is not None else each
        for each in found
    ]


def number_of(elements: Elements) -> int | None:
    """Return the catalogue number of elements as a number, None where they have none.

    >>> number_of({"NORAD_CAT_ID": "00005"})
    5
    """
    value = elements.get("NORAD_CAT_ID")
    if isinstance(value, bool) or value is None:
        return None
    try:
        return int(str(value).strip())
    except ValueError:
        return _alpha_number(str(value).strip())


def _alpha_number(text: str) -> int | None:
    """Return the number of an Alpha-5 text, `A0001` for 100 001; the letters I and O are not
    used.
    """
    letters = "ABCDEFGHJKLMNPQRSTUVWXYZ"
    if len(text) == 5 and text[0] in letters and text[1:].isascii() and text[1:].isdigit():
        return (letters.index(text[0]) + 10) * 10_000 + int(text[1:])
    return None


def _of_json(text: str) -> list[Elements]:
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise BadFileError(f"line {error.lineno}: is not JSON: {error.msg}") from error
    except (RecursionError, ValueError) as error:
        raise BadFileError(f"is not JSON that can be read: {error}") from error
    return [
        each for each in (value if isinstance(value, list) else [value]) if isinstance(each, dict)
    ]


def _of_csv(text: str) -> list[Elements]:
    reader = csv.DictReader(io.StringIO(text.lstrip("\ufeff")))
    try:
        rows = [row for row in reader if any(row.values())]
    except csv.Error as error:
        raise BadFileError(f"line {reader.line_num}: not CSV: {error}") from error
    for number, row in enumerate(rows, 2):
        if None in row or None in row.values():
            raise BadFileError(f"line {number}: has another number of values than line 1 has names")
    return [
        {str(name).strip().upper(): str(value).strip() for name, value in row.items()}
        for row in rows
    ]


def _of_kvn(text: str) -> list[Elements]:
    found: list[dict[str, Any]] = []
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.split()[0] == "COMMENT":
            continue
        key, equals, value = (part.strip() for part in line.partition("="))
        if not equals:
            raise BadFileError(
                f"line {number}: {line.strip()[:60]!r} is not of the form KEYWORD = value"
            )
        if key == "CCSDS_OMM_VERS" or not found:
            found.append({})
        # Units may follow a value: INCLINATION = 51.6 [deg].
        found[-1][key] = re.sub(r"\s*\[[^\]]*\]$", "", value)
    return [dict(each) for each in found]


def _of_xml(text: str) -> list[Elements]:
    root = xml_root(text)
    messages = [root] if root.name == "omm" else list(root.all("omm"))
    found = []
    for message in messages:
        for segment in message.all("segment"):
            blocks = [
                block
                for name in ("metadata", "meanElements", "tleParameters")
                for block in segment.all(name)
            ]
            found.append(
                {
                    node.name: node.text
                    for block in blocks
                    for node in block.children
                    if node.name != "COMMENT"
                }
            )
    return [each for each in found if each]


def tle_elements(text: str) -> Sequence[Elements]:
    """Return the element sets of a text; raises `BadFileError` with the line that is none."""
    found = list(_sets(text))
    if not found:
        raise BadFileError("holds no two-line elements")
    if all("PROBLEM" in each for each in found):
        raise BadFileError(found[0]["PROBLEM"])
    return found


def _sets(text: str) -> Iterator[Elements]:
    lines = [(number, line.rstrip()) for number, line in enumerate(text.split("\n"), 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    name = ""
    place = 0
    while place < len(lines):
        number, line = lines[place]
        if not _FIRST.match(line):
            name = line.removeprefix("0 ").strip()
            if place + 1 == len(lines) or not _FIRST.match(lines[place + 1][1]):
                raise BadFileError(
                    f"line {number}: {line[:40]!r} is neither elements nor a name above them"
                )
            place += 1
            continue
        if place + 1 == len(lines) or not _SECOND.match(lines[place + 1][1]):
            raise BadFileError(
                f"line {number}: the first line of elements has no second one below it"
            )
        yield _set(name, (number, line), lines[place + 1])
        name = ""
        place = place + 2


def _set(name: str, first: tuple[int, str], second: tuple[int, str]) -> Elements:
    notes = list[str]()
    pair = _mended(*first, notes), _mended(*second, notes)
    complaint = tle_complaint(pair)
    number = number_of({"NORAD_CAT_ID": pair[0][2:7]})
    if complaint:
        own = {} if number is None else {"NORAD_CAT_ID": number}
        problem = f"lines {first[0]} and {second[0]}: {complaint}"
        return {"OBJECT_NAME": name or f"object {pair[0][2:7].strip()}", **own, "PROBLEM": problem}
    return {
        "OBJECT_NAME": name or f"object {pair[0][2:7].strip()}",
        "OBJECT_ID": pair[0][9:17].strip(),
        **({} if number is None else {"NORAD_CAT_ID": number}),
        "INCLINATION": float(pair[1][8:16]),
        "MEAN_MOTION": float(pair[1][52:63]),
        "ECCENTRICITY": float(f"0.{pair[1][26:33].strip()}"),
        "EPOCH": _epoch_text(pair[0][18:32]),
        "TLE_LINE1": pair[0],
        "TLE_LINE2": pair[1],
        **({"NOTES": notes} if notes else {}),
    }


def _mended(number: int, line: str, notes: list[str]) -> str:
    """Return a line of 69 columns, where only its checksum lacks or something follows it."""
    if len(line) == _COLUMNS - 1:
        notes.append(f"line {number} has 68 columns: its checksum was added")
        digits = sum(int(c) if c.isdigit() else c == "-" for c in line if c.isascii())
        return f"{line}{digits % 10}"
    if len(line) > _COLUMNS:
        notes.append(f"line {number}: {line[_COLUMNS:].strip()[:30]!r} after column 69 is left out")
    return line[:_COLUMNS]


def _epoch_text(text: str) -> str:
    """Return the epoch of a TLE as a date: the year's last two digits, 57 to 99 of the last
    century, and its day.
    """
    from datetime import datetime, timedelta

    year = int(text[:2])
    day = float(text[2:])
    start = datetime(year + (1900 if year >= 57 else 2000), 1, 1)
    return (start + timedelta(days=day - 1.0)).isoformat()
