"""The query parameters of requests as msgspec Structs, which read and describe them."""

import re
from typing import Annotated, Any, Literal, TypeVar
from urllib.parse import parse_qsl

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from opir_core.plugin import REPORTED_TYPES
from opir_core.reading import epoch_us_of_text
from opir_http.problems import ProblemError
from opir_http.settings import MAXIMUM_PAGE

#: UTC times, 1970 to 2099; a day beyond its month is rejected too.
_UTC_TIME = (
    r"^(19[789][0-9]|20[0-9]{2})-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])"
    r"T([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9](\.[0-9]{1,6})?Z$"
)
_INTEGER = re.compile("[0-9]{1,9}")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]{1,3})?")
_NUMERIC = frozenset({"limit", "track_id", "min_confidence", "step_s"})
_A_TIME = "a UTC time such as 2026-04-01T12:00:00Z"

#: What the values of parameters must be.
_RULES = {
    "limit": f"an integer from 1 to {MAXIMUM_PAGE}",
    "after": "the `next` of a page",
    "track_id": "an integer from 0 to 999999999",
    "since": _A_TIME,
    "until": _A_TIME,
    "min_confidence": "a number from 0 to 1",
    "step_s": "a number from 0.1 to 600",
    "trail": "true or false",
    "view": "full or brief",
}

#: Maximum duration of a part of a saved run, s.
LONGEST_S = 3600.0
SPAN_RULE = f"since and until must be given, at most {LONGEST_S:g} s apart"

Limit = Annotated[int, Meta(ge=1, le=MAXIMUM_PAGE)]


def _time(example: str) -> Any:
    """Return the type of a UTC time; `time_us` checks it."""
    return Annotated[str, Meta(extra_json_schema={"pattern": _UTC_TIME, "examples": [example]})]


class Query(Struct, forbid_unknown_fields=True):
    """The query of a request that has no parameters."""


class DetectionsQuery(Query):
    """A page of detections and their filter."""

    limit: Limit = 100
    after: Annotated[str, Meta(pattern="^[0-9a-z]{1,12}$")] | UnsetType = UNSET
    sensor_id: str | UnsetType = UNSET
    sensor_type: str | UnsetType = UNSET
    target_type: (
        Annotated[
            str,
            Meta(
                examples=list(REPORTED_TYPES),
                extra_json_schema={"pattern": "^[A-Za-z0-9._+-]{1,64}$"},
            ),
        ]
        | UnsetType
    ) = UNSET
    track_id: Annotated[int, Meta(ge=0, le=10**9 - 1)] | UnsetType = UNSET
    since: _time("2026-04-01T12:00:00Z") | UnsetType = UNSET  # type: ignore[valid-type]
    until: _time("2026-04-01T12:05:00Z") | UnsetType = UNSET  # type: ignore[valid-type]
    min_confidence: Annotated[float, Meta(ge=0, le=1)] | UnsetType = UNSET


class TracksQuery(Query):
    """The number of tracks, and whether each has its trail."""

    limit: Limit = 100
    trail: Annotated[
        Literal["true", "false"],
        Meta(description="whether to add the earlier positions of each track"),
    ] = "false"


class StreamQuery(Query):
    """How much of each cycle the stream has."""

    view: Literal["full", "brief"] = "full"


class ReplayQuery(Query):
    """A part of a saved run."""

    since: _time("2026-04-01T12:00:00Z")  # type: ignore[valid-type]
    until: _time("2026-04-01T12:05:00Z")  # type: ignore[valid-type]
    step_s: Annotated[float, Meta(ge=0.1, le=600)] = 1.0


Parameters = TypeVar("Parameters", bound=Query)


def read_query(text: bytes, kind: type[Parameters]) -> Parameters:
    """Return the parameters of a query string.

    Raises `ProblemError` for an unknown or duplicate parameter, or a value that is not valid.
    """
    try:
        return msgspec.convert(_values(text, kind.__struct_fields__), kind)
    except msgspec.ValidationError as error:
        _, is_value, name = str(error).rpartition("$.")
        raise invalid(name.rstrip("`")) if is_value else ProblemError(400, SPAN_RULE) from None


def _values(text: bytes, names: tuple[str, ...]) -> dict[str, str | float]:
    try:
        pairs = (
            parse_qsl(
                text.decode("ascii"), keep_blank_values=True, strict_parsing=True, errors="strict"
            )
            if text
            else []
        )
    except ValueError:
        raise ProblemError(400, "the query string cannot be read") from None
    values: dict[str, str | float] = {}
    for name, word in pairs:
        if name not in names:
            expected = ", ".join(sorted(names)) or "none"
            raise ProblemError(400, f"unknown parameter; expected {expected}")
        if name in values:
            raise ProblemError(400, f"duplicate parameter {name}")
        values[name] = _number(word) if name in _NUMERIC else word
    return values


def _number(word: str) -> float | str:
    """Return the number of a word, or the word if it is not a number."""
    if _INTEGER.fullmatch(word):
        return int(word)
    return float(word) if _NUMBER.fullmatch(word) else word


def invalid(name: str) -> ProblemError:
    """Return the error for a parameter whose value is not valid."""
    return ProblemError(400, f"{name} must be {_RULES[name]}")


def time_us(query: DetectionsQuery | ReplayQuery, name: str) -> int | None:
    """Return the value of a UTC time parameter in Unix microseconds, or None if it is absent."""
    text = getattr(query, name)
    try:
        return None if text is UNSET else epoch_us_of_text(text)
    except ValueError:
        raise invalid(name) from None
