"""Lines of sight that a file has twice: they are one look, and the second is left out."""

from collections.abc import Iterator
from itertools import zip_longest

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
    """Return the rows without those that repeat the time, sensor and direction of one before."""
    first = dict[str, Row]()
    for row in rows:
        first.setdefault(_look(row), row)
    return list(first.values())


def repeats_text(rows: Rows, unique: Rows) -> Iterator[str]:
    """Yield how many rows were left out, and the first of them."""
    if len(rows) == len(unique):
        return
    repeat = next(row for row, other in zip_longest(rows, unique) if row is not other)
    first = next(row for row in rows if _look(row) == _look(repeat))
    yield (
        f"{place_of(repeat)}repeats {place_of(first).rstrip(': ') or 'another detection'}: time,"
        f" sensor and direction; {len(rows) - len(unique)} of"
        f" {number_of('detection', len(rows))} that repeat others are left out"
    )


def _look(row: Row) -> str:
    return repr([row.get(name) for name in _LOOK])
