"""Gravity and drag together, for arcs each of which stays within one layer of the air."""

import numpy as np
from numpy.typing import NDArray

from opir_core.flight.atmosphere_density import log_density
from opir_core.flight.ellipsoidal_height import height_m
from opir_core.flight.gravity import Column, Gravity, Rows


class GravityAndDrag:
    """The zonal field, and -rho |w| w / (2 beta) with w the velocity relative to air that turns about z.

    `layer_parameters`, (13, n), are those of `AirLayers` for each arc; `log_half_inverse_beta` is ln(1/(2 beta)).
    """

    needs_velocity = True

    def __init__(
        self,
        gravity: Gravity,
        layer_parameters: NDArray[np.float64],
        log_half_inverse_beta: Column,
        air_rotation_rad_s: float,
    ) -> None:
        self._gravity = gravity
        self._parameters = layer_parameters
        self._log_half_inverse_beta = log_half_inverse_beta
        self._rotation = air_rotation_rad_s

    def __call__(self, position: Rows, velocity: Rows) -> Rows:
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
