"""Impact regions whose rings and areas are made when somebody reads them: most are replaced
before.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from attrs import fields

from opir_core.arrays import FloatArray
from opir_core.plugin import ImpactRegion


class Outline(NamedTuple):
    """What a region encloses: its area, km², and the rings of its polygons, as in
    `ImpactRegion`.
    """

    area_km2: float
    polygons: tuple[tuple[FloatArray, ...], ...]


class Outlines:
    """The outlines of regions of one ensemble, made together at the first question for one of
    them.
    """

    def __init__(self, make: Callable[[], Sequence[Outline]]) -> None:
        self._make: Callable[[], Sequence[Outline]] | None = make
        self._made: Sequence[Outline] = ()

    def __getitem__(self, number: int) -> Outline:
        """Return the outline of a region; the points that it is made of are let go."""
        make = self._make  # another thread may read at the same time: both make the same outlines
        if make is not None:
            self._made = make()
            self._make = None
        return self._made[number]


class DeferredRegion(ImpactRegion):
    """A region that takes its area and polygons from outlines when they are first read; otherwise a
    plain region.
    """

    __slots__ = ("_number", "_outlines")

    @classmethod
    def of(cls, outlines: Outlines, number: int, **figures: Any) -> "DeferredRegion":
        """Return the region of an outline, with the other attributes of `ImpactRegion`."""
        region = cls.__new__(cls)
        for name, value in (figures | {"_outlines": outlines, "_number": number}).items():
            object.__setattr__(region, name, value)
        return region

    def __getattr__(self, name: str) -> Any:
        """Set and return what of the outline is not yet set: Python asks here for slots that are
        empty.
        """
        if name not in Outline._fields:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        for each, value in self._outlines[self._number]._asdict().items():
            object.__setattr__(self, each, value)
        return getattr(self, name)

    def __reduce__(self) -> tuple[type[ImpactRegion], tuple[Any, ...]]:
        return ImpactRegion, tuple(getattr(self, each.name) for each in fields(ImpactRegion))
