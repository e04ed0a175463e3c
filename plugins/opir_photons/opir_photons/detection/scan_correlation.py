"""Correlation of a cell's noise from scan to scan: the share of clutter in it times the correlation
of clutter.
"""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import components, length
from opir_core.plugin import Sensor
from opir_photons.detection.receivers import Receiver, noise_w_m2, photon_noise_w_m2
from opir_photons.environment import RadiometricEnvironment
from opir_photons.radiometry.viewing import views


def scan_correlation(
    sensor: Sensor, receiver: Receiver, environment: RadiometricEnvironment, interval_s: FloatArray
) -> FloatArray:
    """Return the correlations (k,) of the noise of a cell in scans that are intervals (k,), s,
    apart.

    The mean over bands, for the cell straight below the sensor at the scene's start; 0 without a
    focal plane or a background with structure.
    """
    background = environment.background
    plane = receiver.plane
    if plane is None or not background.structures:
        return np.zeros(len(interval_s))
    start = np.zeros(1)
    at_m = sensor.orbit.position_ecef_m(start)
    view = views(at_m, -at_m, start, environment.epoch_us)
    radiance, rms, number = background.structured_radiances_w_m2_sr(receiver.bands.tolist(), view)
    range_m = length(*components(view.point_ecef_m - at_m))
    pixel_sr = receiver.radiometer.ifov_rad**2
    clutter = plane.clutter_w_m2_sr(rms, number, range_m)[:, 0] * pixel_sr
    counts = np.array([receiver.count_w_m2(place) for place in range(len(receiver.bands))])
    photons = photon_noise_w_m2(radiance[:, 0] * pixel_sr, counts)
    share = np.square(clutter / noise_w_m2(receiver.nei_w_m2, photons, clutter))
    structure = background.structures[int(number[0])]
    return share @ plane.clutter_correlation(structure, float(range_m[0]), interval_s) / len(share)
