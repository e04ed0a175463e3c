"""Strict reading of request bodies, and the names that only a scene may have.

With the name of a file or an environment variable, a request could read or overwrite a file of the
machine, or send a secret of the environment to a broker of its choice.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from opir_http.problems import ProblemError

#: The deepest nesting of a body. It is within the range of each Python: 3.11 reads some 900 levels,
#: 3.13 10 000.
_DEEPEST = 500
_NAMES = ("path", "file", "csv")
_SECRET = "_variable"
_ENDS = ("_path", "_file", "_csv", _SECRET)


def json_object(body: bytes) -> dict[str, Any]:
    """Return the JSON object of a body: UTF-8, no duplicate keys, no NaN; raises `ProblemError`.

    A byte-order mark, which some clients send, is ignored (RFC 8259, section 8.1).
    """
    too_deep = ProblemError(400, f"the body is nested more than {_DEEPEST} deep")
    try:
        value = json.loads(
            body.decode("utf-8-sig"), parse_constant=_refuse_constant, object_pairs_hook=_pairs_once
        )
    except UnicodeDecodeError:
        raise ProblemError(400, "the body is not UTF-8") from None
    except RecursionError:
        raise too_deep from None
    except ValueError as error:
        raise ProblemError(400, f"the body is not JSON: {error}") from None
    if not isinstance(value, dict):
        raise ProblemError(422, "the body is not a JSON object")
    if _is_deeper(value, _DEEPEST):
        raise too_deep
    return value


def _is_deeper(value: Any, limit: int) -> bool:
    """Whether lists and objects are nested more than `limit` deep."""
    blocks = [value]
    depth = 0
    while blocks and depth <= limit:
        items = (block.values() if isinstance(block, dict) else block for block in blocks)
        blocks = [item for block in items for item in block if isinstance(item, dict | list)]
        depth += 1
    return depth > limit


def _refuse_constant(word: str) -> Any:
    raise ValueError(f"{word} is not a JSON number")


def _pairs_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    unique = dict(pairs)
    if len(unique) < len(pairs):
        raise ValueError("duplicate key")
    return unique


def merged(present: Mapping[str, Any], patch: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object with a merge patch applied (RFC 7396)."""
    result = dict(present)
    for key, value in patch.items():
        before = result.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, Mapping):
            result[key] = merged(before if isinstance(before, Mapping) else {}, value)
        else:
            result[key] = value
    return result


def refuse_names(block: Mapping[str, Any]) -> None:
    """Raise `ProblemError` if a launch names a file or a variable."""
    errors = tuple((path, "only a scene may name files and variables") for path in _names(block))
    if errors:
        raise ProblemError(422, "the request names a file or a variable", errors)


def refuse_other_names(present: Mapping[str, Any], changed: Mapping[str, Any]) -> None:
    """Raise `ProblemError` if a configuration names other files or variables, or changes an output
    with a secret.
    """
    names = _names(present)
    changed_names = _names(changed)
    reason = "needs a restart: only the scene names files and variables with secrets"
    errors = [
        (path, reason)
        for path in sorted({*names, *changed_names})
        if names.get(path) != changed_names.get(path)
    ]
    outputs = changed.get("outputs")
    for number, output in enumerate(present.get("outputs") or ()):
        has_secret = any(path.endswith(_SECRET) for path in _names(output))
        is_same = isinstance(outputs, list) and number < len(outputs) and outputs[number] == output
        if has_secret and not is_same:
            errors.append(
                (f"outputs[{number}]", "needs a restart: an output with a secret cannot change")
            )
    if errors:
        raise ProblemError(409, "some settings need a restart", tuple(errors))


def _names(value: Any) -> dict[str, Any]:
    """Return the values, by path, of all keys that name a file or a variable, at any depth."""
    return {
        path: item
        for path, key, item in _items(value)
        if item is not None and (key in _NAMES or key.endswith(_ENDS))
    }


def _items(value: Any) -> Iterator[tuple[str, str, Any]]:
    """Yield path, key and value of each key of nested objects."""
    blocks = [("", value)]
    while blocks:
        path, block = blocks.pop()
        if isinstance(block, Mapping):
            for key, item in block.items():
                place = f"{path}.{key}" if path else str(key)
                yield place, str(key), item
                blocks.append((place, item))
        elif isinstance(block, list | tuple):
            blocks += [(f"{path}[{number}]", item) for number, item in enumerate(block)]
