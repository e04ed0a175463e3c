"""Rays: the lines of sight of detections, and what each says about the track it is held against."""

import numpy as np
from attrs import evolve, frozen

from opir_core.columns import Columns
from opir_core.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.records import Detections, FloatArray, IndexArray, IntArray

#: Fewer rows than this are added up by numpy's reduction, more column by column: the same sums, each way sooner there.
_FEW = 80


@frozen(eq=False)
class Rays(Columns):
    """Lines of sight, one row each: scene time of the look, sensor, its scan, where from and where to in ECEF, error.

    `direction_ecef` (n, 3) are unit vectors; `sigma_rad` the standard deviation of each of two angles across.
    """

    time_s: FloatArray
    sensor: IndexArray
    scan: IntArray
    origin_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def of(cls, detections: Detections) -> "Rays":
        """Return the rays of detections."""
        return cls(
            detections.time_s,
            detections.sensor,
            detections.scan,
            detections.sensor_ecef_m,
            detections.line_of_sight_ecef,
            detections.line_of_sight_sigma_rad,
        )


@frozen(eq=False)
class Sights(Columns):
    """What rays say of tracks: two whitened residuals each, in the plane across a reference direction.

    A point p is seen at y = E (p - origin) / (z · (p - origin)), with E the first two rows of `axes` (n, 3, 3) and z
    the third; the residuals are `whitener` (n, 2, 2) times (`seen` (n, 2) - y). `track` is a row of the bank, `time_s`
    when the light left, and all vectors are inertial.
    """

    track: IntArray
    time_s: FloatArray
    origin_m: FloatArray
    axes: FloatArray
    seen: FloatArray
    whitener: FloatArray

    def placed(self, track: IntArray) -> "Sights":
        """Return the sights as those of other rows of a bank."""
        return evolve(self, track=track)

    def residuals(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened residuals (n, 2) at positions (n, 3), and what y gains a metre there, whitened, (n, 2, 3)."""
        local = along(self.axes, position_m - self.origin_m)
        depth = local[:, 2]
        y = local[:, :2] / depth[:, None]
        slope = (self.axes[:, :2] - y[:, :, None] * self.axes[:, None, 2]) / depth[:, None, None]
        return along(self.whitener, self.seen - y), self.whitener @ slope


def alike(one: Rays, other: Rays) -> bool:
    """Return whether two records hold the same rays, whatever scan they are taken for parts of."""
    if len(one) != len(other):
        return False
    names = ("time_s", "sensor", "direction_ecef", "origin_ecef_m", "sigma_rad")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def no_rays() -> Rays:
    """Return the record of no rays."""
    whole, none = np.empty(0, dtype=np.int64), np.empty((0, 3))
    return Rays(np.empty(0), np.empty(0, dtype=np.int32), whole, none, none, np.empty(0))


def no_sights() -> Sights:
    """Return the record of no sights."""
    none, square = np.empty((0, 3)), np.empty((0, 2, 2))
    return Sights(np.empty(0, dtype=np.int64), np.empty(0), none, np.empty((0, 3, 3)), np.empty((0, 2)), square)


def emission_s(time_s: FloatArray, range_m: FloatArray, light_time: bool) -> FloatArray:
    """Return when light seen at scene times (n,) left a distance (n,) away."""
    return time_s - range_m / SPEED_OF_LIGHT_M_S if light_time else time_s


def turned(vectors: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return ECEF vectors (n, 3) in the inertial frame at scene times (n,)."""
    angle = EARTH_ROTATION_RAD_S * time_s
    cosine, sine = np.cos(angle), np.sin(angle)
    out = vectors.copy()
    out[:, 0] = cosine * vectors[:, 0] - sine * vectors[:, 1]
    out[:, 1] = sine * vectors[:, 0] + cosine * vectors[:, 1]
    return out


def axes_across(direction: FloatArray) -> FloatArray:
    """Return right-handed orthonormal axes (n, 3, 3) as rows whose third is the unit vectors (n, 3) given.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6 (2017): smooth everywhere but across z = 0.
    """
    x, y, z = direction[:, 0], direction[:, 1], direction[:, 2]
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes = np.empty((len(direction), 3, 3))
    axes[:, 0, 0], axes[:, 0, 1], axes[:, 0, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    axes[:, 1, 0], axes[:, 1, 1], axes[:, 1, 2] = b, sign + y * y * a, -y
    axes[:, 2] = direction
    return axes


def along(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the products (n, r) of matrices (n, r, c) and vectors (n, c), added up in order of the columns."""
    if len(vectors) < _FEW:
        few: FloatArray = np.add.reduce(matrix * vectors[:, None, :], axis=2)
        return few
    product: FloatArray = matrix[:, :, 0] * vectors[:, :1]
    for column in range(1, vectors.shape[1]):
        product += matrix[:, :, column] * vectors[:, column, None]
    return product


def dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the products (n,) of vectors (n, 3), added up in order."""
    if len(first) < _FEW:
        few: FloatArray = np.add.reduce(first * second, axis=1)
        return few
    total: FloatArray = first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1] + first[:, 2] * second[:, 2]
    return total
