"""The version of the plugin interface, and the range of versions that a plugin declares.

A distribution declares the range in its metadata, so that a plugin of another range is refused without being imported:
an entry point in group `opir.api` whose name is the range and whose value is the plugin's.

    [project.entry-points."opir.api"]
    "1.0" = "opir_dsp.plugin"

`1.2` is 1.2 up to the last 1.x, `1.2-3` up to the last 3.x, `1.2-3.4` up to 3.4 (it included).
"""

import re
from typing import Self

from attrs import frozen

#: What plugins may rely on: hooks, component classes, protocols, records, config fields, and `opir_core.testing`. The
#: first number changes when something is taken away or changed, the second when something is added.
API_VERSION = (1, 0)

API_GROUP = "opir.api"

_VERSION = r"(\d{1,4})(?:\.(\d{1,4}))?"
_RANGE = re.compile(rf"{_VERSION}(?:-{_VERSION})?")
#: Stands for the last minor version of a major one.
_LAST = 10_000


@frozen
class ApiRange:
    """A range of versions of the plugin interface, both ends included."""

    lowest: tuple[int, int]
    highest: tuple[int, int]

    @classmethod
    def of(cls, text: str) -> Self:
        """Return the range that a declaration means; raises `ValueError` with a complaint where it means none."""
        match = _RANGE.fullmatch(text)
        if match is None:
            raise ValueError(f"declares the plugin API {text!r}, which is not of the form 1.0, 1.2-3 or 1.2-3.4")
        low_major, low_minor, high_major, high_minor = match.groups()
        lowest = (int(low_major), int(low_minor or 0))
        highest = (int(high_major or low_major), _LAST if high_minor is None else int(high_minor))
        if highest < lowest:
            raise ValueError(f"declares the plugin API {text!r}, a range that ends before it begins")
        return cls(lowest, highest)

    def admits(self, version: tuple[int, int]) -> bool:
        """Return whether a version lies in the range."""
        return self.lowest <= version <= self.highest

    def __str__(self) -> str:
        """Return the range as messages call it, `1.0 to 1.x`."""
        return f"{version_text(self.lowest)} to {version_text(self.highest)}"


def version_text(version: tuple[int, int]) -> str:
    """Return a version as `1.0`, or as `1.x` where it is the last of its major version."""
    return f"{version[0]}.{'x' if version[1] == _LAST else version[1]}"


def complaint_about(declared: str, distribution: str, core_version: str) -> str:
    """Return why a plugin that declares a range cannot be used with this core, or "" where it can."""
    try:
        wanted = ApiRange.of(declared)
    except ValueError as error:
        return str(error)
    if wanted.admits(API_VERSION):
        return ""
    has = version_text(API_VERSION)
    return (
        f"is written for plugin API {wanted}, and opir-core {core_version} has {has}; install an opir-core that has it,"
        f" or a release of {distribution} for API {has}"
    )
