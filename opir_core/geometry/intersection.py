"""Where a line of sight meets the Earth."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.vectors import components, floats, length, vector


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def intersection_with_ellipsoid(
    origin_ecef_m: ArrayLike, direction: ArrayLike, height_m: ArrayLike = 0.0
) -> FloatArray:
    """Return the first points (..., 3), m, at which rays meet the ellipsoid with both semi-axes longer by `height_m`.

    Origins in ECEF (..., 3), m; directions in ECEF (..., 3), of any length but 0. From inside it is the point where the
    ray leaves. `nan` where there is none: a miss, a ray that points away, a direction of length 0, a height that
    leaves no ellipsoid, anything not finite. An origin on the ellipsoid counts as inside or outside as rounding has it.

    The longer ellipsoid is not quite the surface of constant height: at 100 km they differ by 0.3 m at most. Errors
    are those of rounding, along the ray: 2e-9 m from a low orbit and 2e-8 m from a geostationary one, divided by the
    sine of the angle at which the ray meets the ground. Source: the ray and the unit sphere, after each axis is divided
    by its semi-axis, with the discriminant from the cross product, which does not cancel when the ray grazes.
    """
    height = floats(height_m)
    a, b = WGS84.equatorial_radius_m + height, WGS84.polar_radius_m + height
    (ox, oy, oz), (dx, dy, dz) = components(origin_ecef_m), components(direction)
    x, y, z, u, v, w = ox / a, oy / a, oz / b, dx / a, dy / a, dz / b
    speed, moment = length(u, v, w), length(y * w - z * v, z * u - x * w, x * v - y * u)
    root = np.sqrt((speed - moment) * (speed + moment))
    radius, along = length(x, y, z), x * u + y * v + z * w
    outside = (radius - 1.0) * (radius + 1.0)
    # Two forms of each root of the quadratic: the one whose terms have one sign.
    entry = np.where(along < 0.0, outside / (root - along), np.nan)
    leave = np.where(along <= 0.0, (root - along) / (speed * speed), -outside / (root + along))
    step = np.where((b > 0.0) & (speed > 0.0), np.where(outside > 0.0, entry, leave), np.nan)
    return vector(ox + step * dx, oy + step * dy, oz + step * dz)
