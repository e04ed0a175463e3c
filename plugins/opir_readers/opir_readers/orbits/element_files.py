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
from itertools import pairwise
from typing import Any

from opir_core.orbits import omm_complaint, omm_name, tle_complaint
from opir_core.plugin import BadFileError
from opir_readers.xml_nodes import XmlNode, root_name, xml_root

#: The elements of a satellite by the keywords of an OMM.
Elements = Mapping[str, Any]
ElementSets = Sequence[Elements]

_NEEDED = ("MEAN_MOTION", "ECCENTRICITY", "INCLINATION")
_LINE_1 = re.compile(r"1 [ \dA-Z][ \d]{4}")
_LINE_2 = re.compile(r"2 [ \dA-Z][ \d]{4}")
_COLUMNS = 69


def is_omm(text: str) -> bool:
    """Whether a text holds Orbit Mean-Elements Messages, in any of their four forms."""
    head = _head(text[:4000])
    if head[:1] in ("{", "["):
        return '"MEAN_MOTION"' in head and '"ECCENTRICITY"' in head
    if head[:1] == "<":
        return root_name(text) in ("omm", "ndm") and "<meanElements" in text
    names = {name.strip().strip('"') for name in head.partition("\n")[0].upper().split(",")}
    return "CCSDS_OMM_VERS" in head[:400] or set(_NEEDED) <= names


def _head(text: str) -> str:
    return text.lstrip("\ufeff \t\r\n")


def is_tle(text: str) -> bool:
    """Whether a text holds two-line elements, with or without lines of names."""
    lines = [line for line in text[:4000].split("\n") if line.strip() and not line.startswith("#")]
    pairs = [pair for pair in pairwise(lines) if _LINE_1.match(pair[0]) and _LINE_2.match(pair[1])]
    # In a bulletin, between other lines, both have the width of elements.
    return any(pair == (*lines[:2],) or pair == (*lines[1:3],) for pair in pairs) or any(
        min(map(len, pair)) >= _COLUMNS - 1 for pair in pairs
    )


def omm_elements(text: str) -> ElementSets:
    """Return the messages of a text; raises `BadFileError`."""
    head = _head(text)
    if head[:1] in ("{", "["):
        messages = _of_json(text)
    elif head[:1] == "<":
        messages = _of_xml(text)
    elif "CCSDS_OMM_VERS" in head[:400]:
        messages = _of_kvn(text)
    else:
        messages = _of_csv(text)
    if not messages:
        raise BadFileError("holds no OMM")
    numbers = map(number_of, messages)
    return [
        message if number is None else {**message, "NORAD_CAT_ID": number}
        for message, number in zip(messages, numbers, strict=True)
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
    items = value if isinstance(value, list) else [value]
    return [item for item in items if isinstance(item, dict)]


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
    messages = list[dict[str, Any]]()
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.split()[0] == "COMMENT":
            continue
        key, equals, value = (word.strip() for word in line.partition("="))
        if not equals:
            raise BadFileError(
                f"line {number}: {line.strip()[:60]!r} is not of the form KEYWORD = value"
            )
        if key == "CCSDS_OMM_VERS" or not messages:
            messages.append({})
        # Units may follow a value: INCLINATION = 51.6 [deg].
        messages[-1][key] = re.sub(r"\s*\[[^\]]*\]$", "", value)
    return list(messages)


def _of_xml(text: str) -> list[Elements]:
    root = xml_root(text)
    messages = [root] if root.name == "omm" else list(root.all("omm"))
    segments = (segment for message in messages for segment in message.all("segment"))
    return [elements for segment in segments if (elements := _of_segment(segment))]


def _of_segment(segment: XmlNode) -> Elements:
    elements = dict[str, str]()
    for name in ("metadata", "meanElements", "tleParameters"):
        for block in segment.all(name):
            elements |= block.texts()
    return elements


def tle_elements(text: str) -> ElementSets:
    """Return the element sets of a text; raises `BadFileError` with the line that is none."""
    sets = list(_sets(text))
    if not sets:
        raise BadFileError("holds no two-line elements")
    if all("PROBLEM" in elements for elements in sets):
        raise BadFileError(sets[0]["PROBLEM"])
    return sets


def _sets(text: str) -> Iterator[Elements]:
    lines = [(number, line.rstrip()) for number, line in enumerate(text.split("\n"), 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    name = ""
    place = 0
    others = list[str]()
    while place < len(lines):
        number, line = lines[place]
        following = lines[place + 1 : place + 2]
        if not _LINE_1.match(line):
            name = line.removeprefix("0 ").strip()
            if not following or not _LINE_1.match(following[0][1]):
                others.append(
                    f"line {number}, {line[:40]!r}, is left out: no elements or their name"
                )
            place += 1
            continue
        if not following or not _LINE_2.match(following[0][1]):
            raise BadFileError(
                f"line {number}: the first line of elements has no second one below it"
            )
        elements = _set(name, (number, line), following[0])
        notes = [*elements.get("NOTES", ()), *others]
        yield {**elements, "NOTES": notes} if notes else elements
        others = []
        name = ""
        place += 2


def _set(name: str, numbered_1: tuple[int, str], numbered_2: tuple[int, str]) -> Elements:
    """Return the elements of two lines, with their numbers."""
    notes = list[str]()
    line_1 = _mended(*numbered_1, notes)
    line_2 = _mended(*numbered_2, notes)
    elements: dict[str, Any] = {"OBJECT_NAME": name or f"object {line_1[2:7].strip()}"}
    number = number_of({"NORAD_CAT_ID": line_1[2:7]})
    complaint = tle_complaint((line_1, line_2))
    if not complaint:
        elements["OBJECT_ID"] = line_1[9:17].strip()
    if number is not None:
        elements["NORAD_CAT_ID"] = number
    if complaint:
        problem = f"lines {numbered_1[0]} and {numbered_2[0]}: {complaint}; copy them anew"
        return {**elements, "PROBLEM": problem}
    elements |= {
        "INCLINATION": float(line_2[8:16]),
        "MEAN_MOTION": float(line_2[52:63]),
        "ECCENTRICITY": float(f"0.{line_2[26:33].strip()}"),
        "EPOCH": _epoch_text(line_1[18:32]),
        "TLE_LINE1": line_1,
        "TLE_LINE2": line_2,
    }
    return {**elements, "NOTES": notes} if notes else elements


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


def elements_complaints(rows: ElementSets) -> list[str]:
    """Return the errors in elements, with the name of each satellite that has some."""
    return [
        f"the elements of {omm_name(row)}: {words}" for row in rows if (words := _complaint(row))
    ]


def _complaint(row: Elements) -> str | None:
    problem: str | None = row.get("PROBLEM")
    return problem or (None if "TLE_LINE1" in row else omm_complaint(row))
