"""What no request names: files, and variables of the environment. They are the scene's alone.

A request that could name them could have a file of the machine read out to it, a file written over, or a secret of the
environment sent to a broker of its choice.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from opir_http.problems import ProblemError

_NAMES = ("path", "file")
_ENDS = ("_path", "_file", "_variable")
_SECRET = "_variable"


def refuse_names(block: Mapping[str, Any]) -> None:
    """Raise `ProblemError` where a launch names a file or a variable."""
    found = tuple((path, "a request names no file and no variable; a scene may") for path, _ in _named(block))
    if found:
        raise ProblemError(422, "a file or a variable is named", found)


def refuse_other_names(before: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raise `ProblemError` where a configuration names other files or variables, or changes an output with a secret."""
    ours, theirs = dict(_named(before)), dict(_named(wanted))
    reason = "needs a restart: files, and variables that hold secrets, are named in the scene"
    found = [(path, reason) for path in sorted({*ours, *theirs}) if ours.get(path) != theirs.get(path)]
    outputs = wanted.get("outputs")
    for number, output in enumerate(before.get("outputs") or ()):
        has_secret = any(path.endswith(_SECRET) for path, _ in _named(output))
        is_same = isinstance(outputs, list) and number < len(outputs) and outputs[number] == output
        if has_secret and not is_same:
            found.append((f"outputs[{number}]", "needs a restart: it holds a secret, which goes nowhere else"))
    if found:
        raise ProblemError(409, "some settings need a restart", tuple(found))


def _named(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield paths and values of all keys that name a file or a variable, to whatever depth."""
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
