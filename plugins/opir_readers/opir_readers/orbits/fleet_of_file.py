"""The satellites of a file of elements that the settings of a fleet choose."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.orbits import omm_complaint, omm_name
from opir_core.plugin import BadFileError, FileReader
from opir_readers.orbits.fleet import FleetFilter, latest, satellites_of
from opir_readers.orbits.fleet_config import FleetConfig, ranges_of
from opir_readers.reading import content_of, file_text, reader_of


def satellites_of_file(
    config: FleetConfig, epoch_us: int | None, readers: Sequence[FileReader]
) -> Sequence[Mapping[str, Any]]:
    """Return `id` and `orbit` of each satellite; the latest elements of each. Raises `BadFileError`.

    Without an epoch no elements are too old.
    """
    try:
        text = file_text(config.file).text
        reader = reader_of(text, [each for each in readers if each.yields == "orbits"])
        rows = content_of(text, reader, {}, epoch_us or 0)
        filter_ = _filter(config, epoch_us)
        why = Counter(filter_.left_out(row) for row in rows)
        kept = latest([row for row in rows if not filter_.left_out(row)])
        if not kept and "with errors" not in why:
            left = ", ".join(f"{count} {reason}" for reason, count in why.items() if reason)
            raise BadFileError(f"no satellite is left of {len(rows)}; left out {left}")
        _require_elements([*kept, *(row for row in rows if filter_.left_out(row) == "with errors")])
    except BadFileError as error:
        raise BadFileError(f"{config.file}: {error}") from error
    return list(satellites_of(kept))


def _filter(config: FleetConfig, epoch_us: int | None) -> FleetFilter:
    return FleetFilter(
        name=config.name,
        inclination_deg=(config.min_inclination_deg, config.max_inclination_deg),
        numbers=ranges_of(config.numbers) if config.numbers else (),
        most_age_days=None if epoch_us is None else config.max_age_days,
        epoch_s=(epoch_us or 0) * 1e-6,
    )


def _require_elements(rows: Sequence[Mapping[str, Any]]) -> None:
    """Raise `BadFileError` with the first elements that have errors, by name: in the scene they have no line."""
    wrong = [(omm_name(row), words) for row in rows if (words := _complaint(row))]
    if wrong:
        more = f"; and {len(wrong) - 3} others" if len(wrong) > 3 else ""
        listed = "; ".join(f"the elements of {name}: {words}" for name, words in wrong[:3])
        raise BadFileError(f"{listed}{more}; mend them, or leave them out by name or numbers")


def _complaint(row: Mapping[str, Any]) -> str | None:
    problem: str | None = row.get("PROBLEM")
    return problem or (None if "TLE_LINE1" in row else omm_complaint(row))
