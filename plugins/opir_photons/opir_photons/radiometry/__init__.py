"""Radiometry: radiance of black bodies, transmittance of the atmosphere, background radiance, irradiance at a sensor.

The chain is source, path, aperture: a `Signatures` model gives in-band radiant intensity at the source (W/sr), a
`Transmittance` the share of it that leaves the atmosphere along a path, `irradiance_at_aperture` the irradiance at the
sensor (W/m²); a `Background` gives the radiance behind the target (W m⁻² sr⁻¹). These protocols are in
`opir_core.plugin`. For the focal plane: spots, pixels, electrons, noise, centroids, and the clutter that filters leave.
Each name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.interfaces.radiometric_models import Paths, Views
    from opir_photons.radiometry.aperture import (
        irradiance_at_aperture,
        irradiance_of_projected_area,
        irradiance_of_sphere,
        minimum_detectable_intensity,
    )
    from opir_photons.radiometry.clutter import (
        FrameDifference,
        SpatialTransfer,
        structure_correlation,
        structure_spectrum,
    )
    from opir_photons.radiometry.focal_plane import (
        airy_sigma_rad,
        blurred_sigma_rad,
        centroid_factor_rad,
        centroid_sigma_rad,
        electrons_per_w_m2,
        ensquared_energy,
        instantaneous_field_of_view_rad,
        joined_centroid_variance,
        noise_electrons,
        noise_equivalent_irradiance,
        photon_centroid_variance,
        sampling_ratio,
        saturation_irradiance,
    )
    from opir_photons.radiometry.lowtran import band_transmittance
    from opir_photons.radiometry.pixel_filters import filter_weights, mean_shares, noise_gain, signal_gain
    from opir_photons.radiometry.planck import (
        Temperature,
        band_photon_radiance,
        band_radiance,
        band_radiance_slope,
        band_ratio,
        grey_body_intensity,
        planck_photon_radiance,
        planck_radiance,
        two_colour_temperature,
    )
    from opir_photons.radiometry.sunlight import lambert_phase, lambert_sphere_intensity, solar_irradiance

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "opir_photons.radiometry.aperture": (
        "irradiance_at_aperture irradiance_of_projected_area irradiance_of_sphere minimum_detectable_intensity"
    ),
    "opir_photons.radiometry.clutter": "FrameDifference SpatialTransfer structure_correlation structure_spectrum",
    "opir_photons.radiometry.focal_plane": (
        "airy_sigma_rad blurred_sigma_rad centroid_factor_rad centroid_sigma_rad electrons_per_w_m2 ensquared_energy "
        "instantaneous_field_of_view_rad joined_centroid_variance noise_electrons noise_equivalent_irradiance "
        "photon_centroid_variance sampling_ratio saturation_irradiance"
    ),
    "opir_photons.radiometry.lowtran": "band_transmittance",
    "opir_photons.radiometry.pixel_filters": "filter_weights mean_shares noise_gain signal_gain",
    "opir_photons.radiometry.planck": (
        "Temperature band_photon_radiance band_radiance band_radiance_slope band_ratio grey_body_intensity "
        "planck_photon_radiance planck_radiance two_colour_temperature"
    ),
    "opir_photons.radiometry.sunlight": "lambert_phase lambert_sphere_intensity solar_irradiance",
    "opir_core.interfaces.radiometric_models": "Paths Views",
}

__all__ = [
    "FrameDifference",
    "Paths",
    "SpatialTransfer",
    "Temperature",
    "Views",
    "airy_sigma_rad",
    "band_photon_radiance",
    "band_radiance",
    "band_radiance_slope",
    "band_ratio",
    "band_transmittance",
    "blurred_sigma_rad",
    "centroid_factor_rad",
    "centroid_sigma_rad",
    "electrons_per_w_m2",
    "ensquared_energy",
    "filter_weights",
    "grey_body_intensity",
    "instantaneous_field_of_view_rad",
    "irradiance_at_aperture",
    "irradiance_of_projected_area",
    "irradiance_of_sphere",
    "joined_centroid_variance",
    "lambert_phase",
    "lambert_sphere_intensity",
    "mean_shares",
    "minimum_detectable_intensity",
    "noise_electrons",
    "noise_equivalent_irradiance",
    "noise_gain",
    "photon_centroid_variance",
    "planck_photon_radiance",
    "planck_radiance",
    "sampling_ratio",
    "saturation_irradiance",
    "signal_gain",
    "solar_irradiance",
    "structure_correlation",
    "structure_spectrum",
    "two_colour_temperature",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(home), name)
            return value
    raise AttributeError(f"module 'opir_photons.radiometry' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
