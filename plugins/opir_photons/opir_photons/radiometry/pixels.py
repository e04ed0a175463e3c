"""What an imager shows: brightness temperatures of pixels, and the place on the map of something
above the ground.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry import (
    components,
    ecef_to_geodetic,
    geodetic_to_ecef,
    intersection_with_ellipsoid,
    length,
)
from opir_core.plugin import Band
from opir_photons.radiometry.planck import COLDEST_K, HOTTEST_K, band_radiance, band_radiance_slope

#: Newton's steps in ln L over 1/T, along which it is nearly straight.
_STEPS = 10


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def brightness_temperature_k(radiance_w_m2_sr: ArrayLike, band: Band) -> FloatArray:
    """Return the temperatures of the black bodies that have in-band radiances, K.

    nan for a radiance of a black body outside 50 K to 20 000 K, and for what is not above 0.
    """
    radiance = np.asarray(radiance_w_m2_sr, dtype=np.float64)
    edges = (band.lower_um, band.upper_um)
    wanted = np.log(np.where(radiance > 0.0, radiance, np.nan))
    temperature = np.full(radiance.shape, 300.0)
    for _ in range(_STEPS):
        black = band_radiance(temperature, *edges)
        per_inverse = -np.square(temperature) * band_radiance_slope(temperature, *edges) / black
        inverse = 1.0 / temperature + (wanted - np.log(black)) / per_inverse
        temperature = 1.0 / np.clip(inverse, 1.0 / HOTTEST_K, 1.0 / COLDEST_K)
    least, most = (band_radiance(limit, *edges) for limit in (COLDEST_K, HOTTEST_K))
    return np.where((radiance >= least) & (radiance <= most), temperature, np.nan)


def pixel_temperature_k(
    irradiance_w_m2: ArrayLike, background_w_m2_sr: ArrayLike, pixel_rad: float, band: Band
) -> FloatArray:
    """Return the brightness temperatures, K, of square pixels that hold a point of light before a
    background.

    `irradiance_w_m2` is that part of the point's in-band irradiance at the aperture that falls into
    the pixel.
    """
    added = np.asarray(irradiance_w_m2, dtype=np.float64) / (pixel_rad * pixel_rad)
    return brightness_temperature_k(np.asarray(background_w_m2_sr, dtype=np.float64) + added, band)


class Parallax(NamedTuple):
    """Places (n,) on a map where things above the ground appear: geodetic latitude, longitude, rad;
    the shift, m.
    """

    latitude_rad: FloatArray
    longitude_rad: FloatArray
    shift_m: FloatArray


def parallax(sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> Parallax:
    """Return the places on the WGS 84 ellipsoid behind targets (n, 3), seen from sensors (n, 3).

    The shift is the straight distance from the point below the target; all are nan where the view
    misses the Earth.
    """
    ground = intersection_with_ellipsoid(sensor_ecef_m, target_ecef_m - sensor_ecef_m)
    below = ecef_to_geodetic(target_ecef_m)
    foot = geodetic_to_ecef(below.latitude_rad, below.longitude_rad, np.zeros(len(ground)))
    seen = ecef_to_geodetic(ground)
    return Parallax(seen.latitude_rad, seen.longitude_rad, length(*components(ground - foot)))
