"""The least height of a segment that runs through the Earth, and the outward normal at any point."""

from typing import NamedTuple

import numpy as np

from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.foot import height_along_normal, normal_at_foot, support_m
from opir_core.geometry.vectors import NEVER_ZERO, Floats, components

_A, _B = WGS84.equatorial_radius_m, WGS84.polar_radius_m

#: A search ends when a step can win less than this, m.
_NEGLIGIBLE_M = 1e-10

#: Newton's steps before bisections are mixed in, and steps enough for these to exhaust a double's digits.
_TRUSTED_STEPS, _MOST_STEPS = 10, 130


class Normal(NamedTuple):
    """The upward normal of the ellipsoid under a point, and the point's height, m."""

    x: Floats
    y: Floats
    z: Floats
    height: Floats


def normal(x: Floats, y: Floats, z: Floats) -> Normal:
    """Return the upward normal at the foot of points, and their height above the WGS 84 ellipsoid."""
    rho = np.sqrt(x * x + y * y)
    sine, cosine = normal_at_foot(rho, z, _A, _B)
    share = cosine / (rho + NEVER_ZERO)
    return Normal(share * x, share * y, sine, height_along_normal(rho, z, sine, cosine, _A, _B))


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def least_height_inside_m(observer_ecef_m: Floats, target_ecef_m: Floats) -> Floats:
    """Return the least height, m, along segments (n, 3) that fall from the observer and rise to the target.

    Newton's method on the slope, which only grows along the segment, from where an ellipsoid of the same shape first
    touches it. A step that leaves the bracket is a bisection, and so is every other one after the tenth: the slope
    jumps where the segment crosses the equatorial disc of radius a e² about the centre.
    """
    share = _touching_share(observer_ecef_m, target_ecef_m)
    low, high, least = np.zeros_like(share), np.ones_like(share), np.full_like(share, np.inf)
    active = np.arange(share.size)
    for step in range(_MOST_STEPS):
        here, below, above = share[active], low[active], high[active]
        slope, curvature, height = _slope(observer_ecef_m[active], target_ecef_m[active], here)
        least[active] = np.minimum(least[active], height)
        below, above = np.where(slope < 0.0, here, below), np.where(slope < 0.0, above, here)
        guess = here - slope / curvature
        wild = ~((guess > below) & (guess < above)) | (step > _TRUSTED_STEPS and step % 2 == 0)
        guess = np.where(wild, 0.5 * (below + above), guess)
        share[active], low[active], high[active] = guess, below, above
        active = active[np.abs(slope * (guess - here)) > _NEGLIGIBLE_M]
        if not active.size:
            break
    return least


def _touching_share(observer: Floats, target: Floats) -> Floats:
    """Return where on the segments a shrunken ellipsoid of the same shape would touch them, between 0 and 1."""
    ox, oy, oz = components(observer)
    tx, ty, tz = components(target)
    dx, dy, dz = tx - ox, ty - oy, tz - oz
    stretch = (_A / _B) ** 2
    share = -(ox * dx + oy * dy + stretch * oz * dz) / (dx * dx + dy * dy + stretch * dz * dz + NEVER_ZERO)
    return np.clip(share, 1e-9, 1.0 - 1e-9)


def _slope(observer: Floats, target: Floats, share: Floats) -> tuple[Floats, Floats, Floats]:
    """Return height at a share of the segment, and its first and second derivative by the share."""
    ox, oy, oz = components(observer)
    tx, ty, tz = components(target)
    dx, dy, dz = tx - ox, ty - oy, tz - oz
    x, y, z = ox + share * dx, oy + share * dy, oz + share * dz
    up = normal(x, y, z)
    rising = up.x * dx + up.y * dy + up.z * dz
    rho = np.sqrt(x * x + y * y) + NEVER_ZERO
    east = (x * dy - y * dx) / rho
    north_squared = np.maximum(0.0, dx * dx + dy * dy + dz * dz - rising * rising - east * east)
    support = support_m(up.z, np.sqrt(up.x * up.x + up.y * up.y), _A, _B)
    across, along = _A * _A / support + up.height, _A * _A * _B * _B / support**3 + up.height
    return rising, east * east / (across + NEVER_ZERO) + north_squared / (along + NEVER_ZERO), up.height
