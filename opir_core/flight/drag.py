"""Gravity and drag together, for arcs each of which stays within one layer of the air."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.atmosphere_density import log_density, log_density_alone
from opir_core.flight.ellipsoidal_height import height_alone_m, height_m
from opir_core.flight.gravity import Alone, Gravity


class GravityAndDrag:
    """The zonal field, and -rho |w| w / (2 beta) with w the velocity relative to air that turns about z.

    `layer_parameters`, (13, n), are those of `AirLayers` for each arc; `log_half_inverse_beta` is ln(1/(2 beta)).
    """

    needs_velocity = True

    def __init__(
        self,
        gravity: Gravity,
        layer_parameters: NDArray[np.float64],
        log_half_inverse_beta: FloatArray,
        air_rotation_rad_s: float,
    ) -> None:
        self._gravity = gravity
        self._parameters = layer_parameters
        self._log_half_inverse_beta = log_half_inverse_beta
        self._rotation = air_rotation_rad_s

    def __call__(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return accelerations (3, n), m/s²."""
        acceleration, inverse_radius = self._gravity.with_inverse_radius(position)
        factor = log_density(self._parameters, height_m(position, inverse_radius))
        factor += self._log_half_inverse_beta
        np.exp(factor, out=factor)
        wind = velocity.copy()
        wind[0] += self._rotation * position[1]
        wind[1] -= self._rotation * position[0]
        squares = wind * wind
        speed = squares[0] + squares[1]
        speed += squares[2]
        factor *= np.sqrt(speed, out=speed)
        wind *= factor
        acceleration -= wind
        return acceleration

    def alone(self, arc: int) -> Alone:
        """Return the right side for one arc: the operations of the whole in their order, so the same bits."""
        gravity, omega = self._gravity.alone_with_inverse_radius, self._rotation
        parameters, logarithm = self._parameters[:, arc].tolist(), float(self._log_half_inverse_beta[arc])

        def acceleration(x: float, y: float, z: float, vx: float, vy: float, vz: float) -> tuple[float, float, float]:
            ax, ay, az, inverse_radius = gravity(x, y, z)
            height = height_alone_m(x, y, z, inverse_radius)
            wx, wy = vx + omega * y, vy - omega * x
            factor = float(np.exp(log_density_alone(parameters, height) + logarithm))
            factor *= sqrt(wx * wx + wy * wy + vz * vz)
            return ax - wx * factor, ay - wy * factor, az - vz * factor

        return acceleration
