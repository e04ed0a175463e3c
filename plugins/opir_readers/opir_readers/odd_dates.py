"""Times that count from a date, in a column that is named for another: days of a Julian date under
`mjd`, of a spreadsheet, of MATLAB, or milliseconds under `unix_time`.
"""

from collections.abc import Iterator

from opir_core.plugin import BadFileError
from opir_readers.columns import SCALES, unix_s_of_scale
from opir_readers.table_checks import moment_text

_DAY_S = 86_400.0

#: Scales: the name, seconds of a unit, Unix seconds of 0, and how a file gives them.
_SCALES = (
    ("Unix seconds", 1.0, 0.0, "name the column unix_time_s"),
    ("Unix milliseconds", 1e-3, 0.0, "name the column unix_time_ms"),
    ("Unix microseconds", 1e-6, 0.0, "divide them by 1000 and name the column unix_time_ms"),
    ("days of a Julian date", _DAY_S, SCALES["jd"], "name the column jd"),
    ("days of a modified Julian date", _DAY_S, SCALES["mjd"], "name the column mjd"),
    (
        "days of a spreadsheet",
        _DAY_S,
        -25_569.0 * _DAY_S,
        "add 15018 to them and name the column mjd",
    ),
    (
        "days of MATLAB",
        _DAY_S,
        -719_529.0 * _DAY_S,
        "subtract 678942 from them and name the column mjd",
    ),
)

#: Unix seconds of 1957 and 2100: there was no orbit before, and no scene is after.
_EARLIEST_S = -13 * 365.25 * _DAY_S
_LATEST_S = 4_102_444_800.0

#: Unix seconds of 2000 and 2050, between which most files are.
_USUAL_S = (946_684_800.0, 2_524_608_000.0)


def date_notes(scale: str, since_s: float, line: int) -> Iterator[str]:
    """Yield what the first time of a column that counts from a date, s, may be instead.

    Raises `BadFileError` where it is no date of the space age.
    """
    unix_s = unix_s_of_scale(scale, since_s)
    likely = [
        f"as {name} it is {moment_text(other_s)}: {way}"
        for name, unit_s, origin_s, way in _SCALES
        if _USUAL_S[0] <= (other_s := _raw(scale, since_s) * unit_s + origin_s) <= _USUAL_S[1]
        and abs(other_s - unix_s) > _DAY_S
    ]
    if not _EARLIEST_S <= unix_s <= _LATEST_S:
        ways = "; ".join(likely) or "is the column named for another scale?"
        raise BadFileError(
            f"line {line}: {scale} {_raw(scale, since_s):.12g} is {_year(unix_s)}; {ways}"
        )
    if not _USUAL_S[0] <= unix_s <= _USUAL_S[1] and likely:
        yield f"{scale} {_raw(scale, since_s):.12g} is {moment_text(unix_s)}; {'; '.join(likely)}"


def _raw(scale: str, since_s: float) -> float:
    """Return the number that a file has of a time since the date of a scale, s."""
    return since_s / _DAY_S if scale in ("mjd", "jd") else since_s


def _year(unix_s: float) -> str:
    return f"in the year {1970.0 + unix_s / (365.2425 * _DAY_S):.0f}"
