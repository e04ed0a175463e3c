"""Kinds of hot sources other than launches, from `opir_photons/data/hot_sources.json`."""

from typing import NamedTuple

from opir_photons.laws import law
from opir_photons.radiometry.propellants import log_sigma


class SourceKind(NamedTuple):
    """A kind of hot source other than launches: a grey body; `area_m2` is the median of emissivity
    times area, which holds within the factor `spread`, either way.

    Temperature, K, and height, m, are even between limits. It shines for `shining_s` on average, an
    exponentially distributed time, or within the factor `shining_spread` of that. `group` is the
    group of its hypothesis.
    """

    name: str
    group: str
    temperature_k: tuple[float, float]
    area_m2: float
    spread: float
    height_m: tuple[float, float]
    shining_s: float
    shining_spread: float | None

    @property
    def area_log_sigma(self) -> float:
        """The standard deviation of the logarithm of the area."""
        return log_sigma(self.spread)

    @property
    def shining_log_sigma(self) -> float:
        """The standard deviation of the logarithm of the time, 0 for an exponential one."""
        return log_sigma(self.shining_spread) if self.shining_spread else 0.0


KINDS = tuple(
    SourceKind(**{name: row.get(name) for name in SourceKind._fields})
    for row in law("hot_sources")["kinds"]
)
