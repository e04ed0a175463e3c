"""Where a line of sight meets the Earth."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.vectors import Floats, components, vector


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def intersection_with_ellipsoid(origin_ecef_m: ArrayLike, direction: ArrayLike, height_m: ArrayLike = 0.0) -> Floats:
    """Return the first point (..., 3), m, at which rays meet the ellipsoid with both semi-axes longer by `height_m`."""
    height = np.asarray(height_m, dtype=np.float64)
    a, b = WGS84.equatorial_radius_m + height, WGS84.polar_radius_m + height
    ox, oy, oz = components(origin_ecef_m)
    dx, dy, dz = components(direction)
    x, y, z, u, v, w = ox / a, oy / a, oz / b, dx / a, dy / a, dz / b
    cx, cy, cz = y * w - z * v, z * u - x * w, x * v - y * u
    speed, moment = np.sqrt(u * u + v * v + w * w), np.sqrt(cx * cx + cy * cy + cz * cz)
    radius = np.sqrt(x * x + y * y + z * z)
    outside = (radius - 1.0) * (radius + 1.0)
    along = x * u + y * v + z * w
    root = np.sqrt((speed - moment) * (speed + moment))
    entry = np.where(along < 0.0, outside / (root - along), np.nan)
    leave = np.where(along <= 0.0, (root - along) / (speed * speed), -outside / (root + along))
    step = np.where(outside > 0.0, entry, leave)
    return vector(ox + step * dx, oy + step * dy, oz + step * dz)
