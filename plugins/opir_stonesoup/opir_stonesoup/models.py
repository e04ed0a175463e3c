"""opir's motion and measurement models as Stone Soup models.

States are Earth-fixed (ECEF, WGS 84): position, velocity relative to the Earth and, depending on
the motion, specific force (all but gravity) and its rate; metres and seconds, x, y, z each.
"""

from datetime import timedelta
from typing import Any

import numpy as np
from attrs import evolve
from opir_estimation import BOOST, Motion, earth_rotated
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel, TimeVariantModel
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
from stonesoup.models.transition.base import TransitionModel
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.flight import ForceModel, Forces, forces_of

#: Size of the state of each motion.
SIZES = {"two-body": 6, "acceleration": 9, "jerk": 12}

_SPIN = EARTH_ROTATION_RAD_S * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


class EarthFixedTransition(TransitionModel, GaussianModel, TimeVariantModel):  # type: ignore[misc]
    """Motion under gravity in ECEF, with white noise in the last derivative of the state.

    Two-body motion (6; with the zonal harmonics of `forces`), a nearly constant specific force (9),
    or a nearly constant rate of it (12): `opir_estimation.motion` in ECEF. Drag is neglected.
    """

    ndim_state: int = Property(default=9, doc="6, 9 or 12")
    noise: float = Property(default=2.0, doc="standard deviation of the last derivative per √s")
    forces: Any = Property(default="kepler", doc='"kepler" or `opir_core.flight.Forces`')

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._motion = Motion(self.ndim_state, self.noise, free_forces(self.forces))
        self._full_motion = (
            evolve(self._motion, size=max(self.ndim_state, BOOST))
            if self.ndim_state > 6
            else self._motion
        )

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """Return the state vector (d, 1), or vectors (d, n), after `time_interval`."""
        if isinstance(noise, bool) or noise is None:
            noise = self.rvs(num_samples=state.state_vector.shape[1], **kwargs) if noise else 0
        step_s = _seconds(kwargs["time_interval"])
        columns = np.asarray(state.state_vector, dtype=np.float64)
        start = np.zeros((columns.shape[1], self._full_motion.size))
        start[:, : self.ndim_state] = (inertial_matrix(self.ndim_state) @ columns).T
        end = self._full_motion.propagated(start, np.full(len(start), step_s))
        end = end[:, : self.ndim_state].T
        kind = StateVector if columns.shape[1] == 1 else StateVectors
        return kind(_earth_fixed(self.ndim_state, step_s) @ end) + noise

    def jacobian(self, state: Any, **kwargs: Any) -> FloatArray:
        """Return the transition matrix (d, d), a series with the gradient at the start."""
        step_s = _seconds(kwargs["time_interval"])
        position = np.asarray(state.state_vector[:3], dtype=np.float64).reshape(1, 3)
        matrix = self._motion.transition(position, np.array([step_s]))[0]
        return np.asarray(
            _earth_fixed(self.ndim_state, step_s) @ matrix @ inertial_matrix(self.ndim_state)
        )

    def covar(self, **kwargs: Any) -> Any:
        """Return the process-noise covariance (d, d) of `time_interval`."""
        step_s = _seconds(kwargs["time_interval"])
        root = self._motion.noise_root(np.array([step_s]))
        if root is None:
            return CovarianceMatrix(np.zeros((self.ndim_state, self.ndim_state)))
        side = _earth_fixed(self.ndim_state, step_s) @ root[0]
        return CovarianceMatrix(side @ side.T)


class SightModel(CartesianToElevationBearing):  # type: ignore[misc]
    """Elevation and bearing of a target from a sensor in ECEF, including light time.

    `axes` (3, 3) are the sensor's, as rows in ECEF: bearing is from the first towards the second,
    elevation from their plane towards the third. `translation_offset` is the sensor position at the
    look, m. The state is that at the look; light was emitted range/c before.
    """

    axes: Any = Property(default=None, doc="the sensor's axes as rows in ECEF")
    light_time: bool = Property(default=True, doc="whether light takes its time")

    @property
    def rotation_matrix(self) -> FloatArray:
        """Return the sensor's axes (3, 3), rows in ECEF; without `axes` those of ECEF."""
        return np.eye(3) if self.axes is None else np.asarray(self.axes)

    def _function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        if isinstance(noise, bool) or noise is None:
            noise = self.rvs(num_samples=state.state_vector.shape[1], **kwargs) if noise else 0
        x, y, z = self._emission(np.asarray(state.state_vector, dtype=np.float64))[0]
        return StateVectors([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)]) + noise

    def jacobian(self, state: Any, **_: Any) -> FloatArray:
        """Return the Jacobian (2, d) of elevation and bearing by the state."""
        columns = np.asarray(state.state_vector, dtype=np.float64)
        local, delay, direction = self._emission(columns)
        x, y, z = local[:, 0]
        horizontal2 = x * x + y * y
        range2 = horizontal2 + z * z
        horizontal = np.sqrt(horizontal2)
        elevation = [
            -x * z / (horizontal * range2),
            -y * z / (horizontal * range2),
            horizontal / range2,
        ]
        bearing = [-y / horizontal2, x / horizontal2, 0.0]
        slope = np.array([elevation, bearing]) @ self.rotation_matrix
        velocity = columns[3:6, 0]
        matrix = np.zeros((2, len(columns)))
        matrix[:, :3] = (
            slope
            - (slope @ velocity)[:, None] * direction[:, 0] / SPEED_OF_LIGHT_M_S * self.light_time
        )
        matrix[:, 3:6] = -delay[0] * slope
        return matrix

    def _emission(self, columns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions (3, n) at emission in the sensor's axes, delays (n,), directions (3, n).

        Directions are unit vectors from the sensor, ECEF.
        """
        offset = columns[:3] - np.asarray(self.translation_offset, dtype=np.float64)
        range_m = np.sqrt((offset * offset).sum(axis=0))
        delay = range_m / SPEED_OF_LIGHT_M_S * self.light_time
        return self.rotation_matrix @ (offset - delay * columns[3:6]), delay, offset / range_m


def free_forces(forces: ForceModel) -> Forces:
    """Return the forces of a scene without drag."""
    forces_with_drag = forces_of(forces)
    return Forces(zonal=forces_with_drag.zonal, gravity=forces_with_drag.gravity)


def sensor_axes(sensor_ecef_m: FloatArray) -> FloatArray:
    """Return a sensor's axes (3, 3), rows in ECEF: to the Earth's centre, west, north.

    They are right-handed. On the Earth's axis they are those at longitude 0.
    """
    down = -sensor_ecef_m / np.sqrt((sensor_ecef_m * sensor_ecef_m).sum())
    length = np.hypot(down[0], down[1])
    west = (
        np.array([-down[1], down[0], 0.0]) / length if length > 1e-9 else np.array([0.0, -1.0, 0.0])
    )
    return np.array([down, west, np.cross(down, west)])


def _seconds(interval: timedelta) -> float:
    return interval.total_seconds()


def inertial_matrix(size: int) -> FloatArray:
    """Return the matrix (d, d) from ECEF to the inertial frame with the same axes now."""
    matrix = np.eye(size)
    matrix[3:6, :3] = _SPIN
    return matrix


def _earth_fixed(size: int, step_s: float) -> FloatArray:
    """Return the matrix (d, d) to ECEF from the inertial frame of `step_s` ago."""
    turn = earth_rotated(np.eye(3), np.full(3, -step_s)).T
    matrix: FloatArray = np.zeros((size, size))
    for block in range(0, size, 3):
        matrix[block : block + 3, block : block + 3] = turn
    matrix[3:6, :3] = -turn @ _SPIN
    return matrix
