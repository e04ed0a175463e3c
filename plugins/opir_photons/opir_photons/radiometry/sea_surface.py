"""A sea that mirrors the Sun: slopes of waves, Fresnel's reflectance, and the radiance of sun
glint.

The Sun is mirrored by the wave facets with a normal that bisects the directions to Sun and sensor.
The density of slopes is that of Cox and Munk, isotropic: normal, of variance 0.003 + 0.00512 W with
the wind W in m/s. Source: C. Cox and W. Munk, J. Opt. Soc. Am. 44 (1954), 838-850. Shadowed facets
and double reflection are not modelled.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.geometry import components, dot, length, local_axes, sun_ecef_m
from opir_core.plugin import Band, Paths, Transmittance, Views
from opir_photons.radiometry.sunlight import SUN_SOLID_ANGLE_SR, solar_irradiance


def slope_variance(wind_m_s: float) -> float:
    """Return the variance of the slopes of a sea under a wind, m/s (Cox and Munk)."""
    return 0.003 + 0.00512 * wind_m_s


@np.errstate(over="ignore", under="ignore")
def slope_density(tilt_rad: FloatArray, variance: float) -> FloatArray:
    """Return the density of slopes over cos⁴ of the tilt, (n,)."""
    cosine = np.maximum(np.cos(tilt_rad), 1e-6)
    steepness = 1.0 / np.square(cosine) - 1.0
    return np.exp(-steepness / variance) / (np.pi * variance) / np.square(np.square(cosine))


def reflectance(cosine: FloatArray, refractive_index: float) -> FloatArray:
    """Return Fresnel's reflectances (n,) of unpolarised light, by the cosine of the angle of
    incidence.
    """
    inside = np.sqrt(1.0 - (1.0 - np.square(cosine)) / refractive_index**2)
    across = (cosine - refractive_index * inside) / (cosine + refractive_index * inside)
    along = (refractive_index * cosine - inside) / (refractive_index * cosine + inside)
    return 0.5 * (np.square(across) + np.square(along))


@frozen(eq=False)
class SeaGlint:
    """Sun glint of a sea that covers the Earth: the Sun's irradiance (bands,) W/m², and the slopes
    of the waves.
    """

    irradiance_w_m2: FloatArray
    slope_variance: float
    atmosphere: Transmittance
    epoch_us: int

    @classmethod
    def of(
        cls, bands: Sequence[Band], wind_m_s: float, atmosphere: Transmittance, epoch_us: int
    ) -> "SeaGlint":
        """Return the glint of a sea under a wind, m/s."""
        light = [float(solar_irradiance(band.lower_um, band.upper_um)) for band in bands]
        # Bands with swapped edges are empty.
        return cls(np.maximum(np.array(light), 0.0), slope_variance(wind_m_s), atmosphere, epoch_us)

    def radiances_w_m2_sr(self, bands: Sequence[int], view: Views) -> FloatArray:
        """Return the radiances (bands, n) of sun glint on views of the ground, above the air.

        L = E τ τ' ρ p / (4 cos θ cos⁴ β) with the irradiance E of the Sun, transmittances down and
        up, Fresnel's ρ at the facet, the density of slopes p at its tilt β and the angle θ of the
        sensor from the zenith; no more than the radiance of a mirror. 0 by night.
        """
        radiance = np.zeros((len(bands), len(view)))
        rows = np.flatnonzero((view.sun_elevation_sine > 0.0) & (view.elevation_sine > 0.0))
        if not len(rows):
            return radiance
        lit = view.take(rows)
        sun_m = sun_ecef_m(lit.time_s, self.epoch_us)
        air = self._transmittances(bands, lit, sun_m)
        light_w_m2 = self.irradiance_w_m2[list(bands)][:, None]
        radiance[:, rows] = light_w_m2 * air * self._mirrored_share(lit, sun_m)
        return radiance

    def _mirrored_share(self, view: Views, sun_m: FloatArray) -> FloatArray:
        """Return the radiance (n,), 1/sr, of the sea over the irradiance of the Sun."""
        point_m = view.point_ecef_m
        to_sun = (sun_m - point_m) / length(*components(sun_m - point_m))[:, None]
        bisector = to_sun - view.line_of_sight_ecef
        size = length(*components(bisector))
        tilt = np.arccos(np.clip(dot(local_axes(point_m)[:, 2], bisector) / size, -1.0, 1.0))
        # The refractive index of water in visible light.
        mirrored = reflectance(np.minimum(dot(to_sun, bisector) / size, 1.0), 1.33)
        share = 0.25 * slope_density(tilt, self.slope_variance) / view.elevation_sine
        return mirrored * np.minimum(share, 1.0 / SUN_SOLID_ANGLE_SR)

    def _transmittances(self, bands: Sequence[int], view: Views, sun_m: FloatArray) -> FloatArray:
        """Return the transmittances (bands, n) down from the Sun and up to the sensor."""
        ground = np.zeros(len(view))
        point_m = view.point_ecef_m
        # A point so far along a line of sight is above all air.
        above_m = point_m - 1e8 * view.line_of_sight_ecef
        down = Paths(ground, view.sun_elevation_sine, point_m, sun_m, view.time_s)
        up = Paths(ground, view.elevation_sine, point_m, above_m, view.time_s)
        return self.atmosphere.transmittances(bands, down) * self.atmosphere.transmittances(
            bands, up
        )
