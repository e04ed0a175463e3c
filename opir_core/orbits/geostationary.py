"""The ideal geostationary slot."""

import math

import numpy as np
from attrs import field, frozen

from opir_core.arrays import FloatArray
from opir_core.constants import GEOSTATIONARY_RADIUS_M


@frozen
class GeostationaryOrbit:
    """An ideal geostationary slot: no inclination, no eccentricity, no drift, hence one point in ECEF."""

    #: East longitude of the slot.
    slot_deg: float
    is_stationary: bool = field(default=True, init=False)

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at scene times (n,): the same for all, as a read-only view of one row."""
        slot_rad = math.radians(self.slot_deg)
        position = (GEOSTATIONARY_RADIUS_M * math.cos(slot_rad), GEOSTATIONARY_RADIUS_M * math.sin(slot_rad), 0.0)
        return np.broadcast_to(np.array(position), (len(time_s), 3))
