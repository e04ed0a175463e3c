"""Sun glint: water whose waves are small mirrors.

A sensor sees the Sun in the facets whose normal halves the angle between the two. How many facets are tilted so is the
law of Cox and Munk, isotropic in the direction of the wind: slopes are normal, of variance 0.003 + 0.00512 W with the
wind W in m/s. Radiant intensity over an area A is then A ρ E p / (4 cos⁴ β) with the tilt β, the density of slopes
p = exp(-tan² β / σ²) / (π σ²), the Sun's in-band irradiance E at the surface and the reflectance ρ of Fresnel, taken at
the Sun's zenith angle. Source: C. Cox and W. Munk, J. Opt. Soc. Am. 44 (1954), 838-850. Facets in each other's shadow
and light that is mirrored twice are left out.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.geometry import local_axes
from opir_core.geometry.sun import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M
from opir_core.geometry.vectors import components, dot, length
from opir_core.protocols import Band
from opir_core.radiometry.emitters import Emitters
from opir_core.radiometry.planck import band_radiance
from opir_core.radiometry.protocols import SourceContext, Transmittance
from opir_core.radiometry.records import Paths
from opir_core.radiometry.source_configs import GlintConfig
from opir_core.radiometry.viewing import sun_ecef_m

_SUN_SOLID_ANGLE_SR = np.pi * (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2


@frozen(eq=False)
class GlintSignatures:
    """Patches of water (n,) under the Sun: `sunlight_w_m2` (bands, n) is irradiance above the air, head on."""

    sunlight_w_m2: FloatArray
    area_m2: FloatArray
    ignition_s: FloatArray
    height_m: FloatArray
    position_ecef_m: FloatArray
    up_ecef: FloatArray
    slope_variance: float
    refractive_index: float
    epoch_us: int
    sky: Transmittance | None

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,) at the surface, W/sr; `aspect_rad` is the tilt of the facets that glint."""
        time_s = self.ignition_s[target] + time_since_ignition_s
        sine = self._sun_sine(target, time_s)
        mirrored = reflectance(np.maximum(sine, 0.0), self.refractive_index)
        light = self.sunlight_w_m2[band][target] * self._sun_transmittance(band, target, time_s, sine)
        intensity = self.area_m2[target] * light * mirrored * 0.25 * slope_density(aspect_rad, self.slope_variance)
        return np.where(sine > 0.0, intensity, 0.0)

    def aspect_rad(self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray) -> FloatArray | None:
        """Return the tilts (n,) of the facets that mirror the Sun to the sensors, in [0, pi]."""
        half = self._to_sun(target, time_s) + to_sensor_ecef
        size = length(*components(half))
        cosine = dot(half, self.up_ecef[target]) / np.where(size > 0.0, size, np.inf)
        return np.arccos(np.clip(cosine, -1.0, 1.0))

    def _to_sun(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        offset = sun_ecef_m(time_s, self.epoch_us) - self.position_ecef_m[target]
        unit: FloatArray = offset / length(*components(offset))[:, None]
        return unit

    def _sun_sine(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        return dot(self._to_sun(target, time_s), self.up_ecef[target])

    def _sun_transmittance(self, band: int, target: IndexArray, time_s: FloatArray, sine: FloatArray) -> FloatArray:
        """Return what the air lets through on the way down; 1 where the scene's atmosphere is not known."""
        if self.sky is None:
            return np.ones(len(target))
        sun = sun_ecef_m(time_s, self.epoch_us)
        path = Paths(self.height_m[target], sine, self.position_ecef_m[target], sun, time_s)
        return self.sky.transmittance(band, path)


def glint_signatures(
    config: GlintConfig, emitters: Emitters, position_ecef_m: FloatArray, context: SourceContext
) -> GlintSignatures:
    """Return the signatures of patches of water at positions (n, 3)."""
    light = [sunlight_w_m2(emitters["temperature_k"], band) * emitters["emissivity"] for band in context.bands]
    return GlintSignatures(
        sunlight_w_m2=np.maximum(np.array(light, dtype=np.float64).reshape(len(context.bands), len(emitters)), 0.0),
        area_m2=emitters["area_m2"],
        ignition_s=emitters["start_s"],
        height_m=emitters["height_m"],
        position_ecef_m=position_ecef_m,
        up_ecef=local_axes(position_ecef_m)[:, 2],
        slope_variance=0.003 + 0.00512 * config.wind_m_s,
        refractive_index=config.refractive_index,
        epoch_us=context.epoch_us,
        sky=context.make_atmosphere() if context.make_atmosphere is not None else None,
    )


def sunlight_w_m2(temperature_k: FloatArray, band: Band) -> FloatArray:
    """Return the Sun's in-band irradiance at one astronomical unit, W/m²: a disc of a black body."""
    return band_radiance(temperature_k, band.lower_um, band.upper_um) * _SUN_SOLID_ANGLE_SR


@np.errstate(over="ignore", under="ignore")
def slope_density(tilt_rad: FloatArray, variance: float) -> FloatArray:
    """Return the density of slopes over cos⁴ of the tilt, (n,): what Cox and Munk's law gives per solid angle."""
    cosine = np.maximum(np.cos(tilt_rad), 1e-6)
    steepness = 1.0 / np.square(cosine) - 1.0
    return np.exp(-steepness / variance) / (np.pi * variance) / np.square(np.square(cosine))


def reflectance(cosine: FloatArray, refractive_index: float) -> FloatArray:
    """Return Fresnel's reflectances (n,) of unpolarised light, by the cosine of the angle of incidence."""
    inside = np.sqrt(1.0 - (1.0 - np.square(cosine)) / refractive_index**2)
    across = (cosine - refractive_index * inside) / (cosine + refractive_index * inside)
    along = (refractive_index * cosine - inside) / (refractive_index * cosine + inside)
    mean: FloatArray = 0.5 * (np.square(across) + np.square(along))
    return mean
