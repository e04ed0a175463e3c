"""Regions on the ground that contain an impact with a stated probability."""

import math

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.geometry.sphere import AzimuthalEquidistant, unit_vectors

#: What an impact region presumes: that the target comes down; that its burn is over and it comes
#: down; that it burns again and comes down then.
IMPACT_CONDITIONS = ("comes down", "burn over", "relights")


@frozen(eq=False)
class ImpactRegion:
    """A highest-density region of an impact: the smallest area that contains it with probability
    `containment`.

    `polygons` are tuples of closed rings: the outer one, then holes. A ring is an array (k, 2) of
    latitude_rad and longitude_rad, the last point equal to the first. A region may have several
    polygons.

    Edges are straight in the azimuthal equidistant projection about `centre`, latitude_rad and
    longitude_rad; by default about the mean of the corners. It matters to regions as wide as
    continents.
    """

    containment: float
    area_km2: float
    polygons: tuple[tuple[FloatArray, ...], ...]
    centre: tuple[float, float] | None = None
    condition: str = IMPACT_CONDITIONS[0]
    probability: float = 1.0
    effective_samples: float = math.nan

    def __eq__(self, region: object) -> bool:
        """Return whether another region has the same figures, centre and rings, point by point."""
        return isinstance(region, ImpactRegion) and self._parts() == region._parts()

    def __hash__(self) -> int:
        return hash(self._parts())

    def _parts(self) -> tuple[object, ...]:
        polygons = tuple(tuple(ring.tobytes() for ring in polygon) for polygon in self.polygons)
        presumed = self.condition, self.probability, repr(self.effective_samples)
        return self.containment, self.area_km2, polygons, self.centre, *presumed

    def chart(self) -> AzimuthalEquidistant:
        """Return the map in which the edges are straight; a region without polygons needs a
        `centre`.
        """
        if self.centre is not None:
            return AzimuthalEquidistant.about(unit_vectors(np.array([self.centre]))[0])
        rings = [ring for polygon in self.polygons for ring in polygon]
        return AzimuthalEquidistant.about(
            np.add.reduce([unit_vectors(ring).mean(axis=0) for ring in rings])
        )

    def contains(self, latitude_rad: float, longitude_rad: float) -> bool:
        """Return whether a point lies in the region.

        Rings and point are projected by directions and distances from the centre of the region
        (azimuthal equidistant), at poles and the 180th meridian too; a point is
        inside an odd number of rings.
        """
        rings = [ring for polygon in self.polygons for ring in polygon]
        if not rings:
            return False
        chart = self.chart()
        x, y = chart.points(np.array([[latitude_rad, longitude_rad]]))[0].tolist()
        inside = False
        for ring in rings:
            corner = chart.points(ring)
            (x0, y0), (x1, y1) = corner[:-1].T, corner[1:].T
            crosses = (y0 > y) != (y1 > y)
            slope = (x1 - x0)[crosses] / (y1 - y0)[crosses]
            inside ^= bool(np.count_nonzero(x0[crosses] + (y - y0[crosses]) * slope > x) % 2)
        return inside
