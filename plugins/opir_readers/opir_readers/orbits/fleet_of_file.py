"""The satellites of a file of elements, or of a pattern, that the settings of a fleet choose."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.orbits import omm_complaint, omm_name
from opir_core.plugin import BadFileError, FileReader
from opir_readers.orbits.fleet import FleetFilter, latest, satellites_of
from opir_readers.reading import content_of, file_text, reader_of


def satellites_of_file(
    path: str, chosen: FleetFilter, epoch_us: int, readers: Sequence[FileReader]
) -> Sequence[Mapping[str, Any]]:
    """Return `id` and `orbit` of each satellite; the latest elements of each. Raises
    `BadFileError`.
    """
    try:
        text = file_text(path).text
        reader = reader_of(text, [each for each in readers if each.yields == "orbits"])
        rows = content_of(text, reader, {}, epoch_us)
        kept, wrong = _chosen(rows, chosen)
        _require_elements([*kept, *wrong])
    except BadFileError as error:
        raise BadFileError(f"{path}: {error}") from error
    return list(satellites_of(kept))


def satellites_of_pattern(
    rows: Sequence[Mapping[str, Any]], chosen: FleetFilter
) -> Sequence[Mapping[str, Any]]:
    """Return `id` and `orbit` of each satellite of a pattern. Raises `BadFileError` if none is
    left.
    """
    kept, _ = _chosen(rows, chosen)
    return list(satellites_of(kept))


def _chosen(rows: Sequence[Mapping[str, Any]], chosen: FleetFilter) -> tuple[list[Any], list[Any]]:
    """Return the rows that a filter leaves, the latest of each satellite, and those of them with
    errors.
    """
    why = [chosen.left_out(row) for row in rows]
    kept = latest([row for row, reason in zip(rows, why, strict=True) if not reason])
    wrong = [row for row, reason in zip(rows, why, strict=True) if reason == "with errors"]
    if not kept and not wrong:
        left = ", ".join(f"{count} {reason}" for reason, count in Counter(why).items())
        raise BadFileError(f"no satellite is left of {len(rows)}; left out {left}")
    return list(kept), wrong


def _require_elements(rows: Sequence[Mapping[str, Any]]) -> None:
    """Raise `BadFileError` with the first elements that have errors, by name: in the scene they
    have no line.
    """
    wrong = [(omm_name(row), words) for row in rows if (words := _complaint(row))]
    if wrong:
        more = f"; and {len(wrong) - 3} others" if len(wrong) > 3 else ""
        listed = "; ".join(f"the elements of {name}: {words}" for name, words in wrong[:3])
        raise BadFileError(f"{listed}{more}; mend them, or leave them out by name or numbers")


def _complaint(row: Mapping[str, Any]) -> str | None:
    problem: str | None = row.get("PROBLEM")
    return problem or (None if "TLE_LINE1" in row else omm_complaint(row))
