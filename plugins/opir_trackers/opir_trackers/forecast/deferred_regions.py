"""Impact regions whose rings and areas are computed at the first reading: most regions are replaced
before.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from attrs import fields

from opir_core.arrays import FloatArray
from opir_core.plugin import ImpactRegion


class Outline(NamedTuple):
    """Outline of a region: its area, km², and the rings of its polygons, as in `ImpactRegion`."""

    area_km2: float
    polygons: tuple[tuple[FloatArray, ...], ...]


class Outlines:
    """The outlines of regions of one ensemble, computed together at the first question for one of
    them.
    """

    def __init__(self, make: Callable[[], Sequence[Outline]]) -> None:
        self._make: Callable[[], Sequence[Outline]] | None = make
        self._outlines: Sequence[Outline] = ()

    def __getitem__(self, number: int) -> Outline:
        """Return the outline of a region; the points of the ensemble are let go."""
        make = self._make  # another thread may read at the same time: both make the same outlines
        if make is not None:
            self._outlines = make()
            self._make = None
        return self._outlines[number]


class DeferredRegion(ImpactRegion):
    """A region that takes its area and polygons from outlines when they are first read; otherwise a
    plain region.
    """

    __slots__ = ("_number", "_outlines")

    @classmethod
    def of(cls, outlines: Outlines, number: int, **figures: Any) -> "DeferredRegion":
        """Return the region of an outline, with the other attributes of `ImpactRegion`."""
        region = cls.__new__(cls)
        region._set(figures | {"_outlines": outlines, "_number": number})
        return region

    def _set(self, figures: dict[str, Any]) -> None:
        for name, value in figures.items():
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Any:
        """Set and return an attribute of the outline: Python asks here for slots that are empty."""
        if name not in Outline._fields:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self._set(self._outlines[self._number]._asdict())
        return getattr(self, name)

    def __reduce__(self) -> tuple[type[ImpactRegion], tuple[Any, ...]]:
        figures = tuple(getattr(self, attribute.name) for attribute in fields(ImpactRegion))
        return ImpactRegion, figures
