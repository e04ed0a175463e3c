"""Whether the Earth stands between two points, and how closely the line between them passes it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.geometry.geodetic import ecef_to_geodetic, geodetic_to_ecef
from opir_core.geometry.vectors import Floats, components, vector


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def grazing_height_m(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> Floats:
    """Return the least height above the ellipsoid of the segments between observers and targets, m."""
    return _lowest(observer_ecef_m, target_ecef_m)[0]


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def is_occluded(
    observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike, grazing_height_m: ArrayLike = 0.0
) -> NDArray[np.bool_]:
    """Return whether the segment dips between its ends below `grazing_height_m` above the ellipsoid."""
    height, inside = _lowest(observer_ecef_m, target_ecef_m)
    return inside & (height < grazing_height_m)


def _lowest(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the least height and whether it is reached between the ends: bisection on the slope, which only grows."""
    ox, oy, oz = components(observer_ecef_m)
    tx, ty, tz = components(target_ecef_m)
    dx, dy, dz = tx - ox, ty - oy, tz - oz

    def slope(share: Floats) -> tuple[Floats, Floats]:
        point = vector(ox + share * dx, oy + share * dy, oz + share * dz)
        latitude, longitude, height = ecef_to_geodetic(point)
        up = components(geodetic_to_ecef(latitude, longitude, 1.0) - geodetic_to_ecef(latitude, longitude, 0.0))
        return up[0] * dx + up[1] * dy + up[2] * dz, height

    low, high = np.zeros(np.shape(dx)), np.ones(np.shape(dx))
    slope_low, height_low = slope(low)
    slope_high, height_high = slope(high)
    for _ in range(50):
        middle = 0.5 * (low + high)
        slope_middle, _height = slope(middle)
        low, high = np.where(slope_middle < 0.0, middle, low), np.where(slope_middle < 0.0, high, middle)
    inside = (slope_low < 0.0) & (slope_high > 0.0)
    height = np.where(inside, slope(low)[1], np.minimum(height_low, height_high))
    return height, inside
