from opir_core.plugin import (
    Paths as Paths,
    Views as Views,
)
from opir_photons.radiometry.aperture import (
    irradiance_at_aperture as irradiance_at_aperture,
    irradiance_of_projected_area as irradiance_of_projected_area,
    irradiance_of_sphere as irradiance_of_sphere,
    minimum_detectable_intensity as minimum_detectable_intensity,
)
from opir_photons.radiometry.clutter import (
    FrameDifference as FrameDifference,
    SpatialTransfer as SpatialTransfer,
    structure_correlation as structure_correlation,
    structure_spectrum as structure_spectrum,
)
from opir_photons.radiometry.detector import (
    conversion_noise_electrons as conversion_noise_electrons,
    dark_current_density_a_cm2 as dark_current_density_a_cm2,
    dark_electrons_per_s as dark_electrons_per_s,
    warm_optics_photons_per_s as warm_optics_photons_per_s,
)
from opir_photons.radiometry.filtered_spots import (
    FilteredSpot as FilteredSpot,
    OwnPast as OwnPast,
    ensquared_airy_energy as ensquared_airy_energy,
)
from opir_photons.radiometry.focal_plane import (
    airy_sigma_rad as airy_sigma_rad,
    blurred_sigma_rad as blurred_sigma_rad,
    centroid_factor_rad as centroid_factor_rad,
    centroid_sigma_rad as centroid_sigma_rad,
    electrons_per_w_m2 as electrons_per_w_m2,
    ensquared_energy as ensquared_energy,
    joined_centroid_variance as joined_centroid_variance,
    noise_electrons as noise_electrons,
    noise_equivalent_irradiance as noise_equivalent_irradiance,
    photon_centroid_variance as photon_centroid_variance,
)
from opir_photons.radiometry.heating import (
    equilibrium_temperature_k as equilibrium_temperature_k,
    stagnation_flux_w_m2 as stagnation_flux_w_m2,
)
from opir_photons.radiometry.lowtran import (
    band_transmittance as band_transmittance,
)
from opir_photons.radiometry.pixel_filters import (
    filter_weights as filter_weights,
    mean_shares as mean_shares,
    noise_gain as noise_gain,
    signal_gain as signal_gain,
)
from opir_photons.radiometry.pixels import (
    Parallax as Parallax,
    brightness_temperature_k as brightness_temperature_k,
    parallax as parallax,
    pixel_temperature_k as pixel_temperature_k,
)
from opir_photons.radiometry.planck import (
    Temperature as Temperature,
    band_photon_radiance as band_photon_radiance,
    band_radiance as band_radiance,
    band_radiance_slope as band_radiance_slope,
    grey_body_intensity as grey_body_intensity,
    planck_radiance as planck_radiance,
    two_colour_temperature as two_colour_temperature,
)
from opir_photons.radiometry.point_spread import (
    PointSpread as PointSpread,
)
from opir_photons.radiometry.sunlight import (
    lambert_phase as lambert_phase,
    lambert_sphere_intensity as lambert_sphere_intensity,
    solar_irradiance as solar_irradiance,
)
