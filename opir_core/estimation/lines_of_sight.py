"""Rays: the lines of sight of detections, and what each says about the track it is held against."""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.records import Detections

#: Fewer rows than this are added up by numpy's reduction, more column by column: the same sums, each way sooner there.
FEW = 80

#: No line of sight is taken for better than this, rad: a metre from geostationary height. Of 0.01 µrad and less, what
#: paths within a slice leave out is more than the error, and targets lose their tracks; of 0.03 µrad none does
#: (measured, an ICBM that one or two scanners see).
LEAST_SIGMA_RAD = 3e-8


@frozen(eq=False)
class LinesOfSight(Columns):
    """Lines of sight, one row each: scene time of the look, sensor, its scan, where from and where to in ECEF, error.

    `direction_ecef` (n, 3) are unit vectors; `sigma_rad` the standard deviation of each of two angles across, as a
    tracker takes it: of detections never less than `LEAST_SIGMA_RAD`.
    """

    time_s: FloatArray
    sensor: IndexArray
    scan: IntArray
    origin_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def of(cls, detections: Detections) -> "LinesOfSight":
        """Return the rays of detections."""
        return cls(
            detections.time_s,
            detections.sensor,
            detections.scan,
            detections.sensor_ecef_m,
            detections.line_of_sight_ecef,
            np.maximum(detections.line_of_sight_sigma_rad, LEAST_SIGMA_RAD),
        )

    def of_instants(self) -> "LinesOfSight":
        """Return the rays as if each instant of a sensor were a scan of its own."""
        scan = np.rint(self.time_s * 1e9).astype(np.int64)
        return LinesOfSight(self.time_s, self.sensor, scan, self.origin_ecef_m, self.direction_ecef, self.sigma_rad)


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

    def missed(self, position_m: FloatArray) -> FloatArray:
        """Return whitened residuals (n, 2) at positions (n, 3)."""
        local = along(self.axes, position_m - self.origin_m)
        return along(self.whitener, self.seen - local[:, :2] / local[:, 2:])

    def residuals(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened residuals (n, 2) at positions (n, 3), and what y gains a metre there, whitened, (n, 2, 3)."""
        return self.whitened().projected(position_m)[:2]

    def whitened(self) -> "Planes":
        """Return the planes of the sights in units of their errors."""
        axes, sharp = self.axes.copy(), self.whitener[:, 0, 0]
        many = len(sharp) >= FEW and np.count_nonzero(self.whitener) == 2 * len(sharp)
        if many and np.array_equal(self.whitener[:, 1, 1], sharp):
            axes[:, :2] *= sharp[:, None, None]
            return Planes(self.origin_m, axes, self.seen * sharp[:, None])
        axes[:, :2] = self.whitener @ self.axes[:, :2]
        return Planes(self.origin_m, axes, along(self.whitener, self.seen))


class Planes(NamedTuple):
    """The planes of sights in units of their errors: the first two `axes` are E whitened, `aim` (n, 2) is `seen`."""

    origin_m: FloatArray
    axes: FloatArray
    aim: FloatArray

    def projected(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals and slopes as `Sights.residuals` does, and depths along z, m, at positions (..., n, 3)."""
        local = along(self.axes, position_m - self.origin_m)
        depth = local[..., 2]
        y = local[..., :2] / depth[..., None]
        slope = self.axes[:, :2] - y[..., None] * self.axes[:, 2:]
        slope /= depth[..., None, None]
        return self.aim - y, slope, depth


def no_rays() -> LinesOfSight:
    """Return the record of no rays."""
    whole, none = np.empty(0, dtype=np.int64), np.empty((0, 3))
    return LinesOfSight(np.empty(0), np.empty(0, dtype=np.int32), whole, none, none, np.empty(0))


def no_sights() -> Sights:
    """Return the record of no sights."""
    none, square = np.empty((0, 3)), np.empty((0, 2, 2))
    return Sights(np.empty(0, dtype=np.int64), np.empty(0), none, np.empty((0, 3, 3)), np.empty((0, 2)), square)


def emission_s(time_s: FloatArray, range_m: FloatArray | float, light_time: bool) -> FloatArray:
    """Return when light seen at scene times (n,) left a distance (n,) away."""
    return time_s - range_m / SPEED_OF_LIGHT_M_S if light_time else time_s


def turned(vectors: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return ECEF vectors (n, 3) in the inertial frame at scene times (n,)."""
    out = vectors.copy()
    plane = np.ascontiguousarray(out[:, :2])
    plane.view(np.complex128)[:, 0] *= _spun(time_s)
    out[:, :2] = plane
    return out


def both_turned(first: FloatArray, second: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return two vectors (n, 3) each in ECEF in the inertial frame at scene times (n,), as (2, n, 3)."""
    out = np.empty((2, *first.shape))
    out[0], out[1] = first, second
    plane = np.ascontiguousarray(out[:, :, :2])
    plane.view(np.complex128)[:, :, 0] *= _spun(time_s)
    out[:, :, :2] = plane
    return out


def turn_slightly(vectors: FloatArray, later_s: FloatArray) -> None:
    """Turn inertial vectors (k, n, 3) of places on Earth to what they are times (n,) later, in place.

    To first order: of a vector 4e-11 of its length is left in 0.1 s.
    """
    angle = EARTH_ROTATION_RAD_S * later_s
    x, y = vectors[:, :, 0], vectors[:, :, 1]
    aside = angle * x
    x -= angle * y
    y += aside


def _spun(time_s: FloatArray) -> NDArray[np.complex128]:
    """Return what x + i y in ECEF is multiplied by (n,) in the inertial frame at scene times (n,)."""
    angle = EARTH_ROTATION_RAD_S * time_s
    factor = np.empty(angle.shape, dtype=np.complex128)
    factor.real, factor.imag = np.cos(angle), np.sin(angle)
    return factor


def axes_across(direction: FloatArray) -> FloatArray:
    """Return right-handed orthonormal axes (n, 3, 3) as rows whose third is the unit vectors (n, 3) given.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6 (2017): smooth everywhere but across z = 0.
    """
    x, y, z = np.ascontiguousarray(direction.T)
    sign, low = np.copysign(1.0, z), np.abs(z)
    low += 1.0
    across_x, across_y = x / low, y / low
    axes = np.empty((len(direction), 3, 3))
    # (0, 0, 1) is turned to the direction: all rows follow from the outer product of their sum.
    np.subtract(1.0, across_x * x, out=axes[:, 0, 0])
    both = np.negative(across_x * y, out=axes[:, 0, 1])
    np.negative(sign * x, out=axes[:, 0, 2])
    np.multiply(both, sign, out=axes[:, 1, 0])
    np.multiply(sign, 1.0 - across_y * y, out=axes[:, 1, 1])
    np.negative(y, out=axes[:, 1, 2])
    axes[:, 2] = direction
    return axes


def along(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the products (..., n, r) of matrices (n, r, c) and vectors (n, c), or some such (k, n, c)."""
    if vectors.shape[-2] < FEW:
        few: FloatArray = (matrix @ vectors[..., None])[..., 0]
        return few
    if vectors.ndim == 2:
        product: FloatArray = np.einsum("nrc,nc->nr", matrix, vectors)
        return product
    return np.array([along(matrix, some) for some in vectors])


def dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the products (n,) of vectors (n, 2) or (n, 3), added up in order."""
    if len(first) < FEW:
        few: FloatArray = np.add.reduce(first * second, axis=1)
        return few
    total: FloatArray = first[:, 0] * second[:, 0]
    for column in range(1, first.shape[1]):
        total += first[:, column] * second[:, column]
    return total
