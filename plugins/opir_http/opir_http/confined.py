"""Names of files and environment variables in requests: only a scene may have them.

With them a request could read or overwrite a file of the machine, or send a secret of the environment to a broker of
its choice.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from opir_http.problems import ProblemError

_NAMES = ("path", "file")
_ENDS = ("_path", "_file", "_variable")
_SECRET = "_variable"


def refuse_names(block: Mapping[str, Any]) -> None:
    """Raise `ProblemError` if a launch names a file or a variable."""
    errors = tuple((path, "only a scene may name files and variables") for path, _ in _named(block))
    if errors:
        raise ProblemError(422, "the request names a file or a variable", errors)


def refuse_other_names(before: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raise `ProblemError` if a configuration names other files or variables, or changes an output with a secret."""
    ours, theirs = dict(_named(before)), dict(_named(wanted))
    reason = "needs a restart: only the scene names files and variables with secrets"
    errors = [(path, reason) for path in sorted({*ours, *theirs}) if ours.get(path) != theirs.get(path)]
    outputs = wanted.get("outputs")
    for number, output in enumerate(before.get("outputs") or ()):
        has_secret = any(path.endswith(_SECRET) for path, _ in _named(output))
        is_same = isinstance(outputs, list) and number < len(outputs) and outputs[number] == output
        if has_secret and not is_same:
            errors.append((f"outputs[{number}]", "needs a restart: an output with a secret cannot change"))
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
