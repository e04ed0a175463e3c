"""The shape of the Earth: an ellipsoid of revolution, WGS 84 unless told otherwise."""

from typing import NamedTuple

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING


class Ellipsoid(NamedTuple):
    """An oblate ellipsoid of revolution about z: its equatorial radius (m) and its flattening (dimensionless)."""

    equatorial_radius_m: float
    flattening: float

    @property
    def polar_radius_m(self) -> float:
        """The semi-minor axis, m."""
        return self.equatorial_radius_m * (1.0 - self.flattening)

    @property
    def eccentricity_squared(self) -> float:
        """The square of the first eccentricity."""
        return self.flattening * (2.0 - self.flattening)


#: World Geodetic System 1984 (NIMA TR8350.2, 3rd ed., table 3.1).
WGS84 = Ellipsoid(EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING)
