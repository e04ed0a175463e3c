"""A part of the Earth between two parallels and two meridians, as a scene gives it."""

import math

from attrs import frozen

from opir_core.scene.fields import number

#: Radius of the sphere with as much surface as the ellipsoid: WGS 84's authalic radius (NIMA
#: TR8350.2, table 3.5).
AUTHALIC_RADIUS_M = 6_371_007.1809


@frozen
class QuadrangleConfig:
    """Part of the Earth between two parallels and two meridians; it may cross the date line."""

    south_deg: float = number(
        unit="deg", minimum=-90.0, maximum=90.0, help="geodetic latitude of the southern edge"
    )
    north_deg: float = number(
        unit="deg", minimum=-90.0, maximum=90.0, help="geodetic latitude of the northern edge"
    )
    west_deg: float = number(
        unit="deg", minimum=-180.0, maximum=180.0, help="east longitude of the western edge"
    )
    east_deg: float = number(
        unit="deg", minimum=-180.0, maximum=180.0, help="east longitude of the eastern edge"
    )

    def __attrs_post_init__(self) -> None:
        if self.south_deg >= self.north_deg:
            raise ValueError(
                f"south_deg {self.south_deg:g} is not below north_deg {self.north_deg:g}"
            )
        if self.west_deg == self.east_deg:
            raise ValueError("west_deg and east_deg are equal: the area has no width")

    @property
    def width_deg(self) -> float:
        """The difference of its longitudes, degrees."""
        return (self.east_deg - self.west_deg) % 360.0 or 360.0

    @property
    def surface_m2(self) -> float:
        """Its surface, m², on the authalic sphere, with geodetic latitudes as if they were authalic.

        For a narrow area that is off by up to 0.9 %.
        """
        south, north = (math.sin(math.radians(edge)) for edge in (self.south_deg, self.north_deg))
        return AUTHALIC_RADIUS_M**2 * (north - south) * math.radians(self.width_deg)
