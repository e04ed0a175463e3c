"""Lines of sight and the Earth: occlusion, the least height of a segment, and intersections with
the ellipsoid.

Height above the ellipsoid is the signed distance to a convex body, so along a straight line it
falls, then rises: its minimum is at an end or where the line is level. Seen along the line the
ellipsoid is an ellipse, and the height of a line that misses it is the distance of the line from
that ellipse, in closed form.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_core.geometry.ellipsoid import WGS84, height_along_normal, normal_at_foot
from opir_core.geometry.vectors import NEVER_ZERO, components, floats, length, select, vector

_A = WGS84.equatorial_radius_m
_B = WGS84.polar_radius_m


class Normal(NamedTuple):
    """The upward normal of the ellipsoid under a point, and the point's height, m."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    height: FloatArray


def normal(x: FloatArray, y: FloatArray, z: FloatArray) -> Normal:
    """Return the upward normal at the foot of points, and their height above the WGS 84
    ellipsoid.
    """
    rho = np.sqrt(x * x + y * y)
    sine, cosine = normal_at_foot(rho, z, _A, _B)
    share = cosine / (rho + NEVER_ZERO)
    return Normal(share * x, share * y, sine, height_along_normal(rho, z, sine, cosine, _A, _B))


@np.errstate(all="ignore")
def least_height_inside_m(observer_ecef_m: FloatArray, target_ecef_m: FloatArray) -> FloatArray:
    """Return the least height, m, along segments (n, 3) that fall from the observer and rise to the
    target.

    The slope grows monotonically along a segment. Its zero is bracketed by false position and
    bisection in turn, for the slope jumps where the segment crosses the equatorial disc of radius a
    e² about the centre. Height is above its tangents, so the smaller slope times the bracket bounds
    the remaining improvement.
    """
    count = len(observer_ecef_m)
    low = np.zeros(count)
    high = np.ones(count)
    slope_low, height_low = _slope(observer_ecef_m, target_ecef_m, low)
    slope_high, height_high = _slope(observer_ecef_m, target_ecef_m, high)
    least = np.minimum(height_low, height_high)
    active = np.arange(count)
    # Every other step halves the bracket: steps enough to exhaust a double's digits.
    for step in range(120):
        start = low[active]
        stop = high[active]
        falling = slope_low[active]
        rising = slope_high[active]
        guess = 0.5 * (start + stop)
        if step % 2 == 0:
            secant = start - falling * ((stop - start) / (rising - falling))
            guess = np.where((secant > start) & (secant < stop), secant, guess)
        slope, height = _slope(observer_ecef_m[active], target_ecef_m[active], guess)
        least[active] = np.minimum(least[active], height)
        down = slope < 0.0
        low[active] = np.where(down, guess, start)
        slope_low[active] = np.where(down, slope, falling)
        high[active] = np.where(down, stop, guess)
        slope_high[active] = np.where(down, rising, slope)
        flattest = np.minimum(-slope_low[active], slope_high[active])
        # The search ends when no point of the segment can be lower than the lowest so far by more
        # than this, m.
        active = active[flattest * (high[active] - low[active]) > 1e-9]
        if not active.size:
            break
    return least


_Vector = tuple[FloatArray, FloatArray, FloatArray]


def _segment(observer: ArrayLike, target: ArrayLike) -> tuple[_Vector, _Vector]:
    """Return the components of the observer's position and of the way to the target."""
    ox, oy, oz = components(observer)
    tx, ty, tz = components(target)
    return (ox, oy, oz), (tx - ox, ty - oy, tz - oz)


def _slope(
    observer: FloatArray, target: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the change of height with the share of the segment covered, and the height there,
    m.
    """
    (ox, oy, oz), (dx, dy, dz) = _segment(observer, target)
    up = normal(ox + share * dx, oy + share * dy, oz + share * dz)
    return up.x * dx + up.y * dy + up.z * dz, up.height


@np.errstate(all="ignore")
def intersection_with_ellipsoid(
    origin_ecef_m: ArrayLike, direction: ArrayLike, height_m: ArrayLike = 0.0
) -> FloatArray:
    """Return the first points (..., 3), m, at which rays meet the ellipsoid with both semi-axes
    longer by `height_m`.

    Origins in ECEF (..., 3), m; directions in ECEF (..., 3), of any length but 0. From inside it is
    the point where the ray leaves. `nan` for a miss, a ray that points away, a direction of length
    0, a height without an ellipsoid, and anything not finite. An origin on the ellipsoid counts as
    inside or outside by rounding.

    The longer ellipsoid differs from the surface of constant height by at most 0.3 m at 100 km.
    Errors along the ray are rounding: 2e-9 m from a low orbit and 2e-8 m from a geostationary one,
    divided by the sine of the angle between ray and ground. Source: the ray and the unit sphere,
    after each axis is divided by its semi-axis, with the discriminant from the cross product, which
    does not cancel for grazing rays.
    """
    height = floats(height_m)
    a = WGS84.equatorial_radius_m + height
    b = WGS84.polar_radius_m + height
    ox, oy, oz = components(origin_ecef_m)
    dx, dy, dz = components(direction)
    x = ox / a
    y = oy / a
    z = oz / b
    u = dx / a
    v = dy / a
    w = dz / b
    speed = length(u, v, w)
    moment = length(y * w - z * v, z * u - x * w, x * v - y * u)
    root = np.sqrt((speed - moment) * (speed + moment))
    radius = length(x, y, z)
    along = x * u + y * v + z * w
    outside = (radius - 1.0) * (radius + 1.0)
    # Two forms of each root of the quadratic: the one whose terms have one sign.
    entry = np.where(along < 0.0, outside / (root - along), np.nan)
    leave = np.where(along <= 0.0, (root - along) / (speed * speed), -outside / (root + along))
    step = np.where((b > 0.0) & (speed > 0.0), np.where(outside > 0.0, entry, leave), np.nan)
    return vector(ox + step * dx, oy + step * dy, oz + step * dz)


class _Dip(NamedTuple):
    """Whether segments are level between their ends, the height of their lines there, and of the
    lower end, m.
    """

    is_between: BoolArray
    line_height: FloatArray
    end_height: FloatArray


@np.errstate(all="ignore")
def grazing_height_m(
    observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike, *, exact_above_m: float = -np.inf
) -> FloatArray:
    """Return the least height above the WGS 84 ellipsoid of the segments between two ECEF points
    (..., 3), m.

    Ends count: without a minimum between them it is the height of the lower end. Negative where the
    segment runs through the Earth. Exact up to rounding: 5e-9 m near the Earth, 3e-8 m with an end
    at geostationary distance. Not finite: `nan`. A height below `exact_above_m` may be replaced by
    an upper bound that is below it too, which costs no search.
    """
    dip = _dip(observer_ecef_m, target_ecef_m)
    height = select(dip.is_between, np.minimum(dip.line_height, dip.end_height), dip.end_height)
    searched = dip.is_between & (dip.line_height < 0.0)
    if exact_above_m > -np.inf:
        bound_m = closest_to_centre_m(observer_ecef_m, target_ecef_m) - _B
        is_deep = searched & (bound_m < exact_above_m)
        height = select(is_deep, bound_m, height)
        searched = searched & ~is_deep
    return _with_depths(height, observer_ecef_m, target_ecef_m, searched)


@np.errstate(all="ignore")
def is_occluded(
    observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike, grazing_height_m: ArrayLike = 0.0
) -> BoolArray:
    """Return whether the segment between two ECEF points (..., 3), m, has a minimum below a height.

    The minimum is between the ends, less than `grazing_height_m` above the WGS 84 ellipsoid. Ends
    do not occlude: a target on the ground, or below the margin, is visible from above its horizon.
    Points that are not finite are occluded.
    """
    margin = floats(grazing_height_m)
    dip = _dip(observer_ecef_m, target_ecef_m)
    searched = dip.is_between & (dip.line_height < 0.0) & (margin < 0.0)
    height = _with_depths(dip.line_height, observer_ecef_m, target_ecef_m, searched)
    return (dip.is_between & (height < margin)) | np.isnan(dip.end_height)


def closest_to_centre_m(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> FloatArray:
    """Return the least distance of segments (..., 3) from the Earth's centre, m.

    Their height there is at most this minus the polar radius, for the sphere of that radius lies in
    the ellipsoid.
    """
    (ox, oy, oz), (dx, dy, dz) = _segment(observer_ecef_m, target_ecef_m)
    share = -(ox * dx + oy * dy + oz * dz) / (dx * dx + dy * dy + dz * dz + NEVER_ZERO)
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    return length(ox + share * dx, oy + share * dy, oz + share * dz)


def _dip(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> _Dip:
    """Return the minima of height along the segments."""
    (ox, oy, oz), (dx, dy, dz) = _segment(observer_ecef_m, target_ecef_m)
    tx, ty, tz = components(target_ecef_m)
    observer = normal(ox, oy, oz)
    target = normal(tx, ty, tz)
    falls = observer.x * dx + observer.y * dy + observer.z * dz < 0.0
    rises = target.x * dx + target.y * dy + target.z * dz > 0.0
    # From the end nearer to the Earth: an error of direction has the shorter arm there.
    is_lower = tx * tx + ty * ty + tz * tz < ox * ox + oy * oy + oz * oz
    px = select(is_lower, tx, ox)
    py = select(is_lower, ty, oy)
    pz = select(is_lower, tz, oz)
    return _Dip(
        falls & rises,
        _line_height(px, py, pz, dx, dy, dz),
        np.minimum(observer.height, target.height),
    )


def _line_height(
    px: FloatArray, py: FloatArray, pz: FloatArray, dx: FloatArray, dy: FloatArray, dz: FloatArray
) -> FloatArray:
    """Return the distances, m, of infinite lines from the ellipse that is the ellipsoid seen along
    them.

    Minus infinity for a line through the ellipsoid. The axes of the view are the horizontal across
    the line and the remainder of z.
    """
    level = np.sqrt(dx * dx + dy * dy)
    distance = length(dx, dy, dz)
    sine = dz / (distance + NEVER_ZERO)
    cosine = select(distance < NEVER_ZERO, 1.0, level / (distance + NEVER_ZERO))
    upright = level < NEVER_ZERO
    ux = select(upright, 1.0, dx / (level + NEVER_ZERO))
    uy = select(upright, 0.0, dy / (level + NEVER_ZERO))
    across = np.abs(py * ux - px * uy)
    above = pz * cosine - (px * ux + py * uy) * sine
    semi_minor = np.sqrt(_B * _B * cosine * cosine + _A * _A * sine * sine)
    pierced = np.square(across / _A) + np.square(above / semi_minor) < 1.0
    across = select(pierced, _A, across)
    view_sine, view_cosine = normal_at_foot(across, above, _A, semi_minor)
    height = height_along_normal(across, above, view_sine, view_cosine, _A, semi_minor)
    return select(pierced, -np.inf, height)


def _with_depths(
    height: FloatArray,
    observer_ecef_m: ArrayLike,
    target_ecef_m: ArrayLike,
    searched: BoolArray,
) -> FloatArray:
    """Return heights, with a search for the segments that run through the Earth."""
    if not np.any(searched):
        return height
    shape = (*np.broadcast_shapes(np.shape(height), np.shape(searched)), 3)
    where = np.broadcast_to(searched, shape[:-1])
    observer = np.broadcast_to(floats(observer_ecef_m), shape)[where]
    target = np.broadcast_to(floats(target_ecef_m), shape)[where]
    deepened = np.array(np.broadcast_to(height, shape[:-1]))
    deepened[where] = least_height_inside_m(observer, target)
    return deepened[()]
