"""The motion of a satellite on a Kepler orbit, over the turning Earth."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import eci_to_ecef, eci_to_ecef_state
from opir_core.orbits.elements import Elements


@frozen
class TwoBodyMotion:
    """A Kepler orbit: gravity of a point mass alone, the Earth turning evenly below it (`EARTH_ROTATION_RAD_S`)."""

    elements: Elements

    def state_eci(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s, (n, 3) in ECI at scene times (n,)."""
        position, velocity = (np.array(vector) for vector in self.elements.perigee_state_eci())
        return propagate_kepler(position, velocity, np.asarray(time_s) - self.elements.perigee_time_s)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in ECEF at scene times (n,)."""
        return eci_to_ecef(self.state_eci(time_s)[0], time_s)

    def state_ecef(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities relative to the turning Earth, m/s, (n, 3) in ECEF."""
        return eci_to_ecef_state(*self.state_eci(time_s), time_s)
