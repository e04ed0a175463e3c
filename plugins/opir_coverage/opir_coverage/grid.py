"""The grid of launch places, and points above it prepared for tests of visibility."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.geometry import WGS84, east_north_up_axes, geodetic_to_ecef, local_axes

_AXES_M = np.array([WGS84.equatorial_radius_m, WGS84.equatorial_radius_m, WGS84.polar_radius_m])


@frozen(eq=False)
class PlaceGrid:
    """Cells of equal steps of latitude and longitude by their centres, degrees, south to north."""

    step_deg: float
    latitude_deg: FloatArray
    longitude_deg: FloatArray

    @classmethod
    def of(cls, step_deg: float) -> "PlaceGrid":
        """Return the grid of a step; raises `ValueError` unless it divides 180°."""
        rows = round(180.0 / step_deg) if step_deg > 0.0 else 0
        if rows < 1 or abs(rows * step_deg - 180.0) > 1e-9:
            raise ValueError(
                f"a step of {step_deg:g}° does not divide 180°; give 1, 2, 3, 5 or 10 for instance"
            )
        latitude = np.asarray((np.arange(rows) + 0.5) * step_deg - 90.0)
        return cls(step_deg, latitude, np.asarray((np.arange(2 * rows) + 0.5) * step_deg - 180.0))

    @property
    def shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns."""
        return len(self.latitude_deg), len(self.longitude_deg)

    def places_rad(self) -> tuple[FloatArray, FloatArray]:
        """Return the latitudes and longitudes (cells,) of all cells, row by row, rad."""
        rows, columns = self.shape
        latitude = np.radians(self.latitude_deg)
        longitude = np.radians(self.longitude_deg)
        return np.repeat(latitude, columns), np.tile(longitude, rows)

    def weights(self) -> FloatArray:
        """Return the shares (cells,) of the sphere's area, which add up to 1."""
        edges = np.sin(np.radians(np.append(self.latitude_deg - 0.5 * self.step_deg, 90.0)))
        return np.repeat(np.diff(edges), self.shape[1]) / (2.0 * self.shape[1])


@frozen(eq=False)
class SeenPoints:
    """Points (n,) as columns; a test of a sensor costs two products with its position.

    `position_m` and `up` (n, 3) are in ECEF, `up` is the geodetic vertical; `scaled` is the
    position over the semi-axes of WGS 84, in which the ellipsoid is the unit sphere.
    """

    position_m: FloatArray
    up: FloatArray
    scaled: FloatArray
    squared_m2: FloatArray
    along_up_m: FloatArray
    scaled_squared: FloatArray
    squared_limits_m2: tuple[float, float]

    @classmethod
    def of(cls, position_m: FloatArray, up: FloatArray | None = None) -> "SeenPoints":
        """Return points at ECEF positions (n, 3), m; `up` (n, 3) are their verticals, if known."""
        up = local_axes(position_m)[:, 2] if up is None else up
        scaled = position_m / _AXES_M
        products = (dot(position_m, position_m), dot(up, position_m), dot(scaled, scaled))
        limits = (float(products[0].min(initial=np.inf)), float(products[0].max(initial=0.0)))
        return cls(position_m, up, scaled, *products, limits)

    @classmethod
    def above(cls, grid: PlaceGrid, height_m: float) -> "SeenPoints":
        """Return the points at a geodetic height above the cells of a grid."""
        latitude, longitude = grid.places_rad()
        position = geodetic_to_ecef(latitude, longitude, np.full(latitude.shape, height_m))
        return cls.of(position, np.ascontiguousarray(east_north_up_axes(latitude, longitude)[:, 2]))

    def __len__(self) -> int:
        return len(self.squared_m2)


def dot(vectors: FloatArray, other_vectors: FloatArray) -> FloatArray:
    """Return the scalar products (n,) of vectors (n, 3)."""
    return (
        vectors[:, 0] * other_vectors[:, 0]
        + vectors[:, 1] * other_vectors[:, 1]
        + vectors[:, 2] * other_vectors[:, 2]
    )
