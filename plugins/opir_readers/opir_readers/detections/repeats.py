"""Lines of sight that stand in a file twice: they are one look, and the second is left out."""

from collections.abc import Iterator

from opir_core.errors import number_of
from opir_readers.detections.numbers import Row, Rows, place_of

#: The keys of a look and of the direction that it gave.
_LOOK = (
    "timestamp",
    "time_s",
    "sensor_id",
    "azimuth_deg",
    "elevation_deg",
    "right_ascension_deg",
    "declination_deg",
    "line_of_sight_ecef",
    "line_of_sight_eme2000",
)


def without_repeats(rows: Rows) -> Rows:
    """Return the rows, those that repeat the time, sensor and direction of another left out."""
    return list({_look(row): row for row in reversed(rows)}.values())[::-1]


def repeats_text(rows: Rows, unique: Rows) -> Iterator[str]:
    """Yield how many rows were left out, and the first of them."""
    count = len(rows) - len(unique)
    if count:
        first, row = _first_repeat(rows)
        yield (
            f"{place_of(row)}repeats {place_of(first).rstrip(': ') or 'another detection'}: time,"
            f" sensor and direction; {count} of {number_of('detection', len(rows))} that repeat"
            " others are left out"
        )


def _first_repeat(rows: Rows) -> tuple[Row, Row]:
    rows_by_look = dict[str, Row]()
    for row in rows:
        look = _look(row)
        if look in rows_by_look:
            return rows_by_look[look], row
        rows_by_look[look] = row
    raise ValueError("no row repeats another")


def _look(row: Row) -> str:
    return repr([row.get(name) for name in _LOOK])
