"""Physical constants, in SI units, each with its source."""

__all__ = [
    "EARTH_ECCENTRICITY_SQUARED",
    "EARTH_EQUATORIAL_RADIUS_M",
    "EARTH_FLATTENING",
    "EARTH_MU_M3_S2",
    "EARTH_POLAR_RADIUS_M",
    "EARTH_ROTATION_RAD_S",
    "GEOSTATIONARY_RADIUS_M",
    "SPEED_OF_LIGHT_M_S",
    "ZONAL_FORCES",
]

#: Geocentric gravitational constant including the atmosphere, m³/s² (WGS 84, NIMA TR8350.2, 3rd
#: ed., table 3.1).
EARTH_MU_M3_S2 = 3.986004418e14

#: Semi-major axis of the WGS 84 ellipsoid, m (NIMA TR8350.2, table 3.1).
EARTH_EQUATORIAL_RADIUS_M = 6378137.0

#: Flattening of the WGS 84 ellipsoid (NIMA TR8350.2, table 3.1).
EARTH_FLATTENING = 1.0 / 298.257223563

#: Semi-minor axis of the WGS 84 ellipsoid, m (derived).
EARTH_POLAR_RADIUS_M = EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING)

#: First eccentricity squared of the WGS 84 ellipsoid (derived).
EARTH_ECCENTRICITY_SQUARED = EARTH_FLATTENING * (2.0 - EARTH_FLATTENING)

#: Angular velocity of the Earth, rad/s (WGS 84, NIMA TR8350.2, table 3.1).
EARTH_ROTATION_RAD_S = 7.292115e-5

#: Speed of light in vacuum, m/s (exact, SI).
SPEED_OF_LIGHT_M_S = 299792458.0

#: Radius of the geostationary orbit, m: (mu / omega²)^(1/3) with the two constants above.
GEOSTATIONARY_RADIUS_M = (EARTH_MU_M3_S2 / EARTH_ROTATION_RAD_S**2) ** (1.0 / 3.0)

#: The zonal harmonics of gravity that forces may name, in the order in which they are written.
ZONAL_FORCES = ("j2", "j3", "j4")
