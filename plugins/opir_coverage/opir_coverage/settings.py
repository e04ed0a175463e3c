"""Settings of a coverage: grid, heights, times of the day, launches, requirements."""

import operator
import re
from collections.abc import Callable
from typing import Any

from attrs import field, frozen

from opir_core.arrays import BoolArray, FloatArray

_REQUIREMENT = re.compile(r"\s*(\w+)\s*(<=|>=|<|>)\s*([-+.\deE]+)\s*")
_COMPARED: dict[str, Callable[[Any, Any], Any]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}


@frozen
class Requirement:
    """A condition on a layer, `first_report <= 60`; a value of nan does not meet it."""

    layer: str
    sign: str
    limit: float

    @classmethod
    def of(cls, words: str) -> "Requirement":
        """Return the requirement of a text; raises `ValueError` for other texts."""
        match = _REQUIREMENT.fullmatch(words)
        if match is None:
            raise ValueError(f"{words!r} is no requirement; write LAYER<=NUMBER or LAYER>=NUMBER")
        return cls(match[1], match[2], float(match[3]))

    def is_met(self, values: FloatArray) -> BoolArray:
        """Return whether values meet the requirement, elementwise."""
        met: BoolArray = _COMPARED[self.sign](values, self.limit)
        return met

    def __str__(self) -> str:
        """Return the requirement as it is written."""
        return f"{self.layer}{self.sign}{self.limit:g}"


def _all_positive(instance: Any, attribute: Any, value: Any) -> None:
    if not value or min(value) <= 0:
        raise ValueError(f"{attribute.name}: {value} must be numbers above 0, at least one")


@frozen(kw_only=True)
class CoverageSettings:
    """Settings of a coverage.

    Visibility and its figures of merit are of targets at rest at heights above the cells, at
    `steps` instants: the middles of equal parts of `hours` from the scene's epoch. P_d, reports,
    tracks and bounds are of launches of `target_class` from the cells at `launches` instants of the
    same time, with each azimuth. A track is `track_reports` reports; times are those by which they
    have come with probability `chance`.
    """

    target_class: str | None = "ICBM"
    profile: str = ""
    heights_km: tuple[float, ...] = (10.0, 100.0)
    grid_deg: float = 2.0
    hours: float = 24.0
    steps: int = 96
    assets: tuple[int, ...] = field(default=(1, 2), validator=_all_positive)
    azimuths_deg: tuple[float, ...] = (0.0,)
    launches: int = 2
    samples: int = 20
    chance: float = 0.9
    track_reports: int = 4
    requirements: tuple[Requirement, ...] = ()

    def __attrs_post_init__(self) -> None:
        if not self.heights_km or min(self.heights_km) < 0.0 or max(self.heights_km) > 10_000.0:
            raise ValueError("--height: give heights between 0 and 10000 km")
        if not 0.0 < self.chance < 1.0:
            raise ValueError("--chance: give a probability between 0 and 1")
        for name, least in (("steps", 1), ("launches", 1), ("samples", 4), ("track_reports", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"--{name.replace('_', '-')}: give at least {least}")
        if self.hours <= 0.0:
            raise ValueError("--hours: give a length above 0")
