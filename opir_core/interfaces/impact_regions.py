"""Regions on the ground that contain an impact with a stated probability."""

from math import cos, sin

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray


@frozen(eq=False)
class ImpactRegion:
    """A highest-density region of an impact: the smallest area that contains it with probability `containment`.

    `polygons` are tuples of closed rings: the outer one, then holes. A ring is an array (k, 2) of latitude_rad and
    longitude_rad, the last point equal to the first. A region may have several polygons.

    Edges are straight in the azimuthal equidistant projection about `centre`, latitude_rad and longitude_rad; by
    default about the mean of the corners. It matters to regions as wide as continents.
    """

    containment: float
    area_km2: float
    polygons: tuple[tuple[FloatArray, ...], ...]
    centre: tuple[float, float] | None = None

    def __eq__(self, other: object) -> bool:
        """Return whether another region has the same figures and the same rings, point by point."""
        return isinstance(other, ImpactRegion) and self._parts() == other._parts()

    def __hash__(self) -> int:
        return hash(self._parts())

    def _parts(self) -> tuple[object, ...]:
        polygons = tuple(tuple(ring.tobytes() for ring in polygon) for polygon in self.polygons)
        return self.containment, self.area_km2, polygons

    def contains(self, latitude_rad: float, longitude_rad: float) -> bool:
        """Return whether a point lies in the region.

        Rings and point are projected by directions and distances from the centre of the region (azimuthal
        equidistant), so poles and the 180th meridian are no exceptions; a point is inside an odd number of rings.
        """
        rings = [ring for polygon in self.polygons for ring in polygon]
        if not rings:
            return False
        units = [_unit_vectors(ring[:, 0], ring[:, 1]) for ring in rings]
        if self.centre is None:
            middle = np.add.reduce([unit.mean(axis=0) for unit in units])
        else:
            middle = _unit_vectors(*(np.array([angle]) for angle in self.centre))[0]
        east, north, up = _axes(middle / np.linalg.norm(middle))
        x, y = _projected(_unit_vectors(np.array([latitude_rad]), np.array([longitude_rad])), east, north, up)[
            0
        ].tolist()
        inside = False
        for unit in units:
            corner = _projected(unit, east, north, up)
            (x0, y0), (x1, y1) = corner[:-1].T, corner[1:].T
            crosses = (y0 > y) != (y1 > y)
            slope = (x1 - x0)[crosses] / (y1 - y0)[crosses]
            inside ^= bool(np.count_nonzero(x0[crosses] + (y - y0[crosses]) * slope > x) % 2)
        return inside


def _unit_vectors(latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
    flat = np.cos(latitude_rad)
    return np.stack([flat * np.cos(longitude_rad), flat * np.sin(longitude_rad), np.sin(latitude_rad)], axis=1)


def _axes(up: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return east, north and up of a unit vector on the sphere; at a pole, those of longitude 0."""
    longitude = float(np.arctan2(up[1], up[0]))
    east = np.array([-sin(longitude), cos(longitude), 0.0])
    return east, np.cross(up, east), up


def _projected(unit: FloatArray, east: FloatArray, north: FloatArray, up: FloatArray) -> FloatArray:
    """Return unit vectors (k, 3) as directions and angular distances from `up`, (k, 2) rad."""
    flat = np.stack([unit @ east, unit @ north], axis=1)
    sine = np.sqrt(np.add.reduce(flat * flat, axis=1))
    angle = np.arctan2(sine, unit @ up)
    plane: FloatArray = flat * (angle / np.maximum(sine, 1e-300))[:, None]
    return plane
