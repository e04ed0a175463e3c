"""A fleet of sensors from elements: which satellites, and the sensors' blocks for a scene."""

import fnmatch
import json
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from attrs import frozen

from opir_core.orbits import omm_epoch, omm_name
from opir_core.plugin import BadFileError, FileReader
from opir_readers.orbits.element_files import (
    Elements,
    ElementSets,
    elements_complaints,
    number_of,
)
from opir_readers.published import published
from opir_readers.reading import content_of, file_text, reader_of


@frozen(kw_only=True)
class FleetFilter:
    """Which satellites of a file: by name (with * and ?), inclination, deg, numbers, and age at an
    epoch, days.
    """

    name: str | None = None
    inclination_deg: tuple[float, float] | None = None
    numbers: tuple[tuple[int, int], ...] = ()
    most_age_days: float | None = None
    epoch_s: float | None = None

    def left_out(self, row: Elements) -> str:
        """Return why a satellite is left out, "" if it is not."""
        name = omm_name(row).casefold()
        number = number_of(row)
        if self.name is not None and not fnmatch.fnmatchcase(name, self.name.casefold()):
            return "by name"
        if self.numbers and (
            number is None or not any(low <= number <= high for low, high in self.numbers)
        ):
            return "by number"
        if "PROBLEM" in row:
            return "with errors"
        if self.inclination_deg is not None and not self._has_inclination(row):
            return "by inclination"
        is_old = self.most_age_days is not None and self._age_days(row) > self.most_age_days
        return "by age" if is_old else ""

    def _has_inclination(self, row: Elements) -> bool:
        low, high = self.inclination_deg or (0.0, 180.0)
        try:
            return low <= float(row.get("INCLINATION", "nan")) <= high
        except (TypeError, ValueError):
            return False

    def _age_days(self, row: Elements) -> float:
        if self.epoch_s is None:
            raise BadFileError("a limit on the age of elements needs the scene's epoch")
        try:
            moment = omm_epoch(row.get("EPOCH"))
        except ValueError as error:
            raise BadFileError(f"the elements of {omm_name(row)}: EPOCH: {error}") from error
        return abs(self.epoch_s - moment.replace(tzinfo=UTC).timestamp()) / 86_400.0


def reasons_text(reasons: Counter[str]) -> str:
    """Return the reasons to leave satellites out, each with the number of them."""
    return ", ".join(f"{count} {reason}" for reason, count in reasons.items())


def range_of(text: str, kind: type[Any]) -> tuple[Any, Any]:
    """Return the range of `LOW:HIGH`, or of one number; raises `ValueError`.

    >>> range_of("5:9", int)
    (5, 9)
    """
    low, _, high = text.partition(":")
    return kind(low), kind(high or low)


def epoch_s_of(text: str) -> float:
    """Return Unix seconds of a date in UTC; raises `ValueError`."""
    moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def latest(rows: ElementSets) -> ElementSets:
    """Return the rows with the latest elements of each satellite: of equal numbers, of equal names
    without one.
    """
    newest: dict[Any, Elements] = {}
    for row in rows:
        number = number_of(row)
        key = omm_name(row) if number is None else number
        if key not in newest or str(row.get("EPOCH", "")) > str(newest[key].get("EPOCH", "")):
            newest[key] = row
    return list(newest.values())


def sensor_lines(rows: ElementSets, model: str) -> Iterator[str]:
    """Yield the lines of the `sensors:` block of a scene, one sensor a line."""
    yield "sensors:"
    for satellite in satellites_of(rows):
        yield f"  - {json.dumps({'model': model, **satellite}, ensure_ascii=False)}"


def satellites_of(rows: ElementSets) -> Iterator[Mapping[str, Any]]:
    """Yield `id` and `orbit` of each satellite, as a sensor's block has them."""
    taken: dict[str, int] = {}
    for row in rows:
        yield {"id": _id(row, taken), "orbit": row.get("orbit") or _orbit(row)}


def _orbit(row: Elements) -> Mapping[str, Any]:
    if "TLE_LINE1" in row:
        return {"tle": [row["TLE_LINE1"], row["TLE_LINE2"]]}
    elements = {
        name: value
        for name, value in row.items()
        if isinstance(value, str | int | float) and value != ""
        if re.fullmatch(r"[A-Z][A-Z0-9_]*", name)
    }
    return {"omm": elements}


def _id(row: Elements, taken: dict[str, int]) -> str:
    """Return an id that a scene takes, made of the name and, where that is taken, the number.

    A name in letters that have no Latin ones is left out, and the number counts. `taken` has the
    ids so far, each with the least count that may be free behind it.
    """
    written = omm_name(row)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", _in_latin(written)).strip("-._")[:48]
    number = number_of(row)
    if not name or (any(map(str.isalpha, written)) and not any(map(str.isalpha, name))):
        name = "SAT" if number is None else f"SAT-{number}"
    satellite_id = name if name not in taken or number is None else f"{name}-{number}"
    while satellite_id in taken:
        satellite_id = f"{name}-{taken[name]}"
        taken[name] += 1
    taken[satellite_id] = 2
    return satellite_id


def _in_latin(name: str) -> str:
    """Return a name with Latin letters for those of other alphabets, as far as they have some."""
    letters = published("letters")["letters"]
    bare = unicodedata.normalize("NFKD", name)
    small = {letter: letters.get(letter.lower(), letter) for letter in bare}
    latin = [small[letter].capitalize() if letter.isupper() else small[letter] for letter in bare]
    return "".join(latin).encode("ascii", "ignore").decode()


def satellites_of_file(
    path: str, fleet_filter: FleetFilter, epoch_us: int, readers: Sequence[FileReader]
) -> ElementSets:
    """Return `id` and `orbit` of each satellite; the latest elements of each. Raises
    `BadFileError`.
    """
    try:
        text = file_text(path).text
        reader = reader_of(text, [reader for reader in readers if reader.yields == "orbits"])
        rows = content_of(text, reader, {}, epoch_us)
        selected, wrong = _selected(rows, fleet_filter)
        _require_elements([*selected, *wrong])
    except BadFileError as error:
        raise BadFileError(f"{path}: {error}") from error
    return list(satellites_of(selected))


def satellites_of_pattern(rows: ElementSets, fleet_filter: FleetFilter) -> ElementSets:
    """Return `id` and `orbit` of each satellite of a pattern. Raises `BadFileError` if none is
    left.
    """
    selected, _ = _selected(rows, fleet_filter)
    return list(satellites_of(selected))


def _selected(rows: ElementSets, fleet_filter: FleetFilter) -> tuple[ElementSets, ElementSets]:
    """Return the rows that a filter leaves, the latest of each satellite, and those of them with
    errors.
    """
    by_reason: dict[str, list[Elements]] = {}
    for row in rows:
        by_reason.setdefault(fleet_filter.left_out(row), []).append(row)
    selected = latest(by_reason.get("", []))
    wrong = by_reason.get("with errors", [])
    if not selected and not wrong:
        reasons = Counter({reason: len(group) for reason, group in by_reason.items()})
        raise BadFileError(f"no satellite is left of {len(rows)}; left out {reasons_text(reasons)}")
    return selected, wrong


def _require_elements(rows: ElementSets) -> None:
    """Raise `BadFileError` with the first elements that have errors, by name: in the scene they
    have no line.
    """
    wrong = elements_complaints(rows)
    if wrong:
        more = f"; and {len(wrong) - 3} others" if len(wrong) > 3 else ""
        raise BadFileError(f"{'; '.join(wrong[:3])}{more}; {MEND_ELEMENTS}")


#: What to do with elements that a scene refuses.
MEND_ELEMENTS = "mend them, or leave them out by name or numbers"
