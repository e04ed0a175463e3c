"""Strict reading of request bodies and query strings, and the names that only a scene may have.

With the name of a file or an environment variable, a request could read or overwrite a file of the
machine, or send a secret of the environment to a broker of its choice.
"""

import json
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any
from urllib.parse import parse_qsl

from opir_core.reading import epoch_us_of_text
from opir_http.problems import ProblemError

_DIGITS = 9
#: The deepest nesting of a body. It is within what each Python reads: 3.11 some 900 levels, 3.13 10
#: 000.
_DEEPEST = 500
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]{1,3})?")
_NAMES = ("path", "file", "csv")
_ENDS = ("_path", "_file", "_csv", "_variable")
_SECRET = "_variable"


def json_object(body: bytes) -> dict[str, Any]:
    """Return the JSON object of a body: UTF-8, no duplicate keys, no NaN; raises `ProblemError`.

    A byte-order mark, which some clients send, is passed over (RFC 8259, section 8.1).
    """
    try:
        value = json.loads(
            body.decode("utf-8-sig"), parse_constant=_refuse_constant, object_pairs_hook=_pairs_once
        )
    except UnicodeDecodeError:
        raise ProblemError(400, "the body is not UTF-8") from None
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:
        raise ProblemError(400, f"the body is not JSON: {error}") from None
    if not isinstance(value, dict):
        raise ProblemError(422, "the body is not a JSON object")
    if _is_deeper(value, _DEEPEST):
        raise _too_deep()
    return value


def _too_deep() -> ProblemError:
    return ProblemError(400, f"the body is nested more than {_DEEPEST} deep")


def _is_deeper(value: Any, limit: int) -> bool:
    """Return whether lists and objects are nested more than `limit` deep."""
    blocks = [value]
    depth = 0
    while blocks and depth <= limit:
        inner = (at.values() if isinstance(at, dict) else at for at in blocks)
        blocks = [at for block in inner for at in block if isinstance(at, dict | list)]
        depth += 1
    return depth > limit


def query(raw: bytes, names: Collection[str]) -> Mapping[str, str]:
    """Return the parameters of a query string; raises `ProblemError` for unknown and duplicate
    ones.
    """
    try:
        pairs = (
            parse_qsl(
                raw.decode("ascii"), keep_blank_values=True, strict_parsing=True, errors="strict"
            )
            if raw
            else []
        )
    except ValueError:
        raise ProblemError(400, "the query string cannot be read") from None
    parameters: dict[str, str] = {}
    for key, value in pairs:
        if key not in names:
            raise ProblemError(
                400, f"unknown parameter; expected {', '.join(sorted(names)) or 'none'}"
            )
        if key in parameters:
            raise ProblemError(400, f"duplicate parameter {key}")
        parameters[key] = value
    return parameters


def whole_number(
    given: Mapping[str, str], key: str, default: int, most: int, *, least: int = 1
) -> int:
    """Return the value of an integer parameter from `least` to `most`."""
    word = given.get(key)
    if word is None:
        return default
    if not (
        word.isascii() and word.isdecimal() and len(word) <= _DIGITS and least <= int(word) <= most
    ):
        raise ProblemError(400, f"{key} must be an integer from {least} to {most}")
    return int(word)


def unit_number(given: Mapping[str, str], key: str) -> float | None:
    """Return the value of a parameter from 0 to 1, or None if it is absent."""
    return None if key not in given else number_within(given, key, 0.0, 0.0, 1.0)


def number_within(
    given: Mapping[str, str], key: str, default: float, least: float, most: float
) -> float:
    """Return the value of a parameter from `least` to `most`."""
    word = given.get(key)
    if word is None:
        return default
    if not _NUMBER.fullmatch(word) or not least <= float(word) <= most:
        raise ProblemError(400, f"{key} must be a number from {least:g} to {most:g}")
    return float(word)


def instant_us(given: Mapping[str, str], key: str) -> int | None:
    """Return the value of a UTC time parameter in Unix microseconds, or None if it is absent."""
    word = given.get(key)
    if word is None:
        return None
    try:
        return epoch_us_of_text(word)
    except ValueError:
        raise ProblemError(400, f"{key} must be a UTC time such as 2026-04-01T12:00:00Z") from None


def _refuse_constant(word: str) -> Any:
    raise ValueError(f"{word} is not a JSON number")


def _pairs_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    unique = dict(pairs)
    if len(unique) < len(pairs):
        raise ValueError("duplicate key")
    return unique


def refuse_names(block: Mapping[str, Any]) -> None:
    """Raise `ProblemError` if a launch names a file or a variable."""
    errors = tuple((path, "only a scene may name files and variables") for path, _ in _named(block))
    if errors:
        raise ProblemError(422, "the request names a file or a variable", errors)


def refuse_other_names(before: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raise `ProblemError` if a configuration names other files or variables, or changes an output
    with a secret.
    """
    ours = dict(_named(before))
    theirs = dict(_named(wanted))
    reason = "needs a restart: only the scene names files and variables with secrets"
    errors = [
        (path, reason) for path in sorted({*ours, *theirs}) if ours.get(path) != theirs.get(path)
    ]
    outputs = wanted.get("outputs")
    for number, output in enumerate(before.get("outputs") or ()):
        has_secret = any(path.endswith(_SECRET) for path, _ in _named(output))
        is_same = isinstance(outputs, list) and number < len(outputs) and outputs[number] == output
        if has_secret and not is_same:
            errors.append(
                (f"outputs[{number}]", "needs a restart: an output with a secret cannot change")
            )
    if errors:
        raise ProblemError(409, "some settings need a restart", tuple(errors))


def _named(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield paths and values of all keys that name a file or a variable, at any depth."""
    waiting = [("", value)]
    while waiting:
        path, at = waiting.pop()
        if isinstance(at, Mapping):
            for key, inner in at.items():
                place = f"{path}.{key}" if path else str(key)
                if inner is not None and (key in _NAMES or str(key).endswith(_ENDS)):
                    yield place, inner
                waiting.append((place, inner))
        elif isinstance(at, list | tuple):
            waiting += [(f"{path}[{number}]", inner) for number, inner in enumerate(at)]
