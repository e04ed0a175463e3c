"""The satellites of a file of elements, or of a pattern, that the settings of a fleet choose."""

from collections import Counter
from collections.abc import Sequence

from opir_core.orbits import omm_complaint, omm_name
from opir_core.plugin import BadFileError, FileReader
from opir_readers.orbits.element_files import Elements
from opir_readers.orbits.fleet import FleetFilter, latest, reasons_text, satellites_of
from opir_readers.reading import content_of, file_text, reader_of


def satellites_of_file(
    path: str, fleet_filter: FleetFilter, epoch_us: int, readers: Sequence[FileReader]
) -> Sequence[Elements]:
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


def satellites_of_pattern(
    rows: Sequence[Elements], fleet_filter: FleetFilter
) -> Sequence[Elements]:
    """Return `id` and `orbit` of each satellite of a pattern. Raises `BadFileError` if none is
    left.
    """
    selected, _ = _selected(rows, fleet_filter)
    return list(satellites_of(selected))


def _selected(
    rows: Sequence[Elements], fleet_filter: FleetFilter
) -> tuple[Sequence[Elements], Sequence[Elements]]:
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


def _require_elements(rows: Sequence[Elements]) -> None:
    """Raise `BadFileError` with the first elements that have errors, by name: in the scene they
    have no line.
    """
    wrong = [(omm_name(row), words) for row in rows if (words := _complaint(row))]
    if wrong:
        more = f"; and {len(wrong) - 3} others" if len(wrong) > 3 else ""
        listed = "; ".join(f"the elements of {name}: {words}" for name, words in wrong[:3])
        raise BadFileError(f"{listed}{more}; mend them, or leave them out by name or numbers")


def _complaint(row: Elements) -> str | None:
    problem: str | None = row.get("PROBLEM")
    return problem or (None if "TLE_LINE1" in row else omm_complaint(row))
