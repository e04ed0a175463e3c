"""The launch point of a file whose places are local, and where on the Earth these are."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.geometry import east_north_up_axes, geodesic_direct, geodetic_to_ecef
from opir_core.plugin import BadFileError
from opir_readers.configs_of_sites import SiteConfig
from opir_readers.frames import along_axes


@frozen
class Site:
    """A launch point, rad and m above the WGS 84 ellipsoid, and the azimuth of the flight, rad; nan
    for none.
    """

    latitude_rad: float
    longitude_rad: float
    height_m: float
    azimuth_rad: float

    @classmethod
    def of(cls, config: SiteConfig | None, needs: str, *, with_azimuth: bool = False) -> "Site":
        """Return the site of a setting; raises `BadFileError` with what `needs` it where it is
        missing.
        """
        if config is None:
            more = ", azimuth_deg: A" if with_azimuth else ""
            raise BadFileError(
                f"{needs}: set site: {{lat_deg: …, lon_deg: …, height_m: …{more}}}, or --site"
            )
        if with_azimuth and config.azimuth_deg is None:
            raise BadFileError(
                f"{needs}: set site.azimuth_deg, the direction of flight from the launch point"
            )
        azimuth = np.nan if config.azimuth_deg is None else config.azimuth_deg
        angles = np.radians([config.lat_deg, config.lon_deg, azimuth]).tolist()
        return cls(angles[0], angles[1], config.height_m, angles[2])

    def of_local(self, east_m: FloatArray, north_m: FloatArray, up_m: FloatArray) -> FloatArray:
        """Return positions (n, 3) in ECEF of local ones: in the plane that touches the Earth at the
        launch point.
        """
        launch = geodetic_to_ecef(self.latitude_rad, self.longitude_rad, self.height_m)
        axes = east_north_up_axes(np.array(self.latitude_rad), np.array(self.longitude_rad))
        return launch + along_axes(np.stack([east_m, north_m, up_m], axis=1), axes)

    def of_ground(
        self, east_m: FloatArray, north_m: FloatArray, height_m: FloatArray
    ) -> FloatArray:
        """Return positions (n, 3) in ECEF of distances along the ground and heights above the
        ellipsoid.
        """
        azimuth = np.arctan2(east_m, north_m)
        return self._at_distance(np.hypot(east_m, north_m), azimuth, height_m)

    def of_downrange(self, distance_m: FloatArray, height_m: FloatArray) -> FloatArray:
        """Return positions (n, 3) in ECEF of distances along the geodesic of the site's azimuth."""
        return self._at_distance(distance_m, self.azimuth_rad, height_m)

    def _at_distance(
        self, distance_m: FloatArray, azimuth_rad: FloatArray | float, height_m: FloatArray
    ) -> FloatArray:
        where = geodesic_direct(self.latitude_rad, self.longitude_rad, azimuth_rad, distance_m)
        return geodetic_to_ecef(where.latitude_rad, where.longitude_rad, height_m)
