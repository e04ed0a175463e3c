"""Lines of sight of detections, and the angle measurements that they give of tracks."""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.interfaces import Columns
from opir_core.plugin import Detections
from opir_estimation.directions import FEW_ROWS, matvec

#: Lower bound on the standard deviation of a line of sight at its target, m: with less, the model
#: error of the path within a slice exceeds the noise and tracks are lost (at 0.4 m, of an ICBM seen
#: by one or two geostationary scanners; at 1 m none is). A sensor in a low orbit has the same bound
#: in metres, so a larger angle.
LEAST_SIGMA_M = 1.0

#: Least height of a sensor for this, m.
_LOWEST_M = 100e3

#: Cross product with the Earth's rotation, 1/s.
SPIN = EARTH_ROTATION_RAD_S * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


@frozen(eq=False, repr=False)
class LinesOfSight(Columns):
    """Lines of sight, one row each: scene time of the look, sensor, scan, origin and direction in
    ECEF, error.

    `direction_ecef` (n, 3) are unit vectors; `sigma_rad` is the standard deviation of each of the
    two angles across the line, at least `LEAST_SIGMA_M` as far away as the ground below the sensor.
    """

    time_s: FloatArray
    sensor: IndexArray
    scan: IntArray
    origin_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def of(cls, detections: Detections) -> "LinesOfSight":
        """Return the lines of sight of detections."""
        return cls(
            detections.time_s,
            detections.sensor,
            detections.scan,
            detections.sensor_ecef_m,
            detections.line_of_sight_ecef,
            np.maximum(
                detections.line_of_sight_sigma_rad, least_sigma_rad(detections.sensor_ecef_m)
            ),
        )

    def ranges_m(self, point_m: FloatArray) -> FloatArray:
        """Return the distances (n,), m, of points (n, 3), in ECEF, from the origins."""
        return np.sqrt(np.sum((point_m - self.origin_ecef_m) ** 2, axis=1))

    def of_instants(self) -> "LinesOfSight":
        """Return the lines of sight with each instant of a sensor as a scan of its own."""
        scan = np.rint(self.time_s * 1e9).astype(np.int64)
        return LinesOfSight(
            self.time_s, self.sensor, scan, self.origin_ecef_m, self.direction_ecef, self.sigma_rad
        )


def least_sigma_rad(origin_ecef_m: FloatArray) -> FloatArray:
    """Return lower bounds (n,), rad, of sensors at positions (n, 3)."""
    height = (
        np.sqrt(np.add.reduce(origin_ecef_m * origin_ecef_m, axis=1)) - EARTH_EQUATORIAL_RADIUS_M
    )
    return LEAST_SIGMA_M / np.maximum(height, _LOWEST_M)


@frozen(eq=False, repr=False)
class AngleMeasurements(Columns):
    """Angle measurements of tracks in the tangent plane of a reference direction; two whitened
    residuals each.

    A point p projects to y = E (p - origin) / (z · (p - origin)), where E is the first two rows of
    `axes` (n, 3, 3) and z the third. The residuals are `whitener` (n, 2, 2) times (`measured` (n,
    2) - y). `track` is a row of the estimates, `time_s` the time of emission; vectors are inertial.
    """

    track: IntArray
    time_s: FloatArray
    origin_m: FloatArray
    axes: FloatArray
    measured: FloatArray
    whitener: FloatArray

    def with_track(self, track: IntArray) -> "AngleMeasurements":
        """Return the measurements with other track rows."""
        return evolve(self, track=track)

    def residuals(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened residuals (n, 2) at positions (n, 3) and the whitened Jacobian (n, 2, 3)
        of y, 1/m.
        """
        return self.whitened().projected(position_m)[:2]

    def whitened(self) -> "TangentPlanes":
        """Return the tangent planes scaled to unit measurement noise."""
        axes = self.axes.copy()
        sharp = self.whitener[:, 0, 0]
        is_uniform = len(sharp) >= FEW_ROWS and np.count_nonzero(self.whitener) == 2 * len(sharp)
        if is_uniform and np.array_equal(self.whitener[:, 1, 1], sharp):
            axes[:, :2] *= sharp[:, None, None]
            return TangentPlanes(self.origin_m, axes, self.measured * sharp[:, None])
        axes[:, :2] = self.whitener @ self.axes[:, :2]
        return TangentPlanes(self.origin_m, axes, matvec(self.whitener, self.measured))


class TangentPlanes(NamedTuple):
    """Tangent planes scaled to unit noise: `axes` with E whitened, and `aim` (n, 2), `measured`
    whitened.
    """

    origin_m: FloatArray
    axes: FloatArray
    aim: FloatArray

    def projected(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals and Jacobians as `AngleMeasurements.residuals`, and depths, m, at
        positions (..., n, 3).
        """
        local = matvec(self.axes, position_m - self.origin_m)
        depth = local[..., 2]
        y = local[..., :2] / depth[..., None]
        slope = self.axes[:, :2] - y[..., None] * self.axes[:, 2:]
        slope /= depth[..., None, None]
        return self.aim - y, slope, depth


def no_lines_of_sight() -> LinesOfSight:
    """Return an empty record of lines of sight."""
    numbers = np.empty(0, dtype=np.int64)
    none = np.empty((0, 3))
    return LinesOfSight(np.empty(0), np.empty(0, dtype=np.int32), numbers, none, none, np.empty(0))


def no_measurements() -> AngleMeasurements:
    """Return an empty record of measurements."""
    none = np.empty((0, 3))
    square = np.empty((0, 2, 2))
    return AngleMeasurements(
        np.empty(0, dtype=np.int64),
        np.empty(0),
        none,
        np.empty((0, 3, 3)),
        np.empty((0, 2)),
        square,
    )


def emission_s(time_s: FloatArray, range_m: FloatArray | float, light_time: bool) -> FloatArray:
    """Return emission times (n,) of light received at scene times (n,) from a range (n,), m."""
    return time_s - range_m / SPEED_OF_LIGHT_M_S if light_time else time_s


def earth_rotated(vectors: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return ECEF vectors (n, 3) in the inertial frame at scene times (n,); negative times give the
    inverse.
    """
    out = vectors.copy()
    plane = np.ascontiguousarray(out[:, :2])
    plane.view(np.complex128)[:, 0] *= _rotation_factor(time_s)
    out[:, :2] = plane
    return out


def ground_velocities(position: FloatArray) -> FloatArray:
    """Return the inertial velocities (n, 3) of what turns with the Earth at positions (n, 3)."""
    x, y, _ = position.T
    return EARTH_ROTATION_RAD_S * np.stack([-y, x, np.zeros(len(x))], axis=1)


def both_earth_rotated(origin: FloatArray, direction: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return two sets of ECEF vectors (n, 3) in the inertial frame at scene times (n,), as (2, n,
    3).
    """
    out = np.empty((2, *origin.shape))
    out[0] = origin
    out[1] = direction
    plane = np.ascontiguousarray(out[:, :, :2])
    plane.view(np.complex128)[:, :, 0] *= _rotation_factor(time_s)
    out[:, :, :2] = plane
    return out


def rotate_slightly(vectors: FloatArray, later_s: FloatArray) -> None:
    """Rotate inertial vectors (k, n, 3) of Earth-fixed points to times (n,) later, in place.

    First order: the relative error is 4e-11 for 0.1 s.
    """
    angle = EARTH_ROTATION_RAD_S * later_s
    x = vectors[:, :, 0]
    y = vectors[:, :, 1]
    aside = angle * x
    x -= angle * y
    y += aside


def _rotation_factor(time_s: FloatArray) -> NDArray[np.complex128]:
    """Return the complex factor (n,) that takes x + i y from ECEF to the inertial frame at scene
    times (n,).
    """
    angle = EARTH_ROTATION_RAD_S * time_s
    factor = np.empty(angle.shape, dtype=np.complex128)
    factor.real = np.cos(angle)
    factor.imag = np.sin(angle)
    return factor
