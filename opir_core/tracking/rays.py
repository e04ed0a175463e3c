"""Rays: the lines of sight of detections, and what each says about the track it is held against."""

import numpy as np
from attrs import evolve, frozen

from opir_core.columns import Columns
from opir_core.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.records import Detections, FloatArray, IndexArray, IntArray

#: Fewer rows than this are added up by numpy's reduction, more column by column: the same sums, each way sooner there.
FEW = 80


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

    def of_instants(self) -> "Rays":
        """Return the rays as if each instant of a sensor were a scan of its own."""
        scan = np.rint(self.time_s * 1e9).astype(np.int64)
        return Rays(self.time_s, self.sensor, scan, self.origin_ecef_m, self.direction_ecef, self.sigma_rad)


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
        return self.projected(position_m)[:2]

    def projected(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals and slopes as `residuals` does, and distances along z, m, of positions (..., n, 3)."""
        local = along(self.axes, position_m - self.origin_m)
        depth = local[..., 2]
        y = local[..., :2] / depth[..., None]
        slope = (self.axes[:, :2] - y[..., None] * self.axes[:, 2:]) / depth[..., None, None]
        return along(self.whitener, self.seen - y), self.whitener @ slope, depth


def alike(one: Rays, other: Rays) -> bool:
    """Return whether two records hold the same rays, to the last bit, whatever scan they are taken for parts of."""
    if len(one) != len(other):
        return False
    names = ("time_s", "sensor", "direction_ecef", "origin_ecef_m", "sigma_rad")
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in names)


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


def both_turned(first: FloatArray, second: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two vectors (n, 3) each in ECEF in the inertial frame at scene times (n,)."""
    angle = EARTH_ROTATION_RAD_S * time_s
    cosine, sine = np.cos(angle), np.sin(angle)
    out = np.array([first, second])
    x, y = out[:, :, 0], out[:, :, 1]
    out[:, :, 0], out[:, :, 1] = cosine * x - sine * y, sine * x + cosine * y
    return out[0], out[1]


def axes_across(direction: FloatArray) -> FloatArray:
    """Return right-handed orthonormal axes (n, 3, 3) as rows whose third is the unit vectors (n, 3) given.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6 (2017): smooth everywhere but across z = 0.
    """
    sign = np.copysign(1.0, direction[:, 2])
    turned_by = direction.copy()
    turned_by[:, 2] += sign
    # (0, 0, 1) is turned to the direction: all rows follow from the outer product of their sum.
    axes = (turned_by / -np.abs(turned_by[:, 2:]))[:, :, None] * turned_by[:, None]
    axes[:, 0, 0] += 1.0
    axes[:, 1, 1] += 1.0
    axes[:, 1] *= sign[:, None]
    axes[:, 2] = direction
    return axes


def along(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the products (..., n, r) of matrices (n, r, c) and vectors (..., n, c), added up in order of columns."""
    if vectors.shape[-2] < FEW:
        few: FloatArray = np.add.reduce(matrix * vectors[..., None, :], axis=-1)
        return few
    product: FloatArray = matrix[..., 0] * vectors[..., :1]
    for column in range(1, vectors.shape[-1]):
        product += matrix[..., column] * vectors[..., column, None]
    return product


def dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the products (n,) of vectors (n, 3), added up in order."""
    if len(first) < FEW:
        few: FloatArray = np.add.reduce(first * second, axis=1)
        return few
    total: FloatArray = first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1] + first[:, 2] * second[:, 2]
    return total
