"""The versions of opir-core that a plugin requires: the specifier (PEP 440) of its dependency on opir-core.

    [project]
    dependencies = ["opir-core>=0.1,<0.2"]

pip checks the specifier at installation. The host checks it again at discovery, because opir-core may have been
replaced since, and rejects the plugin without importing it. Only release numbers are compared. A clause that cannot be
read is ignored: rejecting it is the installer's task.
"""

import re
from collections.abc import Iterable

_CORE = re.compile(r"opir[-_.]+core\s*(?:\[[^]]*\])?\s*\(?((?:[~=!<>][^;@()]*)?)\)?\s*(?:;(.*))?", re.IGNORECASE)
_CLAUSE = re.compile(r"(~=|==|!=|<=|>=|<|>)\s*v?(\d+(?:\.\d+)*)(\.\*)?")


def core_specifier(requirements: Iterable[str]) -> str:
    """Return the specifier of opir-core among requirements (the values of `Requires-Dist`), `>=0.1,<0.2`; "" for none.

    Requirements of extras do not count.
    """
    found = (_CORE.fullmatch(requirement.strip()) for requirement in requirements)
    clauses = {
        "".join(clause.split())
        for match in found
        if match and "extra" not in (match[2] or "")
        for clause in match[1].split(",")
    }
    return ",".join(sorted(clauses - {""}, reverse=True))


def error_of_requirement(specifier: str, distribution: str, core_version: str) -> str:
    """Return why a plugin that requires `specifier` cannot be used with this core, or "" where it can."""
    if all(_admits(clause, core_version) for clause in specifier.split(",")):
        return ""
    return (
        f"requires opir-core {specifier}, and opir-core {core_version} is installed; install an opir-core in that"
        f" range, or a release of {distribution} for opir-core {core_version}"
    )


def _admits(clause: str, version: str) -> bool:
    match = _CLAUSE.fullmatch(clause)
    if match is None:
        return True
    operator, bound, is_prefix = match[1], _release(match[2]), bool(match[3])
    installed = _release(version)
    if operator == "~=":
        return _padded(installed, bound) >= _padded(bound, installed) and _starts(installed, bound[:-1])
    is_equal = _starts(installed, bound) if is_prefix else _padded(installed, bound) == _padded(bound, installed)
    if operator in ("==", "!="):
        return is_equal == (operator == "==")
    is_less = _padded(installed, bound) < _padded(bound, installed)
    return ("=" in operator and is_equal) or (not is_equal and is_less == operator.startswith("<"))


def _release(version: str) -> tuple[int, ...]:
    """Return the numbers of a version's release, (0, 1, 0) of `0.1.0rc1`."""
    match = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(map(int, match[0].split("."))) if match else ()


def _padded(release: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return release + (0,) * (len(other) - len(release))


def _starts(release: tuple[int, ...], prefix: tuple[int, ...]) -> bool:
    return _padded(release, prefix)[: len(prefix)] == prefix
