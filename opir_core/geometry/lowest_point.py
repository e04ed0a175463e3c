"""The least height of a segment that runs through the Earth, and the outward normal at any point."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.subsatellite_point import height_along_normal, normal_at_foot
from opir_core.geometry.vectors import NEVER_ZERO, components

_A, _B = WGS84.equatorial_radius_m, WGS84.polar_radius_m

#: A search ends when no point of the segment can be lower than the lowest found by more than this, m.
_NEGLIGIBLE_M = 1e-9

#: Every other step halves the bracket: steps enough to exhaust a double's digits.
_MOST_STEPS = 120


class Normal(NamedTuple):
    """The upward normal of the ellipsoid under a point, and the point's height, m."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    height: FloatArray


def normal(x: FloatArray, y: FloatArray, z: FloatArray) -> Normal:
    """Return the upward normal at the foot of points, and their height above the WGS 84 ellipsoid."""
    rho = np.sqrt(x * x + y * y)
    sine, cosine = normal_at_foot(rho, z, _A, _B)
    share = cosine / (rho + NEVER_ZERO)
    return Normal(share * x, share * y, sine, height_along_normal(rho, z, sine, cosine, _A, _B))


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def least_height_inside_m(observer_ecef_m: FloatArray, target_ecef_m: FloatArray) -> FloatArray:
    """Return the least height, m, along segments (n, 3) that fall from the observer and rise to the target.

    The slope only grows along a segment. Its zero is bracketed by false position and bisection in turn: bisection, for
    the slope jumps where the segment crosses the equatorial disc of radius a e² about the centre. Height lies above
    its tangents, so the flatter end's slope times the bracket bounds what is left to win.
    """
    count = len(observer_ecef_m)
    low, high = np.zeros(count), np.ones(count)
    slope_low, height_low = _slope(observer_ecef_m, target_ecef_m, low)
    slope_high, height_high = _slope(observer_ecef_m, target_ecef_m, high)
    least = np.minimum(height_low, height_high)
    active = np.arange(count)
    for step in range(_MOST_STEPS):
        left, right, falling, rising = low[active], high[active], slope_low[active], slope_high[active]
        guess = 0.5 * (left + right)
        if step % 2 == 0:
            secant = left - falling * ((right - left) / (rising - falling))
            guess = np.where((secant > left) & (secant < right), secant, guess)
        slope, height = _slope(observer_ecef_m[active], target_ecef_m[active], guess)
        least[active] = np.minimum(least[active], height)
        down = slope < 0.0
        low[active], slope_low[active] = np.where(down, guess, left), np.where(down, slope, falling)
        high[active], slope_high[active] = np.where(down, right, guess), np.where(down, rising, slope)
        flattest = np.minimum(-slope_low[active], slope_high[active])
        active = active[flattest * (high[active] - low[active]) > _NEGLIGIBLE_M]
        if not active.size:
            break
    return least


def _slope(observer: FloatArray, target: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the change of height with the share of the segment covered, and the height there, m."""
    ox, oy, oz = components(observer)
    tx, ty, tz = components(target)
    dx, dy, dz = tx - ox, ty - oy, tz - oz
    up = normal(ox + share * dx, oy + share * dy, oz + share * dz)
    return up.x * dx + up.y * dy + up.z * dz, up.height
