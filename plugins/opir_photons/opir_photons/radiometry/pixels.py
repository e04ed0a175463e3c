"""Brightness temperatures of an imager's pixels, and the places on its map of objects above the
ground.
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
from opir_photons.columns import floats
from opir_photons.radiometry.planck import COLDEST_K, HOTTEST_K, band_radiance, band_radiance_slope


@np.errstate(all="ignore")
def brightness_temperature_k(radiance_w_m2_sr: ArrayLike, band: Band) -> FloatArray:
    """Return the temperatures of the black bodies that have in-band radiances, K.

    nan for a radiance of a black body outside 50 K to 20 000 K, and for radiances not above 0.
    """
    radiance = floats(radiance_w_m2_sr)
    edges = (band.lower_um, band.upper_um)
    log_radiance = np.log(np.where(radiance > 0.0, radiance, np.nan))
    temperature = np.full(radiance.shape, 300.0)
    # Newton's steps in ln L over 1/T, along which it is nearly straight.
    for _ in range(10):
        black = band_radiance(temperature, *edges)
        per_inverse = -np.square(temperature) * band_radiance_slope(temperature, *edges) / black
        inverse = 1.0 / temperature + (log_radiance - np.log(black)) / per_inverse
        temperature = 1.0 / np.clip(inverse, 1.0 / HOTTEST_K, 1.0 / COLDEST_K)
    is_within = (radiance >= band_radiance(COLDEST_K, *edges)) & (
        radiance <= band_radiance(HOTTEST_K, *edges)
    )
    return np.where(is_within, temperature, np.nan)


def pixel_temperature_k(
    irradiance_w_m2: ArrayLike, background_w_m2_sr: ArrayLike, pixel_rad: float, band: Band
) -> FloatArray:
    """Return the brightness temperatures, K, of square pixels that hold a point of light before a
    background.

    `irradiance_w_m2` is that part of the point's in-band irradiance at the aperture that falls into
    the pixel.
    """
    point_w_m2_sr = floats(irradiance_w_m2) / (pixel_rad * pixel_rad)
    return brightness_temperature_k(floats(background_w_m2_sr) + point_w_m2_sr, band)


class Parallax(NamedTuple):
    """Places (n,) on a map where objects above the ground appear: geodetic latitude, longitude, rad;
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
    place = ecef_to_geodetic(ground)
    return Parallax(place.latitude_rad, place.longitude_rad, length(*components(ground - foot)))
